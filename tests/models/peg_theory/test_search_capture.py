"""How likely a spiral finds its hole: closed forms, the track itself, and drawn holes."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.stats

from chamfer.models.peg_theory.search_capture import SpiralCoverage, draw_errors

SPIRAL = SpiralCoverage(pitch=0.001, radius=0.003, capture=0.0008)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 2.5, 4.0])
def test_without_noise_a_pass_covers_twice_the_capture(ratio: float) -> None:
    spiral = replace(SPIRAL, pitch=ratio * SPIRAL.capture)
    assert spiral.between_turns() == pytest.approx(min(1.0, 2 / ratio), abs=1e-3)


def test_of_a_large_disc_it_finds_the_share_that_the_last_turn_reaches() -> None:
    far, near, size = 0.003 + 0.0008, 0.002 + 0.0008, 0.006
    closed = (far**3 - near**3) / (3 * 0.001 * size**2)
    assert SPIRAL.probability(size) == pytest.approx(closed, rel=1e-3)
    assert SPIRAL.probability(0.002) == 1.0


@pytest.mark.parametrize("size", [0.002, 0.0035, 0.006])
def test_theory_is_what_the_track_finds_of_drawn_holes(size: float) -> None:
    generator, n = np.random.default_rng(5), 4000
    found = int(SPIRAL.finds(draw_errors(size, n, generator), generator).sum())
    interval = scipy.stats.binomtest(found, n).proportion_ci(0.999)
    assert interval.low - 0.005 <= SPIRAL.probability(size) <= interval.high + 0.005


def test_noise_finds_less_of_what_is_nearly_captured() -> None:
    # Independent passes: the mean over a turn by another rule, of both sides.
    noisy = replace(SPIRAL, noise=0.0004)
    generator = np.random.default_rng(3)
    d = generator.uniform(0.0, noisy.pitch, 200_000)
    passes = np.stack([d, noisy.pitch - d]) + generator.normal(0.0, noisy.noise, (2, d.size))
    share = (np.abs(passes) <= noisy.capture).any(axis=0).mean()
    assert noisy.between_turns() == pytest.approx(share, abs=4e-3)
    assert noisy.between_turns() < SPIRAL.between_turns()


def test_a_peg_that_is_dragged_runs_inside_its_command() -> None:
    spiral = SpiralCoverage(pitch=0.0004, radius=0.004, capture=0.0002, drag=0.0015)
    track = spiral.track()
    assert math.hypot(*track[-1]) == pytest.approx(math.sqrt(0.004**2 - 0.0015**2), rel=0.02)
    free = replace(spiral, drag=0.0)
    assert spiral.probability(0.005) < free.probability(0.005)
