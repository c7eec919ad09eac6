"""Metrics of an estimate of a surface's normal, and of a force along it."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import Quantity
from chamfer.analysis.contact.contact_metrics import longest, settling_time
from chamfer.analysis.scenario.experiment import Table
from chamfer.models.surfaces.damage import SCRATCH_FORCE

Array = NDArray[np.float64]

DEVIATIONS: Final = 3.0  # standard deviations, calibrated on Figs. 5-3 to 5-6
TELLS: Final = 90.0  # deg, a wider band holds every normal that a contact may have
TOLERANCE: Final = 0.1  # of the desired force, section 5.3.4
_SETTLED: Final = 0.05  # of the desired force
_DIGITS: Final = 9  # of a degree; less is rounding
_EQUILIBRIUM: Final = (8.0, 14.9)  # s
_MEAN: Final = (1.0, 15.0)  # s
_ERRORS: Final = (2.0, 15.0)  # s
_LARGEST_ERROR: Final = (0.55, 14.97)  # s
FORCE_FROM: Final = 1.0  # s, section 5.3.4; then it has settled

_OF_ERRORS: Final = {
    "error.max": Quantity("deg"),
    "error.rms": Quantity("deg", "rms"),
    "error.bias": Quantity("deg"),
    "coverage": Quantity("%"),
    "nees": Quantity(""),
}
ESTIMATION: Final = {
    "band.equilibrium": Quantity("deg"),
    "band.mean": Quantity("deg"),
    "band.final": Quantity("deg"),
    **_OF_ERRORS,
    "estimate.change": Quantity("deg"),
    "breakaway_time": Quantity("s"),
    "drift_after_halt": Quantity("deg", "rms"),
    "band_after_halt": Quantity("deg"),
}
TRACKING: Final = {
    "force.min": Quantity("N"),
    "force.max": Quantity("N"),
    "force.final": Quantity("N"),
    "force.settling_time": Quantity("s"),
    "force.settling_time_10": Quantity("s"),
    "force.within_10": Quantity("%"),
    "contact.losses": Quantity(""),
    "damage.scratch_time": Quantity("s"),
    "position.travel": Quantity("m"),
    "band.mean": Quantity("deg"),
    **_OF_ERRORS,
}


def angle_between(estimate: Array, truth: Array) -> Array:
    """Return the angle from true to estimated unit normals, deg, shape (n,).

    It has a sign in the plane, counter-clockwise; in space it is not negative. NaN where there is
    no true normal (zeros).

    Args:
        estimate: Shape (n, d).
        truth: Shape (n, d).
    """
    along = np.sum(estimate * truth, axis=1)
    if estimate.shape[1] == 2:
        across = truth[:, 0] * estimate[:, 1] - truth[:, 1] * estimate[:, 0]
    else:
        across = np.linalg.norm(np.cross(truth, estimate), axis=1)
    known = np.any(truth != 0.0, axis=1)
    return np.where(known, np.degrees(np.arctan2(across, along)), np.nan)


def normalised_square(estimate: Array, truth: Array, covariance: Array) -> Array:
    """Return the normalised estimation error squared over its degrees of freedom, shape (n,).

    It is 1 on average where the covariance is that of the errors (Bar-Shalom, Li and Kirubarajan,
    Estimation with Applications to Tracking and Navigation, 2001, section 5.4). NaN where there is
    no true normal, and where the covariance is none.

    Args:
        estimate: Unit normals, shape (n, d).
        truth: Unit normals, or zeros, shape (n, d).
        covariance: Of the estimate, shape (n, d, d), rad^2; its part in the tangent plane counts.
    """
    angle = np.radians(np.abs(angle_between(estimate, truth)))
    tangents = np.linalg.svd(estimate[:, None, :])[2][:, 1:]  # (n, d - 1, d)
    across = np.einsum("nij,nj->ni", tangents, truth)
    length = np.linalg.norm(across, axis=1)
    error = across * np.divide(angle, length, out=np.zeros_like(length), where=length > 0)[:, None]
    spread = tangents @ covariance @ np.swapaxes(tangents, 1, 2)
    certain = np.linalg.det(spread) <= 0.0
    spread[certain] = np.eye(estimate.shape[1] - 1)
    square = np.einsum("ni,ni->n", error, np.linalg.solve(spread, error[..., None])[..., 0])
    return np.where(certain | np.isnan(angle), np.nan, square / (estimate.shape[1] - 1))


def estimation_metrics(traces: Table, *, halt: float) -> dict[str, float | None]:
    """Measure an estimate along a path; a value is None where it is undefined.

    Args:
        traces: ``time`` s; ``error`` and ``band`` deg and ``nees``, a row per sample of the
            observer; ``change`` deg, from the first estimate; ``speed`` m/s, of the contact point;
            ``normal_x`` and so on, the estimate.
        halt: s, when the gripper halts.
    """
    time, band, change = traces["time"], traces["band"], traces["change"]
    values: dict[str, float | None] = dict.fromkeys(ESTIMATION)
    values |= errors(traces, _until(_ERRORS, halt), largest=_until(_LARGEST_ERROR, halt))
    values["band.equilibrium"] = _mean(band, _within(time, _until(_EQUILIBRIUM, halt)))
    values["band.mean"] = _mean(band, _within(time, _until(_MEAN, halt)))
    values["band.final"] = float(band[-1])
    values["estimate.change"] = float(np.max(np.abs(change)))
    touching = np.isfinite(traces["error"])
    slides = np.flatnonzero((traces["speed"] > 0) & touching)
    values["breakaway_time"] = float(time[slides[0]]) if len(slides) else None
    after = np.flatnonzero(time > halt - 1e-9)
    if len(after) > 1:
        first = after[0]
        axes = [traces[name] for name in ("normal_x", "normal_y", "normal_z") if name in traces]
        normals = np.stack(axes, axis=1)
        drift = angle_between(normals[-1:], normals[first : first + 1])
        values["drift_after_halt"] = float(drift[0])
        values["band_after_halt"] = float(band[-1] - band[first])
    return values


def tracking_metrics(traces: Table, *, force: float, every: int) -> dict[str, float | None]:
    """Measure control along a surface; a value is None where it is undefined.

    Args:
        traces: ``time`` s; ``force`` N, the true normal force; ``error`` and ``band`` deg and
            ``nees``; ``travel`` m, of the contact point along x.
        force: N, desired.
        every: The observer's samples are each so many rows.
    """
    time, push = traces["time"], traces["force"]
    values: dict[str, float | None] = dict.fromkeys(TRACKING)
    window = (FORCE_FROM, math.inf)
    sampled = {name: traces[name][::every] for name in ("time", "error", "band", "nees")}
    values |= errors(sampled, window, largest=window)
    values["band.mean"] = _mean(sampled["band"], _within(sampled["time"], window))
    inside = _within(time, window)
    if np.any(inside):
        values |= held(push[inside], force)
    values["force.final"] = float(push[-1])
    values["force.settling_time"] = settling_time(time, push, force, _SETTLED * force)
    values["force.settling_time_10"] = settling_time(time, push, force, TOLERANCE * force)
    values["contact.losses"] = float(np.sum((push[1:] <= 0) & (push[:-1] > 0)))
    values["damage.scratch_time"] = longest(time, push > SCRATCH_FORCE)
    values["position.travel"] = float(traces["travel"][-1])
    return values


def held(push: Array, force: float) -> dict[str, float | None]:
    """Return a force's least and largest, N, and whether all is within 10 % of the desired, %."""
    low, high = float(push.min()), float(push.max())
    within = max(high - force, force - low) <= TOLERANCE * force
    return {"force.min": low, "force.max": high, "force.within_10": 100.0 if within else 0.0}


def errors(
    traces: Table, window: tuple[float, float], *, largest: tuple[float, float]
) -> dict[str, float | None]:
    """Return statistics of the errors in a window, and the largest error in another.

    They are rms, bias, coverage of the band and mean normalised square. A band without
    information covers nothing.

    Args:
        traces: ``time`` s; ``error`` and ``band`` deg and ``nees``, as
            :func:`normalised_square`; NaN where there is no true normal.
        window: s, from and up to.
        largest: s, from and up to.
    """
    time, error, band = traces["time"], traces["error"], traces["band"]
    known = np.isfinite(error)
    values: dict[str, float | None] = {}
    rows = known & _within(time, largest)
    largest_error = float(np.max(np.abs(error[rows]), initial=0.0))
    values["error.max"] = round(largest_error, _DIGITS) if np.any(rows) else None
    rows = known & _within(time, window)
    some = bool(np.any(rows))
    values["error.rms"] = math.sqrt(float(np.mean(error[rows] ** 2))) if some else None
    values["error.bias"] = float(np.mean(error[rows])) if some else None
    covered = np.abs(error[rows]) <= band[rows] + 1e-9  # what is exact has no band
    covered &= band[rows] < TELLS
    values["coverage"] = 100 * float(np.mean(covered)) if some else None
    squares = traces["nees"][rows]
    squares = squares[np.isfinite(squares)]
    values["nees"] = float(np.mean(squares)) if len(squares) else None
    return values


def _until(window: tuple[float, float], end: float) -> tuple[float, float]:
    return window[0], min(window[1], end)


def _within(time: Array, window: tuple[float, float]) -> NDArray[np.bool_]:
    # Rounding of sample times must not decide.
    return np.asarray((time > window[0] - 1e-9) & (time < window[1] - 1e-9))


def _mean(values: Array, rows: NDArray[np.bool_]) -> float | None:
    return round(float(values[rows].mean()), _DIGITS) if np.any(rows) else None
