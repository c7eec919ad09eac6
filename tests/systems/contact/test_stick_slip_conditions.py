"""Sticking friction and contact against the conditions they solve, on random arms."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.systems.contact.stick_slip import Held, Material, Motion, Moved, step

H = 1e-4  # s
seeds = st.integers(0, 2**32 - 1)
several = pytest.mark.parametrize("points", [1, 2])
both = pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "gripper"])


class Case(NamedTuple):
    held: Held
    material: Material
    motion: Motion
    gripper_damping: np.ndarray


def random_case(
    seed: int,
    *,
    rigid: bool = True,
    driven: bool = True,
    stiffness: float | None = None,
    mu: float | None = None,
    points: int = 1,
) -> Case:
    """An arm of 1 to 4 joints near surfaces, with every kind of friction; some joints at rest."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))

    def conditioned(rows: int, least: float) -> np.ndarray:
        u, _, vt = np.linalg.svd(rng.normal(size=(rows, n)), full_matrices=False)
        return u @ np.diag(rng.uniform(least, 1.0, len(vt))) @ vt

    root = conditioned(n, 0.5)
    normals = rng.normal(size=(points, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
    jacobians = np.array([conditioned(3, 0.4) for _ in range(points)])
    if n == 2:  # a planar arm on surfaces at right angles to its plane
        plane, _ = np.linalg.qr(rng.normal(size=(3, 2)))
        jacobians = np.array([plane @ conditioned(2, 0.4) for _ in range(points)])
        normals = np.array([plane @ [math.cos(a), math.sin(a)] for a in 1.0 + np.arange(points)])
    stuck = rng.integers(0, 2, n).astype(float)
    spring, damping, stretch = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    yielding = np.zeros((3, 3))
    if not rigid:
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        spring = turn @ np.diag(10 ** rng.uniform(2, 5, 3)) @ turn.T
        damping = turn @ np.diag(10 ** rng.uniform(-1, 2, 3)) @ turn.T
        yielding = np.linalg.inv(H * spring + damping)
        stretch = rng.normal(size=3) * 1e-3
    return Case(
        Held(
            10 ** rng.uniform(-1, 1) * root @ root.T,
            rng.normal(size=n) * 5 * driven,
            jacobians,
            rng.uniform(-1e-3, 1e-4, points),
            normals,
            rng.uniform(0, 1, points) if mu is None else np.full(points, mu),
            rigid,
            yielding,
            spring,
            stretch,
        ),
        Material(
            rng.uniform(0, 2, n),
            rng.uniform(1, 2),
            0.02,
            rng.uniform(0, 2, n),
            10 ** rng.uniform(3, 4.5, points) if stiffness is None else np.full(points, stiffness),
            10 ** rng.uniform(0, 2, points),
        ),
        Motion(
            np.where(stuck, 0.0, rng.normal(size=n) * 10 ** rng.uniform(-3, 0)),
            stuck,
            rng.normal(size=n) * 1e-5,
            rng.normal(size=(points, 3)) * 1e-5,
        ),
        damping,
    )


def energy(
    case: Case, velocity: np.ndarray, gap: np.ndarray | float, stretch: np.ndarray
) -> float:
    kinetic = velocity @ case.held.mass @ velocity / 2
    elastic = np.sum(case.material.stiffness * np.minimum(gap, 0.0) ** 2)
    elastic += stretch @ case.held.stiffness @ stretch
    return float(kinetic + elastic / 2)


def law(case: Case, point: int, after: float) -> float:
    """Return the normal impulse for a gap after the step."""
    held, material = case.held, case.material
    gap, k, d = held.gap[point], material.stiffness[point], material.damping[point]
    damper = d * (min(after, 0.0) - min(gap, 0.0))
    if not case.held.rigid:
        return max(0.0, -H * k * after - damper)
    if min(gap, after) >= 0.0:
        return 0.0
    if max(gap, after) <= 0.0:
        return max(0.0, -H * k * (gap + after) / 2 - damper)
    stored = k * (min(after, 0.0) ** 2 - min(gap, 0.0) ** 2) / 2
    return max(0.0, -H * stored / (after - gap) - damper)


def check_conditions(case: Case, done: Moved) -> None:
    held, material, motion, gripper_damping = case
    mass, J = held.mass, held.J_v_WC
    before, v = motion.velocity, done.motion.velocity
    p_joint, p, mean = done.motion.joint_impulse, done.motion.impulse, (before + v) / 2
    speeds = 1e-3 + np.max(np.abs(before))
    assert done.solved
    # Equations of motion.
    right = H * (held.force - material.viscous * mean) + p_joint
    right += np.einsum("aij,ai->j", J, p)
    most = 1e-8 * speeds * np.linalg.norm(mass) + 1e-9 * np.max(np.abs(p))
    np.testing.assert_allclose(mass @ (v - before), right, rtol=0, atol=most)
    # Joints: held within the bound, else the bound against the motion.
    fading = np.where(motion.stuck, 1.0, np.exp(-((before / material.stribeck) ** 2)))
    bounds = H * material.coulomb * (1 + (material.breakaway - 1) * fading)
    for speed, impulse, bound, stuck in zip(v, p_joint, bounds, done.motion.stuck, strict=True):
        if stuck:
            assert speed == 0.0
            assert abs(impulse) <= bound * (1 + 1e-12)
        else:
            assert abs(impulse) == pytest.approx(bound, rel=1e-12)
            assert impulse * speed <= 1e-7 * bound * speeds
    # The gripper: spring and damper carry what the surfaces give.
    pull = H * held.stiffness @ (held.stretch + done.stretch) + gripper_damping @ done.stretch
    if held.rigid:
        np.testing.assert_array_equal(done.stretch, 0.0)
    else:
        weight = np.max(np.abs([*p, H * held.stiffness @ held.stretch]))
        np.testing.assert_allclose(pull, p.sum(axis=0), rtol=0, atol=1e-9 * weight)
    np.testing.assert_allclose(done.displacement, H * mean, rtol=1e-12)
    for point in range(len(p)):
        check_contact(case, done, point)
    # Energy: all that is gone is booked.
    gone = energy(case, before, held.gap, held.stretch) + H * held.force @ mean
    gone -= energy(case, v, done.gap, held.stretch + done.stretch)
    scale = energy(case, np.abs(before) + np.abs(v), held.gap, held.stretch)
    assert done.dissipated == pytest.approx(gone, abs=1e-7 * scale)
    # Friction gives energy back only where a motion is stopped or reversed, and little.
    stopped = np.sum(bounds * np.abs(v - before)) / 2 * np.any(before * v <= 1e-9 * before**2)
    for mu, normal, push, jacobian in zip(held.mu, held.normal, p, J, strict=True):
        bound = mu * (normal @ push)
        stopped += bound * np.linalg.norm(jacobian @ (v - before)) / 2 * held.rigid
    assert done.dissipated >= -stopped - 1e-9 * scale


def check_contact(case: Case, done: Moved, point: int) -> None:
    held, material, motion, _ = case
    J, normal, p = held.J_v_WC[point], held.normal[point], done.motion.impulse[point]
    before, v = motion.velocity, done.motion.velocity
    speeds = 1e-3 + np.max(np.abs(before))
    # The spring and damper, pushing only.
    moved = H * J @ (before + v) / 2 + done.stretch
    after = held.gap[point] + normal @ moved
    slope = H * material.stiffness[point] + material.damping[point]
    p_n = normal @ p
    assert p_n == pytest.approx(law(case, point, after), rel=1e-6, abs=1e-7 * H * slope * speeds)
    # The surface's friction: within the cone, sticking inside it, against the slip on it.
    slip_motion = J @ v if held.rigid else moved / H
    p_t, v_t = p - p_n * normal, slip_motion - normal @ slip_motion * normal
    size, slip = float(np.linalg.norm(p_t)), float(np.linalg.norm(v_t))
    bound = held.mu[point] * p_n
    assert size <= bound * (1 + 1e-12) + 1e-18
    if size < bound * (1 - 1e-9):
        assert slip < 1e-6 * speeds
    else:
        assert p_t @ v_t == pytest.approx(-size * slip, abs=1e-6 * size * speeds)
    # What is reported.
    assert done.gap[point] == pytest.approx(after, abs=1e-12)
    assert done.slip_speed[point] == pytest.approx(slip, abs=1e-9)
    assert done.approach_speed[point] == pytest.approx(-normal @ slip_motion, abs=1e-9)


@both
@several
@given(seed=seeds)
def test_one_step_satisfies_its_conditions(seed: int, points: int, rigid: bool) -> None:
    case = random_case(seed, rigid=rigid, points=points)
    check_conditions(case, step(*case[:3], H))


@both
@pytest.mark.parametrize(("stiffness", "mu"), [(1e8, 5.0), (1e9, 20.0)])
@given(seed=seeds)
def test_stiff_contacts_with_much_friction_are_solved(
    seed: int, stiffness: float, mu: float, rigid: bool
) -> None:
    case = random_case(seed, rigid=rigid, stiffness=stiffness, mu=mu)
    check_conditions(case, step(*case[:3], H))


@both
@given(seed=seeds)
def test_solution_does_not_depend_on_where_it_starts(seed: int, rigid: bool) -> None:
    case = random_case(seed, rigid=rigid)
    cold = case.motion._replace(
        joint_impulse=np.zeros_like(case.motion.stuck), impulse=np.zeros((1, 3))
    )
    warm, cool = step(*case[:3], H), step(*case[:2], cold, H)
    scale = 1e-3 + np.linalg.norm(case.motion.velocity)
    np.testing.assert_allclose(
        warm.motion.velocity, cool.motion.velocity, rtol=0, atol=1e-5 * scale
    )
    # Where joints and tip all stick the share of each is open, but not the surface's push.
    pushes = [case.held.normal[0] @ done.motion.impulse[0] / H for done in (warm, cool)]
    assert pushes[0] == pytest.approx(pushes[1], rel=1e-4, abs=1e-4)


@both
@given(seed=seeds)
def test_friction_and_contact_only_take_energy(take_steps: Any, seed: int, rigid: bool) -> None:
    case = random_case(seed, rigid=rigid, driven=False)
    done = take_steps(*case[:3], H, 40)
    start = energy(case, case.motion.velocity, case.held.gap, case.held.stretch)
    end = energy(case, done.motion.velocity, done.gap, case.held.stretch + done.stretch)
    assert done.dissipated == pytest.approx(start - end, abs=1e-8 * start)
    assert done.dissipated >= -1e-4 * start


def test_inputs_are_left_alone() -> None:
    case = random_case(7, rigid=False)
    copies = [np.copy(value) for part in case[:3] for value in part]
    step(*case[:3], H)
    values = [value for part in case[:3] for value in part]
    for value, copy in zip(values, copies, strict=True):
        np.testing.assert_array_equal(value, copy)


def test_same_bytes_every_time(take_steps: Any) -> None:
    case = random_case(11)
    first, second = take_steps(*case[:3], H, 100), take_steps(*case[:3], H, 100)
    assert first.motion.velocity.tobytes() == second.motion.velocity.tobytes()
    assert first.force.tobytes() == second.force.tobytes()
    assert first[3:10] == second[3:10]
