"""The impedance controller: damping and stability, its law, other arms, what it refuses."""

import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.analysis import Simulator
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel, Placement, ToolParams
from chamfer.systems.force.impedance_controller import ImpedanceController, SpringForce
from chamfer.systems.force.impedance_law import (
    ImpedanceControllerParams,
    gradient,
    rotation_vector,
    stable_damping_ratios,
)
from chamfer.systems.pose import pose_vector

Array = np.ndarray

seeds = st.integers(0, 2**32 - 1)


def one_period(frequency: float, ratio: float, period: float, steps: int) -> float:
    """Spectral radius over a period with the force held and v before x."""
    h = period / steps
    k, d = frequency**2, 2 * ratio * frequency
    columns = []
    for x, v in ((1.0, 0.0), (0.0, 1.0)):
        force = -k * x - d * v
        for _ in range(steps):
            v += h * force
            x += h * v
        columns.append((x, v))
    return float(np.abs(np.linalg.eigvals(np.transpose(columns))).max())


frequencies = st.floats(1.0, 1000.0)
steps = st.sampled_from([1, 2, 3, 50])


@given(frequency=frequencies, part=st.floats(0.02, 0.98), n=steps, product=st.floats(0.01, 1.4))
def test_stable_between_the_bounds(frequency: float, part: float, n: int, product: float) -> None:
    period = product / frequency
    low, high = stable_damping_ratios(frequency, period)
    assert low < high
    assert one_period(frequency, low + part * (high - low), period, n) < 1


@given(frequency=frequencies, excess=st.floats(1.01, 3.0), product=st.floats(0.01, 1.4))
def test_unstable_above_the_upper_bound(frequency: float, excess: float, product: float) -> None:
    period = product / frequency
    _, high = stable_damping_ratios(frequency, period)
    assert one_period(frequency, excess * high, period, 1) > 1
    # With more steps the bound is 2 Lambda/period less a part of the stiffness' share.
    for n in (2, 50):
        exact = (2 - product**2 / (2 * n)) / (2 * product)
        assert one_period(frequency, excess * exact, period, n) > 1
        assert high <= exact


angles = st.floats(0.0, math.pi)


def quaternion(rotation: Rotation) -> Array:
    return np.asarray(rotation.as_quat(scalar_first=True))


def direction(seed: int) -> Array:
    vector = np.random.default_rng(seed).standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, angle=angles, signs=st.tuples(*2 * [st.sampled_from([-1, 1])]))
def test_rotation_vector_in_the_first_axes(
    seed: int, angle: float, signs: tuple[int, int]
) -> None:
    vector = angle * direction(seed)
    start = Rotation.random(rng=np.random.default_rng(seed))
    end = start * Rotation.from_rotvec(vector)
    found = rotation_vector(signs[0] * quaternion(start), signs[1] * quaternion(end))
    assert np.linalg.norm(found) <= math.pi + 1e-12
    if angle < math.pi - 1e-6:
        np.testing.assert_allclose(found, vector, rtol=0, atol=1e-9)
    else:
        turned = (Rotation.from_rotvec(found) * Rotation.from_rotvec(-vector)).magnitude()
        assert turned < 1e-9


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.9e-3, 2.1e-3, 0.3, 1.5, 3.0, math.pi - 1e-6])
def test_moment_is_the_gradient_of_the_energy(angle: float) -> None:
    stiffness = np.array([2.0, 5.0, 11.0])
    vector = angle * direction(3)
    end = Rotation.from_rotvec(vector)

    def energy(turned: Rotation) -> float:
        return float(stiffness @ rotation_vector(np.eye(4)[0], quaternion(turned)) ** 2 / 2)

    step = 1e-6
    # Turned about the axes of the desired pose, in which the moment is told.
    turns = [Rotation.from_rotvec(step * axis) for axis in np.eye(3)]
    slope = [(energy(turn * end) - energy(turn.inv() * end)) / (2 * step) for turn in turns]
    if angle < math.pi - 1e-5:
        np.testing.assert_allclose(gradient(vector, stiffness * vector), slope, rtol=0, atol=1e-7)
    assert np.isfinite(gradient(vector, stiffness * vector)).all()


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
    result = controller.law.torque(np.array([1.0, 0, 0, 0, 0, 0, 0]), *inputs)
    return result[:7], result[7:14], result[14:]


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
    wrench = np.concatenate([moment, force]) + CONTROLLER.law.damping @ local
    wrench = np.concatenate([R_WD.apply(wrench[:3]), R_WD.apply(wrench[3:])])
    # The null space has one direction.
    free = null_space(J)[:, 0]
    inertia = free @ mass @ free
    own_motion = free * (free @ mass @ v) / inertia
    pull = UNEQUAL.null_stiffness * (BENT - q) - CONTROLLER.law.null_damping * own_motion
    null = mass @ free * (free @ pull) / inertia
    torque, tool_pose, saturated = step(CONTROLLER, encoders, desired, velocity)
    np.testing.assert_allclose(torque, gravity - J.T @ wrench + null, rtol=0, atol=2e-3)
    np.testing.assert_allclose(np.abs(tool_pose), np.abs(pose_vector(X_WT)), rtol=0, atol=1e-12)
    assert not np.any(saturated)


def test_damping_and_inertia_of_the_design() -> None:
    rest = MODEL.evaluate(BENT)
    R = rest.X_WT.rotation().matrix()
    J = np.vstack([R.T @ rest.J_V_WT[:3], R.T @ rest.J_V_WT[3:]])
    inverse = J @ np.linalg.inv(rest.mass) @ J.T
    np.testing.assert_allclose(CONTROLLER.law.inertia @ inverse, np.eye(6), rtol=0, atol=1e-9)
    stiffness = np.diag([*UNEQUAL.rotational_stiffness, *UNEQUAL.stiffness])
    system = np.block(
        [[np.zeros((6, 6)), np.eye(6)], [-inverse @ stiffness, -inverse @ CONTROLLER.law.damping]]
    )
    poles = np.linalg.eigvals(system)
    np.testing.assert_allclose(-poles.real / np.abs(poles), 0.7, rtol=1e-5)
    found = np.sort(np.abs(poles))[::2]
    np.testing.assert_allclose(CONTROLLER.law.frequencies, found, rtol=1e-6)
    np.testing.assert_allclose(
        CONTROLLER.law.damping, CONTROLLER.law.damping.T, rtol=1e-9, atol=1e-9
    )
    free = null_space(rest.J_V_WT)[:, 0]
    null_inertia = free @ rest.mass @ free
    expected = 2 * 0.7 * math.sqrt(UNEQUAL.null_stiffness * null_inertia)
    assert CONTROLLER.law.null_damping == pytest.approx(expected, rel=1e-9)


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


def test_quaternion_goes_through_half_a_turn_without_a_jump() -> None:
    model = ArmModel(Placement(rpy=(0.0, 0.0, 2.5)).transform, TOOL)
    controller = ImpedanceController(model, BENT, ImpedanceControllerParams())
    rest = pose_vector(model.evaluate(BENT).X_WT)
    last, poses = rest, []
    for angle in np.linspace(2.5, -2.5, 500):  # the whole arm turns about its base
        q = np.array([angle, *BENT[1:]])
        last = controller.law.torque(last, np.concatenate([q, np.zeros(7)]), rest)[7:14]
        poses.append(last)
    quaternions = np.array(poses)[:, :4]
    assert np.abs(np.diff(quaternions, axis=0)).max() < 0.01
    scalar = quaternions[:, 0]
    assert scalar.min() < -0.1
    assert scalar.max() > 0.1
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1, rtol=0, atol=1e-12)


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


def read(simulator: Simulator, name: str) -> Array:
    port = simulator.get_system().GetOutputPort(name)
    return np.array(port.Eval(simulator.get_context()))


def start(params: ImpedanceControllerParams, **inputs: Array) -> Simulator:
    controller = ImpedanceController(MODEL, BENT, params)
    simulator = Simulator(controller)
    for name, value in inputs.items():
        controller.GetInputPort(name).FixValue(simulator.get_mutable_context(), value)
    return simulator


def test_outputs_are_the_law_and_held_over_a_period() -> None:
    encoders, desired, velocity = scene(4)
    simulator = start(UNEQUAL, encoders=encoders, desired_pose=desired, desired_velocity=velocity)
    rest = MODEL.evaluate(BENT)
    np.testing.assert_allclose(read(simulator, "torque"), rest.gravity, rtol=0, atol=1e-12)
    at_rest = pose_vector(rest.X_WT)
    np.testing.assert_allclose(read(simulator, "tool_pose"), at_rest, rtol=0, atol=1e-15)
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


@pytest.mark.parametrize("quaternion", [0.0, 1e-200])
def test_desired_quaternion_must_not_be_zero(quaternion: float) -> None:
    pose = pose_vector(MODEL.evaluate(BENT).X_WT)
    pose[:4] = quaternion
    simulator = start(
        UNEQUAL,
        encoders=np.append(BENT, np.zeros(7)),
        desired_pose=pose,
        desired_velocity=np.zeros(6),
    )
    message = r"^desired_pose is \[.*, allowed: a quaternion that is not zero$"
    with pytest.raises(ParameterError, match=message):
        simulator.AdvanceTo(0.001)


def at_bound(side: int, factor: float, period: float) -> Callable[[], ImpedanceController]:
    params = ImpedanceControllerParams(period=period)
    fastest = ImpedanceController(MODEL, BENT, params).law.frequencies[-1]
    ratio = factor * stable_damping_ratios(float(fastest), period)[side]
    return lambda: ImpedanceController(
        MODEL, BENT, ImpedanceControllerParams(period=period, damping_ratio=ratio)
    )


@pytest.mark.parametrize("period", [0.001, 0.01])
def test_damping_has_to_be_stable(period: float) -> None:
    at_bound(1, 0.999, period)()
    at_bound(0, 1.001, period)()
    for side, factor in ((1, 1.001), (0, 0.999)):
        with pytest.raises(ParameterError) as caught:
            at_bound(side, factor, period)()
        assert re.match(
            r"^damping_ratio is [\d.]+, allowed: more than [\d.]+ and less than [\d.]+ for a mode "
            rf"of \d+ rad/s and a period of {period:g} s \(damping below 2 Lambda/period\)$",
            str(caught.value),
        )


def test_unstable_if_asked_for() -> None:
    params = ImpedanceControllerParams(damping_ratio=50.0, period=0.05, allow_unstable=True)
    assert ImpedanceController(MODEL, BENT, params).law.damping.max() > 0


REGULAR = r"allowed: joint positions at which the .* is 0.05 or more$"
RANGES = r"allowed: between \(-2.6"


@pytest.mark.parametrize(
    ("q", "changes", "message"),
    [
        (BENT, {"period": 0.02}, r"period is 0.02, allowed: less than 0.01\d* s for"),
        (BENT, {"null_damping_ratio": 300.0}, "null_damping_ratio is 300.0, allowed: more than"),
        (0 * BENT, {}, rf"rest posture is \(.*\), {REGULAR}"),
        (BENT * [1, 0, 1, 1, 1, 0, 1], {}, rf"rest posture is \(.*\), {REGULAR}"),
        (BENT + 3, {}, rf"rest posture is \(.*\), {RANGES}"),
        (BENT * np.nan, {}, rf"rest posture is \(.*\), {RANGES}"),
        (BENT[:6], {}, rf"rest posture is \(.*\), {RANGES}"),
    ],
)
def test_what_is_refused(q: Array, changes: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}"):
        ImpedanceController(MODEL, q, ImpedanceControllerParams(**changes))  # type: ignore[arg-type]


FILE = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
LONG_TOOL = ToolParams(
    mass=0.4,
    centre_of_mass=(-0.05, 0.02, 0.01),
    inertia=(1e-3, 1e-3, 1e-3),
    frame=Placement(position=(0.0, 0.0, 0.1), rpy=(0.0, -1.2, 0.4)),
)
BASE = Placement(position=(0.3, -0.2, 0.1), rpy=(0.1, -0.2, 2.5)).transform
BENT_SIX = np.array([0.2, 0.5, 1.2, -0.6, 0.7, 0.3])


@pytest.fixture(scope="module")
def eight(tmp_path_factory: pytest.TempPathFactory) -> ArmModel:
    text = FILE.read_text(encoding="utf-8")
    for name in ("column", "neck"):
        text = text.replace(f'name="{name}" type="fixed"', f'name="{name}" type="revolute"')
    path = tmp_path_factory.mktemp("arm") / "eight.urdf"
    path.write_text(text, encoding="utf-8")
    return ArmModel(BASE, LONG_TOOL, chosen_arm(str(path), None))


def test_eight_joints_go_to_their_rest_posture_without_moving_the_tool(eight: ArmModel) -> None:
    posture = np.insert(BENT_SIX, [0, 4], [0.1, 0.2])
    params = ImpedanceControllerParams(torque_limits=(1e6,) * 8, null_stiffness=8.0)
    controller = ImpedanceController(eight, posture, params)
    q = posture + np.linspace(-0.3, 0.3, 8)
    now = eight.evaluate(q)
    here = pose_vector(now.X_WT)
    result = controller.law.torque(here, np.append(q, np.zeros(8)), here)
    null = result[:8] - now.gravity
    acceleration = np.linalg.solve(now.mass, null)
    straight = np.linalg.solve(now.mass, 8.0 * (posture - q))
    moved = np.linalg.norm(now.J_V_WT @ acceleration) / np.linalg.norm(now.J_V_WT @ straight)
    assert moved < 1e-4
    assert acceleration @ (posture - q) > 1.0  # towards the rest posture


STIFFNESS = (100.0, 200.0, 400.0)
R_WD = RollPitchYaw(0.1, -0.2, 0.3).ToRotationMatrix()
R_WM = RollPitchYaw(-0.2, 0.1, 0.5).ToRotationMatrix()
P_WD = np.array([0.1, 0.2, 0.3])


def springs(p_WT: np.ndarray, p_WM: np.ndarray) -> tuple[np.ndarray, float]:
    block = SpringForce(STIFFNESS)
    context = block.CreateDefaultContext()
    for name, R, p in (
        ("command", R_WD, P_WD),
        ("tool_pose", RotationMatrix(), p_WT),
        ("hole_pose", R_WM, p_WM),
    ):
        block.GetInputPort(name).FixValue(context, pose_vector(RigidTransform(R, p)))
    force = block.GetOutputPort("force").Eval(context)
    return force, float(block.GetOutputPort("advance").Eval(context)[0])


def test_the_springs_are_along_the_commands_axes_the_force_along_the_holes() -> None:
    off = np.array([0.01, -0.02, 0.005])  # in the command's axes
    force, _ = springs(P_WD - R_WD @ off, np.zeros(3))
    expected = R_WM.inverse() @ (R_WD @ (np.array(STIFFNESS) * off))
    assert force == pytest.approx(expected)


def test_the_advance_is_along_the_holes_axis() -> None:
    p_WM = np.array([0.5, 0.0, 0.1])
    _, advance = springs(p_WM + R_WM @ np.array([-0.03, 0.004, 0.002]), p_WM)
    assert advance == pytest.approx(-0.03)
