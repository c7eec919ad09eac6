"""FSM and PID, designed for one plant and met by what they are not designed for."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.servo.servo_comparison import (
    CONDITIONS,
    CONTROLLERS,
    CRITERIA,
    ResolvedServoComparisonScenario,
    ServoComparisonScenario,
    StepSpread,
    answer,
    design_metrics,
    differences,
    drawn,
    measure,
    resolve_comparison,
    run,
)
from chamfer.diagrams.servo.comparison_loop import ServoCameraParams
from chamfer.models.plants.measured_step import unit_response
from chamfer.models.plants.servo_plant import ServoPlantParams, transfer_function
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.compensator_law import AxisParams


@cache
def scenario() -> ResolvedServoComparisonScenario:
    return resolve_comparison(
        ServoComparisonScenario(trials=1, duration=2.4, spread=StepSpread(step=0.0))
    )


def test_both_settle_when_they_are_designed_to(value: Any) -> None:
    outcome = run(scenario(), 3, lambda fraction, doing="": None)
    for controller in CONTROLLERS:
        assert value(outcome, f"nominal.{controller}.settled") == 100.0
        assert value(outcome, f"nominal.{controller}.settling_time") == pytest.approx(1.5, rel=0.2)
    assert value(outcome, "nominal.fsm.error") < 1e-3
    assert value(outcome, "nominal.fsm.travel") == 0.0  # the compensation is constant
    assert value(outcome, "pid.gain_margin") > 3


def test_controllers_are_the_same_whatever_they_meet() -> None:
    for trial in range(3):
        worlds = drawn(scenario(), 0, trial)
        assert list(worlds) == list(CONDITIONS)
        for one in worlds.values():
            assert (one.fsm, one.pid) == (scenario().fsm, scenario().pid)
        assert worlds["friction"].friction == 2e-3
        assert worlds["lost"].camera.lost == worlds["all"].camera.lost == 0.3
        assert worlds["noise"].camera.noise == pytest.approx(6e-4)
        believed = transfer_function(worlds["nominal"].plant)
        gain = transfer_function(worlds["plant"].plant).numerator[0] / believed.numerator[0]
        assert gain == pytest.approx(1.3) or gain == pytest.approx(0.7)
        assert worlds["all"].plant == worlds["plant"].plant
    spread = replace(scenario(), spread=StepSpread())
    heights = [drawn(spread, 0, trial)["all"].desired.amplitude for trial in range(20)]
    assert 0.015 <= min(heights) < 0.018
    assert 0.022 < max(heights) <= 0.025


def test_a_run_is_measured() -> None:
    time = np.linspace(0.0, 3.0, 301)
    error = 0.02 * np.exp(-2 * time)
    error[50] = -0.002
    command = np.where(time > 2.5, 0.02 + 0.001 * (np.arange(301) % 2), 0.02)
    found = measure(time, error, command, height=0.02, tolerance=1e-3)
    assert found["settling_time"] == pytest.approx(np.log(20) / 2, abs=0.011)
    assert found["overshoot"] == pytest.approx(10.0)
    assert found["travel"] == pytest.approx(50 * 1e-3, rel=0.03)
    assert (
        measure(time, error + 2e-3, command, height=0.02, tolerance=1e-3)["settling_time"] is None
    )
    still = measure(time, 0 * error, command, height=0.02, tolerance=1e-3)
    assert still["settling_time"] == 0.0


def test_the_answer_says_only_what_intervals_bear() -> None:
    def trials(fsm: list[float], pid: list[float]) -> Trials[int]:
        same = {
            f"{condition}.{controller}.{criterion}": 0.0
            for condition in CONDITIONS
            for controller in CONTROLLERS
            for criterion in CRITERIA
        }
        rows = [
            same | {"noise.fsm.overshoot": a, "noise.pid.overshoot": b}
            for a, b in zip(fsm, pid, strict=True)
        ]
        return Trials(tasks=tuple(range(len(rows))), rows=tuple(rows))

    found = differences(scenario(), trials([0.0, 0.1, 0.0], [9.0, 10.0, 11.0]))
    assert [one for one in found if one.better] == [
        next(one for one in found if (one.criterion, one.condition) == ("overshoot", "noise"))
    ]
    assert answer(scenario(), found, 3) == (
        "Over 3 steps of 20 mm to within 1 mm in 1.5 s, the state machine is better in overshoot "
        "with more noise (0.033 against 10 % with more noise), they are alike in settling time "
        "and error at rest and travel of the command."
    )
    for same in ([9.0, 0.0, 20.0], [10.0, 10.9, 9.5]):  # too uncertain, too small
        found = differences(scenario(), trials(same, [10.0, 10.0, 10.0]))
        assert "neither" in answer(scenario(), found, 3)


def test_no_field_is_the_papers() -> None:
    for other in (
        ServoComparisonScenario(plant=ServoPlantParams(mass=1.0, damping=40.0, stiffness=900.0)),
        ServoComparisonScenario(settling_time=2.0),
        ServoComparisonScenario(camera=ServoCameraParams(resolution=3e-4, latency=0.05)),
    ):
        found = resolve_comparison(other)
        assert found.fsm != scenario().fsm
        assert found.pid != scenario().pid


def test_a_measured_step_is_identified_and_its_plants_are_drawn(tmp_path: Path) -> None:
    time = np.arange(-0.5, 3.0, 0.01)
    position = 0.1 + 0.05 * unit_response(time - 0.04, 0.12, 0.3)
    position += 2e-4 * np.random.default_rng(0).standard_normal(len(time))
    rows = [f"{t},{0.05 * (t >= 0)},{y}" for t, y in zip(time, position, strict=True)]
    path = tmp_path / "step.csv"
    path.write_text("\n".join(["time,command,position", *rows]))
    found = resolve_comparison(
        ServoComparisonScenario(plant=ServoPlantParams(measured=str(path)), trials=2)
    )
    identified = found.plant.identified
    assert identified is not None
    assert identified.lag == pytest.approx(0.12, abs=4 * identified.deviations[1])
    assert design_metrics(found)["identified.lag"].value == identified.lag
    plants = {drawn(found, 0, trial)["nominal"].plant.identified for trial in range(3)}
    assert len(plants) == 3
    path.unlink()  # what was found in it is in the scenario
    assert resolve_comparison(found) == found


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        (ServoPlantParams(numerator=(1.0,), denominator=(1.0, -1.0)), "the plant's slowest pole"),
        (ServoPlantParams(numerator=(-1.0,), denominator=(1.0, 1.0)), "the plant's DC gain"),
        (ServoPlantParams(numerator=(1.0,), denominator=(1.0, 0.0)), "the plant's slowest pole"),
        (ServoPlantParams(dead_time=1.0), r"settling_time is 1\.5, allowed: at least"),
        (
            ServoPlantParams(measured="none.csv"),
            r"plant\.measured is 'none\.csv'",
        ),
    ],
)
def test_a_plant_that_can_not_be_steered_is_refused(plant: ServoPlantParams, message: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{message}"):
        resolve_comparison(replace(ServoComparisonScenario(), plant=plant))


@pytest.mark.parametrize(
    ("dead_zone", "increment", "said"),
    [
        (1e-4, 1e-5, "the dead zone is within the camera's error, 0.2 mm"),
        (8e-4, 1.0, "not guaranteed to settle: more than 1"),
        (8e-4, 5e-4, "from a large one it is not guaranteed"),
    ],
)
def test_what_the_theorem_says_of_a_state_machine_that_is_given(
    dead_zone: float, increment: float, said: str
) -> None:
    axis = AxisParams(dead_zone=dead_zone, large_error=dead_zone, increment=increment)
    given = replace(scenario(), fsm=axis, tolerance=1e-3)
    found = design_metrics(given)
    assert said in found["fsm.share_of_theorem"].note
    small = said.startswith("from")
    assert (found["fsm.delay_margin"].value is not None) is small
