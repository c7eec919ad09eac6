"""What an engineer reads off a run in contact: forces, errors, impacts and damage."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.experiment import Metric, Table
from models.damage import SAFE_SPEED, SCRATCH_FORCE

Array = NDArray[np.float64]

BAND = 0.05  # of the desired force: within it the force has settled
_UNITS = {
    "contact_time": "s",
    "force.final": "N",
    "force.peak": "N",
    "force.deviation": "N",
    "force.above": "N",
    "force.below": "N",
    "force.min": "N",
    "force.settling_time": "s",
    "position.lag_error": "m",
    "impact.speed": "m/s",
    "recontact.speed": "m/s",
    "contact.losses": "",
    "damage.scratch_time": "s",
    "damage.impact_share": "%",
    "damage.safe_speed_share": "%",
}


def contact_metrics(
    traces: Table,
    *,
    force: float,
    after: float,
    period: float | None,
    impact_limit: float,
) -> dict[str, float | None]:
    """Measure a run; a value is None where it is undefined.

    Args:
        traces: ``time`` s, ``mode``, ``force`` and ``measured_force`` N (the push), ``peak_force``
            N, ``impact_speed`` m/s, ``position_error`` m (along the motion); shape (n,) each.
        force: N, desired.
        after: s, deviations and errors are measured from then on.
        period: s, of the motion: the final force is the mean over the last one. None: over the
            last second.
        impact_limit: m/s, from which on an impact damages.
    """
    time, mode = traces["time"], traces["mode"]
    touching = np.flatnonzero(mode > 0)
    impacts = traces["impact_speed"][traces["impact_speed"] > 0]
    values: dict[str, float | None] = dict.fromkeys(_UNITS)
    values["force.peak"] = float(traces["peak_force"].max())
    values["contact.losses"] = float(np.sum((mode[1:] == 2) & (mode[:-1] == 1)))
    values["impact.speed"] = float(impacts[0]) if len(impacts) else None
    values["recontact.speed"] = float(impacts[1:].max()) if len(impacts) > 1 else None
    values["damage.scratch_time"] = longest(time, traces["force"] > SCRATCH_FORCE)
    if len(impacts):
        values["damage.impact_share"] = 100 * float(impacts.max()) / impact_limit
        values["damage.safe_speed_share"] = 100 * float(impacts.max()) / SAFE_SPEED
    if len(touching):
        contact_time = float(time[touching[0]])
        values["contact_time"] = contact_time
        values["force.settling_time"] = settling_time(
            time - contact_time, traces["force"], force, BAND * force, lasting=period or 0.0
        )
    window = time >= after
    end = time > time[-1] - (period or 1.0)
    end[-1] = True  # however short the period
    if len(touching) and np.any(window):
        push = traces["measured_force"][window]
        values["force.final"] = float(traces["measured_force"][end].mean())
        values["force.above"] = float(push.max()) - force
        values["force.below"] = float(push.min()) - force
        values["force.deviation"] = float(np.abs(push - force).max())
        values["force.min"] = float(push.min())
        error = float(np.abs(traces["position_error"][window]).max())
        values["position.lag_error"] = round(error, 12)  # less is rounding
    return values


def settling_time(
    time: Array, values: Array, target: float, band: float, *, lasting: float = 0.0
) -> float | None:
    """Return the time after which values stay within a band, or None if they do not.

    To the sample; None also if they come into the band only in the last tenth of the run, or so
    late that they stay there for less than ``lasting`` seconds.
    """
    outside = np.flatnonzero(~(np.abs(values - target) <= band))
    last = int(outside[-1]) + 1 if len(outside) else 0
    shown = max(lasting, 0.1 * (time[-1] - time[0]))
    if last >= len(time) or time[last] > time[-1] - shown:
        return None
    return max(0.0, float(time[last]))


def longest(time: Array, holds: NDArray[np.bool_]) -> float:
    """Return the longest time for which something holds without a break, s."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(np.int8)))
    begins, ends = edges[::2], np.minimum(edges[1::2], len(time) - 1)
    return float(np.max(time[ends] - time[begins], initial=0.0))


def as_metrics(trials: Sequence[Mapping[str, float | None]]) -> dict[str, Metric]:
    """Return the mean of each metric over trials, and its range if there are several."""
    return {name: _metric([trial[name] for trial in trials], _UNITS[name]) for name in _UNITS}


def _metric(values: Sequence[float | None], unit: str) -> Metric:
    known = [value for value in values if value is not None]
    if not known:
        return Metric(value=None, unit=unit, note="does not occur, or settle, in the run")
    notes = []
    if len(values) > 1:
        notes.append(f"mean of {len(known)} seeds, {min(known):.4g} to {max(known):.4g}")
    if len(known) < len(values):
        notes.append(f"undefined in {len(values) - len(known)}")
    return Metric(value=math.fsum(known) / len(known), unit=unit, note=", ".join(notes))
