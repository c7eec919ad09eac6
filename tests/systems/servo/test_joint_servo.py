"""Joint servos: the exact response of a joint, its limits, and where the tool is."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator

from chamfer.diagrams.cell.controller_design import servo_responses
from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel, ToolParams
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.joint_servo import JointServo

Array = NDArray[np.float64]

STEP = 0.001
_TOLD = ("encoders", "saturated", "motion")
FREE = ServoParams(delay=2, velocity=1e3, acceleration=1e6)
TOOL = ToolParams(mass=0.5, centre_of_mass=(0.0, 0.0, 0.0), inertia=(1e-3, 1e-3, 1e-3))
POSTURE = np.array([0.3, -1.6, -1.9, -1.2, 1.5, 0.4])
BASE = RigidTransform(RollPitchYaw(0.0, 0.0, 0.3), [0.1, -0.2, 0.3])


def courses(
    params: ServoParams,
    reference: RigidTransform | None,
    duration: float,
    *,
    model: str = "ur5e",
    posture: Array = POSTURE,
    true: RigidTransform | None = None,
) -> tuple[Array, Array, Array]:
    """Return joints and their rates, what is saturated, and the motion, a row a step."""
    arm = ArmModel(BASE, TOOL, chosen_arm(model, None))
    start = arm.kinematics(posture)[0]
    none = RigidTransform()
    servo = JointServo(params, arm, posture, step=STEP, rest=start, X_TS=none, true=true or none)
    simulator = Simulator(servo)
    context = simulator.get_mutable_context()
    goal = start if reference is None else start @ reference
    servo.GetInputPort("reference_pose").FixValue(context, pose_vector(goal))
    rows: list[Any] = []
    for k in range(round(duration / STEP)):
        simulator.AdvanceTo((k + 0.5) * STEP)
        rows.append(
            [
                servo.GetOutputPort(name).Eval(context)
                for name in ("encoders", "saturated", "motion")
            ]
        )
    joints, saturated, motion = (np.array(column) for column in zip(*rows, strict=True))
    return joints, saturated, motion


def test_a_joint_follows_as_a_critically_damped_second_order_system() -> None:
    turn = RigidTransform(RollPitchYaw(0.0, 0.0, 0.02), np.zeros(3))  # of the last joint alone
    joints, saturated, _ = courses(FREE, turn, 0.2)
    time = STEP * np.arange(1, len(joints) + 1) - FREE.delay * FREE.period
    w, t = FREE.frequency, np.maximum(time, 0.0)
    left = (1 + w * t) * np.exp(-w * t)
    assert np.allclose(joints[:, 5] - POSTURE[5], 0.02 * (1 - left), atol=1e-7)
    assert np.allclose(joints[:, 11], 0.02 * w * w * t * np.exp(-w * t), atol=1e-5)
    assert not saturated.any()
    # The bandwidth is where the response is down by 3 dB.
    s = 2j * math.pi * FREE.bandwidth
    assert math.isclose(abs(w * w / (s + w) ** 2), math.sqrt(0.5), rel_tol=1e-12)
    # The cameras' compensation is designed for the same response.
    designed = servo_responses(FREE).undelivered[0]
    every = round(FREE.period / STEP)
    assert np.allclose(designed[1:40], left[every - 1 :: every][:39], atol=1e-12)


def test_limits_of_rate_and_acceleration_hold_and_are_told() -> None:
    slow = replace(FREE, velocity=0.05, acceleration=0.5)
    turn = RigidTransform(RollPitchYaw(0.0, 0.0, 0.05), np.zeros(3))
    joints, saturated, _ = courses(slow, turn, 1.6)
    rate = joints[:, 6:]
    assert np.abs(rate).max() <= 0.05 + 1e-12
    assert np.abs(np.diff(rate, axis=0)).max() <= 0.5 * STEP + 1e-12
    assert saturated[200:900, 5].all()
    assert not saturated[-1].any()
    assert math.isclose(joints[-1, 5], POSTURE[5] + 0.05, abs_tol=1e-4)


def test_a_joint_stops_at_the_end_of_its_range() -> None:
    down = RigidTransform([0.0, 0.0, 0.25])  # of which the quill has 0.15 m left
    posture = np.array([-0.6, 1.2, 0.15, 0.0])
    joints, saturated, _ = courses(FREE, down, 0.3, model="scara", posture=posture)
    assert math.isclose(joints[-1, 2], 0.3, abs_tol=1e-12)
    assert abs(joints[-1, 6]) < 1e-12
    assert saturated[-1].tolist() == [0.0, 0.0, 1.0, 0.0]


def test_the_tool_gets_where_it_is_told_and_what_is_unknown_does_not_show() -> None:
    X = RigidTransform(RollPitchYaw(0.05, -0.04, 0.06), [0.01, -0.02, 0.015])
    off = RigidTransform(RollPitchYaw(0.0, 0.01, 0.0), [0.001, 0.0, 0.0])
    joints, _, motion = courses(FREE, X, 0.4)
    other, _, moved = courses(FREE, X, 0.4, true=off)
    arm = ArmModel(BASE, TOOL, chosen_arm("ur5e", None))
    start = arm.kinematics(POSTURE)[0]
    reached = start.inverse() @ arm.kinematics(joints[-1, :6])[0]
    assert reached.IsNearlyEqualTo(X, 1e-5)
    assert np.allclose(motion[-1, 3:6], X.translation(), atol=1e-5)
    assert np.array_equal(joints, other)
    elsewhere = (start.inverse() @ off @ start @ X).translation()
    assert np.allclose(moved[-1, 3:6], elsewhere, atol=1e-5)
    # Rates are those of the displacements.
    middle = (motion[1:, 9:] + motion[:-1, 9:]) / 2
    assert (
        np.abs(np.diff(motion[:, 3:6], axis=0) / STEP - middle).max() < 0.02 * np.abs(middle).max()
    )


def test_a_scara_comes_as_near_as_it_can() -> None:
    posture = np.array([-0.6, 1.2, 0.15, 0.0])
    X = RigidTransform(RollPitchYaw(0.03, 0.0, 0.05), [0.004, -0.003, 0.01])
    _, _, motion = courses(FREE, X, 0.4, model="scara", posture=posture)
    assert np.allclose(motion[-1, :6], [0.0, 0.0, 0.05, 0.004, -0.003, 0.01], atol=1e-4)


def test_what_servos_refuse() -> None:
    for name, value, said in (
        ("rate", 100.0, "rate is 100.0, allowed: a number from 125 to 1000 Hz"),
        ("delay", 0.5, "delay is 0.5, allowed: a whole number of samples, 0 to 20"),
        ("bandwidth", 300.0, "bandwidth is 300.0, allowed: less than half of the rate, 250 Hz"),
        ("acceleration", 0.0, "acceleration is 0.0, allowed: a finite number > 0"),
    ):
        with pytest.raises(ParameterError, match=said):
            ServoParams(**{name: value})  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match="reference pose of the arm at 0 s is"):
        courses(FREE, RigidTransform([math.nan, 0.0, 0.0]), 0.01)
