"""Kinematic stability: published poses, the controller linearised by differences, and a run."""

import math
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm, Elbow
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
from chamfer.systems.force.hybrid_law import (
    HybridControllerParams,
    HybridLaw,
    HybridMemory,
    HybridObservation,
    LawKind,
)
from chamfer.systems.force.hybrid_linear import (
    Pose,
    free_growth_rate,
    linear_law,
    stiffness_eigenvalues,
)
from chamfer.systems.force.sampled_loop import (
    NEUTRAL,
    Plant,
    Sampled,
    closed,
    delay_margin,
    gain_margin,
    growth_rate,
    held,
)

Array = np.ndarray

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE)
DYNAMICS = {arm.name: ArmDynamics(arm) for arm in ARMS}
for one in DYNAMICS.values():
    one.chain = one.chain._replace(gravity=np.zeros(3))
LAWS: tuple[LawKind, ...] = ("inverse", "transpose", "projected")
ELBOWS: tuple[Elbow, ...] = ("negative", "positive")
TOUCH = np.array([1.0, -1.5])  # m, the nominal contact point
ALONG = np.diag([1.0, 0.0])
FORCE = 15.0  # N


def make_params(law: LawKind = "inverse", size: int = 2, **changes: Any) -> HybridControllerParams:
    """Return the gains of chapter 2."""
    fields: dict[str, Any] = {
        "stiffness": (400.0,) * size,
        "integral": (400.0,) * size,
        "damping": (60.0,) * size,
        "force_integral": 0.0,
        "feedforward_torque": (),
    }
    return HybridControllerParams(law=law, **{**fields, **changes})


def mass_and_jacobian(arm: Arm, q: Array) -> tuple[Array, Array]:
    return DYNAMICS[arm.name].evaluate(q, np.zeros(len(q))).mass, arm.jacobian(q)


def planar(x: Array, elbow: Elbow) -> tuple[Array, Array]:
    return mass_and_jacobian(PLANAR_TWO_LINK, PLANAR_TWO_LINK.joint_positions(x, elbow))


def random_case(arm: Arm, seed: int) -> tuple[Array, Array, Array, Array]:
    """Return a regular pose, its mass matrix and Jacobian, and a random surface's P."""
    rng, n = np.random.default_rng(seed), arm.num_joints
    while True:
        q = rng.uniform(-math.pi, math.pi, n)
        if np.linalg.cond(arm.jacobian(q)) < 50:
            break
    normal = rng.normal(size=n)
    P = np.eye(n) - np.outer(normal, normal) / (normal @ normal)
    return q, *mass_and_jacobian(arm, q), P


@pytest.mark.parametrize(("elbow", "other"), [("positive", -0.623), ("negative", 4.62)])
def test_nominal_contact_point(elbow: Elbow, other: float) -> None:
    mass, J = planar(TOUCH, elbow)
    found = np.sort_complex(stiffness_eigenvalues(mass, J, ALONG, "inverse"))
    expected = sorted([0.0, other])
    np.testing.assert_allclose(found.real, expected, rtol=0, atol=5e-3)
    np.testing.assert_allclose(found.imag, 0, atol=1e-12)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_projected_and_transpose_have_no_negative_eigenvalue(arm: Arm, seed: int) -> None:
    _, mass, J, P = random_case(arm, seed)
    for law in ("projected", "transpose"):
        found = stiffness_eigenvalues(mass, J, P, law)
        scale = np.abs(found).max()
        assert found.real.min() >= -1e-9 * scale
        assert np.abs(found.imag).max() <= 1e-6 * scale
        # The same as those of a symmetric matrix, L^-1 S L^-T with M = L L^T.
        joint = np.linalg.svd(P @ J)[2][: len(J) - 1]  # what the surface leaves free
        S = J.T @ P @ J if law == "transpose" else joint.T @ joint
        L = np.linalg.inv(np.linalg.cholesky(mass))
        expected = np.linalg.eigvalsh(L @ S @ L.T)
        np.testing.assert_allclose(np.sort(found.real), expected, rtol=1e-7, atol=1e-7 * scale)
        assert expected[1] > 1e-9 * scale > abs(expected[0])  # the normal alone is not held


@pytest.mark.parametrize(
    ("law", "elbow", "rate", "tolerance"),
    [
        ("inverse", "positive", 33.6, 0.3),
        ("inverse", "negative", 0.0, NEUTRAL),
        *((law, elbow, 0.0, NEUTRAL) for law in ("projected", "transpose") for elbow in ELBOWS),
    ],
)
def test_growth_at_the_contact_point(
    law: LawKind, elbow: Elbow, rate: float, tolerance: float
) -> None:
    params = make_params(law, period=1e-5)  # as in continuous time
    found = free_growth_rate(*planar(TOUCH, elbow), ALONG, params, np.ones(2))
    assert found == pytest.approx(rate, abs=tolerance)


def ahead(P: Array) -> Array:
    """Return the unit vector that P leaves to the force."""
    along: Array = np.linalg.eigh(np.eye(len(P)) - P)[1][:, -1]
    return along


def linearised(arm: Arm, q0: Array, P: Array, params: HybridControllerParams, mode: int) -> Array:
    """Return the controller's response about a pose at rest, by differences of the law.

    Rows: the memory's integrals and push, and the torque; columns: the same memory, joint
    positions, velocities and the measured force.
    """
    n, dynamics = len(q0), DYNAMICS[arm.name]
    law = HybridLaw(arm, params, dynamics=dynamics.evaluate if params.full_dynamics else None)
    zero = np.zeros(n)

    def tick(z: Array) -> Array:
        integral, force, push, q, v, measured = np.split(z, np.cumsum([n, n, 1, n, n]))
        memory = HybridMemory(
            torque=zero,
            position_integral=integral,
            force_integral=force,
            offset=zero,
            creep=push,
            mode=np.array([float(mode)]),
            position_error=zero,
            force_error=zero,
        )
        x, pushed = arm.endpoint(q0), FORCE * ahead(P)
        seen = HybridObservation(
            np.concatenate([q, v]), x, pushed, measured, P.ravel(), memory.mode
        )
        now = law.update(memory, seen, 0.0)
        return np.concatenate([now.position_integral, now.force_integral, now.creep, now.torque])

    rest = np.zeros(n)
    if mode == LOST:  # at the creep speed, where the push stays as it is
        rest = np.linalg.solve(arm.jacobian(q0), params.creep_speed * ahead(P))
    start = np.concatenate([np.zeros(2 * n + 1), q0, rest, FORCE * ahead(P)])
    h = 1e-6
    columns = [
        (tick(start + h * axis) - tick(start - h * axis)) / (2 * h) for axis in np.eye(len(start))
    ]
    return np.transpose(columns)


def turning(arm: Arm, q: Array, force: Array) -> Array:
    """Return how the torque of a constant endpoint force changes with q, by complex steps."""
    h = 1e-30
    columns = [arm.jacobian(q + 1j * h * axis).imag.T @ force / h for axis in np.eye(len(q))]
    return np.transpose(columns)


@pytest.mark.parametrize("mode", [APPROACH, CONTACT, LOST, LOST + 1])
@pytest.mark.parametrize(
    ("law", "full"),
    [*((law, False) for law in LAWS), ("inverse", True), ("projected", True)],
    ids=lambda value: {True: "full dynamics", False: ""}.get(value, value),
)
@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
def test_linear_law_is_that_of_the_controller(
    arm: Arm, law: LawKind, full: bool, mode: int
) -> None:
    q, mass, J, P = random_case(arm, 3)
    n = len(q)
    if mode == APPROACH:
        P = np.eye(n)
    rng = np.random.default_rng(3)
    params = make_params(
        law,
        stiffness=tuple(rng.uniform(100, 400, n)),
        integral=tuple(rng.uniform(100, 400, n)),
        damping=tuple(rng.uniform(10, 60, n)),
        force_integral=3.0,
        force_damping=20.0,
        creep_speed=1e-3,  # m/s, so slow that the arm is as good as at rest
        held_integrators=(1,),
        full_dynamics=full,
        inertia=tuple(rng.uniform(0.5, 2, n)) if full else None,
    )
    push = FORCE * ahead(P) if mode not in (APPROACH, LOST) else np.zeros(n)
    pose = Pose(mass, J, turning(arm, q, push), np.zeros((n, n)))
    found = linear_law(pose, P, params, mode)
    found_all = np.block([[found.A, found.B], [found.C, found.D]])
    expected = linearised(arm, q, P, params, mode)
    if mode == LOST:  # it creeps: how that turns with the arm is left out
        expected[:, 2 * n + 1 : 3 * n + 1] = found_all[:, 2 * n + 1 : 3 * n + 1]
    np.testing.assert_allclose(found_all, expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


def test_what_overflows_grows_without_bound() -> None:
    case = planar(TOUCH, "negative")
    assert free_growth_rate(*case, ALONG, make_params(), np.array([1e300, 1.0])) == np.inf


PERIOD = 0.1
FLOW = np.array([[0.0, 1.0], [-4.0, -0.5]])
DRIVE = np.array([[0.0, 0.2], [1.0, -0.3]])
PLANT = Plant(FLOW, DRIVE, np.array([[1.0, 0.0]]), np.zeros((0, 2)))


def responses(system: Sampled, inputs: Array) -> Array:
    z, seen = np.zeros(len(system.A)), []
    for u in inputs:
        seen.append(system.C @ z + system.D @ u)
        z = system.A @ z + system.B @ u
    return np.array(seen)


@pytest.mark.parametrize("parts", [0, 1, 4, 6, 8])
@pytest.mark.parametrize("behind", [0, 1, 3, 4, 5, 8, 9])
def test_an_output_shows_what_was(parts: int, behind: int) -> None:
    fine = held(PLANT, period=PERIOD / 4)
    inputs = np.random.default_rng(2).normal(size=(12, 2))
    late = np.vstack([np.zeros((parts, 2)), np.repeat(inputs, 4, axis=0)])[:48]
    seen = np.concatenate([np.zeros(behind), responses(fine, late)[:, 0]])[:48:4]
    slow = PLANT._replace(late=np.array([[1.0, 0.0]]), lateness=behind * PERIOD / 4)
    found = responses(held(slow, period=PERIOD, delay=parts * PERIOD / 4), inputs)
    np.testing.assert_allclose(found[:, 0], responses(fine, late)[::4, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[:, 1], seen, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scale", [0.0, 1e-6, 1.0, 300.0])
def test_a_period_is_that_of_the_matrix_exponential(scale: float) -> None:
    flow = scale * (np.random.default_rng(3).normal(size=(5, 5)) - 6 * np.eye(5))
    plant = Plant(flow, np.ones((5, 1)), np.eye(5), np.zeros((0, 5)))
    found = held(plant, period=PERIOD)
    expected = control.c2d(control.ss(flow, np.ones((5, 1)), np.eye(5), 0), PERIOD, "zoh")
    np.testing.assert_allclose(found.A, expected.A, rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.B, expected.B, rtol=0, atol=1e-11)


def integrator_loop(gain: float, factor: float = 1.0, delay: float = 0.0) -> float:
    """Return the growth of ``x' = u`` with ``u = -gain x`` held over a period."""
    integrator = Plant(np.zeros((1, 1)), np.eye(1), np.eye(1), np.zeros((0, 1)))
    plant = held(integrator, period=PERIOD, delay=delay)
    law = Sampled(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[-gain]]))
    return growth_rate(closed(plant, law, factor), PERIOD)


@pytest.mark.parametrize("gain", [2.0, 5.0, 15.0, 19.0])
def test_margins_of_an_integrator(gain: float) -> None:
    assert gain_margin(lambda factor: integrator_loop(gain, factor)) == pytest.approx(
        2 / (gain * PERIOD), rel=1e-3
    )
    if gain == 15.0:  # less than a period late, the poles' product is gain * delay
        margin = delay_margin(lambda delay: integrator_loop(gain, delay=delay), PERIOD)
        assert margin == pytest.approx(1 / gain, rel=5e-3)
    if gain == 2.0:  # slow: as in continuous time, less half a period of the hold
        margin = delay_margin(lambda delay: integrator_loop(gain, delay=delay), PERIOD)
        assert margin == pytest.approx(math.pi / 2 / gain - PERIOD / 2, rel=3e-2)


def test_a_loop_that_is_unstable_or_never_so() -> None:
    assert gain_margin(lambda factor: integrator_loop(40.0, factor)) == pytest.approx(
        0.5, rel=1e-3
    )
    assert delay_margin(lambda delay: integrator_loop(40.0, delay=delay), PERIOD) == 0.0
    assert gain_margin(lambda factor: -1.0) is None
    assert gain_margin(lambda factor: 1.0) is None
    assert delay_margin(lambda delay: -1.0, PERIOD) is None
    # Looked at is from a thousandth to a thousand.
    for limit, seen in ((900.0, True), (1100.0, False), (1.1e-3, True), (0.9e-3, False)):
        found = gain_margin(lambda factor, limit=limit: 1e6 * (factor - limit))  # type: ignore[misc]
        assert found == (pytest.approx(limit, rel=1e-3) if seen else None)
