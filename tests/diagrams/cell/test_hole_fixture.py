"""A hole that is fixed in the world: one arm, which takes all of the compensation."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.work_cell import HOLE_ARM, WorkCellScenario, add_work_cell
from chamfer.diagrams.cell.work_cell_view import add_part_shapes
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Placement
from chamfer.systems.pose import pose_vector

FIXTURE = replace(HOLE_ARM, kind="fixture")
CELL = AlignmentScenario(hole=FIXTURE, meeting_point=(0.01, -0.02, 0.15))


def test_only_the_peg_s_arm_is_simulated() -> None:
    builder = DiagramBuilder()
    cell = add_work_cell(builder, CELL, add_parts=partial(add_part_shapes, CELL))
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
    assert resolve(CELL).compensated == "peg"
    assert resolve(AlignmentScenario()).compensated == "both"
    assert resolve(replace(CELL, compensated="none")).compensated == "none"
    for value in ("hole", "both"):
        with pytest.raises(ParameterError, match=f"^compensated is '{value}', allowed: peg, none"):
            replace(CELL, compensated=value)


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
