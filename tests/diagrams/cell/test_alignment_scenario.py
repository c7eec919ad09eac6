"""Which cells can be aligned: parts in view and apart, a fixture, an axis downwards."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from chamfer.analysis.cell.alignment_runs import run_alignment
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    require_fine_enough,
    require_start_apart,
)
from chamfer.diagrams.cell.work_cell import (
    HOLE_ARM,
    PEG_ARM,
    ArmName,
    WorkCellScenario,
    add_part_shapes,
    add_work_cell,
)
from chamfer.diagrams.insertion.insertion import InsertionScenario
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.pose import pose_vector

CELL = AlignmentScenario()
ASIDE = Placement(position=(0.0, 0.2, 0.0))


def error(**elements: float) -> dict[str, Any]:
    names = ("x", "y", "z", "roll", "pitch", "yaw")
    return {"initial_error": tuple(elements.get(name, 0.0) for name in names)}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gap": 0.4}, r"gap is 0.4, .* peg's tip .*; in that of xz, .* at \(-2..\.., 1..\.?.?\)"),
        (error(y=9.0), "initial_error is .* peg's tip .*; in that of xy, .* it is at "),
        (error(z=-0.1), "initial_error is .* peg's tip .*; in that of xz, 320 x 240 pixels"),
        (error(y=-1.0), "initial_error is .* peg's tip .*; it is behind the xz camera"),
        ({"start_offset": (0.0, 0.0, 0.5)}, "start_offset is .* peg's tip .*; in that of xz"),
        ({"peg": replace(PEG_ARM, base_error=ASIDE)}, "peg.base_error is .* peg's tip .*xy"),
        ({"hole": replace(HOLE_ARM, base_error=ASIDE)}, "hole.base_error is .* hole part's .*xy"),
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
    small, larger = (
        replace(CELL, parts=ColouredParts(peg_radius=r, hole_radius=r / 0.99, chamfer_width=0.001))
        for r in (0.002376, 0.00297)
    )
    require_fine_enough(larger)
    message = r"cameras.pixel_size is 0.0005, allowed: at most 0.000475 m, so that both parts"
    with pytest.raises(ParameterError, match=message):
        require_fine_enough(small)
    require_fine_enough(replace(small, cameras=replace(CELL.cameras, pixel_size=0.00025)))


NO_ERROR = (0.0,) * 6
IN = (0.04, 0.0, 0.0)  # m, of the tip, to 1 cm into the bore
CELL_START_APART = AlignmentScenario(initial_error=NO_ERROR)
DOWN = replace(CELL_START_APART, axis="downwards", hole=replace(HOLE_ARM, kind="fixture"))


@pytest.mark.parametrize("cell", [CELL_START_APART, DOWN])
@pytest.mark.parametrize(
    ("change", "name"),
    [
        # In the bore but not in line with it, or on its bottom.
        ({"start_offset": (0.04, 0.006, 0.0)}, "start_offset"),
        ({"start_offset": IN, "initial_error": (0.0, 0.0, 0.0, 0.0, 0.1, 0.0)}, "initial_error"),
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
    with pytest.raises(ParameterError, match=rf"^{name} is .* part are apart; they overlap by "):
        resolve(replace(cell, **change))


@pytest.mark.parametrize(("name", "arm"), [("peg", PEG_ARM), ("hole", HOLE_ARM)])
def test_arms_that_are_elsewhere(name: str, arm: Any) -> None:
    off = replace(arm, base_error=Placement(position=(0.035, 0.01, 0.0)))
    with pytest.raises(ParameterError, match=rf"^{name}\.base_error is .* hole part are apart"):
        resolve(replace(CELL_START_APART, **{name: off}))


@pytest.mark.parametrize("cell", [CELL_START_APART, DOWN])
@pytest.mark.parametrize(
    "change",
    [
        {"start_offset": IN},
        {"gap": 0.0},
        {"gap": 0.002, "initial_error": (0.0, 0.01, 0.0, 0.0, 0.1, 0.1)},
        {"start_offset": (-0.03, 0.02, 0.03), "initial_error": (0.0, 0.01, 0.01, 0.0, 0.1, 0.1)},
    ],
)
def test_parts_that_are_apart(cell: AlignmentScenario, change: dict[str, Any]) -> None:
    resolve(replace(cell, **change))


def test_the_bottom_of_a_blind_bore_is_material() -> None:
    parts = ColouredParts(bore_depth=0.02)
    cell = InsertionScenario(initial_error=NO_ERROR, parts=parts)
    require_start_apart(replace(cell, start_offset=(cell.gap + 0.0199, 0.0, 0.0)))
    touching = replace(cell, start_offset=(cell.gap + 0.0201, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"^start_offset is .* they overlap by 0\.1 mm$"):
        require_start_apart(touching)


FIXTURE = replace(HOLE_ARM, kind="fixture")
CELL_HOLE_FIXTURE = AlignmentScenario(hole=FIXTURE, meeting_point=(0.01, -0.02, 0.15))


def test_only_the_peg_s_arm_is_simulated() -> None:
    builder = DiagramBuilder()
    cell = add_work_cell(
        builder, CELL_HOLE_FIXTURE, add_parts=partial(add_part_shapes, CELL_HOLE_FIXTURE)
    )
    assert cell.plant.num_positions() == 7
    assert set(cell.arms) == {"peg"}
    # The hole part is where the mouth is to be, and nothing holds it.
    context = cell.plant.CreateDefaultContext()
    X_WM = cell.plant.EvalBodyPoseInWorld(context, cell.tools["hole"])
    np.testing.assert_allclose(
        pose_vector(X_WM), [1, 0, 0, 0, 0.01, -0.02, 0.15], rtol=0, atol=1e-12
    )
    assert len(cell.plant.GetVisualGeometriesForBody(cell.tools["hole"])) == 1
    assert len(cell.plant.GetVisualGeometriesForBody(cell.tools["peg"])) == 2


def test_with_one_arm_the_compensation_is_the_peg_s() -> None:
    assert resolve(CELL_HOLE_FIXTURE).compensated == "peg"
    assert resolve(AlignmentScenario()).compensated == "both"
    assert resolve(replace(CELL_HOLE_FIXTURE, compensated="none")).compensated == "none"
    for value in ("hole", "both"):
        with pytest.raises(ParameterError, match=f"^compensated is '{value}', allowed: peg, none"):
            replace(CELL_HOLE_FIXTURE, compensated=value)


SIX_JOINTS = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
OTHER: dict[str, Any] = {
    "base": Placement(position=(1.0, 0.0, 0.0)),
    "posture": (0.1,) * 7,
    "tool": replace(HOLE_ARM.tool, mass=1.0),
    "payload_error": 0.2,
    "payload_position": (0.0, 0.0, 0.0),
    "mass_scale": 1.1,
    "base_error": Placement(rpy=(0.0, 0.1, 0.0)),
    "joint_friction": (0.0,) * 7,
    "rotor_inertia": (0.1,) * 7,
    "model": str(SIX_JOINTS),
}


@pytest.mark.parametrize("name", OTHER)
def test_what_only_an_arm_has_is_refused(name: str) -> None:
    with pytest.raises(ParameterError, match=rf"^hole\.{name} is .*, a fixture is no arm$"):
        WorkCellScenario(hole=replace(FIXTURE, **{name: OTHER[name]}))
    WorkCellScenario(hole=replace(HOLE_ARM, **{name: OTHER[name]}))


ACROSS = AlignmentScenario()
DOWNWARDS = AlignmentScenario(axis="downwards", hole=FIXTURE)
ARMS: tuple[ArmName, ...] = ("peg", "hole")


def test_where_the_parts_meet_follows_from_the_axis_unless_it_is_said() -> None:
    assert resolve(ACROSS).meeting_point == (0.0, 0.0, 0.158)
    assert resolve(DOWNWARDS).meeting_point == DOWNWARDS.mouth == (-0.3, 0.0, -0.3)
    said = replace(DOWNWARDS, meeting_point=(-0.25, 0.0, -0.1))
    assert resolve(said).meeting_point == said.mouth == (-0.25, 0.0, -0.1)


def test_two_arms_that_do_not_reach_each_other_are_refused_in_a_line() -> None:
    two = replace(DOWNWARDS, hole=HOLE_ARM)
    with pytest.raises(ParameterError) as caught:
        resolve(two)
    assert str(caught.value).startswith(
        "meeting_point is (-0.3, 0.0, -0.3), allowed: one that the hole's arm reaches with an "
        "axis that is downwards; its flange position is"
    )
    near = replace(HOLE_ARM, base=Placement(position=(-0.1, 0.0, -1.1), rpy=(0.0, 0.0, np.pi)))
    assert resolve(replace(two, hole=near)).arms == ARMS


@pytest.mark.parametrize("axis", ["start_offset", "initial_error"])
def test_what_leaves_the_image_is_along_the_hole_s_axes(axis: str) -> None:
    far: dict[str, Any] = {
        "start_offset": (0.0, 0.0, 0.5),
        "initial_error": (0.0, 0.0, 0.1, 0.0, 0.0, 0.0),
    }
    with pytest.raises(ParameterError, match=rf"^{axis} is .*in that of xz, .* it is at \(.*, -"):
        resolve(replace(DOWNWARDS, **{axis: far[axis]}))


def test_downwards_errors_are_along_and_about_the_hole_s_axes_and_are_compensated() -> None:
    smooth = replace(PEG_ARM, joint_friction=(0.0,) * 7, payload_error=0.0)
    found = run_alignment(resolve(replace(DOWNWARDS, peg=smooth)), 0)
    row = int(DOWNWARDS.begin * 80) - 1
    lacks = [found[f"true_{name}"][row] for name in ("y", "z", "pitch", "yaw")]
    np.testing.assert_allclose(lacks[:2], [-0.006, 0.008], rtol=0, atol=3e-4)
    np.testing.assert_allclose(lacks[2:], [-0.05, 0.06], rtol=0, atol=4e-3)
    assert found["lateral_error"][-1] < 0.001
    assert found["rotational_error"][-1] < 0.02
