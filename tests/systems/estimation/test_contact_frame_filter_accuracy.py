"""How well the observers that follow the path do with the noise of section 5.2.2."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Paraboloid, Wave, WavySheet
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.sliding_contact import SLIP, STICK
from chamfer.systems.estimation.contact_frame import NUMBERS
from chamfer.systems.estimation.contact_frame_filter import (
    ContactFrameFilter,
    ContactFrameFilterParams,
)
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    ConstrainedFilterParams,
    Status,
)

Array = np.ndarray
Make = Callable[..., ContactFrameFilter]

VARYING = SurfaceFriction(coefficient=0.5, ripple=0.3)
DROP = SurfaceFriction(jump=-0.4, jump_at=0.8)
BOWL = Circle(centre=(0.0, 2.0), radius=2.0, inside=True)
HOLLOW = Sphere(centre=(0.0, 0.0, 2.0), radius=2.0, inside=True)


@pytest.fixture(scope="package")
def make_filter(slides: Any) -> Make:
    def make(d: int, **changes: Any) -> ContactFrameFilter:
        fields = {**slides.told(d), **changes}
        return ContactFrameFilter(ContactFrameFilterParams(**fields))

    return make


@pytest.mark.parametrize(
    ("surface", "rms", "coverage"),
    [  # deg; about a sixth more than measured
        (Parabola(), 1.15, 0.995),
        (Wave(wavelength=2.0), 1.95, 0.99),
        (BOWL, 2.1, 0.99),
        (Paraboloid(), 1.8, 0.995),
        (Paraboloid(coefficients=(0.2, -0.2)), 2.6, 0.96),
        (HOLLOW, 2.6, 0.97),
        (WavySheet(wavelengths=(2.0, 2.0)), 2.6, 0.985),
    ],
)
@pytest.mark.parametrize("friction", [SurfaceFriction(), VARYING])
def test_error_and_band_along_a_surface(
    slides: Any,
    make_filter: Make,
    surface: Surface,
    friction: SurfaceFriction,
    rms: float,
    coverage: float,
) -> None:
    d = surface.dimension
    slide = slides.make(surface, slides.lead(d, heading=0.7), 6.0, friction=friction)
    found = slides.noisy(make_filter(d), slide, seeds=6)
    assert found.rms < rms
    assert found.coverage >= coverage
    # Nor is it too careful.
    assert found.band < 4 * 1.3 * found.rms


@pytest.mark.parametrize("friction", [SurfaceFriction(), VARYING, DROP])
def test_better_than_the_thesis_filter_and_honest(
    slides: Any, make_filter: Make, friction: SurfaceFriction
) -> None:
    slide = slides.make(Parabola(), slides.lead(2), 10.0, friction=friction)
    found = slides.noisy(make_filter(2), slide, seeds=5)
    thesis = slides.noisy(
        ConstrainedFilter(ConstrainedFilterParams(**slides.told(2), gated=True)), slide, seeds=5
    )
    assert found.rms < 0.65 * thesis.rms
    assert found.coverage >= 0.999
    assert found.band < thesis.band


def test_friction_does_not_matter(slides: Any, make_filter: Make) -> None:
    found = [
        slides.noisy(make_filter(2), slides.make(Parabola(), slides.lead(2), 10.0, friction=mu))
        for mu in (SurfaceFriction(), VARYING, DROP, SurfaceFriction(coefficient=0.1))
    ]
    rms = [each.rms for each in found]
    assert max(rms) < 1.2 * min(rms)


@pytest.mark.parametrize(
    ("friction", "holds"), [(SurfaceFriction(), True), (VARYING, False), (DROP, False)]
)
def test_a_friction_state_only_where_friction_is_constant(
    slides: Any, make_filter: Make, friction: SurfaceFriction, holds: bool
) -> None:
    slide = slides.make(Parabola(), slides.lead(2), 10.0, friction=friction)
    changes = {"models": 1, "by_point": False}
    without = slides.noisy(make_filter(2, **changes), slide, seeds=6)
    found = slides.noisy(make_filter(2, **changes, by_friction=True), slide, seeds=6)
    assert without.coverage > 0.995
    if holds:
        assert found.rms < 0.7 * without.rms
        assert found.coverage > 0.995
    else:
        assert found.rms > 2 * without.rms
        assert found.coverage < 0.6


def test_a_constant_error_of_the_force_sensor_does_not_matter_in_the_plane(
    slides: Any, make_filter: Make
) -> None:
    slide = slides.make(Parabola(), slides.lead(2), 6.0)
    biased = slide._replace(
        samples=[s._replace(force=s.force + np.array([2.0, 3.0])) for s in slide.samples]
    )
    plain, found = (slides.noisy(make_filter(2), each, seeds=4) for each in (slide, biased))
    np.testing.assert_allclose(found.errors, plain.errors, rtol=0, atol=math.radians(0.05))


def test_stiffness_that_is_not_the_same_in_every_direction(slides: Any, make_filter: Make) -> None:
    for surface, K, rms in (
        (Parabola(), ((150.0, 40.0), (40.0, 80.0)), 1.4),
        (Paraboloid(), ((150.0, 40.0, 0.0), (40.0, 80.0, 10.0), (0.0, 10.0, 120.0)), 1.9),
    ):
        d = surface.dimension
        slide = slides.make(surface, slides.lead(d, heading=0.7), 8.0, stiffness=K)
        found = slides.noisy(make_filter(d, stiffness=K), slide, seeds=5)
        assert found.rms < rms
        assert found.coverage > 0.995
        mistaken = slides.noisy(make_filter(d), slide, seeds=3)
        assert mistaken.rms > 1.6 * found.rms


def test_weights_go_to_the_model_that_is_smooth_enough(slides: Any, make_filter: Make) -> None:
    weights = []
    for coefficient in (0.0, 0.05, 0.3, 0.6):
        surface = Parabola(coefficient=coefficient)
        slide = slides.make(surface, slides.lead(2), 6.0)
        runs = [
            slides.follow(make_filter(2), slides.disturb(slide.samples, seed)).memory
            for seed in range(5)
        ]
        weights.append(np.mean([memory[3 * NUMBERS : 3 * NUMBERS + 3] for memory in runs], axis=0))
    sharpest, smoothest = np.array(weights)[:, 0], np.array(weights)[:, 2]
    assert np.all(np.diff(sharpest) > 0)
    assert np.all(np.diff(smoothest) < 0)
    assert sharpest[0] < 0.2 < 0.8 < sharpest[3]
    assert smoothest[0] > 0.55 > 0.05 > smoothest[3]


def test_several_models_are_worth_it(slides: Any, make_filter: Make) -> None:
    slide = slides.make(Parabola(), slides.lead(2), 8.0)
    one, three = (slides.noisy(make_filter(2, models=count), slide, seeds=6) for count in (1, 3))
    assert three.rms < 0.8 * one.rms
    assert three.band < 0.8 * one.band
    assert one.coverage == three.coverage == 1


def test_where_the_point_is_tells_more_than_how_it_moves(slides: Any, make_filter: Make) -> None:
    slide = slides.make(Parabola(), slides.lead(2), 8.0)
    by_point, by_velocity = (
        slides.noisy(make_filter(2, models=1, by_point=given), slide, seeds=5)
        for given in (True, False)
    )
    assert by_point.rms < 0.75 * by_velocity.rms
    assert by_point.band < 0.85 * by_velocity.band


@pytest.mark.parametrize("speed", [0.05, 0.09])
@pytest.mark.parametrize(
    "surface", [Parabola(coefficient=0.15), Paraboloid(coefficients=(0.15, 0.15))]
)
def test_slow_slide_below_the_gate_is_measured(
    slides: Any, make_filter: Make, surface: Surface, speed: float
) -> None:
    d = surface.dimension
    slide = slides.make(surface, slides.lead(d, speed=speed, heading=0.4), 1.2 / speed)
    found = slides.follow(make_filter(d), slides.disturb(slide.samples, 0))
    measured = np.count_nonzero(found.statuses == Status.MEASURED)
    # Once in five standard deviations of a distance, 41 mm, or a little later.
    assert measured > 12
    assert measured < 0.2 * len(slide.samples)
    assert set(found.statuses) == {Status.MEASURED, Status.STUCK}
    noisy = slides.noisy(make_filter(d), slide, seeds=4, after=40)
    assert noisy.rms < 3.6
    assert noisy.coverage > 0.99
    # What passes the gate of the velocity alone is noise.
    gated = slides.noisy(make_filter(d, by_point=False), slide, seeds=4, after=40)
    assert noisy.rms < 0.6 * gated.rms


@pytest.mark.parametrize("surface", [Parabola(), Paraboloid()])
def test_sticking_is_not_taken_for_motion(
    slides: Any, make_filter: Make, surface: Surface
) -> None:
    # Noise that passes the gate has any direction; in space it would tilt the normal.
    d = surface.dimension
    slide = slides.make(surface, slides.lead(d, speed=0.005), 8.0)
    assert np.all(slide.modes == STICK)
    moved = []
    for seed in range(8):
        found = slides.follow(make_filter(d), slides.disturb(slide.samples, seed))
        moved.append(np.degrees(slides.angles(found.normals, np.eye(d)[[-1]]).max()))
    assert sum(angle > 0.5 for angle in moved) <= 1
    assert max(moved) < 6


@pytest.mark.parametrize("surface", [Parabola(), Paraboloid()])
def test_reversal(slides: Any, make_filter: Make, surface: Surface) -> None:
    d = surface.dimension
    ahead = 0.2 * np.eye(d)[0]
    start = [*np.zeros(d - 1), -0.1]
    slide = slides.make(surface, slides.legs(start, [(5.0, ahead), (5.0, -ahead)]), 10.0)
    back = (slide.velocities[:, 0] < 0) & (slide.modes == SLIP)
    assert np.count_nonzero(back) > 40
    found = slides.noisy(make_filter(d), slide, seeds=6)
    assert found.rms < 1.6
    assert found.coverage == 1


@pytest.mark.parametrize(("degrees", "rms"), [(45, 1.7), (90, 1.8), (120, 4.2), (150, 1.8)])
def test_corner_of_the_path_in_space(
    slides: Any, make_filter: Make, degrees: float, rms: float
) -> None:
    angle = math.radians(degrees)
    after = [0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.0]
    motion = slides.legs([0.0, 0.0, -0.1], [(3.0, [0.2, 0.0, 0.0]), (4.0, after)])
    slide = slides.make(Paraboloid(), motion, 7.0)
    found = slides.noisy(make_filter(3), slide, seeds=8, after=60)
    assert found.rms < rms
    # At 120 deg it sticks first, and may go on by too little of a turn to be told from noise.
    assert found.coverage > 0.96


@pytest.mark.parametrize("heading", [0.0, 0.5, 1.0, 2.5, 4.0])
def test_every_direction_to_begin_with_is_as_good(
    slides: Any, make_filter: Make, heading: float
) -> None:
    # From the first motion on, on a surface that is the same all around.
    slide = slides.make(Paraboloid(), slides.lead(3, heading=heading), 2.5)
    found = slides.noisy(make_filter(3), slide, seeds=8, after=0)
    assert found.rms < 3.0
    assert found.coverage > 0.99
    assert np.degrees(found.errors.max()) < 12


@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_loss_and_return_of_contact(slides: Any, make_filter: Make, degrees: float) -> None:
    angle = math.radians(degrees)
    after = np.array([0.2 * math.cos(angle), 0.2 * math.sin(angle), 0.0])
    up = np.array([0.0, 0.0, 0.6])
    motion = slides.legs(
        [0.0, 0.0, -0.1],
        [(3.0, [0.2, 0.0, 0.0]), (1.0, after + up), (1.0, after - up), (4.0, after)],
    )
    slide = slides.make(Paraboloid(), motion, 9.0)
    found = slides.noisy(make_filter(3), slide, seeds=6)
    assert found.rms < 3.8
    assert found.coverage > 0.98
    at_last = slides.noisy(make_filter(3), slide, seeds=6, after=140)
    assert at_last.rms < 2.2
    assert at_last.coverage > 0.995
