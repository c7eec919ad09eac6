import gc

import numpy as np
import pytest

from chamfer.analysis.report.replay import open_meshcat
from chamfer.diagrams.skills.connector_insertion import BncConnectorScenario, DConnectorScenario
from chamfer.diagrams.skills.connector_view import make_connector_view
from chamfer.models.arms.wrist import tip_pose

PLUG = np.array([[0.05, -0.02, 0.6, 0.001, 0.002, -0.004], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
CARRIAGE = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.1, 0.2, -1.5, 0.01, -0.02, 0.03]])


@pytest.mark.parametrize("scenario", [DConnectorScenario(), BncConnectorScenario()])
def test_plug_and_gripper_are_where_they_are_told_to_be(
    scenario: DConnectorScenario | BncConnectorScenario,
) -> None:
    meshcat = open_meshcat(0)
    view = make_connector_view(scenario, meshcat)
    plant = view.plant
    context = plant.GetMyMutableContextFromRoot(view.diagram.CreateDefaultContext())
    positions = view.positions(PLUG, CARRIAGE)
    for q, plug, carriage in zip(positions, PLUG, CARRIAGE, strict=True):
        plant.SetPositions(context, q)
        for name, expected in (("tool", plug), ("gripper", carriage)):
            X = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName(name))
            assert X.IsNearlyEqualTo(tip_pose(expected), 1e-12)
    view.diagram.ForcedPublish(view.diagram.CreateDefaultContext())
    for part in ("wrist/tool", "gripper/gripper"):
        assert meshcat.HasPath(f"insertion/{part}")
    del view, plant, context, meshcat
    gc.collect()
