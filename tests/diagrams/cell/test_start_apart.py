"""Which starts are refused because the parts would be in each other."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, require_start_apart
from chamfer.diagrams.cell.work_cell import HOLE_ARM, PEG_ARM
from chamfer.diagrams.insertion.insertion import InsertionScenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement

NO_ERROR = (0.0,) * 6
CELL = AlignmentScenario(initial_error=NO_ERROR)
DOWN = replace(CELL, axis="downwards", hole=replace(HOLE_ARM, kind="fixture"))


def base_error(arm: Any, x: float, y: float) -> Any:
    return replace(arm, base_error=Placement(position=(x, y, 0.0)))


@pytest.mark.parametrize("cell", [CELL, DOWN])
@pytest.mark.parametrize(
    ("change", "name"),
    [
        # In the bore but not in line with it, or on its bottom.
        ({"gap": -0.01, "initial_error": (0.0, 0.006, 0.0, 0.0, 0.0, 0.0)}, "gap"),
        ({"gap": -0.01, "initial_error": (0.0, 0.0, 0.0, 0.0, 0.1, 0.0)}, "gap"),
        # Into the front face, at once, or on the way past it.
        ({"start_offset": (0.035, 0.0, 0.01)}, "start_offset"),
        ({"start_offset": (0.06, 0.0, 0.035)}, "initial_error"),
        ({"initial_error": (0.035, 0.0, 0.01, 0.0, 0.0, 0.0)}, "initial_error"),
        # The tip is before the mouth, and its rim beyond it.
        ({"gap": 0.0005, "initial_error": (0.0, 0.01, 0.0, 0.0, 0.1, 0.1)}, "initial_error"),
    ],
)
def test_parts_that_are_in_each_other(
    cell: AlignmentScenario, change: dict[str, Any], name: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        resolve(replace(cell, **change))
    assert str(caught.value).startswith(f"{name} is ")
    assert "allowed: one with which peg and hole part are apart; they overlap by " in str(
        caught.value
    )


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"peg": base_error(PEG_ARM, 0.035, 0.01)}, "peg.base_error"),
        ({"hole": base_error(HOLE_ARM, 0.035, 0.01)}, "hole.base_error"),  # it faces the other
    ],
)
def test_arms_that_are_elsewhere(change: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name} is .* peg and hole part are apart"):
        resolve(replace(CELL, **change))


@pytest.mark.parametrize("cell", [CELL, DOWN])
@pytest.mark.parametrize(
    "change",
    [
        {"gap": -0.01},  # in line
        {"gap": 0.0},
        {"gap": 0.002, "initial_error": (0.0, 0.01, 0.0, 0.0, 0.1, 0.1)},
        {"start_offset": (-0.03, 0.02, 0.03), "initial_error": (0.0, 0.01, 0.01, 0.0, 0.1, 0.1)},
    ],
)
def test_parts_that_are_apart(cell: AlignmentScenario, change: dict[str, Any]) -> None:
    resolve(replace(cell, **change))


def test_the_bottom_of_a_blind_bore_is_material() -> None:
    parts = ColouredParts(bore_depth=0.02)
    touching = InsertionScenario(initial_error=NO_ERROR, parts=parts, gap=-0.0199)
    require_start_apart(touching)
    with pytest.raises(ParameterError, match=r"^gap is -0\.0201, .* they overlap by 0\.1 mm$"):
        require_start_apart(replace(touching, gap=-0.0201))
