"""The compliant wrist: kinematics and inertia as Drake has them, springs by hand."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain
from scipy.linalg import expm

from chamfer.models.arms.wrist import (
    ORDER,
    SIZE,
    WristParams,
    add_wrist,
    in_joint_order,
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


def wrist() -> tuple[MultibodyPlant, RigidBody]:
    plant = MultibodyPlant(0.001)
    held = add_wrist(plant, plant.world_frame(), PARAMS)
    plant.Finalize()
    assert plant.num_positions(held.instance) == SIZE
    return plant, held.body


@settings(deadline=None, max_examples=30)
@given(displacement=SIX)
def test_the_joints_put_the_tip_where_its_pose_is(displacement: tuple[float, ...]) -> None:
    plant, body = wrist()
    context = plant.CreateDefaultContext()
    q = np.array(displacement)
    plant.SetPositions(context, in_joint_order() @ q)
    assert plant.EvalBodyPoseInWorld(context, body).IsNearlyEqualTo(tip_pose(q), 1e-9)


def test_a_displacement_turns_about_the_carriers_x_last() -> None:
    X = tip_pose(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]))
    R = RotationMatrix.MakeXRotation(0.1).multiply(
        RotationMatrix.MakeYRotation(0.2).multiply(RotationMatrix.MakeZRotation(0.3))
    )
    assert X.IsNearlyEqualTo(RigidTransform(R, [1.0, 2.0, 3.0]), 1e-12)


@given(displacement=SIX)
def test_a_poses_displacement_is_that_of_which_it_was_made(
    displacement: tuple[float, ...],
) -> None:
    q = np.array(displacement)
    np.testing.assert_allclose(tip_displacement(tip_pose(q)), q, atol=1e-9)


def test_joint_order_is_a_permutation_of_every_block() -> None:
    single, double = in_joint_order(), in_joint_order(2)
    assert (single @ np.arange(6.0)).tolist() == [3, 4, 5, 0, 1, 2] == list(ORDER)
    assert (double @ np.arange(12.0)).tolist() == [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    np.testing.assert_array_equal(double.T @ double, np.eye(12))


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


@pytest.mark.parametrize("arm", [0.0, 0.01, 0.03])
def test_the_least_inertia_is_that_of_a_body(arm: float) -> None:
    # What is below, Drake refuses as no body's.
    least = 2 * 0.3 * arm**2 or 1e-6
    plant = MultibodyPlant(0.001)
    params = WristParams(centre_of_mass=arm, inertia=least * (1 + 1e-6))
    add_wrist(plant, plant.world_frame(), params)
    plant.Finalize()
    if arm:
        with pytest.raises(ParameterError, match=r"^inertia is .*, allowed: more than 2"):
            WristParams(centre_of_mass=arm, inertia=least * (1 - 1e-6))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mass": 0.0}, "mass is 0.0, allowed: a finite number > 0"),
        ({"inertia": math.nan}, "inertia is nan, allowed: a finite number > 0"),
        ({"damping_ratio": -1.0}, "damping_ratio is -1.0, allowed: a finite number > 0"),
        ({"centre_of_mass": -0.1}, "centre_of_mass is -0.1, allowed: a finite number >= 0"),
        ({"inertia": 2e-4}, "inertia is 0.0002, allowed: more than 2 mass arm^2, 0.00024"),
        *[
            ({"stiffness": x}, f"stiffness is {x}, allowed: six finite numbers > 0")
            for x in ((1.0,) * 5, (0.0,) + (1.0,) * 5, (1.0,) * 5 + (math.inf,))
        ],
    ],
)
def test_refuses(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        WristParams(**values)
    assert str(refused.value) == message
