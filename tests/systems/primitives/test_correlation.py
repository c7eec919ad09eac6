"""Eq. (1), its closed forms, and the block that watches a dither."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.correlation import FREE, Correlation, Phasors, correlation
from chamfer.systems.primitives.dither_blocks import Correlator, ResolvedCorrelatorParams

Array = NDArray[np.float64]


def cosine(samples: int, lag: float = 0.0, periods: int = 1) -> Array:
    return np.cos(2 * np.pi * periods * np.arange(samples) / samples - lag)


def sine(samples: int) -> Array:
    return cosine(samples, lag=math.pi / 2)


def by_phasors(command: Array, motion: Array) -> Correlation:
    total, ends = Phasors(), np.linspace(0, 1, len(command) + 1).tolist()
    for f, g, begin, end in zip(command, motion, ends, ends[1:], strict=False):
        total = total.add(f, g, begin, end)
    return total.correlation()


@settings(deadline=None)
@given(samples=st.integers(2, 300).map(lambda half: 2 * half))
def test_the_closed_form_holds_for_every_even_number_of_samples(samples: int) -> None:
    wave = sine(samples)
    expected = samples**2 / 8 * math.tan(math.pi / samples) ** 2
    assert correlation(wave, wave).value == pytest.approx(expected, rel=1e-9)
    # A wave that begins a quarter of a cycle in may have no zero on a sample.
    of_angle = math.sin if samples % 4 else math.tan
    expected = samples**2 / 8 * of_angle(math.pi / samples) ** 2
    wave = cosine(samples)
    assert correlation(wave, wave).value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("lag", [0.0, 0.4, 1.0, math.pi / 2, 2.0, math.pi])
def test_a_phase_lag_lowers_it_by_its_cosine(lag: float) -> None:
    found = correlation(cosine(4000), cosine(4000, lag=lag))
    assert found.value == pytest.approx(FREE * math.cos(lag), abs=1e-5)
    found = by_phasors(cosine(20), 0.5 * cosine(20, lag=lag))
    assert found == pytest.approx((FREE * math.cos(lag), 0.5, 0.0), abs=1e-12)


@pytest.mark.parametrize(("command", "motion"), [(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)])
def test_a_signal_of_zero_gives_zero(command: float, motion: float) -> None:
    found = correlation(command * cosine(20), motion * cosine(20))
    assert found == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert by_phasors(command * cosine(20), motion * cosine(20)) == (0.0, 0.0, 0.0)


def test_a_stop_on_one_side_is_seen_by_the_amplitudes_only() -> None:
    f = cosine(100_000)
    found = correlation(f, np.maximum(f, 0.0))
    assert found.value == pytest.approx(FREE, rel=1e-8)
    assert found.amplitude_ratio == pytest.approx(0.5, rel=1e-8)
    assert found.bias == pytest.approx(1.0)


class Watched:
    """A correlator that is fed one pair of samples a tick."""

    def __init__(self, **params: Any) -> None:
        self.params = ResolvedCorrelatorParams(**{"samples": 8, "period": 0.25, **params})
        self.block = Correlator(self.params)
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()
        self.ticks = 0

    def tick(self, command: float, motion: float) -> None:
        self.block.GetInputPort("command").FixValue(self.context, [command])
        self.block.GetInputPort("motion").FixValue(self.context, [motion])
        self.simulator.AdvanceTo(self.ticks * self.params.period)
        self.simulator.AdvancePendingEvents()
        self.ticks += 1

    def window(self, command: Array, motion: Array) -> None:
        for f, g in zip(command, motion, strict=True):
            self.tick(f, g)

    @property
    def hindered(self) -> float:
        return float(self.block.GetOutputPort("hindered").Eval(self.context)[0])


F = cosine(8, lag=0.3)


@pytest.mark.parametrize("windows", [1, 2, 3])
def test_it_is_hindered_after_so_many_windows_in_a_row(windows: int) -> None:
    watched = Watched(windows=windows)
    watched.window(F, F)
    assert watched.hindered == 0.0
    for before in range(windows):
        assert watched.hindered == 0.0, before
        watched.window(F, np.zeros(8))
    assert watched.hindered == 1.0
    watched.window(F, np.zeros(8))
    assert watched.hindered == 1.0


@pytest.mark.parametrize(
    ("motion", "hindered"),
    [
        (0.75 * F, 0.0),  # both above their thresholds
        (0.65 * F, 1.0),  # the amplitude alone
        (np.maximum(F, 0.0), 1.0),  # likewise: a stop on one side
        (cosine(8, lag=0.3 + math.pi / 2), 1.0),  # the correlation alone
        (-F, 1.0),
    ],
)
def test_either_test_suffices(motion: Array, hindered: float) -> None:
    watched = Watched(windows=1)
    watched.window(F, motion)
    assert watched.hindered == hindered
    found = watched.block.GetOutputPort("correlation").Eval(watched.context)
    np.testing.assert_allclose(found, correlation(F, motion), atol=1e-12)


@pytest.mark.parametrize("port", ["command", "motion"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_an_input_that_is_not_finite_is_named(port: str, value: float) -> None:
    watched = Watched()
    inputs = {"command": 0.0, "motion": 0.0, port: value}
    with pytest.raises(ParameterError, match=f"{port} is {value}, allowed: a finite number"):
        watched.tick(**inputs)
