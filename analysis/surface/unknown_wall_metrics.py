"""What an engineer reads off a run along an unknown wall: contact, force, normal, loss, return."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import Quantity
from chamfer.analysis.contact.contact_metrics import settling_time
from chamfer.analysis.scenario.experiment import Table
from chamfer.analysis.surface.normal_metrics import TELLS, TOLERANCE
from chamfer.models.surfaces.damage import SAFE_SPEED
from chamfer.systems.force.contact_detection import CONTACT, LOST

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]

RECOVERY: Final = 1.0  # s, after contact is made again; within it Fig. 5-8 has settled
QUANTITIES: Final = {
    "contact_time": Quantity("s"),
    "impact.speed": Quantity("m/s"),
    "force.peak": Quantity("N"),
    "force.settling_time_10": Quantity("s"),
    "force.min": Quantity("N"),
    "force.max": Quantity("N"),
    "force.within_10": Quantity("%"),
    "force.final": Quantity("N"),
    "error.start": Quantity("deg"),
    "error.rms": Quantity("deg", "rms"),
    "error.max": Quantity("deg"),
    "band.mean": Quantity("deg"),
    "coverage": Quantity("%"),
    "contact.losses": Quantity(""),
    "loss.duration": Quantity("s"),
    "recontact.speed": Quantity("m/s"),
    "recontact.settling_time_10": Quantity("s"),
    "wall.smallest_radius": Quantity("m"),
    "position.travel": Quantity("m"),
    "damage.impact_share": Quantity("%"),
    "damage.safe_speed_share": Quantity("%"),
}


def wall_metrics(
    traces: Table, *, force: float, after: float, kick: float | None, impact_limit: float
) -> dict[str, float | None]:
    """Measure a run; a value is None where it is undefined.

    Forces and errors count from ``after`` on, but for the time from a blow until
    :data:`RECOVERY` after the return; a contact that is lost without a blow counts.

    Args:
        traces: ``time`` s, ``mode``, ``force`` N (the true normal one), ``error`` and ``band``
            deg, ``curvature`` 1/m, ``travel`` m, ``peak_force`` N, ``impact_speed`` m/s; shape
            (n,) each.
        force: N, desired.
        after: s.
        kick: s, of a blow that takes the tip off the wall.
        impact_limit: m/s, from which on an impact damages.
    """
    time, mode, push = traces["time"], traces["mode"], traces["force"]
    values: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    values["force.peak"] = float(traces["peak_force"].max())
    values["contact.losses"] = float(np.sum((mode[1:] == LOST) & (mode[:-1] == CONTACT)))
    values["error.start"] = float(traces["error"][0])
    values["position.travel"] = float(traces["travel"][-1])
    impacts = traces["impact_speed"][traces["impact_speed"] > 0]
    if len(impacts):
        values["impact.speed"] = float(impacts[0])
        values["damage.impact_share"] = 100 * float(impacts.max()) / impact_limit
        values["damage.safe_speed_share"] = 100 * float(impacts.max()) / SAFE_SPEED
    touching = np.flatnonzero(mode == CONTACT)
    if not len(touching):
        return values
    contact = float(time[touching[0]])
    values["contact_time"] = contact
    back = _return(traces, kick)
    first = (time >= contact) & (time < (math.inf if kick is None else kick))
    values["force.settling_time_10"] = _settled(time, push, first, force)
    counted = time >= after
    if kick is not None:
        late = (kick if back is None else back) + RECOVERY
        counted &= (time < kick) | (time >= late)
    if kick is not None and back is not None:
        blown = (time >= kick) & (traces["impact_speed"] > 0)
        values["loss.duration"] = back - kick
        speeds = traces["impact_speed"][blown]
        values["recontact.speed"] = float(speeds.max()) if len(speeds) else None
        values["recontact.settling_time_10"] = _settled(time, push, time >= back, force)
    if np.any(counted):
        low, high = float(push[counted].min()), float(push[counted].max())
        values["force.min"], values["force.max"] = low, high
        held = max(high - force, force - low) <= TOLERANCE * force
        values["force.within_10"] = 100.0 if held else 0.0
        values["force.final"] = float(push[time > time[-1] - 1.0].mean())
    known = counted & (push > 0)
    if np.any(known):
        sharpest = float(traces["curvature"][known].max())
        values["wall.smallest_radius"] = 1 / sharpest if sharpest > 0 else None
        error, band = traces["error"][known], traces["band"][known]
        values["error.rms"] = math.sqrt(float(np.mean(error**2)))
        values["error.max"] = float(error.max())
        values["band.mean"] = float(band.mean())
        values["coverage"] = 100 * float(np.mean((error <= band) & (band < TELLS)))
    return values


def _return(traces: Table, kick: float | None) -> float | None:
    """Return when contact is made again after a blow, s; None without a blow or a return."""
    if kick is None:
        return None
    time, mode = traces["time"], traces["mode"]
    lost = np.flatnonzero((time >= kick) & (mode == LOST))
    if not len(lost):
        return None
    again = np.flatnonzero((time > time[lost[0]]) & (mode == CONTACT))
    return float(time[again[0]]) if len(again) else None


def _settled(time: Array, push: Array, rows: Rows, force: float) -> float | None:
    """Return how long after the first of some rows the force stays within 10 %."""
    if np.count_nonzero(rows) < 2:
        return None
    return settling_time(time[rows] - time[rows][0], push[rows], force, TOLERANCE * force)
