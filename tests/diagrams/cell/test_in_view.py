"""Which parts are refused because a camera can't see them."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    require_fine_enough,
)
from chamfer.diagrams.cell.work_cell import HOLE_ARM, PEG_ARM
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement

CELL = AlignmentScenario()
ASIDE = Placement(position=(0.0, 0.2, 0.0))


def error(**elements: float) -> dict[str, Any]:
    names = ("x", "y", "z", "roll", "pitch", "yaw")
    return {"initial_error": tuple(elements.get(name, 0.0) for name in names)}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"gap": 0.4},
            r"gap is 0.4, .* peg's tip .*; in that of xz, .* at \(-2..\.., 1..\.?.?\)",
        ),
        (error(y=9.0), "initial_error is .* peg's tip .*; in that of xy, .* it is at "),
        (
            error(z=-0.1),
            "initial_error is .* peg's tip .*; in that of xz, 320 x 240 pixels",
        ),
        (error(y=-1.0), "initial_error is .* peg's tip .*; it is behind the xz camera"),
        ({"start_offset": (0.0, 0.0, 0.5)}, "start_offset is .* peg's tip .*; in that of xz"),
        ({"peg": replace(PEG_ARM, base_error=ASIDE)}, "peg.base_error is .* peg's tip .*xy"),
        (
            {"hole": replace(HOLE_ARM, base_error=ASIDE)},
            "hole.base_error is .* hole part's .*xy",
        ),
    ],
)
def test_what_takes_a_part_out_of_view_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}"):
        resolve(replace(CELL, **change))


@pytest.mark.parametrize(
    "change", [{"friction": 0.3}, {"chamfer_angle": 1.0}, {"bore_depth": 0.03}]
)
def test_what_of_the_parts_nobody_sees_is_refused(change: dict[str, Any]) -> None:
    ((name, value),) = change.items()
    with pytest.raises(ParameterError, match=rf"^parts.{name} is {value}, .*, the parts don't t"):
        AlignmentScenario(parts=ColouredParts(**change))


def test_a_part_may_come_into_view_before_the_compensation_begins() -> None:
    far: dict[str, Any] = {"start_offset": (0.0, 0.0, 0.2), "motion_time": 2.0}
    resolve(replace(CELL, begin=1.5, **far))
    with pytest.raises(ParameterError, match=r"^start_offset is \(0\.0, 0\.0, 0\.2\), allowed: "):
        resolve(replace(CELL, begin=0.5, **far))


def test_pixels_too_large_for_the_parts_are_refused() -> None:
    small = replace(CELL, parts=ColouredParts().scaled(0.0024, 0.01))
    require_fine_enough(replace(CELL, parts=ColouredParts().scaled(0.003, 0.01)))
    message = r"cameras.pixel_size is 0.0005, allowed: at most 0.000475 m, so that both parts"
    with pytest.raises(ParameterError, match=message):
        require_fine_enough(small)
    require_fine_enough(replace(small, cameras=replace(CELL.cameras, pixel_size=0.00025)))
