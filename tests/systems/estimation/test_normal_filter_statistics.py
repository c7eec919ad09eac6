"""The constrained filter over many samples: exactness, consistency, band, turned axes."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Paraboloid, Wave, WavySheet
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.sliding_contact import SLIP
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    ConstrainedFilterParams,
    Sample,
    Status,
)

Array = np.ndarray


@pytest.mark.parametrize(
    "surface",
    [
        Parabola(),
        Wave(wavelength=2.0),
        Circle(centre=(0.0, 2.0), radius=2.0, inside=True),
        Paraboloid(coefficients=(0.05, -0.2)),
        Sphere(centre=(0.0, 0.0, 2.0), radius=2.0, inside=True),
        WavySheet(wavelengths=(2.0, 3.0)),
    ],
)
@pytest.mark.parametrize(
    "friction", [SurfaceFriction(), SurfaceFriction(coefficient=0.5, ripple=0.3)]
)
@pytest.mark.parametrize("gated", [False, True])
def test_exact_without_noise(
    slides: Any, surface: Surface, friction: SurfaceFriction, gated: bool
) -> None:
    # Section 5.2.2, Fig. 5-5: the estimate is exact and P zero, whatever the friction.
    d = surface.dimension
    slide = slides.make(surface, slides.lead(d, heading=0.4), 6.0, friction=friction)
    found = slides.follow(
        ConstrainedFilter(
            ConstrainedFilterParams(
                stiffness=slides.stiffness(d),
                force_noise=0.0,
                force_rate_noise=0.0,
                gated=gated,
            )
        ),
        slide.samples,
    )
    sliding = slide.modes == SLIP
    assert np.count_nonzero(sliding) > 60
    assert np.degrees(slides.angles(found.normals, slide.normals)[sliding].max()) < 1e-9
    assert np.abs(found.covariances[sliding]).max() < 1e-25
    assert np.all(found.statuses[sliding] == Status.MEASURED)


def turned(normal: Array, by: Array) -> Array:
    """Return a unit vector turned by a small rotation vector's tangential part, shape (d,)."""
    by = by - (by @ normal) * normal
    angle = float(np.linalg.norm(by))
    found: Array = math.cos(angle) * normal + np.sinc(angle / np.pi) * by
    return found


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("solver", ["closed_form", "newton"])
def test_error_is_as_large_as_the_covariance_says(slides: Any, d: int, solver: Any) -> None:
    """Normalised error squared, where the filter's own model holds.

    The true normal takes a random walk with Q, and each sample shows it with an error of
    covariance R: along the surface there are d - 1 directions.
    """
    params = ConstrainedFilterParams(**slides.told(d), smallest_radius=0.5, solver=solver)
    observer = ConstrainedFilter(params)
    random = np.random.default_rng(10 + d)
    push, speed, runs = 30.0, 0.4, 100
    u = math.hypot(1.0 / (math.sqrt(3) * push), 0.05 / (math.sqrt(3) * speed))
    walk, error = speed * params.period / 0.5 / math.sqrt(3), u / math.sqrt(3)
    squares = []
    for _ in range(runs):
        normal = np.eye(d)[-1]
        memory = observer.start(
            turned(normal, params.initial_deviation * random.standard_normal(d))
        )
        for step in range(25):
            normal = turned(normal, walk * random.standard_normal(d))
            shown = turned(normal, error * random.standard_normal(d))
            # Without friction the force is along the normal that is to be shown.
            ahead = random.standard_normal(d)
            ahead -= (ahead @ shown) * shown
            found = observer.update(
                memory,
                Sample(
                    push * shown,
                    np.zeros(d),
                    np.zeros(d),
                    speed * ahead / np.linalg.norm(ahead),
                ),
            )
            memory = found.memory
            if step in (0, 4, 24):  # of these the errors are nearly independent
                flat = np.linalg.svd(normal[None])[2][1:]
                off = flat @ found.normal
                squares.append(off @ np.linalg.solve(flat @ found.covariance @ flat.T, off))
    for first in range(3):
        degrees = runs * (d - 1)
        total = sum(squares[first::3])
        assert chi2.ppf(1e-4, degrees) < total < chi2.ppf(1 - 1e-4, degrees)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("period", [0.01, 0.05])
@pytest.mark.parametrize("radius", [0.75, 2.0])
def test_band_in_equilibrium(slides: Any, d: int, period: float, radius: float) -> None:
    # The process noise of a step is as T^2, so that the band depends on the sample time.
    observer = ConstrainedFilter(
        ConstrainedFilterParams(**slides.told(d), period=period, smallest_radius=radius)
    )
    push, speed = 20.0, 0.2
    sample = Sample(push * np.eye(d)[-1], np.zeros(d), np.zeros(d), speed * np.eye(d)[0])
    memory = observer.start(np.eye(d)[-1])
    for _ in range(1500):
        found = observer.update(memory, sample)
        memory = found.memory
    u = math.hypot(1 / (math.sqrt(3) * push), 0.05 / (math.sqrt(3) * speed))
    expected = math.sqrt(speed * period * u / (3 * radius))
    assert math.sqrt(found.covariance[0, 0]) == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(
    ("radius", "band"),
    [(0.75, (5.8, 6.4)), (10.0, (2.7, 3.3))],  # +-6 deg and +-3 deg (Figs. 5-3 and 5-4)
)
def test_band_on_the_surface_of_the_thesis(
    slides: Any, radius: float, band: tuple[float, float]
) -> None:
    slide = slides.make(Parabola(), slides.lead(2), 15.0)
    observer = ConstrainedFilter(ConstrainedFilterParams(**slides.told(2), smallest_radius=radius))
    found = slides.noisy(observer, slide, seeds=6)
    assert band[0] < found.band < band[1]
    assert 1.8 < found.rms < 2.9  # deg


def test_huge_noise_is_not_listened_to(slides: Any) -> None:
    # Fig. 5-6: the assumed noise is a thousand times larger.
    slide = slides.make(Parabola(), slides.lead(2), 3.5)
    observer = ConstrainedFilter(
        ConstrainedFilterParams(
            stiffness=slides.stiffness(2), force_noise=1000.0, force_rate_noise=5000.0
        )
    )
    found = slides.follow(observer, slides.disturb(slide.samples, 0))
    assert np.degrees(slides.angles(found.normals, np.array([[0.0, 1.0]])).max()) < 0.001
    assert 3 * math.degrees(found.deviations[-1]) == pytest.approx(19.8, abs=0.5)


def test_prior_weights_have_no_bias_towards_the_samples(slides: Any) -> None:
    # Where the sample divides its own force a sample that is off in one direction counts more.
    slide = slides.make(Parabola(coefficient=0.0), slides.lead(2), 10.0)
    biases, told = {}, slides.told(2)
    for weights in ("sample", "prior"):
        observer = ConstrainedFilter(ConstrainedFilterParams(**told, gated=True, weights=weights))
        runs = [slides.follow(observer, slides.disturb(slide.samples, seed)) for seed in range(8)]
        biases[weights] = math.degrees(np.mean([run.normals[40:, 0].mean() for run in runs]))
    assert abs(biases["sample"]) > 1.2
    assert abs(biases["prior"]) < 0.5 * abs(biases["sample"])


@pytest.mark.parametrize("weights", ["sample", "prior"])
@pytest.mark.parametrize("seed", range(2))
def test_turned_axes_turn_the_estimate(
    slides: Any, random_rotation: Callable[..., Array], weights: Any, seed: int
) -> None:
    random = np.random.default_rng(seed)
    R = random_rotation(random, 3)
    root = random.standard_normal((3, 3))
    K = 50 * np.eye(3) + 30 * (root @ root.T)
    found = []
    samples = slides.disturb(
        slides.make(Paraboloid(coefficients=(0.1, 0.2)), slides.lead(3, heading=0.5), 5.0).samples,
        seed,
    )
    for turn in (np.eye(3), R):
        stiffness = turn @ K @ turn.T
        params = ConstrainedFilterParams(
            **{**slides.told(3), "stiffness": tuple(map(tuple, stiffness.tolist()))},
            gated=True,
            weights=weights,
        )
        found.append(
            slides.follow(ConstrainedFilter(params), slides.turn(samples, turn), turn[:, 2])
        )
    np.testing.assert_array_equal(found[1].statuses, found[0].statuses)
    np.testing.assert_allclose(found[1].normals, found[0].normals @ R.T, rtol=0, atol=1e-11)
    np.testing.assert_allclose(
        found[1].covariances, R @ found[0].covariances @ R.T, rtol=0, atol=1e-13
    )
