"""Margins of a linear loop, by python-control."""

import math
import warnings
from typing import NamedTuple

import control
import numpy as np

from chamfer.analysis.scenario.experiment import Metric, measured


class Margins(NamedTuple):
    """Stability margins; infinite without a crossover."""

    gain_margin: float  # factor
    phase_margin: float  # degrees
    delay_margin: float  # s, of more dead time that makes it unstable
    crossover: float  # rad/s, of the gain
    sensitivity_peak: float  # largest |1/(1 + L)|

    def as_metrics(self, prefix: str) -> dict[str, Metric]:
        """Return the margins as metrics named ``<prefix>.<name>``."""
        units = ("", "deg", "s", "rad/s", "")
        return {
            f"{prefix}.{name}": measured(value, unit, missing="infinite")
            for name, value, unit in zip(self._fields, self, units, strict=True)
        }


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
        gain_margin=float(gain),
        phase_margin=float(phase),
        delay_margin=float(delays.min()) if len(delays) else math.inf,
        crossover=float(crossover),
        sensitivity_peak=float(np.abs(1 / (1 + response)).max()),
    )
