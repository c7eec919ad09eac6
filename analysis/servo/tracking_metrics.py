"""How well a loop follows a sinusoid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Metric
from chamfer.models.validation import ParameterError


@dataclass(frozen=True)
class TrackingMetrics:
    """The response at the input's frequency and the error."""

    amplitude_ratio: float  # fundamental of the response over the input's amplitude
    phase_lag: float  # degrees, positive where the response is late
    error_rms: float  # in the steady state
    error_max: float  # in the steady state
    transient_error_rms: float  # in the transient


def tracking_metrics(
    time: NDArray[np.float64],
    desired: NDArray[np.float64],
    response: NDArray[np.float64],
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


def as_metrics(prefix: str, measured: TrackingMetrics, unit: str) -> dict[str, Metric]:
    """Return the measured values as metrics named ``<prefix>.<name>``."""
    return {
        f"{prefix}.amplitude_ratio": Metric(value=measured.amplitude_ratio, unit=""),
        f"{prefix}.phase_lag": Metric(value=measured.phase_lag, unit="deg"),
        f"{prefix}.error_rms": Metric(value=measured.error_rms, unit=unit),
        f"{prefix}.error_max": Metric(value=measured.error_max, unit=unit),
        f"{prefix}.transient_error_rms": Metric(value=measured.transient_error_rms, unit=unit),
    }


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))
