"""What is seen of the work cell: arms where they truly are, parts that are held."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams, SceneGraphInspector

from chamfer.diagrams.cell.work_cell import HOLE_ARM, PEG_ARM, ArmName, WorkCellScenario
from chamfer.diagrams.cell.work_cell_view import WorkCellView, make_work_cell_view
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.force.arm_model import Placement

PARTS = ColouredParts(
    peg_radius=0.007,
    hole_radius=0.0072,
    peg_length=0.05,
    hole_length=0.03,
    outer_radius=0.016,
    peg_colour=(200, 100, 0),
    hole_colour=(0, 100, 200),
)
SCENARIO = WorkCellScenario(
    parts=PARTS,
    peg=replace(PEG_ARM, base_error=Placement(position=(0.01, 0.02, -0.03), rpy=(0.1, 0.0, 0.2))),
    hole=replace(HOLE_ARM, base_error=Placement(rpy=(0.0, -0.05, 0.0))),
)


@pytest.fixture(scope="module")
def view() -> WorkCellView:
    return make_work_cell_view(SCENARIO, Meshcat(MeshcatParams(host="localhost", port=0)))


def inspector(view: WorkCellView) -> SceneGraphInspector:
    return view.diagram.GetSubsystemByName("scene_graph").model_inspector()


def shapes(view: WorkCellView, arm: ArmName, body: str = "tool") -> dict[str, int]:
    """Return a body's shapes, by name."""
    found = view.plant.GetBodyByName(body, view.instances[arm])
    ids = view.plant.GetVisualGeometriesForBody(found)
    return {inspector(view).GetName(one).split("::")[-1]: one for one in ids}


@pytest.mark.parametrize(
    ("arm", "low", "high", "radius", "colour"),
    [
        ("peg", -PARTS.peg_length, 0.0, PARTS.peg_radius, PARTS.peg_colour),
        ("hole", 0.0, PARTS.hole_length, PARTS.outer_radius, PARTS.hole_colour),
    ],
)
def test_parts_have_their_sizes_and_colours_in_the_tools_frames(
    view: WorkCellView,
    arm: ArmName,
    low: float,
    high: float,
    radius: float,
    colour: tuple[int, int, int],
) -> None:
    part = shapes(view, arm)[arm]
    assert inspector(view).GetPoseInFrame(part).IsExactlyIdentity()
    box = inspector(view).GetObbInGeometryFrame(part)
    corners = np.abs(box.pose().rotation().matrix()) @ box.half_width()
    middle = box.pose().translation()
    np.testing.assert_allclose(middle[0] + corners[0] * np.array([-1, 1]), [low, high], atol=1e-6)
    assert radius <= corners[1:].max() < 1.01 * radius
    rgba = inspector(view).GetIllustrationProperties(part).GetProperty("phong", "diffuse").rgba
    np.testing.assert_allclose(rgba[:3], np.array(colour) / 255, atol=1e-6)
    assert rgba[3] == 1.0 if arm == "peg" else 0 < rgba[3] < 1
