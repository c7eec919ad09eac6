"""The impedance controller: its law, singular poses, and the block."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from chamfer.models.arms import wam
from chamfer.systems.force.arm_model import ArmModel, Placement, ToolParams
from chamfer.systems.force.impedance_controller import (
    ImpedanceController,
    ImpedanceControllerParams,
)
from chamfer.systems.pose import pose_vector

Array = np.ndarray

TOOL = ToolParams(
    mass=0.3,
    centre_of_mass=(-0.06, 0.01, 0.0),
    inertia=(1e-4, 3e-4, 3e-4),
    frame=Placement(position=(0.0, 0.01, 0.1), rpy=(0.2, -1.3, 0.1)),
)
MODEL = ArmModel(Placement(position=(-0.8, 0.1, 0.0), rpy=(0.0, 0.0, 0.3)).transform, TOOL)
BENT = np.array([0.2, 0.7, -0.3, 1.7, 0.2, -0.9, 0.4])
UNEQUAL = ImpedanceControllerParams(
    stiffness=(300.0, 500.0, 700.0),
    rotational_stiffness=(3.0, 5.0, 8.0),
    null_stiffness=6.0,
    torque_limits=(1e6,) * 7,
)
CONTROLLER = ImpedanceController(MODEL, BENT, UNEQUAL)
FREE_ELBOW, STIFF_ELBOW = (
    ImpedanceController(MODEL, BENT, replace(UNEQUAL, null_stiffness=stiffness))
    for stiffness in (0.0, 20.0)
)
PORTS = {"encoders": 14, "desired_pose": 7, "desired_velocity": 6}


def pose_of(rotation: Rotation, position: Array) -> Array:
    return np.concatenate([rotation.as_quat(scalar_first=True), position])


def scene(seed: int, turn: float = 0.4) -> tuple[Array, Array, Array]:
    """Encoders, desired pose and velocity, away from each other."""
    rng = np.random.default_rng(seed)
    q = BENT + rng.uniform(-0.2, 0.2, 7)
    X_WT = MODEL.evaluate(q).X_WT
    turned = Rotation.from_matrix(X_WT.rotation().matrix()) * Rotation.from_rotvec(
        turn * rng.uniform(-1, 1, 3)
    )
    desired = pose_of(turned, X_WT.translation() + rng.uniform(-0.1, 0.1, 3))
    return np.concatenate([q, rng.uniform(-1, 1, 7)]), desired, rng.uniform(-1, 1, 6)


def step(controller: ImpedanceController, *inputs: Array) -> tuple[Array, Array, Array]:
    result = controller.step(np.array([1.0, 0, 0, 0, 0, 0, 0]), *inputs)
    return result[:7], result[7:14], result[14:]


# The law


@settings(deadline=None)  # the first call compiles
@given(seed=st.integers(0, 2**32 - 1))
def test_torque_is_that_of_equation_1(seed: int) -> None:
    encoders, desired, velocity = scene(seed)
    q, v = encoders[:7], encoders[7:]
    X_WT, J, mass, gravity = MODEL.evaluate(q)
    R_WD = Rotation.from_quat(desired[:4], scalar_first=True)
    R_WT = Rotation.from_matrix(X_WT.rotation().matrix())
    slip = J @ v - velocity
    force = np.array(UNEQUAL.stiffness) * R_WD.inv().apply(X_WT.translation() - desired[4:])
    theta = (R_WD.inv() * R_WT).as_rotvec()
    # To third order in the angle.
    moment = np.array(UNEQUAL.rotational_stiffness) * theta
    moment = (
        moment
        + np.cross(theta, moment) / 2
        + np.cross(theta, np.cross(theta, moment)) * (1 / 12 + theta @ theta / 720)
    )
    local = np.concatenate([R_WD.inv().apply(slip[:3]), R_WD.inv().apply(slip[3:])])
    wrench = np.concatenate([moment, force]) + CONTROLLER.damping @ local
    wrench = np.concatenate([R_WD.apply(wrench[:3]), R_WD.apply(wrench[3:])])
    # The null space has one direction.
    free = null_space(J)[:, 0]
    inertia = free @ mass @ free
    own_motion = free * (free @ mass @ v) / inertia
    pull = UNEQUAL.null_stiffness * (BENT - q) - CONTROLLER.null_damping * own_motion
    null = mass @ free * (free @ pull) / inertia
    torque, tool_pose, saturated = step(CONTROLLER, encoders, desired, velocity)
    np.testing.assert_allclose(torque, gravity - J.T @ wrench + null, rtol=0, atol=2e-3)
    np.testing.assert_allclose(np.abs(tool_pose), np.abs(pose_vector(X_WT)), rtol=0, atol=1e-12)
    assert not np.any(saturated)


def test_arm_is_only_held_at_its_rest_posture() -> None:
    rest = MODEL.evaluate(BENT)
    torque, tool_pose, _ = step(
        CONTROLLER, np.concatenate([BENT, np.zeros(7)]), pose_vector(rest.X_WT)
    )
    np.testing.assert_allclose(torque, rest.gravity, rtol=0, atol=1e-10)
    np.testing.assert_allclose(tool_pose, pose_vector(rest.X_WT), rtol=0, atol=1e-12)


@pytest.mark.parametrize("factor", [-1.0, 3.0, 1e-3])
def test_length_and_sign_of_the_desired_quaternion_do_not_matter(factor: float) -> None:
    encoders, desired, velocity = scene(1)
    other = np.concatenate([factor * desired[:4], desired[4:]])
    expected = step(CONTROLLER, encoders, desired, velocity)[0]
    found = step(CONTROLLER, encoders, other, velocity)[0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), turn=st.floats(0.0, 10.0))
def test_null_space_torque_does_not_accelerate_the_tool(seed: int, turn: float) -> None:
    encoders, desired, velocity = scene(seed, turn)
    q = encoders[:7]
    _, J, mass, _ = MODEL.evaluate(q)
    free = null_space(J)[:, 0]
    inputs = (encoders, desired, velocity)
    extra = step(STIFF_ELBOW, *inputs)[0] - step(FREE_ELBOW, *inputs)[0]
    acceleration = np.linalg.solve(mass, extra)
    own_motion = free * (free @ mass @ encoders[7:]) / (free @ mass @ free)
    pull = 20.0 * (BENT - q) - STIFF_ELBOW.null_damping * own_motion
    unprojected = J @ np.linalg.solve(mass, pull)
    assert np.abs(J @ acceleration).max() < 1e-4 * np.abs(unprojected).max()
    tolerance = 1e-4 * float(np.linalg.norm(pull))
    assert free @ mass @ acceleration == pytest.approx(free @ pull, rel=0, abs=tolerance)


def test_damping_and_inertia_of_the_design() -> None:
    rest = MODEL.evaluate(BENT)
    R = rest.X_WT.rotation().matrix()
    J = np.vstack([R.T @ rest.J_V_WT[:3], R.T @ rest.J_V_WT[3:]])
    inverse = J @ np.linalg.inv(rest.mass) @ J.T
    np.testing.assert_allclose(CONTROLLER.inertia @ inverse, np.eye(6), rtol=0, atol=1e-9)
    stiffness = np.diag([*UNEQUAL.rotational_stiffness, *UNEQUAL.stiffness])
    system = np.block(
        [[np.zeros((6, 6)), np.eye(6)], [-inverse @ stiffness, -inverse @ CONTROLLER.damping]]
    )
    poles = np.linalg.eigvals(system)
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.7, rtol=1e-5)
    found = np.sort(np.abs(poles))[::2]
    np.testing.assert_allclose(CONTROLLER.frequencies, found, rtol=1e-6)
    free = null_space(rest.J_V_WT)[:, 0]
    null_inertia = free @ rest.mass @ free
    expected = 2 * 0.7 * math.sqrt(UNEQUAL.null_stiffness * null_inertia)
    assert CONTROLLER.null_damping == pytest.approx(expected, rel=1e-9)


# Limits, half turns, singular poses


def test_torque_is_limited() -> None:
    limits = (3.0, 4.0, 2.0, 1.0, 0.5, 0.4, 0.02)
    controller = ImpedanceController(
        MODEL, BENT, ImpedanceControllerParams(torque_limits=limits, null_stiffness=0.0)
    )
    free = ImpedanceController(
        MODEL, BENT, ImpedanceControllerParams(torque_limits=(1e6,) * 7, null_stiffness=0.0)
    )
    seen = set()
    for seed in range(20):
        inputs = scene(seed)
        wanted = step(free, *inputs)[0]
        torque, _, saturated = step(controller, *inputs)
        np.testing.assert_array_equal(torque, np.clip(wanted, -np.array(limits), limits))
        np.testing.assert_array_equal(saturated, np.sign(wanted) * (np.abs(wanted) > limits))
        seen |= set(saturated)
    assert seen == {-1.0, 0.0, 1.0}


def test_limits_of_the_arm_are_the_default() -> None:
    np.testing.assert_array_equal(ImpedanceControllerParams().limits(wam.WAM), wam.TORQUE_LIMITS)


def test_quaternion_goes_through_half_a_turn_without_a_jump() -> None:
    model = ArmModel(Placement(rpy=(0.0, 0.0, 2.5)).transform, TOOL)
    controller = ImpedanceController(model, BENT, ImpedanceControllerParams())
    rest = pose_vector(model.evaluate(BENT).X_WT)
    last, poses = rest, []
    for angle in np.linspace(2.5, -2.5, 500):  # the whole arm turns about its base
        q = np.array([angle, *BENT[1:]])
        last = controller.step(last, np.concatenate([q, np.zeros(7)]), rest)[7:14]
        poses.append(last)
    quaternions = np.array(poses)[:, :4]
    assert np.abs(np.diff(quaternions, axis=0)).max() < 0.01
    scalar = quaternions[:, 0]
    assert scalar.min() < -0.1
    assert scalar.max() > 0.1
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1, rtol=0, atol=1e-12)


def test_torque_up_to_half_a_turn() -> None:
    q = np.concatenate([BENT, np.zeros(7)])
    X_WT = MODEL.evaluate(BENT).X_WT
    R_WT = Rotation.from_matrix(X_WT.rotation().matrix())
    params = ImpedanceControllerParams(torque_limits=(1e3,) * 7)
    controller = ImpedanceController(MODEL, BENT, params)
    J = MODEL.evaluate(BENT).J_V_WT
    for angle in (0.5, 2.0, 3.1, math.pi):
        desired = pose_of(R_WT * Rotation.from_rotvec([0, 0, -angle]), X_WT.translation())
        torque = step(controller, q, desired)[0] - MODEL.evaluate(BENT).gravity
        moment, *_ = np.linalg.lstsq(-J.T, torque, rcond=None)
        assert np.linalg.norm(moment[:3]) == pytest.approx(5.0 * angle, rel=1e-6)


SINGULAR = {
    "upright": np.zeros(7),
    "elbow straight": BENT * [1, 1, 1, 0, 1, 1, 1],
    "wrist straight": BENT * [1, 1, 1, 1, 1, 0, 1],
    "shoulder and wrist straight": BENT * [1, 0, 1, 1, 1, 0, 1],
}


@pytest.mark.parametrize("name", SINGULAR)
def test_singular_poses_give_finite_torques(name: str) -> None:
    desired = pose_vector(MODEL.evaluate(BENT).X_WT)
    controller = ImpedanceController(MODEL, BENT, UNEQUAL)
    torques = []
    for offset in (0.0, 1e-9, 1e-6, 1e-3):
        encoders = np.concatenate([SINGULAR[name] + offset, np.full(7, 0.5)])
        torque, _, _ = step(controller, encoders, desired)
        torques.append(torque)
        assert np.isfinite(torque).all()
        assert np.abs(torque).max() < 1500
    # No jump where the arm is singular.
    assert np.abs(np.diff(torques[:3], axis=0)).max() < 0.1


# The block


def read(simulator: Simulator, name: str) -> Array:
    port = simulator.get_system().GetOutputPort(name)
    return np.array(port.Eval(simulator.get_context()))


def start(params: ImpedanceControllerParams, **inputs: Array) -> Simulator:
    controller = ImpedanceController(MODEL, BENT, params)
    simulator = Simulator(controller)
    for name, value in inputs.items():
        controller.GetInputPort(name).FixValue(simulator.get_mutable_context(), value)
    return simulator


def test_ports() -> None:
    inputs = {
        CONTROLLER.get_input_port(i).get_name(): CONTROLLER.get_input_port(i).size()
        for i in range(CONTROLLER.num_input_ports())
    }
    assert inputs == PORTS
    outputs = [
        (CONTROLLER.get_output_port(i).get_name(), CONTROLLER.get_output_port(i).size())
        for i in range(CONTROLLER.num_output_ports())
    ]
    assert outputs == [("torque", 7), ("tool_pose", 7), ("saturated", 7)]
    assert not CONTROLLER.HasAnyDirectFeedthrough()


def test_outputs_are_the_law_and_held_over_a_period() -> None:
    encoders, desired, velocity = scene(4)
    simulator = start(UNEQUAL, encoders=encoders, desired_pose=desired, desired_velocity=velocity)
    rest = MODEL.evaluate(BENT)
    np.testing.assert_allclose(read(simulator, "torque"), rest.gravity, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(read(simulator, "tool_pose"), pose_vector(rest.X_WT))
    simulator.Initialize()  # before the first period
    torque, tool_pose, saturated = step(CONTROLLER, encoders, desired, velocity)
    np.testing.assert_array_equal(read(simulator, "torque"), torque)
    simulator.AdvanceTo(0.0005)
    np.testing.assert_array_equal(read(simulator, "torque"), torque)
    np.testing.assert_allclose(read(simulator, "tool_pose"), tool_pose, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(read(simulator, "saturated"), saturated)
    other = encoders + 0.01
    port = simulator.get_system().GetInputPort("encoders")
    port.FixValue(simulator.get_mutable_context(), other)
    simulator.AdvanceTo(0.0019)
    np.testing.assert_array_equal(read(simulator, "torque"), torque)
    simulator.AdvanceTo(0.0021)
    np.testing.assert_array_equal(
        read(simulator, "torque"), step(CONTROLLER, other, desired, velocity)[0]
    )


def test_desired_velocity_is_zero_if_not_connected() -> None:
    encoders, desired, _ = scene(5)
    simulator = start(UNEQUAL, encoders=encoders, desired_pose=desired)
    simulator.AdvanceTo(0.001)
    expected = step(CONTROLLER, encoders, desired, np.zeros(6))[0]
    np.testing.assert_array_equal(read(simulator, "torque"), expected)
