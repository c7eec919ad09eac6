"""The hybrid controller's laws, written out again from their formulas."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_controller import HybridControllerParams, Law

Array = np.ndarray

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE)
LAWS: tuple[Law, ...] = ("inverse", "transpose", "projected")
APPROACH, CONTACT = 0, 1
DOWN = np.array([0.0, -1.0])
ALONG = np.diag([1.0, 0.0])  # P in contact
FREE = np.eye(2)


class Formulas:
    """The laws of Figs. 2-1 and 2-2 in a basis of the surface's tangents, tick by tick.

    Shares nothing with the controller but the arm's forward kinematics.
    """

    def __init__(self, arm: Arm, params: HybridControllerParams) -> None:
        self.arm, self.params = arm, params
        self.integral = np.zeros(arm.num_joints)
        self.force_integral = np.zeros(arm.num_joints)

    def jacobian(self, q: Array) -> Array:
        step = 1e-30
        columns = [self.arm.endpoint(q + 1j * step * axis).imag / step for axis in np.eye(len(q))]
        return np.transpose(columns)

    def tick(self, q: Array, v: Array, x_d: Array, f_d: Array, f_m: Array, n: Array) -> Array:
        params, T = self.params, self.params.period
        Kp, Ki, Kd = (np.array(g) for g in (params.stiffness, params.integral, params.damping))
        J = self.jacobian(q)
        tangents = np.linalg.svd(n[None])[2][1:].T  # (m, m - 1)
        e = tangents.T @ (x_d - self.arm.endpoint(q))
        rate = tangents.T @ J @ v
        if params.law == "projected":
            # The least motion of the joints that makes the error, or the rate, good.
            A = tangents.T @ J
            e, rate = (A.T @ np.linalg.solve(A @ A.T, part) for part in (e, rate))
        else:
            e, rate = tangents @ e, tangents @ rate
        if params.law == "inverse":
            e, rate = np.linalg.solve(J, e), np.linalg.solve(J, rate)
        self.integral = self.integral + Ki * e * T
        tau = Kp * e + self.integral - Kd * rate
        if params.law == "transpose":
            tau = J.T @ tau
        self.force_integral = self.force_integral + params.force_integral * T * n * (
            n @ (f_d - f_m)
        )
        result: Array = tau + J.T @ (n * (n @ f_d) + self.force_integral)
        return result


def regular_pose(arm: Arm, rng: np.random.Generator) -> Array:
    """Return joint positions well away from the arm's singular ones."""
    while True:
        q = rng.uniform(-2.5, 2.5, arm.num_joints)
        if np.linalg.cond(arm.jacobian(q)) < 50:
            return q


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_laws_in_contact(drive_arm: Any, arm: Arm, law: Law, seed: int) -> None:
    rng, n = np.random.default_rng(seed), arm.num_joints
    params = HybridControllerParams(
        law=law,
        stiffness=tuple(rng.uniform(100, 400, n)),
        integral=tuple(rng.uniform(100, 400, n)),
        damping=tuple(rng.uniform(10, 60, n)),
        force_integral=rng.uniform(1, 8),
        feedforward_torque=(),
        period=0.125,
        bumpless=False,
    )
    driven, formulas = drive_arm(arm, params), Formulas(arm, params)
    normal = rng.normal(size=n)
    normal /= np.linalg.norm(normal)
    for i in range(5):
        if i == 3:  # a corner of the surface
            normal = np.roll(normal, 1)
        q, v = regular_pose(arm, rng), rng.normal(size=n)
        x_d = arm.endpoint(q) + 0.1 * rng.normal(size=n)
        f_d, f_m = 10 * rng.normal(size=(2, n))
        found = driven.tick(
            encoders=np.concatenate([q, v]),
            desired_position=x_d,
            desired_force=f_d,
            measured_force=f_m,
            selection=np.eye(n) - np.outer(normal, normal),
            mode=CONTACT,
        )
        expected = formulas.tick(q, v, x_d, f_d, f_m, normal)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@settings(max_examples=12, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_inverse_and_projected_agree_in_free_motion(drive_arm: Any, arm: Arm, seed: int) -> None:
    # With P = I the pseudo-inverse is the inverse: a PID on q_d - q to first order.
    rng, n = np.random.default_rng(seed), arm.num_joints
    gains = dict(
        zip(("stiffness", "integral", "damping"), rng.uniform(9, 99, (3, n)).tolist(), strict=True)
    )
    params = HybridControllerParams(
        force_integral=2.0,
        feedforward_torque=(),
        **{name: tuple(values) for name, values in gains.items()},
    )
    inverse = drive_arm(arm, params)
    projected = drive_arm(arm, dataclasses.replace(params, law="projected"))
    integral = np.zeros(n)
    for _ in range(4):
        q, v, e = regular_pose(arm, rng), rng.normal(size=n), rng.normal(size=n)
        inputs = {
            "encoders": np.concatenate([q, v]),
            "desired_position": arm.endpoint(q) + e,
            "desired_force": rng.normal(size=n),  # no direction is under force control
            "measured_force": rng.normal(size=n),
        }
        e_q = np.linalg.solve(arm.jacobian(q), e)
        integral = integral + gains["integral"] * e_q * 0.005
        expected = gains["stiffness"] * e_q + integral - gains["damping"] * v
        found = inverse.tick(**inputs)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(projected.tick(**inputs), found, rtol=1e-10, atol=1e-9)


def test_inverse_and_projected_agree_where_an_axis_is_decoupled(drive_arm: Any) -> None:
    # The Adept's quill alone moves its tip along z.
    params = HybridControllerParams(
        stiffness=(400.0, 300.0, 900.0, 50.0),
        integral=(1.0, 2.0, 3.0, 4.0),
        damping=(60.0, 40.0, 80.0, 9.0),
        force_integral=2.0,
        feedforward_torque=(),
    )
    inputs = {
        "encoders": [0.3, 0.9, 0.2, -0.4, 0.1, -0.2, 0.3, 0.5],
        "desired_position": [0.5, 0.4, 0.6, 0.7],
        "desired_force": [0.0, 0.0, -20.0, 0.0],
        "selection": np.diag([1.0, 1.0, 0.0, 1.0]),
        "mode": CONTACT,
    }
    found = [
        drive_arm(ADEPT_ONE, dataclasses.replace(params, law=law, bumpless=False)).tick(**inputs)
        for law in LAWS
    ]
    np.testing.assert_allclose(found[2], found[0], rtol=1e-12)
    assert not np.allclose(found[1], found[0])
    # d3 counts downwards, so the push of 20 N, grown by Kif 20 T, is a force of the quill.
    assert found[0][2] == pytest.approx(20 * (1 + 2 * 0.005), rel=1e-12)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_laws_agree_where_every_direction_is_under_force_control(drive_arm: Any, arm: Arm) -> None:
    n = arm.num_joints
    force = np.arange(1.0, n + 1)
    found = []
    for law in LAWS:
        params = HybridControllerParams(
            law=law,
            stiffness=400.0,  # of every joint
            integral=400.0,
            damping=60.0,
            force_integral=4.0,
            feedforward_torque=(),
            bumpless=False,
        )
        driven = drive_arm(arm, params)
        driven.feed(selection=np.zeros((n, n)), mode=CONTACT, desired_force=force)
        driven.feed(encoders=np.concatenate([np.full(n, 0.5), np.ones(n)]))
        driven.feed(desired_position=np.ones(n))  # of no concern, like the velocity
        found.append(driven.tick(measured_force=-force))
    # F F_d and one period of the integral of 2 F_d.
    expected = arm.jacobian(np.full(n, 0.5)).T @ (force * (1 + 4.0 * 2 * 0.005))
    np.testing.assert_allclose(found, [expected] * 3, rtol=1e-12)


def test_transpose_law_by_hand(drive: Any) -> None:
    # At q = (90, -90) degrees the tip is at (1, 1): J = [[-1, 0], [1, 1]].
    q = np.radians([90, -90])
    driven = drive("transpose", bumpless=False)
    found = driven.tick(
        encoders=[*q, 0.5, -0.25],  # x' = (-0.5, 0.25)
        desired_position=[1.1, 7.0],
        desired_force=[3.0, -15.0],
        measured_force=[9.0, -11.0],
        selection=ALONG,
        mode=CONTACT,
    )
    along = 400 * 0.1 + 200 * 0.1 * 0.25 - 60 * -0.5
    normal = -15.0 + 3.0 * -4.0 * 0.25
    np.testing.assert_allclose(found, [-along + normal, normal], rtol=1e-12)


# Force law


@pytest.mark.parametrize("law", LAWS)
def test_constant_force_error_is_integrated(drive: Any, contact: Any, law: Law) -> None:
    driven = drive(law, bumpless=False)
    driven.feed(**contact(desired_position=contact.x))
    for k in range(1, 9):
        # Kif times 4 N over k periods; the 4 N along the surface are none of its business.
        expected = contact.J.T @ (DOWN * (15.0 + 3.0 * 4.0 * 0.25 * k))
        np.testing.assert_allclose(driven.tick(), expected, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_no_integrator_sees_the_other_domain(drive: Any, contact: Any, law: Law) -> None:
    plain, disturbed = drive(law), drive(law)
    for _ in range(5):
        expected = plain.tick(**contact())
        found = disturbed.tick(
            **contact(
                desired_position=contact.x + np.array([0.02, 3.0]),  # far off along the normal
                measured_force=[-99.0, -11.0],  # much friction along the surface
            )
        )
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    # Nor does anything come to light when the domains change.
    both = [driven.tick(selection=FREE, mode=APPROACH) for driven in (plain, disturbed)]
    np.testing.assert_allclose(both[1], both[0], rtol=0, atol=1e-10)
    swap = {"selection": np.diag([0.0, 1.0]), "mode": CONTACT, "encoders": contact.rest}
    both = [
        driven.tick(**{**swap, "desired_position": contact.x, "measured_force": 11 * DOWN})
        for driven in (plain, disturbed)
    ]
    np.testing.assert_allclose(both[1], both[0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_damping_of_the_force_domain(drive: Any, contact: Any, law: Law) -> None:
    velocity = np.linalg.solve(contact.J, [0.3, -0.2])  # of the tip, downwards and along
    moving = contact(encoders=np.concatenate([contact.q, velocity]))
    plain, damped = drive(law), drive(law, force_damping=50.0)
    # In free motion there is none, and at the contact it is not taken up by the offset.
    for inputs in (contact(selection=FREE, mode=APPROACH), moving):
        extra = damped.tick(**inputs) - plain.tick(**inputs)
        expected = contact.J.T @ (50.0 * 0.2 * -DOWN) if inputs is moving else np.zeros(2)
        np.testing.assert_allclose(extra, expected, atol=1e-9)
    at_rest = damped.tick(**contact()) - plain.tick(**contact())
    np.testing.assert_allclose(at_rest, 0, atol=1e-9)


# Full dynamics


def load(arm: Arm) -> tuple[MultibodyPlant, Any]:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


@pytest.mark.parametrize("law", ["inverse", "projected"])
@pytest.mark.parametrize("arm", [PUMA_250, ADEPT_ONE], ids=lambda arm: arm.name)
@pytest.mark.parametrize("known", [False, True], ids=["", "gravity fed forward"])
def test_full_dynamics_give_the_acceleration(
    drive_arm: Any, arm: Arm, law: Law, known: bool
) -> None:
    rng, n = np.random.default_rng(11), arm.num_joints
    inertia = rng.uniform(0.5, 2.0, n)
    dynamics = ArmDynamics(arm)
    start = np.full(n, 0.5)
    params = HybridControllerParams(
        law=law,
        stiffness=tuple(rng.uniform(100, 400, n)),
        integral=(0.0,) * n,
        damping=tuple(rng.uniform(10, 60, n)),
        force_integral=0.0,
        full_dynamics=True,
        inertia=tuple(inertia),
        feedforward_torque=tuple(dynamics.gravity_torque(start)) if known else (),
    )
    driven = drive_arm(arm, params, dynamics)
    plant, context = load(arm)
    for _ in range(3):
        q, v, e = regular_pose(arm, rng), rng.normal(size=n), 0.1 * rng.normal(size=n)
        found = driven.tick(encoders=np.concatenate([q, v]), desired_position=arm.endpoint(q) + e)
        effort = np.array(params.stiffness) * np.linalg.solve(arm.jacobian(q), e)
        effort -= np.array(params.damping) * v
        plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
        forces = MultibodyForces(plant)
        plant.CalcForceElementsContribution(context, forces)
        expected = plant.CalcInverseDynamics(context, effort / inertia, forces)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_full_dynamics_leave_the_push_alone(drive_arm: Any) -> None:
    params = HybridControllerParams(
        stiffness=100.0,
        integral=0.0,
        damping=10.0,
        force_integral=4.0,
        feedforward_torque=(),
        full_dynamics=True,
        inertia=(0.5, 0.6, 0.7),
        bumpless=False,
    )
    q = np.full(3, 0.5)
    driven = drive_arm(PUMA_250, params, ArmDynamics(PUMA_250))
    found = driven.tick(
        selection=np.diag([1.0, 1.0, 0.0]), mode=CONTACT, desired_force=[0.0, 0.0, -5.0]
    )
    plant, context = load(PUMA_250)
    plant.SetPositions(context, q)
    gravity = -plant.CalcGravityGeneralizedForces(context)
    push = PUMA_250.jacobian(q).T @ [0.0, 0.0, -5.0 * (1 + 4.0 * 0.005)]
    np.testing.assert_allclose(found, gravity + push, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_damping_acts_on_the_error_of_the_rate(drive: Any, contact: Any, law: Law) -> None:
    # At the desired velocity as at rest; across the surface none is desired, whatever is said.
    moving = np.concatenate([contact.q, np.linalg.solve(contact.J, [0.3, 0.0])])
    torque = [
        drive(law, bumpless=False).tick(**contact(**changes))
        for changes in (
            {},
            {"encoders": moving, "desired_velocity": [0.3, 0.0]},
            {"encoders": moving, "desired_velocity": [0.3, -2.0]},
            {"encoders": moving, "desired_velocity": [0.0, 0.0]},
            {"encoders": moving},
        )
    ]
    rest, followed, across, halted, thesis = torque
    np.testing.assert_allclose(followed, rest, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(across, followed)
    np.testing.assert_array_equal(halted, thesis)
    assert np.abs(thesis - rest).max() > 5.0  # N m
