"""Metrics of a step response, and of a loop that follows a sinusoid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Metric, measured
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

FINAL_PART = 0.2  # of the run: the final value is the mean over its end


@dataclass(frozen=True)
class StepMetrics:
    """The figures of merit of a step response; None where undefined."""

    final: float  # mean over the last 20 %
    rise_time: float | None  # s, first crossings of 10 % and 90 % of the final value
    overshoot: float | None  # %, of the largest value beyond the final one, relative to it
    settling_time: float | None  # s, after which the response stays within 2 % of the final value
    steady_state_error: float  # reference minus final value
    error_max: float  # largest |reference - response| over the last 20 %
    ripple: float | None  # %, peak to peak over the last 20 %, relative to the final value

    def as_metrics(self, prefix: str, unit: str) -> dict[str, Metric]:
        """Return the values as metrics named ``<prefix>.<name>``."""
        never = "the response does not cross or stay within the levels during the run"
        units = {
            "rise_time": "s",
            "overshoot": "%",
            "settling_time": "s",
            "steady_state_error": unit,
            "error_max": unit,
            "ripple": "%",
        }
        return {
            f"{prefix}.{name}": measured(getattr(self, name), of, missing=never)
            for name, of in units.items()
        }


def step_metrics(time: Array, response: Array, reference: float) -> StepMetrics:
    """Measure a response to a step at the first of the times.

    Crossings are interpolated between samples.

    Args:
        time: s, shape (n,), increasing.
        response: Shape (n,).
        reference: The step's height, not zero.
    """
    start = time[0] + (1.0 - FINAL_PART) * (time[-1] - time[0])
    end = response[time >= start]
    final = float(end.mean())
    scaled = response / final if final != 0 else np.full_like(response, np.nan)
    low, high = (_first_crossing(time, scaled, level) for level in (0.1, 0.9))
    return StepMetrics(
        final=final,
        rise_time=None if low is None or high is None else high - low,
        overshoot=100.0 * max(0.0, float(scaled.max()) - 1.0) if final != 0 else None,
        settling_time=_settling_time(time, scaled, band=0.02),
        steady_state_error=reference - final,
        error_max=float(np.abs(reference - end).max()),
        ripple=100.0 * float(np.ptp(end)) / abs(final) if final != 0 else None,
    )


def _first_crossing(time: Array, scaled: Array, level: float) -> float | None:
    above = np.flatnonzero(scaled >= level)
    if len(above) == 0:
        return None
    i = int(above[0])
    if i == 0:
        return float(time[0])
    part = (level - scaled[i - 1]) / (scaled[i] - scaled[i - 1])
    return float(time[i - 1] + part * (time[i] - time[i - 1]))


def _settling_time(time: Array, scaled: Array, *, band: float) -> float | None:
    distance = np.abs(scaled - 1.0)
    outside = np.flatnonzero(~(distance <= band))
    if len(outside) == 0:
        return 0.0
    i = int(outside[-1])
    # Leaving the band in the part that defines the final value is no settling.
    if time[i] - time[0] >= (1.0 - FINAL_PART) * (time[-1] - time[0]):
        return None
    part = (distance[i] - band) / (distance[i] - distance[i + 1])
    return float(time[i] + part * (time[i + 1] - time[i]) - time[0])


@dataclass(frozen=True)
class TrackingMetrics:
    """The response at the input's frequency and the error."""

    amplitude_ratio: float  # fundamental of the response over the input's amplitude
    phase_lag: float  # degrees, positive where the response is late
    error_rms: float  # in the steady state
    error_max: float  # in the steady state
    transient_error_rms: float  # in the transient

    def as_metrics(self, prefix: str, unit: str) -> dict[str, Metric]:
        """Return the values as metrics named ``<prefix>.<name>``."""
        units = {"amplitude_ratio": "", "phase_lag": "deg"}
        return {
            f"{prefix}.{name}": Metric(value=value, unit=units.get(name, unit))
            for name, value in vars(self).items()
        }


def tracking_metrics(
    time: Array,
    desired: Array,
    response: Array,
    *,
    frequency: float,
    transient: float,
    steady: float,
) -> TrackingMetrics:
    """Measure how a response follows ``desired``, a sinusoid of ``frequency`` rad/s.

    The transient is what comes before ``transient`` s, the steady state what comes from
    ``steady`` s on. The fundamental is fitted to the latter by least squares, with an offset.

    Raises:
        ParameterError: If the steady state is shorter than a quarter of a period.
    """
    settled = time >= time[0] + steady
    after = time[settled]
    if len(after) < 8 or (after[-1] - after[0]) * frequency < np.pi / 2:
        raise ParameterError(
            "duration", float(time[-1]), f"more than {steady + np.pi / 2 / frequency:g} s"
        )
    wave = frequency * after
    basis = np.column_stack([np.sin(wave), np.cos(wave), np.ones_like(wave)])
    fit, *_ = np.linalg.lstsq(
        basis, np.column_stack([desired[settled], response[settled]]), rcond=None
    )
    phasors = fit[0] + 1j * fit[1]
    ratio = phasors[1] / phasors[0]
    error = desired - response
    return TrackingMetrics(
        amplitude_ratio=float(abs(ratio)),
        phase_lag=float(-np.degrees(np.angle(ratio))),
        error_rms=_rms(error[settled]),
        error_max=float(np.abs(error[settled]).max()),
        transient_error_rms=_rms(error[time < time[0] + transient]),
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
