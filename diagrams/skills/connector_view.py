"""A view of an insertion: plug and socket at their true places, and the gripper.

It is not part of a control loop. Set positions from displacements, and publish.
"""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import Diagram, DiagramBuilder

from chamfer.diagrams.skills.connector_scenario import ResolvedConnectorScenario
from chamfer.models.arms.wrist import SIZE, add_wrist, in_joint_order, tip_pose

Array = NDArray[np.float64]

_JAW: Final = np.array([0.010, 0.004, 0.030])  # m, along x, y and z; assumed
_PALM: Final = np.array([0.016, 0.030, 0.008])  # m, likewise
_APART: Final = 0.011  # m, from the plug's axis to the middle of a jaw; assumed
_HELD: Final = 0.008  # m, of the jaws' lower ends above the plug's tip; assumed
_STEEL: Final = np.array([0.30, 0.33, 0.38, 1.0])


class ConnectorView(NamedTuple):
    """A diagram that shows an insertion in Meshcat when it publishes."""

    diagram: Diagram
    plant: MultibodyPlant

    def positions(self, plug: Array, carriage: Array) -> Array:
        """Return the plant's positions, shape (n, 13), of displacements, rad above m, (n, 6)."""
        gripper = self.plant.GetModelInstanceByName("gripper")
        wrist = self.plant.GetModelInstanceByName("wrist")
        found = np.zeros((len(plug), self.plant.num_positions()))
        for q, q_plug, q_carriage in zip(found, plug, carriage, strict=True):
            X_WG = tip_pose(q_carriage)
            pose = np.hstack([X_WG.rotation().ToQuaternion().wxyz(), X_WG.translation()])
            self.plant.SetPositionsInArray(gripper, pose, q)
            self.plant.SetPositionsInArray(wrist, in_joint_order() @ q_plug, q)
        return found


def make_connector_view(scenario: ResolvedConnectorScenario, meshcat: Meshcat) -> ConnectorView:
    """Build plug, socket and gripper, and the systems that draw them."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    held = add_wrist(plant, plant.world_frame(), replace(scenario.wrist, centre=0.0))
    scenario.connector.add_plug(plant, held.body, scenario.plug_in_tool)
    scenario.connector.add_socket(plant, RigidTransform())
    instance = plant.AddModelInstance("gripper")
    gripper = plant.AddRigidBody(
        "gripper", instance, SpatialInertia.SolidBoxWithMass(1.0, 0.1, 0.1, 0.1)
    )
    for name, size, p in (
        ("left jaw", _JAW, [0.0, -_APART, _HELD + _JAW[2] / 2]),
        ("right jaw", _JAW, [0.0, _APART, _HELD + _JAW[2] / 2]),
        ("palm", _PALM, [0.0, 0.0, _HELD + _JAW[2] + _PALM[2] / 2]),
    ):
        X_GB = RigidTransform(np.array(p))
        plant.RegisterVisualGeometry(gripper, X_GB, Box(*size), name, _STEEL)
    plant.Finalize()
    assert plant.num_positions() == SIZE + 7
    params = MeshcatVisualizerParams(prefix="insertion")
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    diagram = builder.Build()
    diagram.set_name("Insertion, 3-D view")
    return ConnectorView(diagram, plant)
