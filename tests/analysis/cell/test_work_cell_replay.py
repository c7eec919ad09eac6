"""Replays of the work cell's runs: which joint moves what, the stage and the cameras."""

import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.geometry import Meshcat

from chamfer.analysis.cell.work_cell_replay import replay_alignment
from chamfer.analysis.report.replay import open_meshcat
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import VIEWS
from chamfer.diagrams.cell.work_cell import ARMS, HOLE_ARM
from chamfer.models.arms import wam
from chamfer.systems.force.arm_model import ArmModel, Placement

SCENARIO = AlignmentScenario(
    hole=replace(HOLE_ARM, base_error=Placement(position=(0.0, 0.0, -0.05), rpy=(0.1, 0.0, 0.0)))
)


@pytest.fixture(scope="module")
def joints() -> dict[str, Any]:
    generator = np.random.default_rng(1)
    return {arm: generator.uniform(wam.LOWER_LIMITS, wam.UPPER_LIMITS, (2, 7)) for arm in ARMS}


def outcome(joints: dict[str, Any]) -> Outcome:
    traces = {f"{arm}_q{i + 1}": q for arm, rows in joints.items() for i, q in enumerate(rows.T)}
    return Outcome(
        metrics={}, traces={"time": np.array([0.0, 0.1]), **traces}, simulated_seconds=0.1
    )


@pytest.fixture(scope="module")
def shown(joints: dict[str, Any]) -> Meshcat:
    meshcat = open_meshcat(0)
    replay_alignment(SCENARIO, outcome(joints), meshcat)
    return meshcat


def pose(meshcat: Meshcat, path: str) -> Any:
    """Return the pose of what is shown before the animation, as a matrix, shape (4, 4)."""
    packed = meshcat._GetPackedTransform(path)[-16 * 9 :]
    return np.array([one[0] for one in struct.iter_unpack(">xd", packed)]).reshape(4, 4).T


@pytest.mark.parametrize("arm", ARMS)
def test_tools_are_where_the_traces_say(shown: Meshcat, joints: dict[str, Any], arm: str) -> None:
    settings = getattr(SCENARIO, arm)
    X_WB = settings.base.transform @ settings.base_error.transform
    expected = ArmModel(X_WB, settings.tool).evaluate(joints[arm][0]).X_WT
    found = pose(shown, f"/drake/cell/{arm}_arm/wam/tool")
    np.testing.assert_allclose(found, expected.GetAsMatrix4(), rtol=0, atol=1e-12)


def test_cameras_look_out_of_their_boxes(shown: Meshcat) -> None:
    for i, view in enumerate(VIEWS):
        camera = SCENARIO.camera(view)
        X_WB = pose(shown, f"/drake/camera_{i + 1}/body")
        front = X_WB @ [0.0, 0.0, 0.025, 1.0]
        np.testing.assert_allclose(front[:3], camera.p_WC, rtol=0, atol=1e-12)
        np.testing.assert_allclose(X_WB[:3, 2], camera.R_WC[:, 2], rtol=0, atol=1e-12)


@pytest.mark.parametrize("missing", ["time", "peg_q7", "hole_q1"])
def test_a_missing_column_is_named(joints: dict[str, Any], missing: str) -> None:
    full = outcome(joints)
    traces = {name: values for name, values in full.traces.items() if name != missing}
    with pytest.raises(ValueError, match=f"lack the column '{missing}'"):
        replay_alignment(SCENARIO, replace(full, traces=traces), open_meshcat(0))
