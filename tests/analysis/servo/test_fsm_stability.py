import math

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, quiet, select
from chamfer.analysis.servo.fsm_stability import (
    CYCLES,
    REVERSES,
    SETTLES,
    UNFINISHED,
    MapParams,
    StabilityScenario,
    axis_machine,
    classify,
    gore_findings,
    lap_chart,
    oscillation,
)
from chamfer.diagrams.servo.servo_scenario import (
    CameraParams,
    StepScenario,
    fsm_axis,
    settling_plant,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.compensator_law import (
    AxisParams,
    CompensatorInputs,
    CompensatorParams,
    make_compensator_chart,
)
from chamfer.systems.servo.settling import allowed_axis
from chamfer.systems.statechart.finite_machine import storage, tarraf_properties

FSM_STABILITY = load(select(CATALOGUE.entries, ["fsm-stability"])[0])


SMALL = StabilityScenario(map=MapParams(points=9, trials=3, settings=40))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return FSM_STABILITY.run(SMALL, 0, quiet)


def test_what_is_guaranteed_settles_and_both_sides_are_shown(outcome: Outcome) -> None:
    value = {name: metric.value for name, metric in outcome.metrics.items()}
    assert value["map.cells"] == 81
    assert value["map.guaranteed_not_settling"] == 0
    assert value["map.unfinished"] == 0
    assert value["map.guaranteed"] >= 20
    assert value["map.cycling"] >= 10
    assert value["map.first_reversal"] > 1


def test_the_describing_function_predicts_the_frequency(outcome: Outcome) -> None:
    assert outcome.metrics["describing_function.frequency_error"].value == pytest.approx(4, abs=2)
    cycles = outcome.tables["limit_cycles"]
    # As a certificate it is optimistic: the first limit cycle is there before it says so.
    assert np.isfinite(cycles["measured_frequency"]).sum() > (
        np.isfinite(cycles["predicted_frequency"]).sum()
    )


def test_the_papers_criteria(outcome: Outcome) -> None:
    values = [value for value in PUBLISHED if value.experiment == "fsm-stability"]
    failed = {c.published.metric for c in check(values, outcome.metrics) if not c.ok}
    assert failed == {"compensation.tarraf_properties"}
    assert outcome.metrics["folded.gore_criteria"].value == 1


def test_force_to_velocity_keeps_an_error_beyond_the_dead_zone(outcome: Outcome) -> None:
    slow = outcome.metrics["velocity_80hz.least_error"].value
    fast = outcome.metrics["velocity_1000hz.least_error"].value
    assert slow is not None
    assert fast is not None
    assert slow > fast > 0.01


def test_dead_zones_within_the_cameras_error_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"map\.dead_zone is \(0\.001, 0\.03\)"):
        StabilityScenario(map=MapParams(dead_zone=(0.001, 0.03)))


LOOP = StepScenario()


def axis(share: float) -> AxisParams:
    """An axis whose small increment is that share of the theorem's bound."""
    plant = settling_plant(LOOP, "position")
    increment = share * 5 * 2 * (0.01 - 0.0025) / (1 + plant.total)
    return allowed_axis(plant, dead_zone=0.01, measurement_error=0.0025, increment=increment)


def test_settings_on_both_sides_of_the_bound() -> None:
    axes = [axis(share) for share in (0.5, 0.95, 1.6, 4.0)]
    done = classify(axes, LOOP, trials=8, seed=0)
    assert done.tolist() == [SETTLES, SETTLES, REVERSES, CYCLES]


def test_an_increment_too_small_for_the_trial_counts_as_unfinished() -> None:
    slow = AxisParams(dead_zone=0.01, large_error=1.0, increment=1e-4)
    done = classify([slow], LOOP, trials=3, seed=0)
    assert done.tolist() == [UNFINISHED]


def test_a_bounded_noise_is_covered_by_the_theorem() -> None:
    noisy = StepScenario(camera=CameraParams(resolution=0.0, noise=0.005))
    setting = fsm_axis(noisy, "position")
    done = classify([setting], noisy, trials=40, seed=1)
    assert done.tolist() == [SETTLES]


def test_oscillation_is_measured_where_there_is_one() -> None:
    frequency, amplitude = oscillation([axis(0.9), axis(4.0)], LOOP)
    assert np.isnan(frequency[0])
    # The plant lags by half a turn more than the accumulator near its natural frequency.
    assert frequency[1] == pytest.approx(18.0, rel=0.05)
    assert 0.01 < amplitude[1] < 0.1


AXIS = AxisParams(dead_zone=0.01, large_error=0.1, increment=0.01)
PERIOD = 1 / 80


def test_the_increment_has_all_of_tarrafs_properties() -> None:
    machine = axis_machine(AXIS, accumulated=False)
    found = tarraf_properties(machine)
    assert found.count == 3
    # One small increment per dead zone: 1/0.01; five per large error of 0.1 is less.
    assert math.isclose(found.gain, 100.0, rel_tol=1e-9)
    assert storage(machine, 99.0) is None


def test_the_accumulated_compensation_has_none() -> None:
    machine = axis_machine(AXIS, accumulated=True)
    assert tarraf_properties(machine).count == 0
    assert np.abs(machine.output).max() == 20  # four large increments of five small ones


def run_of_errors() -> list[float]:
    return (0.3 * np.sin(np.linspace(0, 4 * np.pi, 400))).tolist()


def test_the_compensator_meets_gores_criteria_on_a_run_that_uses_all_of_it() -> None:
    assert gore_findings(AXIS, run_of_errors(), PERIOD, folded=False) == ()


def test_a_lap_in_one_tick_loses_the_state_that_fig_3_begins_it_with() -> None:
    lost = "next_desired_position"
    assert gore_findings(AXIS, run_of_errors(), PERIOD, folded=True) == (
        f"criterion 2: {lost} not used, no way from aligned to {lost}, "
        f"no way from modify_compensation to {lost}, no way from hold to {lost}",
    )


def test_two_ticks_of_fig_3_as_drawn_do_what_one_tick_of_the_chart_that_runs_does() -> None:
    params = CompensatorParams(axes=(AXIS, AXIS), period=PERIOD, end_time=300 * PERIOD)
    drawn, runs = lap_chart(params), make_compensator_chart(params)
    a, b = drawn.start(), runs.start()
    for i, error in enumerate(run_of_errors()):
        inputs = CompensatorInputs((error, -0.5 * error), (float(i % 7 > 0),), (0.1 * i, 1.0))
        a, _ = drawn.step(a, inputs, i * PERIOD)
        b, _ = runs.step(b, inputs, i * PERIOD)
        assert a.state == b.state
        assert a.memory == b.memory
        a, _ = drawn.step(a, inputs, (i + 0.5) * PERIOD)
        assert a.state == (drawn.initial if i < 300 else "trajectory_ended")
        assert a.memory == b.memory


def test_a_range_increases() -> None:
    with pytest.raises(ParameterError, match=r"^dead_zone is .*, allowed: two increasing"):
        MapParams(dead_zone=(0.02, 0.01))
