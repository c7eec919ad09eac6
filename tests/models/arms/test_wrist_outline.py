"""The gripper's corners are those of what the URDF draws."""

import itertools

import numpy as np
from pydrake.geometry import Box, Cylinder
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.arms.adept_wrist import ADEPT_WRIST, gripper_points, joint_positions

X = np.array([0.45, 0.25, 0.3, 0.7, 0.2, -0.3, 0.4])


def test_points_are_the_corners_of_what_is_drawn() -> None:
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(str(ADEPT_WRIST.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    diagram = builder.Build()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, joint_positions(X, "positive"))
    inspector = scene_graph.model_inspector()
    boxes, fork = [], []
    for name in ("link_5", "link_6", "link_7"):
        body = plant.GetBodyByName(name)
        for geometry in plant.GetVisualGeometriesForBody(body):
            X_WG = body.EvalPoseInWorld(context) @ inspector.GetPoseInFrame(geometry)
            shape = inspector.GetShape(geometry)
            if isinstance(shape, Box):
                half = np.array([shape.width(), shape.depth(), shape.height()]) / 2
                boxes += [X_WG @ (signs * half) for signs in itertools.product((-1, 1), repeat=3)]
            elif isinstance(shape, Cylinder):
                fork.append((X_WG.inverse(), shape.radius(), shape.length()))
    del diagram
    found = gripper_points(X[np.newaxis])[0]
    apart = np.linalg.norm(found[:, np.newaxis] - np.array(boxes), axis=2)
    assert len(boxes) == 24
    np.testing.assert_allclose(apart.min(axis=0), 0.0, atol=1e-12)
    ((X_GW, radius, length),) = fork
    round_about = (X_GW @ found[apart.min(axis=1) > 1e-9].T).T
    assert len(round_about) == len(found) - 24
    np.testing.assert_allclose(np.hypot(*round_about[:, :2].T), radius, atol=1e-12)
    np.testing.assert_allclose(np.abs(round_about[:, 2]), length / 2, atol=1e-12)
