"""Metrics of a run in contact, and of its loop's stability."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import Quantity
from chamfer.analysis.scenario.experiment import Metric, Table
from chamfer.diagrams.contact.hybrid_loop_stability import Stability
from chamfer.models.surfaces.damage import SAFE_SPEED, SCRATCH_FORCE
from chamfer.systems.force.contact_detection_law import CONTACT, LOST
from chamfer.systems.force.sampled_loop import NEUTRAL

Array = NDArray[np.float64]

BAND = 0.05  # of the desired force: within it the force has settled
_BLOW: Final = 0.1  # s, in which a blow takes the tip off
KEPT: Final = {
    "contact.losses": Quantity(""),  # of true contact, but for that by a blow
    "contact.losses_seen": Quantity(""),  # by contact detection, all
    "contact.share": Quantity("%"),
    "contact.settled_share": Quantity("%"),
}
QUANTITIES: Final = {
    "contact_time": Quantity("s"),
    "force.final": Quantity("N"),
    "force.peak": Quantity("N"),
    "force.deviation": Quantity("N"),  # of what is measured, as the papers' are
    "force.true_deviation": Quantity("N"),
    "force.above": Quantity("N"),
    "force.below": Quantity("N"),
    "force.min": Quantity("N"),
    "force.settling_time": Quantity("s"),
    "position.lag_error": Quantity("m"),
    "impact.speed": Quantity("m/s"),
    "recontact.speed": Quantity("m/s"),
    **KEPT,
    "damage.scratch_time": Quantity("s"),
    "damage.impact_share": Quantity("%"),
    "damage.safe_speed_share": Quantity("%"),
}


def contact_metrics(
    traces: Table,
    *,
    force: float,
    after: float,
    period: float | None,
    kick: float | None,
    impact_limit: float,
) -> dict[str, float | None]:
    """Measure a run; a value is None where it is undefined.

    Args:
        traces: ``time`` s, ``mode``, ``force`` and ``measured_force`` N (the push), ``peak_force``
            N, ``impact_speed`` m/s, ``position_error`` m (along the motion); shape (n,) each.
        force: N, desired.
        after: s, deviations and errors are measured from then on.
        period: s, of the motion: the final force is the mean over the last one, or as much of it
            as is measured. None: over the last second.
        kick: s, of a blow that takes the tip off.
        impact_limit: m/s, from which on an impact damages.
    """
    time, mode = traces["time"], traces["mode"]
    touching = np.flatnonzero(mode > 0)
    impacts = traces["impact_speed"][traces["impact_speed"] > 0]
    values: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    values["force.peak"] = float(traces["peak_force"].max())
    values |= contact_kept(traces, after, kick)
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
    end &= window
    if len(touching) and np.any(window):
        push = traces["measured_force"][window]
        values["force.final"] = float(traces["measured_force"][end].mean())
        values["force.above"] = float(push.max()) - force
        values["force.below"] = float(push.min()) - force
        values["force.deviation"] = float(np.abs(push - force).max())
        values["force.true_deviation"] = float(np.abs(traces["force"][window] - force).max())
        values["force.min"] = float(push.min())
        error = float(np.abs(traces["position_error"][window]).max())
        values["position.lag_error"] = round(error, 12)  # less is rounding
    return values


def contact_kept(traces: Table, after: float, kick: float | None) -> dict[str, float | None]:
    """Measure the share of contact from the first touch on; None without one.

    A loss by a blow, until the next touch, is planned and does not count. A loss without a return,
    and bounces before and after, do. ``contact.losses`` are those of true contact, also
    within a row; ``contact.share`` is that of the rows with a true force above 0 and
    ``contact.settled_share`` the same from ``after`` on, %.

    Args:
        traces: ``time`` s, ``mode``, ``force`` N, ``impact_speed`` m/s; shape (n,) each.
        after: s.
        kick: s, of the blow; None: none.
    """
    time, mode = traces["time"], traces["mode"]
    touching, hits = traces["force"] > 0, traces["impact_speed"] > 0
    values: dict[str, float | None] = dict.fromkeys(KEPT)
    values["contact.losses_seen"] = float(np.sum((mode[1:] == LOST) & (mode[:-1] == CONTACT)))
    counted = np.logical_or.accumulate(touching | hits)
    if not counted.any():
        return values
    if kick is not None:
        off = np.flatnonzero(~touching & (time >= kick) & (time <= kick + _BLOW))
        back = np.flatnonzero(touching[off[0] :]) if len(off) else off
        if len(back):
            counted[off[0] : off[0] + back[0]] = False
    lost = counted & ~touching
    again = counted[1:] & touching[1:] & touching[:-1] & hits[1:]
    values["contact.losses"] = float(lost[0] + np.sum(lost[1:] & ~lost[:-1]) + np.sum(again))
    values["contact.share"] = 100 * float(touching[counted].mean())
    if np.any(counted & (time >= after)):
        values["contact.settled_share"] = 100 * float(touching[counted & (time >= after)].mean())
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


def stability_metrics(found: Stability) -> dict[str, Metric]:
    """Return growth and margins of the linear loop, the worst of its modes."""
    metrics = (
        {} if found.growth is None else {"loop.growth": _growth_metric(found.growth, "out of")}
    )
    gain = f"on the torque; {found.least_gain}" if found.least_gain else "none up to 1000"
    delay = f"of the torque; {found.least_delay}" if found.least_delay else "none up to 10 periods"
    return metrics | {
        "loop.growth_contact": _growth_metric(found.growth_contact, "in"),
        "loop.gain_margin": Metric(value=found.gain_margin, unit="", note=gain),
        "loop.delay_margin": Metric(value=found.delay_margin, unit="s", note=delay),
    }


def _growth_metric(growth: float, where: str) -> Metric:
    stable = growth <= NEUTRAL
    note = "" if stable else f"unstable {where} contact, run by controller.allow_unstable"
    return Metric(value=0.0 if stable else growth, unit="1/s", note=note)


def mean_over_seeds(values: np.ndarray, unit: str, undefined: str) -> Metric:
    """Return a measured value's mean and range, or the reason if one is not finite."""
    if not np.all(np.isfinite(values)):
        return Metric(value=None, unit=unit, note=undefined)
    note = f"mean of {len(values)} seeds, {values.min():.4g} to {values.max():.4g}"
    return Metric(value=float(values.mean()), unit=unit, note=note)
