"""The hybrid controller: its laws written out again, its switches, its creep, and the block."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    AffineSystem,
    ConstantVectorSource,
    LogVectorOutput,
)

from models.arms.adept_one import ADEPT_ONE
from models.arms.arm import Arm
from models.arms.planar_two_link import PLANAR_TWO_LINK
from models.arms.puma_250 import PUMA_250
from models.joint_friction import JointFrictionParams
from models.surfaces import RippledPlane
from models.validation import ParameterError
from systems.contact.arm_dynamics import ArmDynamics
from systems.contact.arm_in_contact import ArmInContact, ArmInContactParams
from systems.force.hybrid_controller import HybridController, HybridControllerParams, Law

Array = np.ndarray

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE)
LAWS: tuple[Law, ...] = ("inverse", "transpose", "projected")
APPROACH, CONTACT, LOST = 0, 1, 2
EXACT = 1e-12

# The planar arm where it meets the crucible: (1, -1.5), pushing along -y.
Q = PLANAR_TWO_LINK.joint_positions(np.array([1.0, -1.5]), "negative")
REST = np.concatenate([Q, np.zeros(2)])
X = np.array([1.0, -1.5])
J = np.array(  # written out for this pose
    [
        [1.5, -math.sin(Q.sum())],
        [1.0, math.cos(Q.sum())],
    ]
)
DOWN = np.array([0.0, -1.0])
ALONG = np.diag([1.0, 0.0])  # P in contact
FREE = np.eye(2)


def make_params(law: Law = "inverse", **changes: Any) -> HybridControllerParams:
    fields: dict[str, Any] = {
        "law": law,
        "stiffness": (400.0, 300.0),
        "integral": (200.0, 100.0),
        "damping": (60.0, 40.0),
        "force_integral": 3.0,
        "period": 0.25,  # binary, so that the ticks' times are exact
    }
    return HybridControllerParams(**{**fields, **changes})


class Driven:
    """A controller that is fed one set of inputs a tick; what is not given stays."""

    def __init__(
        self,
        params: HybridControllerParams,
        arm: Arm = PLANAR_TWO_LINK,
        dynamics: ArmDynamics | None = None,
    ) -> None:
        n = arm.num_joints
        self.block = HybridController(arm, params, dynamics=dynamics)
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()
        self.period = params.period
        self.ticks = 0
        q = Q if arm is PLANAR_TWO_LINK else np.full(n, 0.5)
        self.feed(
            encoders=np.concatenate([q, np.zeros(n)]),
            desired_position=arm.endpoint(q),
            desired_force=np.zeros(n),
            measured_force=np.zeros(n),
            selection=np.eye(n),
            mode=APPROACH,
        )

    def feed(self, **inputs: Any) -> None:
        for name, value in inputs.items():
            port = self.block.GetInputPort(name)
            port.FixValue(self.context, np.atleast_1d(np.asarray(value, dtype=float).ravel()))

    def tick(self, **inputs: Any) -> Array:
        """Feed the next tick, run it and return the torque."""
        self.feed(**inputs)
        self.simulator.AdvanceTo(self.ticks * self.period)
        self.simulator.AdvancePendingEvents()
        self.ticks += 1
        return self.read("torque")

    def read(self, name: str) -> Array:
        found: Array = self.block.GetOutputPort(name).Eval(self.context).copy()
        return found


def contact(**changes: Any) -> dict[str, Any]:
    """Return inputs in contact at rest, with errors of position and force."""
    inputs = {
        "encoders": REST,
        "desired_position": X + np.array([0.02, -0.1]),
        "desired_force": 15 * DOWN,
        "measured_force": 11 * DOWN + np.array([4.0, 0.0]),
        "selection": ALONG,
        "mode": CONTACT,
    }
    return {**inputs, **changes}


def tip_force(torque: Array) -> Array:
    """Return the force on the environment that a torque of the planar arm at Q stands for."""
    found: Array = np.linalg.solve(J.T, torque)
    return found


# The laws, from the formulas


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
def test_laws_in_contact(arm: Arm, law: Law, seed: int) -> None:
    rng, n = np.random.default_rng(seed), arm.num_joints
    params = HybridControllerParams(
        law=law,
        stiffness=tuple(rng.uniform(100, 400, n)),
        integral=tuple(rng.uniform(100, 400, n)),
        damping=tuple(rng.uniform(10, 60, n)),
        force_integral=rng.uniform(1, 8),
        period=0.125,
        bumpless=False,
    )
    driven, formulas = Driven(params, arm), Formulas(arm, params)
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
def test_inverse_and_projected_agree_in_free_motion(arm: Arm, seed: int) -> None:
    # With P = I the pseudo-inverse is the inverse: a PID on q_d - q to first order.
    rng, n = np.random.default_rng(seed), arm.num_joints
    gains = dict(
        zip(("stiffness", "integral", "damping"), rng.uniform(9, 99, (3, n)).tolist(), strict=True)
    )
    params = HybridControllerParams(
        force_integral=2.0, **{name: tuple(values) for name, values in gains.items()}
    )
    inverse = Driven(params, arm)
    projected = Driven(dataclasses.replace(params, law="projected"), arm)
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


def test_inverse_and_projected_agree_where_an_axis_is_decoupled() -> None:
    # The Adept's quill alone moves its tip along z.
    params = HybridControllerParams(
        stiffness=(400.0, 300.0, 900.0, 50.0),
        integral=(1.0, 2.0, 3.0, 4.0),
        damping=(60.0, 40.0, 80.0, 9.0),
        force_integral=2.0,
    )
    inputs = {
        "encoders": [0.3, 0.9, 0.2, -0.4, 0.1, -0.2, 0.3, 0.5],
        "desired_position": [0.5, 0.4, 0.6, 0.7],
        "desired_force": [0.0, 0.0, -20.0, 0.0],
        "selection": np.diag([1.0, 1.0, 0.0, 1.0]),
        "mode": CONTACT,
    }
    found = [
        Driven(dataclasses.replace(params, law=law, bumpless=False), ADEPT_ONE).tick(**inputs)
        for law in LAWS
    ]
    np.testing.assert_allclose(found[2], found[0], rtol=1e-12)
    assert not np.allclose(found[1], found[0])
    # d3 counts downwards, so the push of 20 N, grown by Kif 20 T, is a force of the quill.
    assert found[0][2] == pytest.approx(20 * (1 + 2 * 0.005), rel=1e-12)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_laws_agree_where_every_direction_is_under_force_control(arm: Arm) -> None:
    n = arm.num_joints
    force = np.arange(1.0, n + 1)
    found = []
    for law in LAWS:
        params = HybridControllerParams(
            law=law,
            stiffness=(400.0,) * n,
            integral=(400.0,) * n,
            damping=(60.0,) * n,
            force_integral=4.0,
            bumpless=False,
        )
        driven = Driven(params, arm)
        driven.feed(selection=np.zeros((n, n)), mode=CONTACT, desired_force=force)
        driven.feed(encoders=np.concatenate([np.full(n, 0.5), np.ones(n)]))
        driven.feed(desired_position=np.ones(n))  # of no concern, like the velocity
        found.append(driven.tick(measured_force=-force))
    # F F_d and one period of the integral of 2 F_d.
    expected = arm.jacobian(np.full(n, 0.5)).T @ (force * (1 + 4.0 * 2 * 0.005))
    np.testing.assert_allclose(found, [expected] * 3, rtol=1e-12)


def test_transpose_law_by_hand() -> None:
    # At q = (90, -90) degrees the tip is at (1, 1): J = [[-1, 0], [1, 1]].
    q = np.radians([90, -90])
    driven = Driven(make_params("transpose", bumpless=False))
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


def test_jacobian_at_the_contact_point() -> None:
    np.testing.assert_allclose(PLANAR_TWO_LINK.jacobian(Q), J, rtol=0, atol=1e-14)


# Force law


@pytest.mark.parametrize("law", LAWS)
def test_constant_force_error_is_integrated(law: Law) -> None:
    driven = Driven(make_params(law, bumpless=False))
    driven.feed(**contact(desired_position=X))
    for k in range(1, 9):
        # Kif times 4 N over k periods; the 4 N along the surface are none of its business.
        expected = J.T @ (DOWN * (15.0 + 3.0 * 4.0 * 0.25 * k))
        np.testing.assert_allclose(driven.tick(), expected, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_desired_force_is_fed_forward(law: Law) -> None:
    driven = Driven(make_params(law, force_integral=0.0, bumpless=False))
    driven.feed(**contact(desired_position=X, desired_force=[8.0, -15.0]))
    np.testing.assert_allclose(driven.tick(), J.T @ [0.0, -15.0], rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_no_integrator_sees_the_other_domain(law: Law) -> None:
    plain, disturbed = Driven(make_params(law)), Driven(make_params(law))
    for _ in range(5):
        expected = plain.tick(**contact())
        found = disturbed.tick(
            **contact(
                desired_position=X + np.array([0.02, 3.0]),  # far off along the normal
                measured_force=11 * DOWN
                + np.array([-99.0, 0.0]),  # much friction along the surface
            )
        )
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    # Nor does anything come to light when the domains change.
    both = [driven.tick(selection=FREE, mode=APPROACH) for driven in (plain, disturbed)]
    np.testing.assert_allclose(both[1], both[0], rtol=0, atol=1e-10)
    swap = {"selection": np.diag([0.0, 1.0]), "mode": CONTACT, "encoders": REST}
    both = [
        driven.tick(**{**swap, "desired_position": X, "measured_force": 11 * DOWN})
        for driven in (plain, disturbed)
    ]
    np.testing.assert_allclose(both[1], both[0], rtol=0, atol=1e-10)


def test_errors_are_told_before_the_selection() -> None:
    driven = Driven(make_params())
    driven.tick(**contact())
    np.testing.assert_allclose(driven.read("position_error"), [0.02, -0.1], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(driven.read("force_error"), [-4.0, -4.0])


# Switches without a jump


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("before", "after"),
    [(APPROACH, CONTACT), (CONTACT, APPROACH), (LOST, CONTACT), (LOST, APPROACH)],
)
def test_torque_does_not_jump(law: Law, before: int, after: int) -> None:
    driven = Driven(make_params(law))
    selection = {APPROACH: FREE, CONTACT: ALONG, LOST: ALONG}
    driven.tick(**contact(selection=FREE, mode=APPROACH))
    for _ in range(3):
        torque = driven.tick(selection=selection[before], mode=before)
    found = driven.tick(selection=selection[after], mode=after)
    np.testing.assert_allclose(found, torque, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_torque_does_not_jump_while_moving(law: Law) -> None:
    # Whatever changes in the same tick: pose, speed, desired values.
    driven = Driven(make_params(law))
    torque = driven.tick(**contact(selection=FREE, mode=APPROACH))
    moved = np.concatenate([Q + np.array([0.1, -0.2]), [0.4, -0.7]])
    found = driven.tick(**contact(encoders=moved, desired_position=X + 0.3))
    np.testing.assert_allclose(found, torque, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_offset_stays_as_it_is_within_a_mode(law: Law) -> None:
    # From tick to tick the torque changes by what the law without an offset changes.
    smooth, plain = Driven(make_params(law)), Driven(make_params(law, bumpless=False))
    rng = np.random.default_rng(5)
    found, expected = [], []
    for mode in [APPROACH] * 2 + [CONTACT] * 6 + [APPROACH] * 3 + [CONTACT] * 3:
        inputs = contact(
            encoders=np.concatenate([Q + 0.1 * rng.normal(size=2), rng.normal(size=2)]),
            measured_force=rng.normal(size=2),
            selection=ALONG if mode else FREE,
            mode=mode,
        )
        found.append(smooth.tick(**inputs))
        expected.append(plain.tick(**inputs))
    change, wanted = np.diff(found, axis=0), np.diff(expected, axis=0)
    for switch in (1, 7, 10):
        np.testing.assert_allclose(change[switch], [0, 0], rtol=0, atol=EXACT)
        wanted[switch] = 0
    np.testing.assert_allclose(change, wanted, rtol=0, atol=1e-11)


@pytest.mark.parametrize("law", LAWS)
def test_without_an_offset_the_torque_jumps(law: Law) -> None:
    driven = Driven(make_params(law, bumpless=False))
    before = driven.tick(**contact(selection=FREE, mode=APPROACH))
    after = driven.tick(**contact())
    assert np.abs(after - before).max() > 10  # N m


def test_first_tick_in_contact_starts_from_the_torque_at_rest() -> None:
    driven = Driven(make_params(feedforward_torque=(2.0, -1.0)))
    np.testing.assert_array_equal(driven.read("torque"), [2.0, -1.0])
    np.testing.assert_allclose(driven.tick(**contact()), [2.0, -1.0], rtol=0, atol=EXACT)


# Loss of contact


@pytest.mark.parametrize("law", LAWS)
def test_push_is_let_go_and_the_rest_stays(law: Law) -> None:
    driven = Driven(make_params(law, feedforward_torque=(5.0, -3.0)))
    for _ in range(4):
        torque = driven.tick(**contact())
    known = np.array([5.0, -3.0])
    before = tip_force(torque - known)
    after = tip_force(driven.tick(mode=LOST) - known)
    assert abs(before[1]) > 1
    np.testing.assert_allclose(after, [before[0], 0.0], rtol=0, atol=1e-11)


@pytest.mark.parametrize("law", LAWS)
def test_bounce_is_damped(law: Law) -> None:
    driven = Driven(make_params(law, creep_damping=70.0))
    for _ in range(2):
        torque = driven.tick(**contact())
    # Away from the surface with 0.3 m/s, along it with 0.2 m/s.
    moving = np.concatenate([Q, np.linalg.solve(J, [0.2, 0.3])])
    after = tip_force(driven.tick(mode=LOST, encoders=moving))
    np.testing.assert_allclose(after, [tip_force(torque)[0], -70.0 * 0.3], rtol=0, atol=1e-11)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("force", [15.0, 4.0, -15.0])
def test_push_grows_with_the_ramp_at_rest(law: Law, force: float) -> None:
    # Towards where the desired force points, whatever its size.
    params = make_params(law, integral=(0.0, 0.0), creep_ramp=40.0, period=0.125)
    driven = Driven(params)
    driven.tick(**contact(desired_force=force * DOWN))
    start = tip_force(driven.tick(mode=LOST))
    for k in range(1, 6):
        grown = tip_force(driven.tick()) - start
        expected = math.copysign(40.0 * 0.125 * k, force) * DOWN
        np.testing.assert_allclose(grown, expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("speed", "share"),  # m/s towards the surface; of the ramp
    [(-9.0, 1.0), (-0.01, 1.0), (0.0, 1.0), (0.02, 0.5), (0.04, 0.0), (0.08, -1.0), (9.0, -1.0)],
)
def test_push_grows_by_what_is_missing_to_the_creep_speed(speed: float, share: float) -> None:
    params = make_params("projected", integral=(0.0, 0.0), creep_speed=0.04, creep_ramp=40.0)
    driven = Driven(params)
    moving = np.concatenate([Q, np.linalg.solve(J, speed * DOWN)])
    driven.tick(**contact(encoders=moving))
    torques = [driven.tick(mode=LOST) for _ in range(4)]
    growth = tip_force(np.diff(torques, axis=0).T).T
    np.testing.assert_allclose(growth, [40.0 * 0.25 * share * DOWN] * 3, rtol=0, atol=1e-10)


def test_every_loss_starts_anew() -> None:
    driven = Driven(make_params(integral=(0.0, 0.0)))
    first = []
    for _ in range(2):
        driven.tick(**contact())
        first.append(tip_force(driven.tick(mode=LOST)))
        for _ in range(5):
            driven.tick()
    assert [force[1] for force in first] == pytest.approx([0.0, 0.0], abs=1e-11)


def test_force_integral_waits_for_contact() -> None:
    driven = Driven(make_params(bumpless=False))
    driven.feed(**contact(desired_position=X))
    driven.tick()
    for _ in range(9):
        driven.tick(mode=LOST, measured_force=[0.0, 0.0])
    # Two periods in contact, and nothing of the nine between.
    expected = J.T @ (DOWN * (15.0 + 2 * 3.0 * 4.0 * 0.25))
    found = driven.tick(mode=CONTACT, measured_force=11 * DOWN)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_without_a_desired_force_nothing_is_sought() -> None:
    driven = Driven(make_params(integral=(0.0, 0.0)))
    driven.tick(**contact(desired_force=[7.0, 0.0]))  # along the surface only
    torques = [driven.tick(mode=LOST) for _ in range(4)]
    np.testing.assert_allclose(torques, [torques[0]] * 4, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_loss_may_be_ignored(law: Law) -> None:
    params = make_params(law, loss_mode=False)
    ignoring, touching = Driven(params), Driven(params)
    rng = np.random.default_rng(2)
    for mode in (APPROACH, CONTACT, CONTACT, LOST, LOST, CONTACT, LOST, CONTACT):
        inputs = contact(
            encoders=np.concatenate([Q, rng.normal(size=2)]),
            measured_force=rng.normal(size=2),
            selection=ALONG if mode else FREE,
        )
        found = ignoring.tick(**{**inputs, "mode": mode})
        expected = touching.tick(**{**inputs, "mode": min(mode, CONTACT)})
        np.testing.assert_array_equal(found, expected)


def test_approach_from_loss_does_not_jump_without_loss_mode() -> None:
    driven = Driven(make_params(loss_mode=False))
    for _ in range(3):
        torque = driven.tick(**contact(mode=LOST))
    found = driven.tick(selection=FREE, mode=APPROACH)
    np.testing.assert_allclose(found, torque, rtol=0, atol=EXACT)


def closed_loop(params: HybridControllerParams, inputs: dict[str, Any], duration: float) -> Array:
    """Simulate the planar arm from rest at Q without friction, far from a surface.

    Args:
        params: The controller's.
        inputs: Its constant inputs, all but the encoders.
        duration: s.

    Returns:
        The tip's positions and velocities at the ticks, shape (ticks, 4).
    """
    builder = DiagramBuilder()
    floor = RippledPlane(point=(0.0, 0.0, -9.0))
    free = JointFrictionParams(coulomb=(0.0, 0.0), viscous=(0.0, 0.0))
    plant = builder.AddSystem(
        ArmInContact(
            PLANAR_TWO_LINK, floor, ArmInContactParams(joint_friction=free, gravity=False), Q
        )
    )
    block = builder.AddSystem(HybridController(PLANAR_TWO_LINK, params))
    for name, value in inputs.items():
        source = builder.AddSystem(ConstantVectorSource(np.asarray(value, dtype=float).ravel()))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    builder.Connect(plant.GetOutputPort("encoders"), block.GetInputPort("encoders"))
    builder.Connect(block.GetOutputPort("torque"), plant.GetInputPort("torque"))
    logger = LogVectorOutput(plant.GetOutputPort("encoders"), builder, params.period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(duration)
    data = logger.FindLog(simulator.get_context()).data().T
    return np.array(
        [
            [*PLANAR_TWO_LINK.endpoint(row[:2]), *(PLANAR_TWO_LINK.jacobian(row[:2]) @ row[2:])]
            for row in data
        ]
    )


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("creep_speed", [0.02, 0.05])
def test_lost_contact_is_sought_with_the_creep_speed(law: Law, creep_speed: float) -> None:
    params = HybridControllerParams(
        law=law,
        stiffness=(400.0, 400.0),
        integral=(400.0, 400.0),
        damping=(60.0, 60.0),
        force_integral=3.0,
        creep_speed=creep_speed,
    )
    path = closed_loop(
        params,
        {
            "desired_position": X,
            "desired_force": 15 * DOWN,
            "measured_force": np.zeros(2),
            "selection": ALONG,
            "mode": np.array([LOST]),
        },
        1.5,
    )
    towards = path[:, 2:] @ DOWN
    assert towards[-1] == pytest.approx(creep_speed, rel=0.02)
    assert towards[:3] == pytest.approx([0, 0, 0], abs=2e-3)  # no push to begin with
    assert towards.max() < 1.3 * creep_speed
    assert np.abs(path[:, 0] - 1.0).max() < 1e-3  # and not along the surface


# Integrators that are held


@pytest.mark.parametrize("law", LAWS)
def test_held_integrators_wait_in_contact_only(law: Law) -> None:
    params = make_params(
        law,
        stiffness=(0.0, 0.0),
        damping=(0.0, 0.0),
        force_integral=0.0,
        held_integrators=(1,),
        bumpless=False,
    )
    driven = Driven(params)
    driven.feed(**contact(selection=FREE, mode=APPROACH, desired_force=[0.0, 0.0]))
    e = np.array([0.02, -0.1])
    growth = np.array([200.0, 100.0]) * 0.25 * (e if law == "transpose" else np.linalg.solve(J, e))

    def integral(torque: Array) -> Array:
        return tip_force(torque) if law == "transpose" else torque

    first, second = integral(driven.tick()), integral(driven.tick())
    np.testing.assert_allclose([first, second], [growth, 2 * growth], rtol=1e-12)
    # The same selection, so that nothing but the mode differs.
    touching = integral(driven.tick(mode=CONTACT))
    np.testing.assert_allclose(touching, growth * [3, 2], rtol=1e-12)
    np.testing.assert_allclose(integral(driven.tick(mode=LOST)), growth * [4, 2], rtol=1e-12)
    back = integral(driven.tick(mode=APPROACH))
    np.testing.assert_allclose(back, growth * [5, 3], rtol=1e-12)


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
def test_full_dynamics_give_the_acceleration(arm: Arm, law: Law, known: bool) -> None:
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
        inertia=tuple(inertia),
        feedforward_torque=tuple(dynamics.gravity_torque(start)) if known else (),
    )
    driven = Driven(params, arm, dynamics)
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


def test_full_dynamics_leave_the_push_alone() -> None:
    params = HybridControllerParams(
        stiffness=(100.0,) * 3,
        integral=(0.0,) * 3,
        damping=(10.0,) * 3,
        force_integral=4.0,
        inertia=(0.5, 0.6, 0.7),
        bumpless=False,
    )
    q = np.full(3, 0.5)
    driven = Driven(params, PUMA_250, ArmDynamics(PUMA_250))
    found = driven.tick(
        selection=np.diag([1.0, 1.0, 0.0]), mode=CONTACT, desired_force=[0.0, 0.0, -5.0]
    )
    plant, context = load(PUMA_250)
    plant.SetPositions(context, q)
    gravity = -plant.CalcGravityGeneralizedForces(context)
    push = PUMA_250.jacobian(q).T @ [0.0, 0.0, -5.0 * (1 + 4.0 * 0.005)]
    np.testing.assert_allclose(found, gravity + push, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_known_torque_is_added(law: Law) -> None:
    known = np.array([2.0, -1.0])
    plain = Driven(make_params(law))
    fed = Driven(make_params(law, feedforward_torque=tuple(known)))
    np.testing.assert_array_equal(fed.read("torque"), known)
    np.testing.assert_array_equal(plain.read("torque"), [0.0, 0.0])
    for mode in (APPROACH, CONTACT, CONTACT, LOST, LOST, CONTACT, APPROACH):
        inputs = contact(mode=mode, selection=ALONG if mode else FREE)
        expected = plain.tick(**inputs) + known
        np.testing.assert_allclose(fed.tick(**inputs), expected, rtol=0, atol=1e-10)


# The block


def test_ports() -> None:
    ones = dict.fromkeys(("stiffness", "integral", "damping"), (1.0,) * 4)
    block = HybridController(ADEPT_ONE, make_params(**ones))
    sizes = {
        block.get_input_port(i).get_name(): block.get_input_port(i).size()
        for i in range(block.num_input_ports())
    }
    assert sizes == {
        "encoders": 8,
        "desired_position": 4,
        "desired_force": 4,
        "measured_force": 4,
        "selection": 16,
        "mode": 1,
    }
    outputs = [block.get_output_port(i).get_name() for i in range(block.num_output_ports())]
    assert outputs == ["torque", "position_error", "force_error"]
    assert not block.HasAnyDirectFeedthrough()


def test_torque_is_held_between_ticks() -> None:
    driven = Driven(make_params())
    torque = driven.tick(**contact())
    driven.feed(**contact(desired_position=X + 1.0, desired_force=-30 * DOWN))
    for time in (0.001, 0.1, 0.249):
        driven.simulator.AdvanceTo(time)
        np.testing.assert_array_equal(driven.read("torque"), torque)
    driven.simulator.AdvanceTo(0.251)
    assert not np.allclose(driven.read("torque"), torque)


@pytest.mark.parametrize("period", [0.005, 0.125])
def test_ticks_at_its_period(period: float) -> None:
    # The integral of a constant error counts them.
    params = make_params("transpose", stiffness=(0.0, 0.0), period=period)
    driven = Driven(params)
    driven.feed(**contact(selection=FREE, mode=APPROACH))
    driven.simulator.AdvanceTo(10.5 * period)
    expected = 11 * period * np.array([200.0, 100.0]) * [0.02, -0.1]
    np.testing.assert_allclose(tip_force(driven.read("torque")), expected, rtol=1e-12)


def test_plant_of_the_same_instant_sees_the_new_torque() -> None:
    builder = DiagramBuilder()
    params = make_params()
    block = builder.AddSystem(HybridController(PLANAR_TWO_LINK, params))
    for name, value in contact(selection=FREE, mode=[APPROACH]).items():
        source = builder.AddSystem(ConstantVectorSource(np.asarray(value, dtype=float).ravel()))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    keep = builder.AddSystem(
        AffineSystem(
            A=np.zeros((2, 2)),
            B=np.eye(2),
            f0=np.zeros(2),
            C=np.eye(2),
            D=np.zeros((2, 2)),
            y0=np.zeros(2),
            time_period=params.period,
        )
    )
    builder.Connect(block.GetOutputPort("torque"), keep.get_input_port())
    simulator = Simulator(builder.Build())
    for ticks in range(3):
        simulator.AdvanceTo(ticks * params.period)
        simulator.AdvancePendingEvents()
        seen = keep.get_output_port().Eval(keep.GetMyContextFromRoot(simulator.get_context()))
        torque = block.GetOutputPort("torque").Eval(
            block.GetMyContextFromRoot(simulator.get_context())
        )
        assert np.abs(torque).max() > 1
        np.testing.assert_array_equal(seen, torque)


def test_contexts_are_apart() -> None:
    driven = Driven(make_params())
    driven.tick(**contact(selection=FREE, mode=APPROACH))
    first = driven.tick()
    again = Driven(make_params())
    fresh = Simulator(driven.block)
    for port in range(6):
        value = driven.block.get_input_port(port).Eval(driven.context)
        driven.block.get_input_port(port).FixValue(fresh.get_mutable_context(), value)
    fresh.AdvanceTo(0.25)
    fresh.AdvancePendingEvents()
    found = driven.block.GetOutputPort("torque").Eval(fresh.get_context())
    np.testing.assert_array_equal(found, first)
    assert not np.any(again.read("torque"))


# What is refused


PORTS = {
    "encoders": 4,
    "desired_position": 2,
    "desired_force": 2,
    "measured_force": 2,
    "selection": 4,
    "mode": 1,
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("mode", [APPROACH, CONTACT, LOST])
@pytest.mark.parametrize("bad", [math.nan, -math.inf])
@pytest.mark.parametrize("port", PORTS)
def test_inputs_have_to_be_finite(port: str, bad: float, mode: int) -> None:
    for index in range(PORTS[port]):
        driven = Driven(make_params())
        driven.tick(**contact(selection=ALONG if mode else FREE, mode=CONTACT if mode else 0))
        value = driven.block.GetInputPort(port).Eval(driven.context).copy()
        value[index] = bad
        driven.feed(mode=mode)
        with pytest.raises(ParameterError) as caught:
            driven.tick(**{port: value})
        message = str(caught.value)
        assert message == f"{port} is {value.tolist()}, allowed: finite numbers"
        # What was there is kept.
        assert np.all(np.isfinite(driven.read("torque")))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    "selection", [[[0.5, 0.0], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]], [[2.0, 0.0], [0.0, 1.0]]]
)
def test_selection_has_to_be_a_projection(law: Law, selection: list[list[float]]) -> None:
    driven = Driven(make_params(law))
    driven.tick(**contact())
    with pytest.raises(ParameterError) as caught:
        driven.tick(selection=selection)
    allowed = "a symmetric projection, P P = P = P^T"
    assert str(caught.value) == f"selection is {selection}, allowed: {allowed}"


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("arm", "q", "printed"),
    [
        (PLANAR_TWO_LINK, (0.5, 0.0), "[0.5, 0.0]"),
        (PLANAR_TWO_LINK, (0.5, 1e-7), "[0.5, 1e-07]"),
        (PUMA_250, (0.1, 0.2, 0.0), "[0.1, 0.2, 0.0]"),
        (ADEPT_ONE, (0.1, 0.0, 0.2, 0.3), "[0.1, 0.0, 0.2, 0.3]"),
    ],
)
def test_singular_pose(law: Law, arm: Arm, q: tuple[float, ...], printed: str) -> None:
    n = arm.num_joints
    driven = Driven(
        make_params(law, **dict.fromkeys(("stiffness", "integral", "damping"), (9.0,) * n)), arm
    )
    driven.tick()
    with pytest.raises(ParameterError) as caught:
        driven.tick(encoders=[*q, *np.zeros(n)])
    allowed = "one in which the Jacobian is regular"
    assert str(caught.value) == f"the pose of the {arm.name} is {printed}, allowed: {allowed}"


def test_nearly_singular_pose_is_fine() -> None:
    driven = Driven(make_params())
    q = np.array([0.5, 1e-4])
    torque = driven.tick(encoders=[*q, 0, 0], desired_position=PLANAR_TWO_LINK.endpoint(q))
    np.testing.assert_allclose(torque, [0, 0], rtol=0, atol=1e-6)


@pytest.mark.parametrize("port", PORTS)
def test_inputs_have_their_size(port: str) -> None:
    driven = Driven(make_params())
    with pytest.raises(RuntimeError):
        driven.feed(**{port: np.zeros(PORTS[port] + 1)})


def test_gains_have_to_fit_the_arm() -> None:
    message = r"^stiffness is \(400.0, 300.0\), allowed: 3 numbers for Puma 250$"
    with pytest.raises(ParameterError, match=message):
        HybridController(PUMA_250, make_params())


def test_inertia_goes_with_a_model() -> None:
    allowed = "allowed: set with a model, None without one"
    with pytest.raises(ParameterError, match=rf"^inertia is \(1.0, 1.0\), {allowed}$"):
        HybridController(PLANAR_TWO_LINK, make_params(inertia=(1.0, 1.0)))
    with pytest.raises(ParameterError, match=rf"^inertia is None, {allowed}$"):
        HybridController(PLANAR_TWO_LINK, make_params(), dynamics=ArmDynamics(PLANAR_TWO_LINK))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"law": "pinv"}, "law is 'pinv', allowed: inverse, transpose, projected"),
        ({"creep_speed": 0.0}, "creep_speed is 0.0, allowed: a finite number > 0"),
        ({"creep_damping": -1.0}, "creep_damping is -1.0, allowed: a finite number > 0"),
        ({"creep_ramp": math.nan}, "creep_ramp is nan, allowed: a finite number > 0"),
        ({"period": math.inf}, "period is inf, allowed: a finite number > 0"),
        ({"force_integral": -1.0}, "force_integral is -1.0, allowed: a finite number >= 0"),
        ({"integral": (1.0,)}, "integral is (1.0,), allowed: 2 finite numbers >= 0"),
        ({"damping": (1.0, -1.0)}, "damping is (1.0, -1.0), allowed: 2 finite numbers >= 0"),
        (
            {"stiffness": (1.0, math.nan)},
            "stiffness is (1.0, nan), allowed: 2 finite numbers >= 0",
        ),
        ({"held_integrators": (0, 2)}, "held_integrators is (0, 2), allowed: indices below 2"),
        ({"held_integrators": (-1,)}, "held_integrators is (-1,), allowed: indices below 2"),
        ({"inertia": (1.0,)}, "inertia is (1.0,), allowed: 2 finite numbers > 0"),
        ({"inertia": (1.0, 0.0)}, "inertia is (1.0, 0.0), allowed: 2 finite numbers > 0"),
        (
            {"inertia": (1.0, 1.0), "law": "transpose"},
            "law is 'transpose', allowed: inverse or projected with full dynamics",
        ),
        (
            {"feedforward_torque": (1.0,)},
            "feedforward_torque is (1.0,), allowed: 2 finite numbers, or none",
        ),
        (
            {"feedforward_torque": (1.0, math.nan)},
            "feedforward_torque is (1.0, nan), allowed: 2 finite numbers, or none",
        ),
    ],
)
def test_parameters(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        make_params(**changes)
    assert str(caught.value) == message
