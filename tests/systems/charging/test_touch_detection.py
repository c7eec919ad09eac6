"""When the mean of the force readings is contact, and how noise misleads it."""

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.charging.charging_params import TouchDetectionParams

SLIDE, PERIOD = 1.2, 0.005  # N, s
RUNS = 400


def means(force: np.ndarray, noise: float, readings: int) -> np.ndarray:
    """Return the means of noisy readings of a force, N, shape (RUNS, k)."""
    rng = np.random.default_rng(0)
    sums = np.cumsum(force + rng.uniform(-noise, noise, (RUNS, len(force))), axis=1)
    result: np.ndarray = (sums[:, readings:] - sums[:, :-readings]) / readings
    return result


@pytest.mark.parametrize("noise", [0.5, 1.5])
def test_false_losses_and_false_contacts_are_rare(noise: float) -> None:
    # Of the wrist's sensor, and three times that; a slide and a search of 2 s each.
    params = TouchDetectionParams().resolved(noise)
    assert params.detect is not None
    slide = means(np.full(400, SLIDE), noise, params.readings)
    assert np.mean(np.any(slide <= params.release, axis=1)) <= 0.01
    free = means(np.zeros(400), noise, params.readings)
    assert np.mean(np.any(free > params.detect, axis=1)) <= 0.01


@pytest.mark.parametrize(("noise", "usual", "late"), [(0.5, 0.08, 0.09), (1.5, 0.08, 0.15)])
def test_a_loss_is_soon_seen(noise: float, usual: float, late: float) -> None:
    params = TouchDetectionParams().resolved(noise)
    n = params.readings
    seen = means(np.r_[np.full(n, SLIDE), np.zeros(200)], noise, n) <= params.release
    delay = PERIOD * (1 + np.argmax(seen, axis=1))
    assert np.median(delay) <= usual
    assert np.quantile(delay, 0.95) <= late


def test_thresholds_follow_from_noise_and_bias() -> None:
    assert TouchDetectionParams().resolved(0.0).detect == pytest.approx(0.3)
    assert TouchDetectionParams(readings=12).resolved(0.6).detect == pytest.approx(0.5)
    assert TouchDetectionParams(readings=12).resolved(0.6, 0.2).detect == pytest.approx(0.7)
    given = TouchDetectionParams(detect=0.4)
    assert given.resolved(0.6) == given


def test_refusals() -> None:
    with pytest.raises(ParameterError, match=r"^readings is 0, allowed: a whole number >= 1"):
        TouchDetectionParams(readings=0)
    with pytest.raises(ParameterError, match=r"^release is 0.4, allowed: less than detect, 0.3"):
        TouchDetectionParams(detect=0.3, release=0.4)
    with pytest.raises(ParameterError, match=r"^detect is 0.4, allowed: more than .* bias, 0.5"):
        TouchDetectionParams(detect=0.4).resolved(0.1, 0.5)
