from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from chamfer.analysis.contact.puma_contact import (
    PUMA_NUGGET_HOLD,
    PUMA_NUGGET_MOTION,
    PUMA_ROLLER_HOLD,
    PUMA_ROLLER_MOTION,
)

from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.diagrams.contact.contact_scenarios import (
    PumaNuggetHoldScenario,
    PumaNuggetMotionScenario,
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.models.validation import ParameterError

ALL: dict[str, tuple[Experiment[Any], Callable[..., Any]]] = {
    "puma-roller-hold": (PUMA_ROLLER_HOLD, PumaRollerHoldScenario),
    "puma-roller-motion": (PUMA_ROLLER_MOTION, PumaRollerMotionScenario),
    "puma-nugget-hold": (PUMA_NUGGET_HOLD, PumaNuggetHoldScenario),
    "puma-nugget-motion": (PUMA_NUGGET_MOTION, PumaNuggetMotionScenario),
}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.mark.parametrize("name", ALL)
def test_each_has_its_scenario(name: str) -> None:
    experiment, make = ALL[name]
    assert experiment.name == name
    assert experiment.scenario is make


@pytest.fixture(scope="module")
def touch() -> Outcome:
    scenario = PumaNuggetHoldScenario(duration=1.5, measure_after=1.0, trials=2)
    task = replace(scenario.task, start=(0.339, -0.011, 0.546), distance=0.001)
    return PUMA_NUGGET_HOLD.run(resolve(replace(scenario, task=task)), 0, quiet)


def test_a_nugget_is_pressed_on_the_wall(touch: Outcome) -> None:
    value = {name: metric.value for name, metric in touch.metrics.items()}
    assert touch.simulated_seconds == 3.0
    assert value["contact_time"] is not None
    assert 0 < value["contact_time"] < 0.5
    assert value["impact.speed"] is not None
    assert 0 < value["impact.speed"] < 0.15
    assert value["force.final"] == pytest.approx(5.0, rel=0.5)
    assert touch.metrics["force.final"].note.startswith("mean of 2 seeds")


def test_out_of_reach_is_one_line() -> None:
    scenario = PumaNuggetHoldScenario()
    far = replace(scenario, task=replace(scenario.task, distance=3.0))
    with pytest.raises(ParameterError, match=r"endpoint is \(.*\), allowed: ") as caught:
        PUMA_NUGGET_HOLD.resolve(far)
    assert "\n" not in str(caught.value)
