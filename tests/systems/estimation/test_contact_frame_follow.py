"""One sample taken into the contact frame: that it corrects, and as surely as it says."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from chamfer.systems.estimation.contact_frame import (
    NUMBERS,
    SIZE,
    Frame,
    Model,
    Reading,
    as_frame,
    follow,
    follow_all,
    travel,
)

Array = np.ndarray

OBLIQUE = np.array([[150.0, 40.0, 0.0], [40.0, 80.0, 10.0], [0.0, 10.0, 120.0]])
NOTHING = np.zeros(3)


def make_model(**changes: Any) -> Model:
    fields: dict[str, Any] = {
        "turn": np.zeros((1, 3)),
        "switch": np.eye(1),
        "length": 0.75,
        "by_point": True,
        "differenced": False,
        "by_friction": False,
        "friction_drift": 0.0,
        "period": 0.05,
        "sharp_turn": math.pi / 3,
        "considers": True,
    }
    return Model(**{**fields, **changes})


def make_frame(seed: int, P: Array) -> Frame:
    random = np.random.default_rng(seed)
    frame = as_frame(np.zeros(NUMBERS))
    frame.p[:] = random.standard_normal(3)
    frame.R[:] = Rotation.random(random_state=seed).as_matrix()
    frame.w[:] = 0.3 * random.standard_normal(3)
    frame.friction[:] = 0.6
    frame.P[:] = P
    return frame


def moved(frame: Frame, error: Array) -> Frame:
    true = as_frame(np.zeros(NUMBERS))
    true.p[:] = frame.p + frame.R @ error[:3]
    true.R[:] = frame.R @ Rotation.from_rotvec(error[3:6]).as_matrix()
    true.w[:] = frame.w + error[6:9]
    true.friction[:] = frame.friction + error[9]
    return true


def error_of(frame: Frame, true: Frame) -> Array:
    return np.concatenate(
        [
            frame.R.T @ (true.p - frame.p),
            Rotation.from_matrix(frame.R.T @ true.R).as_rotvec(),
            true.w - frame.w,
            true.friction - frame.friction,
        ]
    )


class Sensor:
    """Shows a contact in a true frame, with the noise that the filter takes it to have."""

    def __init__(self, noise: float, rate_noise: float, K: Array = OBLIQUE) -> None:
        self.K, self.noise = K, noise
        compliance = np.linalg.inv(K)
        self.compliance = compliance
        self.point_covariance = noise**2 * compliance @ compliance.T
        self.velocity_covariance = rate_noise**2 * compliance @ compliance.T

    def read(
        self, true: Frame, random: np.random.Generator | None, direction: float = 0.02
    ) -> Reading:
        """``direction``, rad: how far friction is off the path's direction, as it is assumed."""
        draw = np.zeros(3) if random is None else random.standard_normal(3)
        velocity, point = 0.5 * true.R[:, 0], true.p.copy()
        angle = float(true.friction[0])
        force = 20 * true.R @ np.array([-math.sin(angle), 0.0, math.cos(angle)])
        if random is not None:
            draw = random.standard_normal((4, 3))
            force += 20 * true.R @ np.array([0.0, direction * draw[3, 0], 0.0])
        else:
            draw = np.zeros((4, 3))
        nominal = true.p - self.compliance @ force
        error = self.noise * draw[0]
        rate = np.linalg.cholesky(self.velocity_covariance)
        return Reading(
            point=point + self.compliance @ error,
            velocity=velocity + rate @ draw[1],
            force=force + error,
            nominal=nominal,
            nominal_velocity=velocity - self.compliance @ np.array([3.0, -2.0, 1.0]),
            stiffness=self.K,
            compliance=self.compliance,
            point_root=np.linalg.inv(np.linalg.cholesky(self.point_covariance)),
            velocity_covariance=self.velocity_covariance,
            force_deviation=self.noise,
        )


@pytest.mark.parametrize("by_point", [True, False])
@pytest.mark.parametrize("by_friction", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_exact_sample_leaves_no_error(by_point: bool, by_friction: bool, seed: int) -> None:
    # A sign or a factor that is wrong in any row leaves, or doubles, what it should remove.
    size = 1e-4
    deviations = np.array([1.0, 1.0, 1.0, 1, 1, 1, 0.01, 0.01, 0.01, 1e-6])
    frame = make_frame(seed, np.diag(deviations**2))
    frame.friction[:] = 0.6
    error = size * np.random.default_rng(seed).standard_normal(SIZE)
    error[6:] = 0.0
    if not by_point:
        error[:3] = 0.0
    true = moved(frame, error)
    model = make_model(by_point=by_point, by_friction=by_friction)
    travel(true, model, NOTHING, 0.5 * model.period)
    follow(frame, model, NOTHING, Sensor(1e-4, 1e-4).read(true, None))
    left = error_of(frame, true)
    # Sideways the force's direction, 0.02 rad, is weighed with the error of 1 rad before.
    assert np.abs(left[4:6]).max() < 2e-3 * size
    assert abs(left[3]) < 2e-2 * size
    if by_point:
        assert np.abs(left[:3]).max() < 2e-2 * size


@pytest.mark.parametrize(
    ("by_point", "by_friction", "noise"),
    [(True, False, 0.5), (True, True, 0.5), (False, False, 0.5), (False, True, 0.5)],
)
@pytest.mark.parametrize("uneven", [False, True])
def test_error_is_as_large_as_the_covariance_says(
    random_covariance: Callable[..., Array],
    by_point: bool,
    by_friction: bool,
    noise: float,
    uneven: bool,
) -> None:
    """Normalised error squared after a sample, over draws of the error before and the noise."""
    random = np.random.default_rng(1)
    # What is drawn is known about as well before as from the sample.
    deviations = np.array([1, 1, 1, 8, 8, 8, 100, 100, 100, 8]) * 4e-3
    root = np.diag(deviations) @ np.linalg.cholesky(
        random_covariance(random, SIZE, 0.05) + 0.5 * np.eye(SIZE)
    )
    P = root @ root.T
    sensor = Sensor(noise, 2.5, OBLIQUE if uneven else 100 * np.eye(3))
    model = make_model(by_point=by_point, by_friction=by_friction)
    direction = 0.02
    counted = list(range(SIZE)) if by_point else list(range(3, SIZE))
    if not by_friction:
        counted.remove(9)
    runs, total = 400, 0.0
    for run in range(runs):
        frame = make_frame(run, P)
        true = moved(frame, root @ random.standard_normal(SIZE))
        travel(true, model, NOTHING, 0.5 * model.period)
        reading = sensor.read(true, random, direction)
        if by_friction and by_point:
            # The friction angle is taken to vary by as much as the force's direction.
            true.friction[:] += direction * random.standard_normal()
        if not by_point:
            frame.p[:] = true.p
        follow(frame, model, NOTHING, reading)
        error = error_of(frame, true)[counted]
        total += error @ np.linalg.solve(frame.P[np.ix_(counted, counted)], error)
    degrees = runs * len(counted)
    assert chi2.ppf(1e-4, degrees) < total < chi2.ppf(1 - 1e-4, degrees)


@pytest.mark.parametrize("seed", range(4))
def test_velocity_whose_components_have_errors_in_common(
    random_covariance: Callable[..., Array], seed: int
) -> None:
    # One component after the other, against both at once; without a force nothing else is known.
    random = np.random.default_rng(seed)
    P = random_covariance(random, SIZE, 0.01)
    P[:3], P[:, :3] = 0.0, 0.0
    frame, before = make_frame(seed, P), make_frame(seed, P)
    K = OBLIQUE + np.diag([0.0, 300.0, 0.0])
    reading = Sensor(0.5, 8.0, K).read(frame, random)._replace(force=np.zeros(3))
    model = make_model(by_point=False)
    follow(frame, model, NOTHING, reading)
    v = before.R.T @ reading.velocity
    travel(before, model, NOTHING, v[0] * model.period)
    before.P[:3], before.P[:, :3] = 0.0, 0.0  # the point is not followed
    v = before.R.T @ reading.velocity
    noise = (before.R.T @ reading.velocity_covariance @ before.R)[1:, 1:]
    rows = np.zeros((2, SIZE))
    rows[0, 5], rows[1, 4] = v[0], -v[0]
    gain = before.P @ rows.T @ np.linalg.inv(rows @ before.P @ rows.T + noise)
    expected = (np.eye(SIZE) - gain @ rows) @ before.P
    np.testing.assert_allclose(frame.P, expected, rtol=0, atol=1e-12)
    turned = before.R @ Rotation.from_rotvec((gain @ v[1:])[3:6]).as_matrix()
    np.testing.assert_allclose(frame.R, turned, rtol=0, atol=1e-12)


def test_sample_says_something_about_every_angle() -> None:
    deviations = np.array([1e-3, 1e-3, 1e-3, 1, 1, 1, 0.1, 0.1, 0.1, 1e-3])
    for by_friction in (False, True):
        frame = make_frame(0, np.diag(deviations**2))
        true = moved(frame, np.zeros(SIZE))
        model = make_model(by_friction=by_friction)
        follow(frame, model, NOTHING, Sensor(0.5, 2.5).read(true, None))
        found = np.sqrt(np.diag(frame.P)[3:6])
        assert np.all(found < [0.15, 0.1, 0.1])
        assert np.all(found > [0.01, 0.01, 0.01])


def test_plane_stays_a_plane(random_covariance: Callable[..., Array]) -> None:
    inside, outside = [0, 2, 4, 7, 9], [1, 3, 5, 6, 8]
    P = np.zeros((SIZE, SIZE))
    P[np.ix_(inside, inside)] = random_covariance(np.random.default_rng(1), 5, 1e-3)
    frame = as_frame(np.zeros(NUMBERS))
    frame.R[:], frame.P[:] = np.diag([1.0, -1.0, -1.0])[:, [0, 2, 1]], P
    K = np.array([[150.0, 40.0, 0.0], [40.0, 80.0, 0.0], [0.0, 0.0, 150.0]])
    for by_friction in (False, True):
        reading = Sensor(0.5, 2.5, K).read(frame, None)
        reading = reading._replace(
            point=np.array([0.02, 0.003, 0.0]), velocity=np.array([0.4, -0.02, 0.0])
        )
        follow(frame, make_model(by_friction=by_friction), np.array([0.0, 0.8, 0.0]), reading)
    assert frame.p[2] == 0.0
    np.testing.assert_array_equal(frame.R[2], [0.0, -1.0, 0.0])
    np.testing.assert_array_equal(frame.P[outside], np.zeros((5, SIZE)))


def test_the_model_that_foresaw_more_weighs_more() -> None:
    """Weights by Bayes' rule, after a chance to switch, and never quite zero."""
    P = np.diag(np.array([0.01, 0.01, 0.01, 0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.1]) ** 2)
    switch = np.array([[0.9, 0.1], [0.2, 0.8]])
    frames = [make_frame(0, P), make_frame(0, P)]
    frames[1].w[:] += [0.0, 3.0, 0.0]
    numbers = np.array([np.concatenate([part.ravel() for part in frame]) for frame in frames])
    model = make_model(turn=np.full((2, 3), 0.5), switch=switch)
    true = moved(frames[0], np.zeros(SIZE))
    travel(true, model, NOTHING, 0.02)
    reading = Sensor(0.5, 2.5).read(true, None)
    likelihood = [follow(frame, model, model.turn[0], reading) for frame in frames]
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
    frames = [make_frame(0, 1e-8 * np.eye(SIZE)) for _ in range(2)]
    frames[1].R[:] = frames[1].R @ Rotation.from_rotvec([0.2, 0.2, 0.0]).as_matrix()
    numbers = np.array([np.concatenate([part.ravel() for part in frame]) for frame in frames])
    model = make_model(turn=np.full((2, 3), 0.5), switch=np.eye(2))
    weights = np.array([0.5, 0.5])
    true = moved(frames[0], np.zeros(SIZE))
    reading = Sensor(1e-3, 1e-3).read(true, None)
    follow_all(numbers, weights, model, reading, 0.02 * true.R[:, 0], 0.3)
    assert weights.sum() == pytest.approx(1, abs=1e-15)
    assert 0 < weights[1] < 1e-8
