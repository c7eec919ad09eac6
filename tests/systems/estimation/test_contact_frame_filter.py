"""The observer that follows the contact point's path: exactness, gates, turned axes."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.profile import Profile
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.sliding_contact import FREE, SLIP
from chamfer.systems.estimation import contact_frame_filter
from chamfer.systems.estimation.contact_frame import NUMBERS, as_frame, repeats
from chamfer.systems.estimation.contact_frame_filter import ContactFrameFilter, resolving_length
from chamfer.systems.estimation.model_error import (
    CALIBRATION,
    GripperCalibration,
    ModelErrorParams,
)
from chamfer.systems.estimation.normal_filter import (
    NormalStatus,
    Sample,
    rotation_between,
    tangential_deviation,
)

Array = np.ndarray
VARYING = SurfaceFriction(coefficient=0.5, ripple=0.3)
HOLLOW = Sphere(centre=(0.0, 0.0, 2.0), radius=2.0, inside=True)


@pytest.mark.parametrize(
    ("surface", "assumed", "known"),
    [  # largest errors, deg: with the noise of section 5.2.2 assumed, and with none
        (Wave(wavelengths=(2.0,)), 2.5, 0.002),
        (HOLLOW, 2.8, 0.002),
        # Across a twisted path the force's direction tells the normal, taken as good to 0.02 rad.
        (Parabola(coefficients=(0.2, -0.2)), 2.8, 1.6),
        (Wave(amplitudes=(0.05, 0.05), wavelengths=(2.0, 2.0)), 3.5, 0.9),
    ],
)
def test_samples_without_noise(
    slides: Any, surface: Surface, assumed: float, known: float
) -> None:
    d = surface.dimension
    slide = slides.make(surface, slides.lead(d, heading=0.7), 6.0, friction=VARYING)
    counted = slide.modes == SLIP
    counted[:20] = False
    assert np.count_nonzero(counted) > 80
    for most, noise in ((assumed, {}), (known, {"force_noise": 0.0, "force_rate_noise": 0.0})):
        found = slides.follow(slides.observer(d, **noise), slide.samples)
        errors = slides.angles(found.normals, slide.normals)[counted]
        assert np.degrees(errors.max()) < most
        assert np.all(errors <= 3 * found.deviations[counted] + 1e-6)
        fast = counted & (np.linalg.norm(slide.velocities, axis=1) > 0.11)
        assert np.all(found.statuses[fast] == NormalStatus.MEASURED)


kinds_of_sample = st.sampled_from(["slide", "noise", "no force", "halt", "parallel", "large"])


@pytest.mark.slow
@settings(deadline=None, max_examples=12)
@given(
    d=st.sampled_from([2, 3]),
    seed=st.integers(0, 2**32 - 1),
    kinds=st.lists(kinds_of_sample, min_size=10, max_size=40),
    silent=st.booleans(),
)
# Half turns that are not exact take the frame out of the plane, further with each step.
@example(d=2, seed=175, kinds=10 * ["slide", "parallel"], silent=False)
@pytest.mark.filterwarnings("error")
def test_norm_and_covariance_over_random_runs(
    slides: Any,
    d: int,
    seed: int,
    kinds: list[str],
    silent: bool,
) -> None:
    noise = {"force_noise": 0.0, "force_rate_noise": 0.0} if silent else {}
    observer = slides.observer(d, **noise)
    random = np.random.default_rng(seed)
    draw = random.standard_normal
    memory = observer.start(np.eye(d)[-1])
    for kind in 3 * kinds:
        force, velocity = 10 * draw(d), 0.3 * draw(d)
        sample = {
            "slide": Sample(10 * np.eye(d)[-1] + draw(d), 3 * draw(d), draw(d), velocity),
            "noise": Sample(0.3 * draw(d), 3 * draw(d), draw(d), velocity),
            "no force": Sample(np.zeros(d), np.zeros(d), draw(d), velocity),
            "halt": Sample(force, 10 * draw(d), draw(d), np.zeros(d)),
            "parallel": Sample(force, np.zeros(d), draw(d), -0.05 * force),
            "large": Sample(10 * force, 100 * draw(d), 3 * draw(d), 10 * velocity),
        }[kind]
        ahead = np.eye(d)[-1] + 0.7 * slides.unit(random, d)
        sample = sample._replace(predicted_normal=ahead / np.linalg.norm(ahead))
        found = observer.update(memory, sample)
        memory = found.memory
        assert np.all(np.isfinite(memory))
        assert abs(float(np.linalg.norm(found.normal)) - 1) < 1e-12
        largest = float(np.abs(found.covariance).max())
        np.testing.assert_allclose(
            found.covariance, found.covariance.T, rtol=0, atol=1e-15 * largest
        )
        assert np.linalg.eigvalsh(found.covariance)[0] >= -1e-12 * largest
        models = memory[: 3 * NUMBERS].reshape(3, NUMBERS)
        for frame in map(as_frame, models):
            np.testing.assert_allclose(frame.R @ frame.R.T, np.eye(3), rtol=0, atol=1e-12)
            if d == 2:
                assert not np.any(frame.R[2, [0, 2]])
                assert not np.any(frame.P[[1, 3, 5, 6, 8]])
            assert np.linalg.eigvalsh(frame.P)[0] >= -1e-9 * np.abs(frame.P).max()
        if kind in ("no force", "halt") or (kind == "noise" and not silent):
            assert found.status is not NormalStatus.MEASURED


@pytest.mark.parametrize(("radius", "count"), [(0.75, 4), (5.9, 4), (6.0, 2), (50.0, 2)])
def test_it_begins_with_the_initial_normal_and_smoother_models_than_the_sharpest(
    slides: Any, radius: float, count: int
) -> None:
    n = np.array([0.6, 0.0, 0.8])
    observer = slides.observer(3, smallest_radius=radius, initial_deviation=0.2)
    memory = observer.start(n)
    assert memory.shape == (count * (NUMBERS + 1) + 33,)
    weights = memory[count * NUMBERS : -33]
    assert weights.sum() == pytest.approx(1, rel=1e-15)
    assert np.all(np.diff(weights) < 0)  # sharp until it has shown to be smooth
    frames = [as_frame(one) for one in memory[: count * NUMBERS].reshape(count, NUMBERS)]
    # Their mean square is a third of the bound's (4-20); the ratios between them are the same.
    # The last one's makes the band.
    radii = [1 / math.sqrt(3 * frame.P[7, 7]) for frame in frames]
    expected = [radius, math.sqrt(6 * radius), 6.0] if count == 4 else [radius]
    np.testing.assert_allclose(radii, [*expected, radius / (0.8 * math.sqrt(3))], rtol=1e-12)
    first = observer.update(memory, Sample(*(np.zeros(3) for _ in range(4))))
    assert first.status is NormalStatus.HALTED
    for normal in (first.normal, *(frame.R[:, 2] for frame in frames)):
        np.testing.assert_allclose(normal, n, rtol=0, atol=1e-15)
    flat = (1.03 * 0.2) ** 2 * (np.eye(3) - np.outer(n, n))
    np.testing.assert_allclose(first.covariance, flat, rtol=0, atol=1e-15)
    # The nominal motion back to the latest force: 0.1 s and four deviations, at 20 Hz.
    late = slides.observer(3, {"delay": 0.1, "delay_deviation": 0.01}, smallest_radius=radius)
    assert len(late.start(n)) - len(memory) == 6 * 4


@pytest.mark.parametrize("d", [2, 3])
def test_lost_contact(slides: Any, d: int) -> None:
    away = np.zeros(d)
    away[-1] = 0.3
    ahead = 0.2 * np.eye(d)[0]
    surface = Parabola() if d == 2 else Parabola(coefficients=(0.05, 0.05))
    motion = slides.legs(
        [*np.zeros(d - 1), -0.1],
        [(4.0, ahead), (2.0, ahead + away), (2.0, ahead - away), (4.0, ahead)],
    )
    slide = slides.make(surface, motion, 12.0)
    free = np.flatnonzero(slide.modes == FREE)
    assert len(free) > 40
    first, last = free[5], free[-1]  # as long as there is a force the point shows a path
    found = slides.follow(slides.observer(d), slides.disturb(slide.samples, 0))
    gone = found.statuses[first : last + 1] == NormalStatus.NO_CONTACT
    assert np.count_nonzero(gone) > 30
    steps = np.diff(found.deviations[first : last + 1])[gone[1:]]
    assert np.all(steps > 0)
    # By as much as the sharpest surface turns, on the way and by what the velocity's noise is.
    travelled = 0.05 * len(gone) * math.hypot(0.2, 0.3)
    grown = found.deviations[last] - found.deviations[first]
    assert travelled / (math.sqrt(3) * 0.75) == pytest.approx(grown, rel=0.25)
    errors = slides.angles(found.normals, slide.normals)
    assert np.all(errors[-40:] < 3 * found.deviations[-40:])
    assert np.degrees(errors[-20:].max()) < 8


def test_contact_point_is_found_again_after_a_loss(slides: Any) -> None:
    # Where the gripper was before says nothing of the surface's direction from there to here.
    observer = slides.observer(2)
    v, zeros = np.array([0.2, 0.0]), np.zeros(2)

    def sample(x: float, y: float, force: float) -> Sample:
        # Without friction on a flat surface at the height y.
        return Sample(np.array([0.0, force]), zeros, np.array([x, y - force / 100]), v)

    memory = observer.start(np.array([0.0, 1.0]))
    for k in range(40):
        memory = observer.update(memory, sample(0.01 * k, 0.0, 10.0)).memory
    for k in range(3):
        memory = observer.update(memory, sample(0.4, 0.1 * k, 0.0)).memory
    for k in range(20):
        found = observer.update(memory, sample(0.4 + 0.01 * k, 0.5, 10.0))
        memory = found.memory
        assert found.status is NormalStatus.MEASURED
        np.testing.assert_allclose(found.normal, [0.0, 1.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_prediction_turns_estimate_and_covariance_along(slides: Any, d: int) -> None:
    random = np.random.default_rng(2)
    observer, zeros = slides.observer(d), np.zeros(d)
    before, after = slides.unit(random, d), slides.unit(random, d)
    memory = observer.start(slides.unit(random, d))
    halt = Sample(zeros, zeros, zeros, zeros, before)
    kept = observer.update(memory, halt)
    turned = observer.update(kept.memory, halt._replace(predicted_normal=after))
    R = rotation_between(before, after)
    np.testing.assert_allclose(turned.normal, R @ kept.normal, rtol=0, atol=1e-12)
    np.testing.assert_allclose(turned.covariance, R @ kept.covariance @ R.T, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("surface", "rms", "coverage"),
    [  # deg; about a sixth more than measured
        (Wave(wavelengths=(2.0,)), 1.95, 0.99),
        (Parabola(coefficients=(0.2, -0.2)), 2.6, 0.96),
    ],
)
def test_error_and_band_along_a_surface(
    slides: Any, surface: Surface, rms: float, coverage: float
) -> None:
    d = surface.dimension
    slide = slides.make(surface, slides.lead(d, heading=0.7), 6.0, friction=VARYING)
    found = slides.noisy(slides.observer(d), slide, seeds=6)
    assert found.rms < rms
    assert found.coverage >= coverage
    # Nor is it too careful.
    assert found.band < 4 * 1.4 * found.rms


def test_slow_slide_below_the_gate_is_measured(slides: Any) -> None:
    surface, speed, d = Parabola(coefficients=(0.15, 0.15)), 0.09, 3
    slide = slides.make(surface, slides.lead(d, speed=speed, heading=0.4), 1.2 / speed)
    found = slides.follow(slides.observer(d), slides.disturb(slide.samples, 0))
    measured = np.count_nonzero(found.statuses == NormalStatus.MEASURED)
    # Once in five standard deviations of a distance, 41 mm, or a little later.
    assert measured > 12
    assert measured < 0.2 * len(slide.samples)
    assert set(found.statuses) == {NormalStatus.MEASURED, NormalStatus.STUCK}
    noisy = slides.noisy(slides.observer(d), slide, seeds=4, after=40)
    assert noisy.rms < 3.6
    assert noisy.coverage > 0.99
    # What passes the gate of the velocity alone is noise.
    gated = slides.noisy(slides.observer(d, kind="curvature"), slide, seeds=4, after=40)
    assert noisy.rms < 0.6 * gated.rms


SHARP = Parabola(coefficients=(0.15,))
SADDLE = Parabola(coefficients=(0.1, -0.1))


@pytest.mark.parametrize("told", [0.7, 1.3])
def test_stiffness_that_may_be_wrong_widens_the_band_alone(slides: Any, told: float) -> None:
    slide = slides.make(SHARP, slides.lead(2), 8.0)
    K = slides.stiffness(2, 100 * told)
    trusting, careful = (
        slides.noisy(slides.observer(2, error, stiffness=K), slide, seeds=3)
        for error in ({}, {"stiffness": 0.3})
    )
    np.testing.assert_array_equal(careful.errors, trusting.errors)
    assert careful.coverage > 0.99
    known, unknown = (
        float(np.mean((one.errors / one.deviations) ** 2)) for one in (careful, trusting)
    )
    assert unknown > 2
    assert 0.2 < known < 1.6


@pytest.mark.parametrize("considered", range(4))
@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_sensitivity_is_the_estimates_derivative(
    slides: Any, monkeypatch: pytest.MonkeyPatch, considered: int, lag: float
) -> None:
    """Of the compliance, 0, and of the bias along each axis, by differences of two runs."""
    slide = slides.make(SADDLE, slides.lead(3, heading=0.5), 3.0)
    size = 1e-4
    samples = slide.samples
    if considered:
        shift = size * np.eye(3)[considered - 1]
        samples = [s._replace(force=s.force + shift) for s in samples]
    monkeypatch.setattr(contact_frame_filter, "_SMOOTHEST_RADIUS", 0.5)  # a single model
    one: dict[str, Any] = {"rate_lag": lag}
    reference = slides.follow(slides.observer(3, **one), slide.samples)
    one["stiffness"] = slides.stiffness(3, 100.0 if considered else 100.0 * (1 + size))
    found = slides.follow(slides.observer(3, {"stiffness": 0.3, "bias": 1.5}, **one), samples)
    frame = as_frame(found.memory[:NUMBERS])
    by_t, by_b = frame.S[3:5, considered]
    # The true frame is the estimate's, turned by S times the error.
    expected = size * frame.R @ np.array([by_b, -by_t, 0.0])
    moved = reference.normals[-1] - found.normals[-1]
    assert float(np.linalg.norm(expected)) > 1e-7
    np.testing.assert_allclose(moved, expected, rtol=0, atol=0.06 * np.linalg.norm(expected))


def test_tare_finds_the_bias(slides: Any) -> None:
    slide = slides.make(SADDLE, slides.lead(3), 6.0)
    bias = np.array([0.5, 2.0, -1.0])
    above, still = np.array([0.0, 0.0, 0.1]), np.zeros(3)
    tare = [Sample(still, still, above, still)] * 20
    samples = [s._replace(force=s.force + bias) for s in [*tare, *slide.samples]]
    slid = np.flatnonzero(slide.modes == SLIP)[20:]
    noisy = slides.disturb(samples, 0)
    found = slides.follow(slides.observer(3, {"bias": 1.5, "tare": 1.0}), noisy)
    assert set(found.statuses[:20]) == {NormalStatus.NO_CONTACT}
    np.testing.assert_array_equal(found.normals[:20], np.tile([0.0, 0.0, 1.0], (20, 1)))
    errors = slides.angles(found.normals[20:], slide.normals)[slid]
    assert np.all(errors < 3 * found.deviations[20:][slid])
    assert math.degrees(errors.max()) < 6
    # Without, the band must hold all of the bias.
    bare = slides.follow(slides.observer(3, {"bias": 1.5}), noisy[20:])
    assert bare.deviations[slid].mean() > 1.5 * found.deviations[20:][slid].mean()
    assert np.all(slides.angles(bare.normals, slide.normals)[slid] < 3 * bare.deviations[slid])


MAY_BE_WRONG = {"stiffness": 0.3, "bias": 1.5, "delay": 0.05, "delay_deviation": 0.05}


def calibrate(
    factor: float, late: float, constant: Any, seed: int | None, **changes: Any
) -> tuple[GripperCalibration, Array]:
    """Hover for 1 s, then press 0.3 m down in 2 s and 0.1 m up in 1 s, the surface at 0.1 m."""
    params = ModelErrorParams(**{**MAY_BE_WRONG, "tare": 1.0, "press": 3.0, **changes})
    told, period = 100.0 * np.eye(3), 0.05
    noise = 1 / math.sqrt(3)
    found = GripperCalibration(params, force=noise, compliance=np.linalg.inv(told), period=period)
    memory = np.zeros(CALIBRATION)
    random = np.random.default_rng(seed)

    def height(t: float) -> float:
        return float(np.interp(t, [1.0, 3.0, 4.0], [0.1, -0.2, -0.1]))

    def force(t: float) -> Array:
        return factor * told @ np.array([0.0, 0.0, max(-height(t), 0.0)]) + constant

    for k in range(81):
        t = k * period
        shown = force(t - late)
        if seed is not None:
            shown = shown + noise * random.standard_normal(3)
        nominal = np.array([0.0, 0.0, height(t - params.delay)])
        velocity = (nominal - [0.0, 0.0, height(t - params.delay - 1e-6)]) / 1e-6
        assert found.take(memory, shown, nominal, velocity) == (k < 80)
    return found, memory


@pytest.mark.parametrize(("factor", "late"), [(0.75, 0.0), (1.4, 0.1)])
def test_calibration_finds_what_is_wrong_as_surely_as_it_says(factor: float, late: float) -> None:
    bias = np.array([1.0, -2.0, 0.5])
    square = np.zeros(3)
    for seed in range(40):
        found, memory = calibrate(factor, late, bias, seed)
        covariance = found.covariance(memory)
        assert math.sqrt(covariance[0, 0]) < 0.06
        square[0] += (found.factor(memory) / factor - 1) ** 2 / covariance[0, 0]
        error = found.bias(memory) - bias
        square[1] += error @ np.linalg.solve(covariance[1:, 1:], error) / 3
        delay, deviation = found.delay(memory)
        assert deviation < 0.02
        square[2] += ((delay - late) / deviation) ** 2
    # Cautious as to stiffness, by what it is taken to be known to at best.
    assert 0.2 < square[0] / 40 < 1.5
    assert np.all(square[1:] / 40 < 2.2)
    assert np.all(square[1:] / 40 > 0.5)


def test_what_cannot_be_wrong_is_not_sought() -> None:
    zeros = np.zeros(3)
    found, memory = calibrate(1.2, 0.05, zeros, None, delay_deviation=0.0)
    assert found.delay(memory) == (0.05, 0.0)
    assert found.factor(memory) == pytest.approx(1.2, rel=0.01)
    found, memory = calibrate(1.2, 0.05, zeros, None, bias=0.0, tare=0.0, press=4.0)
    np.testing.assert_array_equal(found.bias(memory), zeros)
    assert not found.covariance(memory)[1:].any()
    found, memory = calibrate(1.2, 0.05, zeros, None, tare=4.0, press=0.0)
    assert not found.touched(memory)
    assert found.factor(memory) == 1.0
    assert found.covariance(memory)[0, 0] == 0.3**2
    assert found.delay(memory) == (0.05, 0.05)


@pytest.mark.slow
def test_late_force_is_put_where_the_gripper_was(slides: Any) -> None:
    ball = Circle(centre=(0.0, -1.0), radius=1.0, inside=False)
    slide = slides.make(ball, slides.lead(2, speed=0.1, depth=0.3), 6.0)
    late = [
        sample._replace(
            force=slide.samples[max(k - 4, 0)].force,
            force_rate=slide.samples[max(k - 4, 0)].force_rate,
        )
        for k, sample in enumerate(slide.samples)
    ]
    slid = np.flatnonzero(slide.modes == SLIP)[20:]

    def told(**error: float) -> Any:
        quiet = slides.observer(2, error, force_noise=0.01, force_rate_noise=0.05)
        return slides.follow(quiet, late)

    trusting, told_late = (
        float(np.mean(slides.angles(found.normals, slide.normals)[slid]))
        for found in (told(), told(delay=0.2))
    )
    assert told_late < 0.2 * trusting
    # The normal turns with the speed over the radius, or what the filter takes it for; the band is
    # up to 1.5 times as wide.
    sure, unsure = (told(delay=0.2, delay_deviation=one).deviations[slid] for one in (0.0, 0.05))
    added = np.sqrt(unsure**2 - sure**2)
    assert 0.05 * 0.1 < added.mean() < 1.5 * 2.5 * 0.05 * 0.1


def test_rate_that_lags_shows_no_motion_where_the_gripper_turns_round(slides: Any) -> None:
    # Pressed down and up again the contact point rests, but the lagging rate has not turned yet.
    down, up, ahead = (np.array(v) for v in ([0.0, -0.2], [0.0, 0.2], [0.1, 0.0]))
    motion = slides.legs([0.0, -0.1], [(1.0, down), (0.5, up), (0.4, ahead)])
    slide = slides.make(Parabola(), motion, 1.9)
    share, filtered, samples = 1 - math.exp(-0.05 / 0.2), np.zeros(2), []
    for k, sample in enumerate(slide.samples):
        filtered = sample.force if k == 0 else filtered
        step = share * (sample.force - filtered)
        filtered = filtered + step
        samples.append(sample._replace(force_rate=step / 0.05))
    found = slides.follow(slides.observer(2, rate_lag=0.2), samples)
    assert NormalStatus.MEASURED not in found.statuses[10:]
    assert NormalStatus.MEASURED in slides.follow(slides.observer(2), samples).statuses[10:]


def test_a_bend_shows_where_it_has_turned_as_far_as_the_noise() -> None:
    """The resolving length by a mean of velocities, and by a line fitted through points."""
    random, T, speed, radius = np.random.default_rng(0), 0.001, 0.2, 0.75
    for point, velocity in ((3e-3, math.inf), (1.0, 0.05)):
        length = resolving_length(
            radius=radius, speed=speed, period=T, point=point, velocity=velocity
        )
        s = np.arange(0.0, length, speed * T)
        if velocity == math.inf:
            heights = point * random.standard_normal((4000, len(s)))
            slopes = np.polyfit(s, heights.T, 1)[0]
        else:
            slopes = velocity / speed * random.standard_normal((4000, len(s))).mean(axis=1)
        assert slopes.std() == pytest.approx(length / radius, rel=0.05)
    assert resolving_length(radius=1.0, speed=0.0, period=T, point=1.0, velocity=1.0) == 1.0


def test_a_bend_of_5_degrees_stays_within_the_band(slides: Any) -> None:
    """It is over before the sharpest of the competing models follows, whose band it leaves."""
    length = 2 * 0.75 * math.radians(5)
    bend = Profile(lengths=(1.0, length), curvatures=(0.0, 1 / 0.75))
    slide = slides.make(bend, slides.lead(2), 7.5, friction=SurfaceFriction(coefficient=0.5))
    worst = []
    for banded in (True, False):
        observer = ContactFrameFilter(slides.told(2), banded=banded)
        found = slides.noisy(observer, slide, seeds=20)
        inside = np.mean(found.errors <= 2.8 * found.deviations, axis=0)
        worst.append(inside.min())
        square = float(np.mean((found.errors / found.deviations) ** 2))
        assert 0.1 < square < 1.6
    assert worst[0] >= 0.9
    assert worst[1] < 0.5


FLAT = Parabola(coefficients=(0.0, 0.0))


def test_a_known_error_of_the_position_is_in_the_band(slides: Any) -> None:
    """A position that is off by 5 mm, and by as much again 5 cm later on the path."""
    slide = slides.make(FLAT, slides.lead(3, heading=0.4), 12.0, friction=VARYING)
    slid = slide.modes == SLIP
    kept, told = math.exp(-0.2 * 0.05 / 0.05), {"position": 5e-3, "position_length": 0.05}
    for seed in range(3):
        draw, off, samples = np.random.default_rng(seed).standard_normal, np.zeros(3), []
        for sample in slide.samples:
            off = kept * off + math.sqrt(1 - kept**2) * 5e-3 * draw(3)
            nominal = sample.nominal_position + off
            force = sample.force + 0.01 / math.sqrt(3) * draw(3)
            samples.append(sample._replace(nominal_position=nominal, force=force))
        for error in (told, {}):
            observer = slides.observer(3, error, force_noise=0.01, force_rate_noise=0.1)
            found = slides.follow(observer, samples)
            off_by = slides.angles(found.normals, slide.normals)[slid]
            assert np.mean(off_by <= 3 * found.deviations[slid]) >= 0.95
            # Who is not told of it says that something does not fit, and the band is wider.
            assert (NormalStatus.UNFIT in found.statuses) == (not error)


def test_errors_over_a_length_count_as_fewer_samples() -> None:
    """The variance of a long mean of correlated errors is what was counted with."""
    random, n, distance, length = np.random.default_rng(1), 400, 0.004, 0.02
    kept = math.exp(-distance / length)
    errors = np.empty((3000, n))
    errors[:, 0] = random.standard_normal(3000)
    for k in range(1, n):
        new = random.standard_normal(3000)
        errors[:, k] = kept * errors[:, k - 1] + math.sqrt(1 - kept**2) * new
    counted = repeats(distance, length)
    assert counted == pytest.approx((1 + kept) / (1 - kept), rel=1e-12)
    assert n * errors.mean(axis=1).var() == pytest.approx(counted, rel=0.06)
    assert repeats(distance, 0.0) == 1.0
    assert math.isfinite(repeats(0.0, length))


@pytest.mark.parametrize("d", [2, 3])
def test_a_surface_that_would_pull_begins_the_estimate_anew(slides: Any, d: int) -> None:
    flat = FLAT if d == 3 else Parabola(coefficients=(0.0,))
    slide = slides.make(flat, slides.lead(d), 4.0, friction=VARYING)
    observer = slides.observer(d)
    memory, up = observer.start(-np.eye(d)[-1]), np.eye(d)[-1]
    found = []
    for sample in slides.disturb(slide.samples, 3):
        found.append(observer.update(memory, sample))
        memory = found[-1].memory
    (first,) = np.flatnonzero([one.status is NormalStatus.PULLED for one in found])
    assert slide.modes[first] != FREE
    anew, last = found[first], found[-1]
    assert tangential_deviation(anew.normal, anew.covariance) > math.radians(40)
    for one in found[first:]:
        band = 3 * tangential_deviation(one.normal, one.covariance)
        assert math.acos(min(float(one.normal @ up), 1.0)) < band
    assert math.degrees(math.acos(min(float(last.normal @ up), 1.0))) < 5


def test_a_stiffness_that_does_not_fit_is_told(slides: Any) -> None:
    """Told 5.8 times too little: with a load that varies the path leaves every surface."""
    random = np.random.default_rng(5)
    depths = 0.1 + 0.03 * np.sin(0.5 * np.arange(120))
    samples = []
    for k, depth in enumerate(depths.tolist()):
        force = 100.0 * depth * np.array([-0.5, 1.0]) + random.standard_normal(2) / math.sqrt(3)
        point = np.array([0.01 * k, 0.0])
        samples.append(Sample(force, np.zeros(2), point - 0.01 * force, np.array([0.2, 0.0])))
    for factor, doubted in ((1.0, False), (1 / 5.8, True)):
        found = slides.follow(
            slides.observer(2, stiffness=slides.stiffness(2, 100.0 * factor)), samples
        )
        assert (NormalStatus.UNFIT in found.statuses[20:]) == doubted
        errors = slides.angles(found.normals, np.tile([0.0, 1.0], (120, 1)))
        assert np.mean(errors[20:] <= 3 * found.deviations[20:]) >= 0.9
    assert NormalStatus.MEASURED not in found.statuses[90:]
