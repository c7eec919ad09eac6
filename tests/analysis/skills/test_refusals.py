"""Scenarios of the runs of skills that cannot be."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.analysis.skills.correlation_cases import CASES_SCENARIO, resolve_cases
from chamfer.analysis.skills.lissajous import LissajousScenario
from chamfer.analysis.skills.own_skill import OwnSkillScenario
from chamfer.analysis.skills.vision_trials import VisionPrimitivesScenario
from chamfer.diagrams.skills.dither_loops import AxisSensorParams
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.spring_constraint import SpringConstraintParams
from chamfer.systems.primitives.trajectory_primitives import Dither


def cases(**values: Any) -> Any:
    return resolve_cases(replace(CASES_SCENARIO, **values))


ONE_SIDED = SpringConstraintParams(sides="one")


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (VisionPrimitivesScenario, {"map_focal": (0.5, 2.0)}, "map_focal is (0.5, 2.0), allowed"),
        (VisionPrimitivesScenario, {"map_focal": (1.0, 0.5)}, "map_focal is (1.0, 0.5), allowed"),
        (VisionPrimitivesScenario, {"map_angle": (0.1,)}, "map_angle is (0.1,), allowed"),
        (LissajousScenario, {"repeats": (65,)}, "repeats is (65,), allowed: one or more whole"),
        (LissajousScenario, {"repeats": (3, 3)}, "repeats is (3, 3), allowed: different numbers"),
        (cases, {"dither": Dither(cycles=2.0)}, "dither.cycles is 2.0, allowed: a whole number"),
        (cases, {"dither": Dither(cycles=1e5)}, "dither.cycles is 100000.0, allowed: a whole num"),
        (cases, {"dither": Dither(cycles=5.5)}, "dither.cycles is 5.5, allowed: a whole number"),
        (cases, {"dither": Dither(amplitude=0.0)}, "dither.amplitude is 0.0, allowed: a number b"),
        (cases, {"dither": Dither(kind="rotary")}, "dither.kind is 'rotary', allowed: linear"),
        (cases, {"sensor": AxisSensorParams(bias=-1.0)}, "sensor.bias is -1.0, allowed: a finite"),
        (cases, {"constraint": ONE_SIDED}, "constraint.sides is 'one', allowed: both; cases set"),
        (OwnSkillScenario, {"part": "usb"}, "part is 'usb', allowed: d-connector, bnc-"),
        (OwnSkillScenario, {"compared": ("without_tare",)}, "trials is 1, allowed: 2 or more"),
    ],
)
def test_refuses(kind: Any, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        kind(**values)
    assert str(refused.value).startswith(message)
