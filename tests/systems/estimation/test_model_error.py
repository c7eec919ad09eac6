"""What the observer that follows the path makes of wrong stiffness, bias, delay, lost contact."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from chamfer.models.surfaces.graphs import Parabola, Paraboloid
from chamfer.systems.contact.sliding_contact import SLIP
from chamfer.systems.estimation.contact_frame import NUMBERS, as_frame
from chamfer.systems.estimation.contact_frame_filter import (
    ContactFrameFilter,
    ContactFrameFilterParams,
)
from chamfer.systems.estimation.model_error import (
    CALIBRATION,
    GripperCalibration,
    ModelErrorParams,
)
from chamfer.systems.estimation.normal_filter import NormalStatus, Sample

Array = np.ndarray
Make = Callable[..., ContactFrameFilter]
SHARP = Parabola(coefficient=0.15)
SADDLE = Paraboloid(coefficients=(0.1, -0.1))


@pytest.fixture(scope="module")
def make(slides: Any) -> Make:
    def make_filter(d: int, *, told: float = 1.0, **changes: Any) -> ContactFrameFilter:
        error = ModelErrorParams(
            **{n: changes.pop(n) for n in list(changes) if n in ModelErrorParams.__annotations__}
        )
        fields = {**slides.told(d), "stiffness": slides.stiffness(d, 100.0 * told), **changes}
        return ContactFrameFilter(ContactFrameFilterParams(**fields, model_error=error))

    return make_filter


@pytest.mark.parametrize("told", [0.7, 1.3])
def test_stiffness_that_may_be_wrong_widens_the_band_alone(
    slides: Any, make: Make, told: float
) -> None:
    slide = slides.make(SHARP, slides.lead(2), 8.0)
    trusting = slides.noisy(make(2, told=told), slide, seeds=3)
    careful = slides.noisy(make(2, told=told, stiffness=0.3), slide, seeds=3)
    np.testing.assert_array_equal(careful.errors, trusting.errors)
    assert trusting.coverage < 0.8
    assert careful.coverage > 0.99
    square = float(np.mean((careful.errors / careful.deviations) ** 2))
    assert 0.4 < square < 1.6


@pytest.mark.parametrize("considered", range(4))
@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_sensitivity_is_the_estimates_derivative(
    slides: Any, make: Make, considered: int, lag: float
) -> None:
    """Of the compliance, 0, and of the bias along each axis, by differences of two runs."""
    slide = slides.make(SADDLE, slides.lead(3, heading=0.5), 3.0)
    size = 1e-4
    samples = slide.samples
    if considered:
        shift = size * np.eye(3)[considered - 1]
        samples = [s._replace(force=s.force + shift) for s in samples]
    told = 1 + size if not considered else 1.0
    one = {"models": 1, "rate_lag": lag}
    reference = slides.follow(make(3, **one), slide.samples)
    # Where nothing may be wrong, nothing is considered.
    assert not as_frame(reference.memory[:NUMBERS]).S.any()
    found = slides.follow(make(3, **one, told=told, stiffness=0.3, bias=1.5), samples)
    frame = as_frame(found.memory[:NUMBERS])
    by_t, by_b = frame.S[3:5, considered]
    # The true frame is the estimate's, turned by S times the error.
    expected = size * frame.R @ np.array([by_b, -by_t, 0.0])
    moved = reference.normals[-1] - found.normals[-1]
    assert float(np.linalg.norm(expected)) > 1e-7
    np.testing.assert_allclose(moved, expected, rtol=0, atol=0.06 * np.linalg.norm(expected))


def test_tare_finds_the_bias(slides: Any, make: Make) -> None:
    slide = slides.make(SADDLE, slides.lead(3), 6.0)
    bias = np.array([0.5, 2.0, -1.0])
    above, still = np.array([0.0, 0.0, 0.1]), np.zeros(3)
    tare = [Sample(still, still, above, still)] * 20
    samples = [s._replace(force=s.force + bias) for s in [*tare, *slide.samples]]
    slid = np.flatnonzero(slide.modes == SLIP)[20:]
    careful = make(3, bias=1.5, tare=1.0)
    for seed in range(1):
        noisy = slides.disturb(samples, seed)
        found = slides.follow(careful, noisy)
        assert set(found.statuses[:20]) == {NormalStatus.NO_CONTACT}
        np.testing.assert_array_equal(found.normals[:20], np.tile([0.0, 0.0, 1.0], (20, 1)))
        errors = slides.angles(found.normals[20:], slide.normals)[slid]
        assert np.all(errors < 3 * found.deviations[20:][slid])
        assert math.degrees(errors.max()) < 6
        # Without, the band must hold all of the bias.
        bare = slides.follow(make(3, bias=1.5), noisy[20:])
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


def test_rate_that_lags_shows_no_motion_where_the_gripper_turns_round(
    slides: Any, make: Make
) -> None:
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
    found = slides.follow(make(2, rate_lag=0.2), samples)
    assert NormalStatus.MEASURED not in found.statuses[10:]
    assert NormalStatus.MEASURED in slides.follow(make(2), samples).statuses[10:]
