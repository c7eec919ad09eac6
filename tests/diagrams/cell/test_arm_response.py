"""An arm's answer to a step of its commanded pose against the impedance it should have."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial
from scipy.spatial.transform import Rotation

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.cell.controller_design import step_responses
from chamfer.diagrams.cell.work_cell import (
    ARMS,
    HOLE_ARM,
    PEG_ARM,
    ArmName,
    WorkCellScenario,
    add_work_cell,
)
from chamfer.systems.force.compensated_pose import compensate
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.image_plane_error import AXES

Array = np.ndarray

PERIOD = 1 / 80
BEGIN, LONG = 0.1, 1.5  # s
KNOWN = {"payload_error": 0.0, "joint_friction": (0.0,) * 7}
CELL = WorkCellScenario(peg=replace(PEG_ARM, **KNOWN), hole=replace(HOLE_ARM, **KNOWN))
SEEN = ["x", "y", "z", "pitch", "yaw"]


def angular_first(axis: str) -> int:
    """Where an axis of AXES is in a spatial vector."""
    return (AXES.index(axis) + 3) % 6


def step_of(axis: str) -> float:
    return 1e-3 if axis in "xyz" else 1e-2  # m, rad


@lru_cache
def answer(arm: ArmName, axis: str, scenario: WorkCellScenario = CELL) -> Array:
    """How far the tool has moved and turned, shape (n, 6), angular first, a row a period."""
    builder = DiagramBuilder()
    ports = add_work_cell(builder, scenario, arms=(arm,)).arms[arm]
    before = pose_vector(scenario.nominal_pose(arm))
    moved = np.reshape(step_of(axis) * np.eye(len(AXES))[AXES.index(axis)], (2, 3))
    after = compensate(before, (moved @ scenario.hole_axes.matrix().T).ravel())
    begin = round(BEGIN / PERIOD) * PERIOD
    poses = np.column_stack([before, after, after])
    step = PiecewisePolynomial.ZeroOrderHold([0.0, begin, 2 * begin], poses)
    command = builder.AddNamedSystem("command", TrajectorySource(step))
    builder.Connect(command.get_output_port(), ports.desired_pose)
    builder.ExportOutput(ports.true_pose, "true_pose")
    diagram = builder.Build()
    pose = simulate(diagram, duration=BEGIN + LONG, step=PERIOD).outputs["true_pose"]
    turned = Rotation.from_quat(pose[:, :4], scalar_first=True)
    return np.column_stack([(turned * turned[0].inv()).as_rotvec(), pose[:, 4:] - pose[0, 4:]])


@pytest.mark.parametrize(("arm", "axis"), [*(("peg", axis) for axis in SEEN), ("hole", "yaw")])
def test_the_linear_response_is_the_simulated_one(arm: ArmName, axis: str) -> None:
    first, k = round(BEGIN / PERIOD), angular_first(axis)
    simulated = answer(arm, axis)[first + 1 :, k]
    linear = step_responses(CELL, arm)
    gain = linear.gain[AXES.index(axis)]
    assert gain == pytest.approx(1, abs=2e-3)
    expected = step_of(axis) * gain * (1 - linear.sampled(axis, PERIOD))
    count = min(len(expected), len(simulated))
    assert count > 80
    # Every fourth instant is one at which the arm steps, before or after it is looked at.
    sure = np.arange(1, count + 1) % 4 > 0
    off = np.abs(simulated[:count] - expected[:count])
    assert off[sure].max() < 3e-3 * step_of(axis)  # 1 mm and 10 mrad are not quite small
    assert off.max() < 5e-2 * step_of(axis)
    # By one period of the controller off it would be another one.
    assert np.abs(np.diff(linear.undelivered[AXES.index(axis)])).max() > 8e-3


def test_a_linear_response_is_of_the_arm_as_it_is_loaded() -> None:
    heavy = replace(CELL, peg=replace(CELL.peg, payload_error=0.5), hole=HOLE_ARM)
    usual, loaded = (step_responses(one, "peg").sampled("z", PERIOD) for one in (CELL, heavy))
    count = min(len(usual), len(loaded))
    assert np.abs(usual[:count] - loaded[:count]).max() > 0.02
    # What the other arm is, and dry friction, make no difference.
    assert step_responses(replace(CELL, hole=HOLE_ARM), "peg") is step_responses(CELL, "peg")
    rough = replace(CELL, peg=replace(CELL.peg, joint_friction=(0.1,) * 7))
    assert step_responses(rough, "peg") is step_responses(CELL, "peg")


def test_a_linear_response_lasts_until_the_arm_rests() -> None:
    for arm in ARMS:
        left = step_responses(CELL, arm).undelivered
        assert np.abs(left[:, -1]).max() < 1e-4
        np.testing.assert_allclose(left[:, 0], 1.0, atol=1e-6)
