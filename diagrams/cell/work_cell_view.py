"""The work cell to look at: the arms at their true places, holding the parts of their tools.

It is no part of a control loop. Whoever has joint positions sets them and publishes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.diagrams.cell.part_shapes import add_part_shapes
from chamfer.diagrams.cell.work_cell import ArmName, WorkCellScenario, add_holders

Array = NDArray[np.float64]


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
    """Build what holds the parts, as shapes without contact, and what draws it.

    Args:
        scenario: Where the arms are and what they hold.
        meshcat: Where to draw.
    """
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
