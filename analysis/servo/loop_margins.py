"""Margins of a linear loop, by python-control."""

import math
import warnings
from dataclasses import dataclass

import control
import numpy as np

from chamfer.analysis.scenario.experiment import Metric


@dataclass(frozen=True)
class Margins:
    """Stability margins; infinite where there is no crossover."""

    gain: float  # factor
    phase: float  # degrees
    delay: float  # s, of more dead time that makes it unstable
    crossover: float  # rad/s, of the gain
    sensitivity_peak: float  # largest |1/(1 + L)|


def loop_margins(loop: "control.StateSpace") -> Margins:
    """Return the margins of a loop, continuous or sampled, that is closed with a minus."""
    fastest = math.pi / loop.dt if loop.dt else 10 * float(np.abs(loop.poles()).max())
    frequencies = np.geomspace(1e-3 * min(1.0, fastest), fastest, 4000)
    # Poles near z = 1 make margin() see crossovers that are not there, so that a sampled loop is
    # given by its response; of a continuous one it evaluates the zero at s = 0, and complains.
    seen = control.frd(loop, frequencies) if loop.dt else loop
    with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
        gain, phase, _, crossover = control.margin(seen)
        _, phases, _, _, crossovers, _ = control.stability_margins(seen, returnall=True)
    delays = np.radians(phases) / crossovers
    response = loop(np.exp(1j * frequencies * loop.dt) if loop.dt else 1j * frequencies)
    return Margins(
        gain=float(gain),
        phase=float(phase),
        delay=float(delays.min()) if len(delays) else math.inf,
        crossover=float(crossover),
        sensitivity_peak=float(np.abs(1 / (1 + response)).max()),
    )


def as_metrics(prefix: str, margins: Margins) -> dict[str, Metric]:
    """Return the margins as metrics named ``<prefix>.<name>``."""

    def metric(value: float, unit: str) -> Metric:
        finite = math.isfinite(value)
        return Metric(
            value=value if finite else None, unit=unit, note="" if finite else "infinite"
        )

    return {
        f"{prefix}.gain_margin": metric(margins.gain, ""),
        f"{prefix}.phase_margin": metric(margins.phase, "deg"),
        f"{prefix}.delay_margin": metric(margins.delay, "s"),
        f"{prefix}.crossover": metric(margins.crossover, "rad/s"),
        f"{prefix}.sensitivity_peak": metric(margins.sensitivity_peak, ""),
    }
