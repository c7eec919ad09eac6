"""Wrist, gripper, joint friction and the Cartesian manipulator, and what they refuse."""

import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain
from scipy.linalg import expm
from scipy.signal import cont2discrete

from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.cartesian_manipulator import (
    CartesianManipulatorParams,
    cartesian_kinematics,
    sampled_dynamics,
)
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.arms.wrist import (
    SIZE,
    WristParams,
    add_wrist,
    in_joint_order,
    moved,
    tip_displacement,
    tip_pose,
)
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

PARAMS = WristParams(
    stiffness=(10.0, 20.0, 30.0, 1e3, 2e3, 3e3),
    damping_ratio=0.5,
    mass=0.4,
    inertia=9e-4,
    centre_of_mass=0.03,
)
SIX = st.tuples(*[st.floats(-1.5, 1.5)] * 3, *[st.floats(-1, 1)] * 3)


def wrist(centre: float = 0.0) -> tuple[MultibodyPlant, RigidBody]:
    plant = MultibodyPlant(0.001)
    held = add_wrist(plant, plant.world_frame(), replace(PARAMS, centre=centre))
    plant.Finalize()
    assert plant.num_positions(held.instance) == SIZE
    return plant, held.body


@settings(deadline=None, max_examples=30)
@given(displacement=SIX, centre=st.sampled_from([0.0, 0.06, -0.02]))
def test_the_joints_put_the_tip_where_its_pose_is(
    displacement: tuple[float, ...], centre: float
) -> None:
    plant, body = wrist(centre)
    context = plant.CreateDefaultContext()
    q = np.array(displacement)
    plant.SetPositions(context, in_joint_order() @ moved(q, centre))
    assert plant.EvalBodyPoseInWorld(context, body).IsNearlyEqualTo(tip_pose(q), 1e-9)
    np.testing.assert_allclose(moved(moved(q, centre), -centre), q, atol=1e-12)


def test_of_a_wrist_at_the_tip_nothing_is_moved() -> None:
    q = np.linspace(-1.0, 1.0, SIZE)
    np.testing.assert_array_equal(moved(q, 0.0), q)
    np.testing.assert_array_equal(PARAMS.compliance, np.diag(1 / np.array(PARAMS.stiffness)))
    assert PARAMS.tip_stiffness == PARAMS.stiffness


@given(centre=st.floats(-0.2, 0.2))
def test_the_tip_is_as_stiff_as_springs_at_the_centre_make_it(centre: float) -> None:
    params = replace(PARAMS, centre=centre)
    # What a small motion of the tip does at the centre.
    at_centre = np.eye(SIZE)
    at_centre[3, 1], at_centre[4, 0] = centre, -centre
    stiffness = at_centre.T @ np.diag(PARAMS.stiffness) @ at_centre
    np.testing.assert_allclose(params.compliance @ stiffness, np.eye(SIZE), atol=1e-9)
    stiffer = 2 * np.diag(params.tip_stiffness) - stiffness
    assert np.linalg.eigvalsh(stiffer).min() > -1e-6
    # About the centre; about the tool's own axis it is the same.
    across = 9e-4 + 0.4 * ((0.03 - centre) ** 2 - 0.03**2)
    expected = [math.sqrt(k * J) for k, J in ((10, across), (20, across), (30, 9e-4))]
    np.testing.assert_allclose(params.damping[:3], expected)


@given(displacement=SIX)
def test_a_poses_displacement_is_that_of_which_it_was_made(
    displacement: tuple[float, ...],
) -> None:
    q = np.array(displacement)
    np.testing.assert_allclose(tip_displacement(tip_pose(q)), q, atol=1e-9)


def test_the_tool_has_its_inertia_about_the_tip_and_no_weight() -> None:
    plant, body = wrist()
    inertia = body.default_spatial_inertia()
    assert inertia.get_mass() == pytest.approx(0.4)
    np.testing.assert_allclose(inertia.get_com(), [0.0, 0.0, 0.03])
    about_tip = inertia.CalcRotationalInertia().CopyToFullMatrix3()
    np.testing.assert_allclose(about_tip, 9e-4 * np.eye(3), atol=1e-12)
    context = plant.CreateDefaultContext()
    assert not plant.CalcGravityGeneralizedForces(context).any()
    assert plant.CalcTotalMass(context) == pytest.approx(0.4)


def test_the_law_is_springs_and_dampers_in_joint_order() -> None:
    # 2 zeta sqrt(k m)
    rotary = [math.sqrt(k * 9e-4) for k in (10, 20, 30)]
    linear = [math.sqrt(k * 0.4) for k in (1e3, 2e3, 3e3)]
    np.testing.assert_allclose(PARAMS.damping, [*rotary, *linear])
    lack, rates = np.arange(1.0, 7.0), np.arange(2.0, 8.0)
    forces = PARAMS.law @ in_joint_order(2) @ [*lack, *rates]
    expected = np.array(PARAMS.stiffness) * lack + np.array(PARAMS.damping) * rates
    np.testing.assert_allclose(in_joint_order().T @ forces, expected)


def free_tip(params: WristParams, step: float, start: Array, steps: int) -> Array:
    """Positions above rates of a released tip in joint order, shape (steps + 1, 12)."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(MultibodyPlant(step))
    held = add_wrist(plant, plant.world_frame(), params)
    plant.Finalize()
    drive = builder.AddSystem(MatrixGain(-params.implicit_law(step)))
    builder.Connect(plant.get_state_output_port(held.instance), drive.get_input_port())
    builder.Connect(drive.get_output_port(), plant.get_actuation_input_port(held.instance))
    simulator = Simulator(builder.Build())
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    plant.SetPositions(context, start)
    states = []
    for i in range(steps + 1):
        simulator.AdvanceTo(i * step)
        states.append(plant.GetPositionsAndVelocities(context).copy())
    return np.array(states)


@pytest.mark.parametrize("stiffer", [1.0, 100.0])
@pytest.mark.parametrize("step", [0.001, 0.0023, 0.02])
def test_no_spring_is_too_stiff_for_a_step(step: float, stiffer: float) -> None:
    # The mass off the tip couples turn and way: its modes are faster than each axis' own.
    stiffness = tuple(stiffer * k for k in WristParams().stiffness)
    params = WristParams(stiffness=stiffness)
    assert params.centre_of_mass > 0
    for start in np.diag([1e-3] * 3 + [0.02] * 3):
        found = free_tip(params, step, start, 60)
        energy = found[:, :SIZE] ** 2 @ np.diag(params.law[:, :SIZE])
        assert np.isfinite(found).all()
        assert energy[-10:].max() < 1e-3 * energy[0]


def test_a_short_step_moves_as_springs_and_dampers_do() -> None:
    params = WristParams(damping_ratio=0.1)
    step, steps = 2e-5, 2000
    start = np.array([1e-4, 0.0, 0.0, 0.0, 1e-3, 0.0])
    mass = np.diag([params.mass] * 3 + [params.inertia] * 3)
    arm = params.mass * params.centre_of_mass
    mass[0, 4] = mass[4, 0] = arm  # joint order: x with ry, y with rx
    mass[1, 3] = mass[3, 1] = -arm
    stiffness, damping = np.hsplit(params.law, 2)
    rates = np.block(
        [[np.zeros((6, 6)), np.eye(6)], [-np.linalg.solve(mass, a) for a in (stiffness, damping)]]
    )
    expected = expm(rates * step * steps) @ np.concatenate([start, np.zeros(6)])
    found = free_tip(params, step, start, steps)[-1]
    np.testing.assert_allclose(found[:6], expected[:6], atol=0.02 * np.abs(start).max())


def test_one_number_an_axis_each_or_a_matrix() -> None:
    same, own = (
        GripperCompliance(stiffness=50.0),
        GripperCompliance(stiffness=(3.0, 4.0), damping=2.0),
    )
    assert same.matrix(2) == ((50.0, 0.0), (0.0, 50.0))
    assert same.matrix(3)[2] == (0.0, 0.0, 50.0)
    assert same.damping_matrix(2) == ((0.0, 0.0), (0.0, 0.0))
    assert own.matrix(2) == ((3.0, 0.0), (0.0, 4.0))
    assert own.damping_matrix(3)[1] == (0.0, 2.0, 0.0)
    rows = ((3.0, 1.0), (1.0, 4.0))
    assert GripperCompliance(stiffness=rows).matrix(2) == rows


def test_other_dimensions_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"^stiffness is .*, allowed: .*3 rows$"):
        GripperCompliance(stiffness=(1.0, 2.0)).matrix(3)


HEAVY = CartesianManipulatorParams(mass=3.0, damping=7.0)


def continuous(params: CartesianManipulatorParams, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B of (5-7), written down row by row."""
    A, B = np.zeros((2 * d, 2 * d)), np.zeros((2 * d, d))
    for i in range(d):
        A[i, d + i] = 1.0
        A[d + i, d + i] = -params.damping / params.mass
        B[d + i, i] = 1 / params.mass
    return A, B


@pytest.mark.parametrize("step", [1e-4, 1e-3, 0.05, 0.5, 4.0])
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("params", [CartesianManipulatorParams(), HEAVY])
def test_is_the_zero_order_hold(params: CartesianManipulatorParams, d: int, step: float) -> None:
    A, B = continuous(params, d)
    states, inputs = B.shape
    C, D = np.eye(states), np.zeros((states, inputs))
    expected_A, expected_B, *_ = cont2discrete((A, B, C, D), step, method="zoh")
    found_A, found_B = sampled_dynamics(params, step, dimension=d)
    np.testing.assert_allclose(found_A, expected_A, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found_B, expected_B, rtol=1e-12, atol=1e-18)


@given(exponent=st.floats(-9, 1.3), step=st.sampled_from([1e-3, 1.0]))
def test_position_is_exact_for_any_damping(exponent: float, step: float) -> None:
    # (z - 1 + exp(-z)) / z^2 by its series in exact arithmetic: no digit cancels.
    z = 10**exponent
    exact, term = Fraction(0), Fraction(1, 2)
    for k in range(3, 120):
        exact += term
        term *= -Fraction(z) / k
    params = CartesianManipulatorParams(mass=1.0, damping=z / step)
    found = sampled_dynamics(params, step, dimension=2)[1][0, 0] / step**2
    assert found == pytest.approx(float(exact), rel=1e-14, abs=0)


@pytest.mark.parametrize(("dimension", "axes"), [(2, ("x", "y")), (3, ("x", "y", "z"))])
def test_joints_are_the_endpoint(dimension: int, axes: tuple[str, ...]) -> None:
    kinematics = cartesian_kinematics(dimension)
    assert kinematics.joint_names == kinematics.coordinates == axes
    assert kinematics.coordinate_units == ("m",) * dimension
    assert kinematics.num_joints == kinematics.num_coordinates == dimension
    q = np.array([0.3, -0.7, 2.0])[:dimension]
    np.testing.assert_array_equal(kinematics.endpoint(q), q)
    np.testing.assert_array_equal(kinematics.jacobian(q), np.eye(dimension))


FRICTIONS = {"coulomb": (2.0, 0.5), "viscous": (1.0, 0.0)}
MATRIX = "a finite number, 2 of them, or a symmetric matrix of 2 rows"
DEFINITE = "a number > 0, or positive definite"


@pytest.mark.parametrize(
    ("make", "name", "value", "allowed"),
    [
        (WristParams, "inertia", 2e-4, "more than 2 mass arm^2, 0."),
        (GripperCompliance, "stiffness", (1.0, -1.0), DEFINITE),
        (GripperCompliance, "stiffness", ((1.0, 2.0), (2.0, 1.0)), DEFINITE),
        (GripperCompliance, "stiffness", ((1.0, 0.5), (0.4, 1.0)), MATRIX),
        (GripperCompliance, "stiffness", ((1.0, 0.5), (0.4,)), MATRIX),
        (GripperCompliance, "stiffness", (1.0,), "one number, 2 or 3"),
        (GripperCompliance, "damping", (math.nan, 0.0), MATRIX),
        (JointFrictionParams, "viscous", (1.0,), "2 numbers"),
        (cartesian_kinematics, "dimension", 1, "2, 3"),
    ],
)
def test_bad_parameters_are_named(make: Any, name: str, value: Any, allowed: str) -> None:
    given = FRICTIONS if make is JointFrictionParams else {}
    with pytest.raises(ParameterError) as refused:
        make(**{**given, name: value})
    assert str(refused.value).startswith(f"{name} is {value}, allowed: {allowed}")
