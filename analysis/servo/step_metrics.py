"""What an engineer reads off a step response."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Metric

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


def step_metrics(
    time: NDArray[np.float64], response: NDArray[np.float64], reference: float
) -> StepMetrics:
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
    rising = [_first_crossing(time, scaled, level) for level in (0.1, 0.9)]
    low, high = rising
    return StepMetrics(
        final=final,
        rise_time=None if low is None or high is None else high - low,
        overshoot=100.0 * max(0.0, float(scaled.max()) - 1.0) if final != 0 else None,
        settling_time=_settling_time(time, scaled, band=0.02),
        steady_state_error=reference - final,
        error_max=float(np.abs(reference - end).max()),
        ripple=100.0 * float(np.ptp(end)) / abs(final) if final != 0 else None,
    )


def as_metrics(prefix: str, measured: StepMetrics, unit: str) -> dict[str, Metric]:
    """Return the figures of merit as metrics named ``<prefix>.<name>``."""
    never = "the response does not cross or stay within the levels during the run"
    fields = {
        "rise_time": (measured.rise_time, "s"),
        "overshoot": (measured.overshoot, "%"),
        "settling_time": (measured.settling_time, "s"),
        "steady_state_error": (measured.steady_state_error, unit),
        "error_max": (measured.error_max, unit),
        "ripple": (measured.ripple, "%"),
    }
    return {
        f"{prefix}.{name}": Metric(value=value, unit=unit, note=never if value is None else "")
        for name, (value, unit) in fields.items()
    }


def _first_crossing(
    time: NDArray[np.float64], scaled: NDArray[np.float64], level: float
) -> float | None:
    above = np.flatnonzero(scaled >= level)
    if len(above) == 0:
        return None
    i = int(above[0])
    if i == 0:
        return float(time[0])
    part = (level - scaled[i - 1]) / (scaled[i] - scaled[i - 1])
    return float(time[i - 1] + part * (time[i] - time[i - 1]))


def _settling_time(
    time: NDArray[np.float64], scaled: NDArray[np.float64], *, band: float
) -> float | None:
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
