"""The work cell to look at: arms at their true places, holding the shapes of their parts.

The shapes do not collide, and the view is no part of a control loop. Whoever has joint positions
sets them and publishes.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Cylinder, Mesh, Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario, add_holders
from chamfer.models.peg.part_surfaces import part_shape
from chamfer.models.peg.peg_and_hole import Colour

Array = NDArray[np.float64]

_SIDES: Final = 96  # corners of a circle
_SEE_THROUGH: Final = 0.45  # opacity of the hole part, so that the peg is seen in the bore
_GRIP: Final = 1 / 6  # of a part's length, that its holder hides
_SHORTEST: Final = 1e-6  # m, of a holder
_WALL: Final = 0.003  # m, of a holder around its part
_HOLDER: Final = np.array([0.25, 0.27, 0.30, 1.0])  # red, green, blue, opacity


def add_part_shapes(
    scenario: WorkCellScenario,
    plant: MultibodyPlant,
    tools: dict[ArmName, RigidBody],
) -> None:
    """Add the peg and a see-through hole part to their tools; rods hold what arms have.

    Args:
        scenario: The parts, and where the tools are on their flanges.
        plant: Not yet finalized.
        tools: The bodies, whose frames are T and M.
    """
    parts = scenario.parts
    peg, hole = parts.peg, parts.hole
    looks: dict[ArmName, tuple[Array, Colour, float]] = {
        "peg": (peg.closed_profile, parts.peg_colour, 1.0),
        "hole": (hole.closed_profile, parts.hole_colour, _SEE_THROUGH),
    }
    for part, (profile, colour, opacity) in looks.items():
        mesh = part_shape(profile, _SIDES, part, parts.section)
        _add_part(plant, tools[part], part, mesh, colour, opacity)
    ends = {"peg": (-peg.length, peg.radius), "hole": (hole.depth, hole.outer_radius)}
    for arm in scenario.arms:
        X_TF = getattr(scenario, arm).tool.frame.transform.inverse()
        _add_holder(plant, tools[arm], X_TF.translation(), *ends[arm])


def _add_part(
    plant: MultibodyPlant, tool: RigidBody, name: str, mesh: Mesh, colour: Colour, opacity: float
) -> None:
    rgba = np.array([*(channel / 255 for channel in colour), opacity])
    plant.RegisterVisualGeometry(tool, RigidTransform(), mesh, name, rgba)


def _add_holder(
    plant: MultibodyPlant, tool: RigidBody, p_TF: Array, end: float, radius: float
) -> None:
    """Add a rod from the flange around the end of a part, so that the part is seen to be held.

    Args:
        plant: Not yet finalized.
        tool: The body that holds the part, its frame is T.
        p_TF: Where the flange is, m, shape (3,).
        end: Where the part ends, m, along x_T.
        radius: Of the part, m.
    """
    p_TE = np.array([(1 - _GRIP) * end, 0.0, 0.0])
    rod = p_TE - p_TF
    length = float(np.linalg.norm(rod))
    if length < _SHORTEST:
        return
    R_TR = RotationMatrix.MakeFromOneVector(rod / length, 2)
    X_TR = RigidTransform(R_TR, (p_TE + p_TF) / 2)
    shape = Cylinder(radius + _WALL, length)
    plant.RegisterVisualGeometry(tool, X_TR, shape, "holder", _HOLDER)


class WorkCellView(NamedTuple):
    """A diagram that shows the cell in Meshcat when it publishes."""

    diagram: Diagram
    plant: MultibodyPlant
    instances: dict[ArmName, ModelInstanceIndex]

    def positions(self, joints: dict[ArmName, Array]) -> Array:
        """Return the plant's positions, shape (n, j), from each arm's, rad, (n, joints)."""
        found = np.zeros((len(joints["peg"]), self.plant.num_positions()))
        for arm, instance in self.instances.items():
            for q, q_arm in zip(found, joints[arm], strict=True):
                self.plant.SetPositionsInArray(instance, q_arm, q)
        return found


def make_work_cell_view(scenario: WorkCellScenario, meshcat: Meshcat) -> WorkCellView:
    """Build what holds the parts, as shapes without contact, and what draws it."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    instances, tools = add_holders(plant, scenario)
    add_part_shapes(scenario, plant, tools)
    plant.Finalize()
    params = MeshcatVisualizerParams(prefix="cell")
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    diagram = builder.Build()
    diagram.set_name("Work cell to look at")
    return WorkCellView(diagram, plant, instances)
