"""The WAM's kinematics, and its URDF against the table it was written from."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from chamfer.models.arms import wam
from chamfer.models.arms.wam import WAM
from chamfer.models.validation import ParameterError

Array = np.ndarray

# The reference table once more: alpha/pi, a and d (m), mass (kg), centre of mass (mm), inertia
# about it (Ixx, Iyy, Izz, Ixy, Ixz, Iyz, 1e-6 kg m^2), range (rad), torque (N m), and reflected
# inertia (kg m^2).
TABLE = [
    (-0.5, 0, 0, 10.7677, (-4.43, 121.89, -0.66),
     (134880, 113284, 90463, -2130.4, -124.9, 685.6), (-2.6, 2.6), 77.3, 0.20517),
    (0.5, 0, 0, 3.8749, (-2.37, 31.06, 15.42),
     (21409.6, 13778.8, 15589.1, 271.7, 24.6, -1819.2), (-2.0, 2.0), 160.6, 0.18884),
    (-0.5, 0.045, 0.55, 1.8023, (-38.26, 207.51, 0.03),
     (59110.8, 3245.5, 59270.4, -2496.1, 7.4, -17.7), (-2.8, 2.8), 95.6, 0.06691),
    (0.5, -0.045, 0, 2.17266, (5.534, 0.068, 119.277),
     (10674.9, 10586.6, 2820.4, 45.0, -1355.6, -110.0), (-0.9, 3.1), 29.4, 0.03462),
    (-0.5, 0, 0.3, 0.35656, (0.055, 28.863, 1.485),
     (371.1, 194.3, 382.1, -0.1, 0, -16.1), (-4.76, 1.24), 11.6, 0.00323),
    (0.5, 0, 0, 0.40916, (-0.059, -16.861, 24.191),
     (548.9, 238.5, 451.3, 0.2, -0.1, -44.3), (-1.6, 1.6), 11.6, 0.00323),
    (0, 0, 0.0609, 0.07548, (0.148, 0.073, -3.352),
     (39.1, 38.8, 76.1, 0.2, 0, 0), (-3.0, 3.0), 2.7, 0.000317),
]  # fmt: skip
ALPHA, A, D, MASS, COM, INERTIA, RANGE, TORQUE, ROTOR = zip(*TABLE, strict=True)
GRAVITY = 9.81

joints = st.tuples(*(st.floats(low, high) for low, high in RANGE)).map(np.array)


def turn(axis: int, angle: complex) -> Array:
    T = np.eye(4, dtype=complex)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    T[i, i] = T[j, j] = np.cos(angle)
    T[i, j], T[j, i] = -np.sin(angle), np.sin(angle)
    return T


def shift(axis: int, distance: float) -> Array:
    T = np.eye(4, dtype=complex)
    T[axis, 3] = distance
    return T


def frames(q: Array) -> list[Array]:
    """Denavit-Hartenberg frames 1 to 7 in the base."""
    found, T = [], np.eye(4, dtype=complex)
    for i in range(7):
        T = T @ turn(2, q[i]) @ shift(2, D[i]) @ shift(0, A[i]) @ turn(0, ALPHA[i] * np.pi)
        found.append(T)
    return found


def centers(q: Array) -> Array:
    """Centres of mass, m, shape (7, 3)."""
    return np.array(
        [T[:3, :3] @ np.array(c) / 1000 + T[:3, 3] for T, c in zip(frames(q), COM, strict=True)]
    )


def central(values: tuple[float, ...]) -> Array:
    xx, yy, zz, xy, xz, yz = values
    return 1e-6 * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def steps(q: Array) -> list[Array]:
    return [q + 1e-30j * axis for axis in np.eye(7)]


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(wam.URDF))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


@pytest.fixture(scope="module")
def context(plant: MultibodyPlant) -> Context:
    return plant.CreateDefaultContext()


@given(q=joints)
def test_pose_and_jacobian_are_those_of_the_urdf(
    plant: MultibodyPlant, context: Context, q: Array
) -> None:
    plant.SetPositions(context, q)
    R, p = wam.pose(q)
    flange, world = plant.GetFrameByName("flange"), plant.world_frame()
    X = flange.CalcPoseInWorld(context)
    np.testing.assert_allclose(R, X.rotation().matrix(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(p, X.translation(), rtol=0, atol=1e-12)
    J = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, flange, np.zeros(3), world, world
    )
    np.testing.assert_allclose(wam.jacobian(q), J, rtol=0, atol=1e-12)


@given(q=joints)
def test_gravity_torque_is_the_gradient_of_the_potential(
    plant: MultibodyPlant, context: Context, q: Array
) -> None:
    plant.SetPositions(context, q)
    energy = [GRAVITY * float(np.array(MASS) @ centers(s)[:, 2].imag) / 1e-30 for s in steps(q)]
    held = -plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(held, energy, rtol=0, atol=1e-9)


@given(q=joints)
def test_mass_matrix_is_that_of_the_table(
    plant: MultibodyPlant, context: Context, q: Array
) -> None:
    linear = np.array([centers(s).imag / 1e-30 for s in steps(q)])  # (joint, link, 3)
    expected = np.diag(ROTOR)
    stepped = [frames(s) for s in steps(q)]
    for i, T in enumerate(frames(q)):
        R = T[:3, :3].real
        spins = [s[i][:3, :3].imag / 1e-30 @ R.T for s in stepped]
        angular = np.array([[s[2, 1], s[0, 2], s[1, 0]] for s in spins])
        expected = expected + MASS[i] * linear[:, i] @ linear[:, i].T
        expected = expected + angular @ (R @ central(INERTIA[i]) @ R.T) @ angular.T
    plant.SetPositions(context, q)
    found = plant.CalcMassMatrix(context)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    assert np.linalg.eigvalsh(found).min() > 3e-4


def test_masses_limits_and_motors(plant: MultibodyPlant, context: Context) -> None:
    assert plant.CalcTotalMass(context) == pytest.approx(sum(MASS), abs=1e-12)
    low, high = np.transpose(RANGE)
    np.testing.assert_array_equal(plant.GetPositionLowerLimits(), low)
    np.testing.assert_array_equal(plant.GetPositionUpperLimits(), high)
    np.testing.assert_array_equal(plant.GetEffortUpperLimits(), TORQUE)
    np.testing.assert_array_equal([wam.LOWER_LIMITS, wam.UPPER_LIMITS], [low, high])
    assert wam.TORQUE_LIMITS == TORQUE
    assert wam.REFLECTED_INERTIAS == ROTOR
    for i, name in enumerate(wam.JOINT_NAMES):
        actuator = plant.GetJointActuatorByName(f"{name}_motor")
        assert actuator.joint().name() == name
        assert actuator.input_start() == i
        assert actuator.default_reflected_inertia() == ROTOR[i]
        assert plant.GetJointByName(name).position_start() == i


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.03])
def test_scaled_masses(plant: MultibodyPlant, context: Context, scale: float) -> None:
    heavier = MultibodyPlant(0.0)
    Parser(heavier).AddModelsFromString(WAM.urdf_text(scale), "urdf")
    heavier.WeldFrames(heavier.world_frame(), heavier.GetFrameByName("base"))
    heavier.Finalize()
    q = np.linspace(-0.8, 0.9, 7)
    other = heavier.CreateDefaultContext()
    heavier.SetPositions(other, q)
    plant.SetPositions(context, q)
    rotors = np.diag(ROTOR)
    np.testing.assert_allclose(
        heavier.CalcMassMatrix(other) - rotors,
        scale * (plant.CalcMassMatrix(context) - rotors),
        rtol=0,
        atol=1e-12,
    )


BENT = np.array([0.2, 0.7, -0.3, 1.7, 0.2, -0.9, 0.4])
margins = st.lists(st.floats(-0.25, 0.25), min_size=7, max_size=7).map(np.array)


@given(move=margins)
def test_joint_positions_reach_the_pose(move: Array) -> None:
    R, p = wam.pose(BENT + move)
    q = WAM.joint_positions(R, p, BENT)
    R_found, p_found = wam.pose(q)
    np.testing.assert_allclose(R_found, R, rtol=0, atol=1e-10)
    np.testing.assert_allclose(p_found, p, rtol=0, atol=1e-10)


def test_out_of_reach() -> None:
    message = re.escape("flange position is (1.2, 0.0, 0.0), allowed: within reach from (0.2,")
    with pytest.raises(ParameterError, match=message):
        WAM.joint_positions(np.eye(3), np.array([1.2, 0.0, 0.0]), BENT)


@pytest.mark.parametrize("part", range(3))
def test_what_is_no_pose_is_refused(part: int) -> None:
    wanted = [*wam.pose(BENT), BENT]
    wanted[part] = np.full_like(wanted[part], np.nan)
    with pytest.raises(ParameterError, match=r"^flange pose is .*, allowed: finite numbers"):
        WAM.joint_positions(*wanted)


def test_out_of_the_joints_ranges() -> None:
    outside = BENT + np.array([0, 0, 0, 0, 0, -1.0, 0])
    with pytest.raises(ParameterError, match=r"joint positions of the pose is \(.*-1\.9.*between"):
        WAM.joint_positions(*wam.pose(outside), outside)
