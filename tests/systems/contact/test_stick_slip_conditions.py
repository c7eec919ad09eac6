"""Sticking friction and contact against the conditions they solve, on random arms."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from systems.contact.stick_slip import Frozen, Material, Motion, Moved, advance

H = 1e-4  # s
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile before any test: it would exceed the time that one example may take."""
    advance(*random_case(0), H, 1)


class Case(NamedTuple):
    frozen: Frozen
    material: Material
    motion: Motion


def random_case(seed: int, *, driven: bool = True) -> Case:
    """An arm of 1 to 4 joints near a surface, with every kind of friction; some joints at rest."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))

    def conditioned(rows: int, least: float) -> np.ndarray:
        u, _, vt = np.linalg.svd(rng.normal(size=(rows, n)), full_matrices=False)
        return u @ np.diag(rng.uniform(least, 1.0, len(vt))) @ vt

    root = conditioned(n, 0.5)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    jacobian = conditioned(3, 0.4)
    if n == 2:  # a planar arm on a surface at right angles to its plane
        plane, _ = np.linalg.qr(rng.normal(size=(3, 2)))
        jacobian = plane @ conditioned(2, 0.4)
        normal = plane @ [math.cos(1.0), math.sin(1.0)]
    stuck = rng.integers(0, 2, n).astype(float)
    return Case(
        Frozen(
            10 ** rng.uniform(-1, 1) * root @ root.T,
            rng.normal(size=n) * 5 * driven,
            jacobian,
            rng.uniform(-1e-3, 1e-4),
            normal,
        ),
        Material(
            rng.uniform(0, 2, n),
            rng.uniform(1, 2),
            0.02,
            rng.uniform(0, 2, n),
            10 ** rng.uniform(3, 4.5),
            10 ** rng.uniform(0, 2),
            rng.uniform(0, 1),
        ),
        Motion(
            np.where(stuck, 0.0, rng.normal(size=n) * 10 ** rng.uniform(-3, 0)),
            stuck,
            rng.normal(size=n) * 1e-5,
            rng.normal(size=3) * 1e-5,
        ),
    )


def check_conditions(case: Case, done: Moved) -> None:
    frozen, material, motion = case
    mass, force, J, gap, normal = frozen
    v, p_joint, p = done.motion.velocity, done.motion.joint_impulse, done.motion.impulse
    speeds = 1e-3 + np.linalg.norm(motion.velocity)
    # Equations of motion.
    left = (mass + H * np.diag(material.viscous)) @ v
    right = mass @ motion.velocity + H * force + p_joint + J.T @ p
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-6 * speeds * np.linalg.norm(mass))
    # Joints: held within the bound, else the bound against the motion.
    fading = np.where(motion.stuck, 1.0, np.exp(-((motion.velocity / material.stribeck) ** 2)))
    bounds = H * material.coulomb * (1 + (material.breakaway - 1) * fading)
    for speed, impulse, bound, stuck in zip(v, p_joint, bounds, done.motion.stuck, strict=True):
        if abs(impulse) < bound:
            assert speed == 0.0
            assert stuck == 1.0
        else:
            assert abs(impulse) == pytest.approx(bound, rel=1e-12)
            assert impulse * speed <= 1e-7 * bound * speeds
            assert stuck == 0.0
    # Contact: the spring and damper, pushing only.
    p_n, v_n = normal @ p, normal @ J @ v
    after = gap + H * v_n
    pushed = H * max(0.0, -material.stiffness * after - material.damping * v_n)
    assert p_n == pytest.approx(
        pushed, rel=1e-7, abs=1e-7 * H * (H * material.stiffness + material.damping) * speeds
    )
    # The surface's friction: within the cone, sticking inside it, against the slip on it.
    p_t, v_t = p - p_n * normal, J @ v - v_n * normal
    held, slip = float(np.linalg.norm(p_t)), float(np.linalg.norm(v_t))
    bound = material.mu * p_n
    assert held <= bound * (1 + 1e-12) + 1e-18
    if held < bound * (1 - 1e-9):
        assert slip < 1e-6 * speeds
    else:
        assert p_t @ v_t == pytest.approx(-held * slip, abs=1e-6 * held * speeds)
    # What is reported.
    np.testing.assert_allclose(done.displacement, H * v, rtol=1e-12)
    np.testing.assert_allclose(done.force, p / H, rtol=1e-12)
    np.testing.assert_allclose(done.dry_friction, p_joint / H, rtol=1e-12)
    assert done.gap == pytest.approx(after, abs=1e-15)
    assert done.approach_speed == pytest.approx(-v_n, abs=1e-12)
    assert done.slip_speed == pytest.approx(slip, abs=1e-12)
    assert done.peak_force == pytest.approx(p_n / H, abs=1e-9)


@given(seed=seeds)
def test_one_step_satisfies_its_conditions(seed: int) -> None:
    case = random_case(seed)
    check_conditions(case, advance(*case, H, 1))


@given(seed=seeds)
def test_solution_does_not_depend_on_where_it_starts(seed: int) -> None:
    case = random_case(seed)
    n = len(case.frozen.force)
    cold = case.motion._replace(joint_impulse=np.zeros(n), impulse=np.zeros(3))
    warm, cool = advance(*case, H, 1), advance(*case[:2], cold, H, 1)
    scale = 1e-3 + np.linalg.norm(case.motion.velocity)
    np.testing.assert_allclose(
        warm.motion.velocity, cool.motion.velocity, rtol=0, atol=1e-5 * scale
    )
    # Where joints and tip all stick the share of each is open, but not the surface's push.
    pushes = [case.frozen.normal @ done.force for done in (warm, cool)]
    assert pushes[0] == pytest.approx(pushes[1], rel=1e-4, abs=1e-4)


def energy(case: Case, velocity: np.ndarray, gap: float) -> float:
    kinetic = velocity @ case.frozen.mass @ velocity / 2
    return float(kinetic + case.material.stiffness * min(gap, 0.0) ** 2 / 2)


@given(seed=seeds)
def test_friction_and_contact_only_take_energy(seed: int) -> None:
    case = random_case(seed, driven=False)
    frozen, motion = case.frozen, case.motion
    before = start = energy(case, motion.velocity, frozen.gap)
    tolerance = 1e-9 * start + 1e-15
    for _ in range(40):
        done = advance(frozen, case.material, motion, H, 1)
        after = energy(case, done.motion.velocity, done.gap)
        assert after <= before + tolerance
        assert -tolerance <= done.dissipated <= before - after + tolerance
        frozen, motion, before = frozen._replace(gap=done.gap), done.motion, after


@pytest.mark.parametrize("seed", range(5))
def test_all_that_is_lost_is_dissipated_as_steps_shrink(seed: int) -> None:
    case = random_case(seed, driven=False)
    motion = case.motion._replace(joint_impulse=np.zeros_like(case.motion.stuck))
    motion = motion._replace(impulse=np.zeros(3), velocity=motion.velocity + 0.1)
    missing = []
    for h in (4e-5, 1e-5):
        done = advance(case.frozen, case.material, motion, h, round(4e-3 / h))
        lost = energy(case, motion.velocity, case.frozen.gap)
        lost -= energy(case, done.motion.velocity, done.gap)
        missing.append(lost - done.dissipated)
    assert 0 <= missing[1] < 0.05 * lost
    assert missing[1] == pytest.approx(missing[0] / 4, rel=0.3)


@given(seed=seeds)
def test_steps_together_and_one_by_one(seed: int) -> None:
    case = random_case(seed)
    frozen, motion = case.frozen, case.motion
    together = advance(*case, H, 12)
    displacement, peak, dissipated = 0.0, 0.0, 0.0
    for _ in range(12):
        done = advance(frozen, case.material, motion, H, 1)
        displacement = displacement + done.displacement
        peak, dissipated = max(peak, done.peak_force), dissipated + done.dissipated
        frozen, motion = frozen._replace(gap=done.gap), done.motion
    np.testing.assert_allclose(together.motion.velocity, motion.velocity, rtol=0, atol=1e-7)
    np.testing.assert_allclose(together.displacement, displacement, rtol=0, atol=1e-9)
    np.testing.assert_allclose(together.force, done.force, rtol=1e-5, atol=1e-4)
    assert together.peak_force == pytest.approx(peak, rel=1e-5, abs=1e-4)
    assert together.dissipated == pytest.approx(dissipated, rel=1e-5, abs=1e-9)
    assert together.gap == pytest.approx(frozen.gap, abs=1e-9)


def test_inputs_are_left_alone() -> None:
    case = random_case(7)
    copies = [np.copy(value) for value in (*case.frozen, *case.material, *case.motion)]
    advance(*case, H, 10)
    for value, copy in zip((*case.frozen, *case.material, *case.motion), copies, strict=True):
        np.testing.assert_array_equal(value, copy)


def test_same_bytes_every_time() -> None:
    case = random_case(11)
    first, second = advance(*case, H, 100), advance(*case, H, 100)
    assert first.motion.velocity.tobytes() == second.motion.velocity.tobytes()
    assert first.force.tobytes() == second.force.tobytes()
    assert first[4:] == second[4:]
