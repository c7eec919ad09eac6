"""The hybrid controller: its laws from their formulas, its switches, and what it refuses."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_controller import AccelerationFeedforward, HybridController
from chamfer.systems.force.hybrid_law import HybridControllerParams, LawKind

Array = np.ndarray

LAWS: tuple[LawKind, ...] = ("inverse", "transpose", "projected")
APPROACH, CONTACT, LOST = 0, 1, 2
DOWN = np.array([0.0, -1.0])
ALONG = np.diag([1.0, 0.0])  # P in contact
FREE = np.eye(2)


def test_torque_is_held_between_ticks(drive: Any, contact: Any) -> None:
    driven = drive()
    torque = driven.tick(**contact())
    # Errors are told before the selection.
    np.testing.assert_allclose(driven.read("position_error"), [0.02, -0.1], rtol=0, atol=1e-14)
    np.testing.assert_array_equal(driven.read("force_error"), [-4.0, -4.0])
    driven.feed(**contact(desired_position=contact.x + 1.0, desired_force=-30 * DOWN))
    for time in (0.001, 0.1, 0.249):
        driven.simulator.AdvanceTo(time)
        np.testing.assert_array_equal(driven.read("torque"), torque)
    driven.simulator.AdvanceTo(0.251)
    assert not np.allclose(driven.read("torque"), torque)


@pytest.mark.parametrize(
    ("selection", "allowed"),
    [
        ([[1.0, 1.0], [0.0, 0.0]], "a symmetric projection, P P = P = P^T"),
        ([[1.0, 0.0], [0.0, 1.0]], "a rank below 2 in contact, to leave the force a direction"),
    ],
)
def test_selection_has_to_leave_the_force_a_direction(
    drive: Any, contact: Any, selection: list[list[float]], allowed: str
) -> None:
    driven = drive()
    driven.tick(**contact(selection=FREE, mode=APPROACH))
    with pytest.raises(ParameterError) as caught:
        driven.tick(selection=selection, mode=CONTACT)
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
def test_singular_pose(
    make_params: Any, drive_arm: Any, law: LawKind, arm: Arm, q: tuple[float, ...], printed: str
) -> None:
    n = arm.num_joints
    gains = dict.fromkeys(("stiffness", "integral", "damping"), (9.0,) * n)
    driven = drive_arm(arm, make_params(law, **gains))
    driven.tick()
    with pytest.raises(ParameterError) as caught:
        driven.tick(encoders=[*q, *np.zeros(n)])
    allowed = "one in which the Jacobian is regular"
    assert str(caught.value) == f"the pose of the {arm.name} is {printed}, allowed: {allowed}"


def test_full_dynamics_go_with_a_model(make_params: Any) -> None:
    full = make_params(full_dynamics=True, inertia=(1.0, 1.0))
    with pytest.raises(ParameterError, match=r"^full_dynamics is True, allowed: true with a mod"):
        HybridController(PLANAR_TWO_LINK, full)
    with pytest.raises(ParameterError, match=r"^inertia is \(1.0, 1.0\), allowed: None without"):
        HybridController(PLANAR_TWO_LINK, make_params(inertia=(1.0, 1.0)))
    dynamics = ArmDynamics(PLANAR_TWO_LINK)
    with pytest.raises(ParameterError, match=r"^full_dynamics is False, allowed: true with a mod"):
        HybridController(PLANAR_TWO_LINK, make_params(), dynamics=dynamics)


ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE)


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
def test_laws_in_contact(drive_arm: Any, arm: Arm, law: LawKind, seed: int) -> None:
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


@pytest.mark.parametrize("law", LAWS)
def test_damping_of_the_force_domain(drive: Any, contact: Any, law: LawKind) -> None:
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


@pytest.mark.parametrize("law", ["inverse", "projected"])
@pytest.mark.parametrize("arm", [PUMA_250, ADEPT_ONE], ids=lambda arm: arm.name)
@pytest.mark.parametrize("known", [False, True], ids=["", "gravity fed forward"])
def test_full_dynamics_give_the_acceleration(
    drive_arm: Any, arm: Arm, law: LawKind, known: bool
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
    for _ in range(3):
        q, v, e = regular_pose(arm, rng), rng.normal(size=n), 0.1 * rng.normal(size=n)
        found = driven.tick(encoders=np.concatenate([q, v]), desired_position=arm.endpoint(q) + e)
        effort = np.array(params.stiffness) * np.linalg.solve(arm.jacobian(q), e)
        effort -= np.array(params.damping) * v
        state = dynamics.evaluate(q, v)
        expected = state.mass @ (effort / inertia) + state.bias
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_damping_acts_on_the_error_of_the_rate(drive: Any, contact: Any, law: LawKind) -> None:
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


EXACT = 1e-12


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("before", "after"),
    [(APPROACH, CONTACT), (CONTACT, APPROACH), (LOST, CONTACT), (LOST, APPROACH)],
)
def test_torque_does_not_jump(
    drive: Any, contact: Any, law: LawKind, before: int, after: int
) -> None:
    driven = drive(law)
    selection = {APPROACH: FREE, CONTACT: ALONG, LOST: ALONG}
    driven.tick(**contact(selection=FREE, mode=APPROACH))
    for _ in range(3):
        torque = driven.tick(selection=selection[before], mode=before)
    found = driven.tick(selection=selection[after], mode=after)
    np.testing.assert_allclose(found, torque, rtol=0, atol=EXACT)


@pytest.mark.parametrize("law", LAWS)
def test_offset_stays_as_it_is_within_a_mode(drive: Any, contact: Any, law: LawKind) -> None:
    # From tick to tick the torque changes by what the law without an offset changes.
    smooth, plain = drive(law), drive(law, bumpless=False)
    rng = np.random.default_rng(5)
    found, expected = [], []
    for mode in [APPROACH] * 2 + [CONTACT] * 6 + [APPROACH] * 3 + [CONTACT] * 3:
        inputs = contact(
            encoders=np.concatenate([contact.q + 0.1 * rng.normal(size=2), rng.normal(size=2)]),
            desired_position=contact.x + 0.1 * rng.normal(size=2),
            measured_force=rng.normal(size=2),
            selection=ALONG if mode else FREE,
            mode=mode,
        )
        found.append(smooth.tick(**inputs))
        expected.append(plain.tick(**inputs))
    change, wanted = np.diff(found, axis=0), np.diff(expected, axis=0)
    for switch in (1, 7, 10):
        np.testing.assert_allclose(change[switch], [0, 0], rtol=0, atol=EXACT)
        assert np.abs(wanted[switch]).max() > 10  # N m
        wanted[switch] = 0
    np.testing.assert_allclose(change, wanted, rtol=0, atol=1e-11)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("away", [0.0, 0.3])  # m/s
def test_push_is_let_go_and_a_bounce_is_damped(
    drive: Any, contact: Any, law: LawKind, away: float
) -> None:
    known = np.array([5.0, -3.0])
    driven = drive(law, creep_damping=70.0, feedforward_torque=tuple(known))
    for _ in range(4):
        torque = driven.tick(**contact())
    before = contact.tip_force(torque - known)
    assert abs(before[1]) > 1
    # Moving along the surface as well, at 0.2 m/s; what acts along it stays.
    moving = np.concatenate([contact.q, np.linalg.solve(contact.J, [0.2, away])])
    after = contact.tip_force(driven.tick(mode=LOST, encoders=moving) - known)
    np.testing.assert_allclose(after, [before[0], -70.0 * away], rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("speed", "share", "force"),  # m/s towards the surface; of the ramp; N
    [
        *((-9.0, 1.0, 15.0), (-0.01, 1.0, 15.0), (0.0, 1.0, 4.0), (0.02, 0.5, 15.0)),
        *((0.04, 0.0, 15.0), (0.08, -1.0, 15.0), (9.0, -1.0, 15.0), (0.0, -1.0, -15.0)),
    ],
)
def test_push_grows_by_what_is_missing_to_the_creep_speed(
    drive: Any, contact: Any, speed: float, share: float, force: float
) -> None:
    driven = drive("projected", integral=(0.0, 0.0), creep_speed=0.04, creep_ramp=40.0)
    moving = np.concatenate([contact.q, np.linalg.solve(contact.J, speed * DOWN)])
    # Towards where the desired force points, whatever its size.
    driven.tick(**contact(encoders=moving, desired_force=force * DOWN))
    torques = [driven.tick(mode=LOST) for _ in range(4)]
    growth = contact.tip_force(np.diff(torques, axis=0).T).T
    np.testing.assert_allclose(growth, [40.0 * 0.25 * share * DOWN] * 3, rtol=0, atol=1e-10)


def test_force_integral_waits_for_contact(drive: Any, contact: Any) -> None:
    driven = drive(bumpless=False)
    driven.feed(**contact(desired_position=contact.x))
    driven.tick()
    for _ in range(9):
        driven.tick(mode=LOST, measured_force=[0.0, 0.0])
    # Two periods in contact, and nothing of the nine between.
    expected = contact.J.T @ (DOWN * (15.0 + 2 * 3.0 * 4.0 * 0.25))
    found = driven.tick(mode=CONTACT, measured_force=11 * DOWN)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_loss_may_be_ignored(drive: Any, contact: Any, law: LawKind) -> None:
    # As if it were contact.
    ignoring, touching = drive(law, loss_mode=False), drive(law)
    rng = np.random.default_rng(2)
    for mode in (APPROACH, CONTACT, CONTACT, LOST, LOST, CONTACT, LOST, APPROACH, LOST):
        inputs = contact(
            encoders=np.concatenate([contact.q, rng.normal(size=2)]),
            measured_force=rng.normal(size=2),
            selection=ALONG if mode else FREE,
        )
        found = ignoring.tick(**{**inputs, "mode": mode})
        expected = touching.tick(**{**inputs, "mode": min(mode, CONTACT)})
        np.testing.assert_array_equal(found, expected)


PLACE = np.array([0.4, 0.9, 0.2, -0.3])
WANTED = np.array([0.5, -0.3, 0.8, 0.2])


def feedforward(
    selection: np.ndarray, acceleration: np.ndarray, *, diagonal: bool = False
) -> np.ndarray:
    model = ArmDynamics(ADEPT_ONE)
    block = AccelerationFeedforward(ADEPT_ONE, model, period=0.005, diagonal=diagonal)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("encoders").FixValue(context, [*PLACE, 1.0, -2.0, 0.1, 0.5])
    block.GetInputPort("desired_acceleration").FixValue(context, acceleration)
    block.GetInputPort("selection").FixValue(context, selection.ravel())
    assert not block.HasAnyDirectFeedthrough()
    simulator.AdvanceTo(0.001)
    found: np.ndarray = block.GetOutputPort("torque").Eval(context).copy()
    return found


def test_from_rest_the_arm_accelerates_as_wanted_in_the_position_domain_alone() -> None:
    # x'' = J M^-1 tau, where nothing else acts.
    mass = ArmDynamics(ADEPT_ONE).evaluate(PLACE, np.zeros(4)).mass
    normal = np.array([0.6, 0.8, 0.0, 0.0])
    for P in (np.eye(4), np.eye(4) - np.outer(normal, normal)):
        found = ADEPT_ONE.jacobian(PLACE) @ np.linalg.solve(mass, feedforward(P, WANTED))
        np.testing.assert_allclose(found, P @ WANTED, atol=1e-12)
        joints = np.linalg.solve(ADEPT_ONE.jacobian(PLACE), P @ WANTED)
        alone = feedforward(P, WANTED, diagonal=True)
        np.testing.assert_allclose(alone, np.diag(mass) * joints, atol=1e-12)
