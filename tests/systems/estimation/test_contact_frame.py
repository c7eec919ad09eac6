"""The contact frame: how it moves on, takes samples in, and is mixed of several models."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from chamfer.systems.estimation.contact_frame import (
    CONSIDERED,
    NUMBERS,
    SIZE,
    ContactFrame,
    ContactModel,
    ContactReading,
    GripperModel,
    as_frame,
    begins,
    correct,
    follow,
    follow_all,
    head,
    mixture,
    rotation,
    travel,
)

Array = np.ndarray
NONE = np.zeros(CONSIDERED)
CERTAIN = np.zeros((CONSIDERED, CONSIDERED))
seeds = st.integers(0, 2**32 - 1)


def make_model(**changes: Any) -> ContactModel:
    fields: dict[str, Any] = {
        "turn": np.array([[1.0, 1.0, 1.0, 0.75]]),
        "switch": np.eye(1),
        "by_point": True,
        "differenced": False,
        "by_friction": False,
        "period": 0.05,
    }
    return ContactModel(**{**fields, **changes})


def make_frame(seed: int, P: Array, turning: float = 1.0) -> ContactFrame:
    """Return a frame anywhere, pointing anywhere."""
    random = np.random.default_rng(seed)
    frame = as_frame(np.zeros(NUMBERS))
    frame.p[:] = random.standard_normal(3)
    frame.R[:] = Rotation.random(random_state=seed).as_matrix()
    frame.w[:] = turning * random.standard_normal(3)
    frame.friction[:] = 0.6
    frame.P[:] = P
    return frame


def moved(frame: ContactFrame, error: Array) -> ContactFrame:
    """Return the frame that is true if the error of the given one is this, exactly."""
    true = as_frame(np.zeros(NUMBERS))
    true.p[:] = frame.p + frame.R @ error[:3]
    true.R[:] = frame.R @ Rotation.from_rotvec(error[3:6]).as_matrix()
    true.w[:] = frame.w + error[6:9]
    true.friction[:] = frame.friction + error[9]
    return true


def error_of(frame: ContactFrame, true: ContactFrame) -> Array:
    return np.concatenate(
        [
            frame.R.T @ (true.p - frame.p),
            Rotation.from_matrix(frame.R.T @ true.R).as_rotvec(),
            true.w - frame.w,
            true.friction - frame.friction,
        ]
    )


@given(seed=seeds, exponent=st.floats(-12, 1.5))
def test_rotation(seed: int, exponent: float) -> None:
    vector = 10.0**exponent * np.random.default_rng(seed).standard_normal(3)
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotation(vector), expected, rtol=0, atol=1e-12)


@given(seed=seeds, variance=st.floats(-8, 4).map(lambda exponent: 10.0**exponent))
def test_one_scalar_as_in_a_kalman_filter(slides: Any, seed: int, variance: float) -> None:
    random = np.random.default_rng(seed)
    P, d = slides.covariance(random, SIZE), random.standard_normal(SIZE)
    row, residual = random.standard_normal(SIZE), float(random.standard_normal())
    total = row @ P @ row + variance
    innovation = residual - row @ d
    gain = P @ row / total
    left = np.eye(SIZE) - np.outer(gain, row)
    frame, found_d = make_frame(0, P), d.copy()
    S, by = random.standard_normal((SIZE, CONSIDERED)), random.standard_normal(CONSIDERED)
    frame.S[:] = S
    likelihood = correct(frame, found_d, row, by, residual, variance)
    found_P = frame.P
    # What is considered has no part in the gain, and moves the error as the residual.
    np.testing.assert_allclose(frame.S, left @ S - np.outer(gain, by), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found_d, d + gain * innovation, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found_P, left @ P, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found_P, found_P.T)
    # But for the constant that all models share.
    expected = norm.logpdf(innovation, scale=math.sqrt(total)) + 0.5 * math.log(2 * math.pi)
    assert likelihood == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_nearly_exact_scalar_leaves_no_negative_variance() -> None:
    # As P - gain across^T would, by the rounding of the variance before.
    random = np.random.default_rng(0)
    for _ in range(200):
        i = random.integers(SIZE)
        P = np.diag(10.0 ** random.uniform(-3, 2, SIZE))
        row = np.zeros(SIZE)
        row[i] = 10.0 ** random.uniform(-3, 5)
        exact = 1e-18 * P[i, i]
        frame = make_frame(0, P)
        correct(frame, np.zeros(SIZE), row, NONE, 0.1, exact * row[i] ** 2)
        assert 0 < frame.P[i, i] < 1.5 * exact


def test_certain_scalar_says_nothing() -> None:
    frame, d = make_frame(0, np.zeros((SIZE, SIZE))), np.ones(SIZE)
    assert correct(frame, d, np.ones(SIZE), NONE, 3.0, 0.0) == 0.0
    np.testing.assert_array_equal(d, np.ones(SIZE))
    np.testing.assert_array_equal(frame.P, np.zeros((SIZE, SIZE)))


@pytest.mark.parametrize("ds", [0.02, -0.02])
@pytest.mark.parametrize("seed", range(5))
def test_error_moves_on_as_the_frame_does(slides: Any, ds: float, seed: int) -> None:
    """The covariance against differences of the motion itself, which is not linear.

    It is a first-order expansion in the step: halved, what is off is a quarter.
    """
    P = slides.covariance(np.random.default_rng(seed), SIZE)
    none = np.array([0.0, 0.0, 0.0, 0.75])

    def off(step: float) -> float:
        h, J = 1e-6, np.empty((SIZE, SIZE))
        for i in range(SIZE):
            ends = []
            for sign in (1, -1):
                frame = make_frame(seed, P)
                true = moved(frame, sign * h * np.eye(SIZE)[i])
                travel(frame, none, step)
                travel(true, none, step)
                ends.append(error_of(frame, true))
            J[:, i] = (ends[0] - ends[1]) / (2 * h)
        # What the error's motion itself does in the first order must not be lost in P's size.
        assert np.abs(J - np.eye(SIZE)).max() > 0.5 * abs(step)
        return float(np.abs(frame.P - J @ P @ J.T).max() / np.abs(P).max())

    assert off(ds) < 4 * ds**2 + 1e-8
    assert off(ds / 2) < 0.35 * off(ds)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("count", [20, 40])
def test_frame_walks_around_a_ball_or_in_a_bowl(sign: float, count: int) -> None:
    # Where the normal tilts forward, w_b > 0, the surface falls away as a ball does.
    radius, angle = 2.0, 1.5
    frame = as_frame(np.zeros(NUMBERS))
    frame.R[:] = np.column_stack([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    for _ in range(count):
        frame.w[:] = 0.0, sign / radius, 0.0
        travel(frame, np.array([0.0, 0.0, 0.0, 1e12]), radius * angle / count)
    n = np.array([sign * math.sin(angle), 0.0, math.cos(angle)])
    np.testing.assert_allclose(frame.R[:, 2], n, rtol=0, atol=1e-9)
    centre = np.array([0.0, 0.0, -sign * radius])
    error = np.abs(frame.p - (centre + sign * radius * n)).max()
    assert error < 0.2 / count**2


@pytest.mark.parametrize("ds", [0.03, -0.03])
def test_turning_is_a_stationary_process_over_the_path(ds: float) -> None:
    turn = np.array([0.5, 0.8, 1.1, 0.75])
    deviation = turn[:3]
    P = np.zeros((SIZE, SIZE))
    np.fill_diagonal(P[6:9, 6:9], deviation**2)
    frame = make_frame(0, P)
    w = frame.w.copy()
    travel(frame, turn, ds)
    kept = math.exp(-0.03 / 0.75)
    np.testing.assert_allclose(frame.w, kept * w, rtol=1e-12)
    np.testing.assert_allclose(np.diag(frame.P)[6:9], deviation**2, rtol=1e-12)
    # It turns the frame by ds times its deviation, and a little for what is new on the way.
    new = (1 - kept**2) * ds**2 / 3
    np.testing.assert_allclose(np.diag(frame.P)[3:6], deviation**2 * (ds**2 + new), rtol=1e-9)
    assert frame.P[9, 9] == pytest.approx(1e-6, rel=1e-12)
    np.testing.assert_allclose(frame.P[4, 7], ds * kept * deviation[1] ** 2, rtol=1e-12)
    # And displaces it in the second order: sideways by w_n, along the normal by w_b.
    displaced = (0.5 * ds**2 * deviation[[2, 1]]) ** 2
    np.testing.assert_allclose(np.diag(frame.P)[1:3], displaced, rtol=0.1)


@pytest.mark.parametrize("angle", [-3.0, -1.5, -0.8, 0.8, 1.5, math.pi])
def test_path_that_turns_off_sharply(slides: Any, angle: float) -> None:
    P = slides.covariance(np.random.default_rng(2), SIZE, 0.01)
    frame, kept = make_frame(3, P), make_frame(3, P)
    t, b, n = kept.R.T
    # What the direction has along the normal is noise.
    direction = 0.03 * (math.cos(angle) * t + math.sin(angle) * b) + 0.02 * n
    sharp = abs(angle) > math.pi / 3
    assert begins(frame, direction, 0.3) == sharp
    turn = np.array([0.5, 0.8, 1.1])
    head(frame, turn, direction, 0.3)
    np.testing.assert_allclose(frame.R[:, 2], n, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(frame.p, kept.p)
    if not sharp:
        for part, before in zip(frame, kept, strict=True):
            np.testing.assert_array_equal(part, before)
        return
    ahead = math.cos(angle) * t + math.sin(angle) * b
    np.testing.assert_allclose(frame.R[:, 0], ahead, rtol=0, atol=1e-12)
    np.testing.assert_allclose(frame.R @ frame.R.T, np.eye(3), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(frame.w, np.zeros(3))
    # Place and normal are as uncertain as before, in the world's axes.
    for first in (slice(0, 3), slice(3, 5)):

        def spread(of: ContactFrame, axes: slice = first) -> Array:
            R = of.R if axes == slice(0, 3) else of.R[:, :2]
            return np.asarray(R @ of.P[axes, axes] @ R.T)

        np.testing.assert_allclose(spread(frame), spread(kept), rtol=0, atol=1e-14)
    np.testing.assert_allclose(np.diag(frame.P)[5:9], [1.0, *turn**2], rtol=1e-12)
    off = frame.P[5:9].copy()
    np.fill_diagonal(off[:, 5:9], 0)
    np.testing.assert_array_equal(off, np.zeros((4, SIZE)))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("of", ["direction", "path", "both", "turning"])
def test_turn_that_is_no_error_begins_a_path(sign: float, of: str) -> None:
    # Four standard deviations: of the direction shown, the path's, and how it may turn on the way.
    P, deviation = np.zeros((SIZE, SIZE)), 0.0
    if of in ("direction", "both"):
        deviation = 0.06
    if of in ("path", "both"):
        P[5, 5] = 0.08**2
    if of == "turning":
        P[8, 8] = 5.0**2
    least = 4 * {"direction": 0.06, "path": 0.08, "both": 0.1, "turning": 0.02 * 5}[of]
    frame = make_frame(4, P)
    frame.w[2] = 3.0
    for factor, expected in ((0.98, False), (1.02, True)):
        angle = 0.02 * 3.0 + sign * factor * least  # from where the path is expected to go
        t, b, _ = frame.R.T
        step = 0.02 * (math.cos(angle) * t + math.sin(angle) * b)
        assert begins(frame, step, deviation) == expected


def test_mixture_of_one_is_its_normal(slides: Any) -> None:
    # A rotation r takes n to n + r_b t - r_t b; here by sampling.
    random = np.random.default_rng(5)
    P = np.zeros((SIZE, SIZE))
    P[3:6, 3:6] = slides.covariance(random, 3, 1e-4)
    frame = make_frame(6, P)
    numbers = np.concatenate([part.ravel() for part in frame])[None]
    normal, covariance = mixture(numbers, np.ones(1), CERTAIN)
    np.testing.assert_allclose(normal, frame.R[:, 2], rtol=0, atol=1e-15)
    errors = random.multivariate_normal(np.zeros(3), P[3:6, 3:6], 20_000)
    sampled = frame.R @ Rotation.from_rotvec(errors).as_matrix()[:, :, 2].T
    expected = np.cov(sampled)
    np.testing.assert_allclose(covariance, expected, rtol=0, atol=0.06 * np.abs(expected).max())
    np.testing.assert_allclose(covariance @ normal, np.zeros(3), rtol=0, atol=1e-18)


def test_mixture_covers_the_models_disagreement() -> None:
    angle, weights = 0.2, np.array([0.25, 0.75])
    numbers = np.zeros((2, NUMBERS))
    for i, sign in enumerate((1, -1)):
        frame = as_frame(numbers[i])
        frame.R[:] = Rotation.from_rotvec([0.0, sign * angle, 0.0]).as_matrix()
        frame.P[4, 4] = (0.01, 0.03)[i]
    normal, covariance = mixture(numbers, weights, CERTAIN)
    assert float(np.linalg.norm(normal)) == pytest.approx(1, abs=1e-15)
    assert math.atan2(normal[0], normal[2]) == pytest.approx(-angle / 2, rel=0.05)
    mean_square = 0.25 * (0.01 + (1.5 * angle) ** 2) + 0.75 * (0.03 + (0.5 * angle) ** 2)
    assert covariance[0, 0] == pytest.approx(mean_square, rel=0.05)
    np.testing.assert_array_equal(covariance, covariance.T)


OBLIQUE = np.array([[150.0, 40.0, 0.0], [40.0, 80.0, 10.0], [0.0, 10.0, 120.0]])
NOTHING = np.array([0.0, 0.0, 0.0, 0.75])


class Sensor:
    """Shows a contact in a true frame, with the noise that the filter takes it to have."""

    def __init__(self, noise: float, rate_noise: float, K: Array = OBLIQUE) -> None:
        compliance = np.linalg.inv(K)
        spread = compliance @ compliance.T
        self.rate_root = rate_noise * np.linalg.cholesky(spread)
        self.gripper = GripperModel(
            stiffness=K,
            compliance=compliance,
            force_deviation=noise,
            point_covariance=noise**2 * spread,
            point_root=np.linalg.inv(noise * np.linalg.cholesky(spread)),
            point_deviation=math.nan,
            velocity_covariance=rate_noise**2 * spread,
            velocity_deviation=math.nan,
        )

    def read(self, true: ContactFrame, random: np.random.Generator | None) -> ContactReading:
        """Friction is off the path's direction by 0.02 rad, as it is assumed."""
        draw = np.zeros((3, 3)) if random is None else random.standard_normal((3, 3))
        velocity, angle = 0.5 * true.R[:, 0], float(true.friction[0])
        force = 20 * true.R @ np.array([-math.sin(angle), 0.02 * draw[2, 0], math.cos(angle)])
        compliance, error = self.gripper.compliance, self.gripper.force_deviation * draw[0]
        return ContactReading(
            point=true.p + compliance @ error,
            velocity=velocity + self.rate_root @ draw[1],
            force=force + error,
            nominal=true.p - compliance @ force,
            nominal_velocity=velocity - compliance @ np.array([3.0, -2.0, 1.0]),
            gripper=self.gripper,
        )


@pytest.mark.parametrize("by_point", [True, False])
@pytest.mark.parametrize("by_friction", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_exact_sample_leaves_no_error(by_point: bool, by_friction: bool, seed: int) -> None:
    # A sign or a factor that is wrong in any row leaves, or doubles, what it should remove.
    size = 1e-4
    deviations = np.array([1.0, 1.0, 1.0, 1, 1, 1, 0.01, 0.01, 0.01, 1e-6])
    frame = make_frame(seed, np.diag(deviations**2), turning=0.3)
    frame.friction[:] = 0.6
    error = size * np.random.default_rng(seed).standard_normal(SIZE)
    error[6:] = 0.0
    if not by_point:
        error[:3] = 0.0
    true = moved(frame, error)
    model = make_model(turn=NOTHING[np.newaxis], by_point=by_point, by_friction=by_friction)
    travel(true, NOTHING, 0.5 * model.period)
    follow(frame, model, NOTHING, Sensor(1e-4, 1e-4).read(true, None))
    left = error_of(frame, true)
    # Sideways the force's direction, 0.02 rad, is weighed with the error of 1 rad before.
    assert np.abs(left[4:6]).max() < 2e-3 * size
    assert abs(left[3]) < 2e-2 * size
    if by_point:
        assert np.abs(left[:3]).max() < 2e-2 * size


@pytest.mark.parametrize("by_point", [True, False])
@pytest.mark.parametrize("by_friction", [True, False])
def test_error_is_as_large_as_the_covariance_says(
    slides: Any, by_point: bool, by_friction: bool
) -> None:
    """Normalised error squared after a sample, over draws of the error before and the noise."""
    random = np.random.default_rng(1)
    # What is drawn is known about as well before as from the sample.
    deviations = np.array([1, 1, 1, 8, 8, 8, 100, 100, 100, 8]) * 4e-3
    root = np.diag(deviations) @ np.linalg.cholesky(
        slides.covariance(random, SIZE, 0.05) + 0.5 * np.eye(SIZE)
    )
    P = root @ root.T
    sensor = Sensor(0.5, 2.5)
    model = make_model(turn=NOTHING[np.newaxis], by_point=by_point, by_friction=by_friction)
    counted = list(range(SIZE)) if by_point else list(range(3, SIZE))
    if not by_friction:
        counted.remove(9)
    runs, total = 400, 0.0
    for run in range(runs):
        frame = make_frame(run, P, turning=0.3)
        true = moved(frame, root @ random.standard_normal(SIZE))
        travel(true, NOTHING, 0.5 * model.period)
        reading = sensor.read(true, random)
        if by_friction and by_point:
            # The friction angle is taken to vary by as much as the force's direction.
            true.friction[:] += 0.02 * random.standard_normal()
        if not by_point:
            frame.p[:] = true.p
        follow(frame, model, NOTHING, reading)
        error = error_of(frame, true)[counted]
        total += error @ np.linalg.solve(frame.P[np.ix_(counted, counted)], error)
    degrees = runs * len(counted)
    assert chi2.ppf(1e-4, degrees) < total < chi2.ppf(1 - 1e-4, degrees)


@pytest.mark.parametrize("seed", range(4))
def test_velocity_whose_components_have_errors_in_common(slides: Any, seed: int) -> None:
    # One component after the other, against both at once; without a force nothing else is known.
    random = np.random.default_rng(seed)
    P = slides.covariance(random, SIZE, 0.01)
    P[:3], P[:, :3] = 0.0, 0.0
    frame, before = make_frame(seed, P, turning=0.3), make_frame(seed, P, turning=0.3)
    K = OBLIQUE + np.diag([0.0, 300.0, 0.0])
    reading = Sensor(0.5, 8.0, K).read(frame, random)._replace(force=np.zeros(3))
    model = make_model(turn=NOTHING[np.newaxis], by_point=False)
    follow(frame, model, NOTHING, reading)
    v = before.R.T @ reading.velocity
    travel(before, NOTHING, v[0] * model.period)
    before.P[:3], before.P[:, :3] = 0.0, 0.0  # the point is not followed
    v = before.R.T @ reading.velocity
    noise = (before.R.T @ reading.gripper.velocity_covariance @ before.R)[1:, 1:]
    rows = np.zeros((2, SIZE))
    rows[0, 5], rows[1, 4] = v[0], -v[0]
    gain = before.P @ rows.T @ np.linalg.inv(rows @ before.P @ rows.T + noise)
    expected = (np.eye(SIZE) - gain @ rows) @ before.P
    np.testing.assert_allclose(frame.P, expected, rtol=0, atol=1e-12)
    turned = before.R @ Rotation.from_rotvec((gain @ v[1:])[3:6]).as_matrix()
    np.testing.assert_allclose(frame.R, turned, rtol=0, atol=1e-12)


def test_the_model_that_foresaw_more_weighs_more() -> None:
    """Weights by Bayes' rule, after a chance to switch, and never quite zero."""
    P = np.diag(np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.1]) ** 2)
    switch = np.array([[0.9, 0.1], [0.2, 0.8]])
    frames = [make_frame(0, P, turning=0.3), make_frame(0, P, turning=0.3)]
    frames[1].w[:] += [0.0, 3.0, 0.0]
    numbers = np.array([np.concatenate([part.ravel() for part in frame]) for frame in frames])
    model = make_model(turn=np.full((2, 4), 0.5), switch=switch)
    true = moved(frames[0], np.zeros(SIZE))
    travel(true, NOTHING, 0.02)
    reading = Sensor(0.5, 2.5).read(true, None)
    likelihood = [follow(frame, model, model.turn[0], reading)[0] for frame in frames]
    weights = np.array([0.3, 0.7])
    follow_all(numbers, weights, model, reading, 0.02 * true.R[:, 0], 0.3)
    before = np.array([0.9 * 0.3 + 0.2 * 0.7, 0.1 * 0.3 + 0.8 * 0.7])
    expected = before * np.exp(likelihood)
    np.testing.assert_allclose(weights, expected / expected.sum(), rtol=1e-9)
    assert likelihood[0] > likelihood[1]
    for found, frame in zip(numbers, frames, strict=True):
        np.testing.assert_allclose(as_frame(found).R, frame.R, rtol=0, atol=1e-15)
        np.testing.assert_allclose(as_frame(found).P, frame.P, rtol=0, atol=1e-15)


def test_no_model_is_ever_ruled_out() -> None:
    frames = [make_frame(0, 1e-8 * np.eye(SIZE), turning=0.3) for _ in range(2)]
    frames[1].R[:] = frames[1].R @ Rotation.from_rotvec([0.2, 0.2, 0.0]).as_matrix()
    numbers = np.array([np.concatenate([part.ravel() for part in frame]) for frame in frames])
    model = make_model(turn=np.full((2, 4), 0.5), switch=np.eye(2))
    weights = np.array([0.5, 0.5])
    true = moved(frames[0], np.zeros(SIZE))
    reading = Sensor(1e-3, 1e-3).read(true, None)
    follow_all(numbers, weights, model, reading, 0.02 * true.R[:, 0], 0.3)
    assert weights.sum() == pytest.approx(1, abs=1e-15)
    assert 0 < weights[1] < 1e-8
