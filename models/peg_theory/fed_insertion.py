"""The planar theory of a peg fed without cameras: it goes in, may go in, or does not.

Arguments are those of :mod:`chamfer.models.peg_theory.wedging`; ``support_at`` and ``push_at``
take the depth of the tip below the mouth, m, as ``depth`` is here too.

The support is that of the arms in series, which softens as the parts slide into each other: the
statics take it at every depth, the limits to wedging at the depth at which a peg wedges first.
"""

from collections.abc import Callable
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import assembles, sits_on_edge, two_point_onset

Array = NDArray[np.float64]
SupportAt = Callable[[float], Support]  # from the depth of the tip below the mouth, m
PushAt = Callable[[Array], Array]  # N, likewise

_FORCES: Final = 41  # depths at which forces are computed
_ONSETS: Final = 21  # depths for whose support the onset of two points is


class FeedVerdict(IntEnum):
    """The prediction of the theory."""

    SAFE = 0  # it goes in
    MAY = 1  # it may wedge, or sit on the bore's edge
    STOPPED = 2  # it misses the mouth, or no push that there is slides it


class Limits(NamedTuple):
    """The planar limits of several starts, each field of their shape."""

    inside: NDArray[np.bool_]  # on the chamfers, free of wedging, and a push slides it
    on_edge: NDArray[np.bool_]  # the rim may sit on the bore's edge
    misses: NDArray[np.bool_]  # the tip lands beside the mouth

    @property
    def verdict(self) -> NDArray[np.int64]:
        """The :class:`FeedVerdict` with a sufficient push."""
        safe = self.inside & ~self.on_edge
        found = np.where(safe, FeedVerdict.SAFE, FeedVerdict.MAY)
        return np.where(self.misses, FeedVerdict.STOPPED, found).astype(np.int64)


class FeedPrediction(NamedTuple):
    """The prediction of the theory for several starts, each field of their shape."""

    verdict: NDArray[np.int64]  # of :class:`FeedVerdict`
    limits: Limits
    axial: Array  # N, the largest push that slides the peg down to the depth; infinite: none does
    onset: Array  # l, m, at which two points touch first; NaN: they do not

    @property
    def may_wedge(self) -> NDArray[np.bool_]:
        """Whether two points may hold the peg, or no push slide it."""
        return ~self.limits.inside & ~self.limits.misses


def limits(
    parts: PegHoleGeometry, support_at: SupportAt, lateral: ArrayLike, tilt: ArrayLike
) -> Limits:
    """Return the limits to wedging, sliding, the chamfers' reach and the edge."""
    eps0 = np.asarray(lateral, dtype=np.float64)
    theta0 = np.asarray(tilt, dtype=np.float64)
    at_wedging = support_at(parts.wedging_depth + parts.chamfer_height)
    return Limits(
        inside=np.asarray(assembles(parts, at_wedging, eps0, theta0)),
        on_edge=sits_on_edge(parts, eps0, theta0),
        misses=np.abs(eps0) >= _reach(parts, theta0),
    )


def predict_feed(
    parts: PegHoleGeometry,
    support_at: SupportAt,
    push_at: PushAt,
    lateral: ArrayLike,
    tilt: ArrayLike,
    *,
    depth: float,
) -> FeedPrediction:
    """Predict the outcome of pegs with errors in one plane.

    Safe is a start that is on the chamfers and inside the limits to wedging and sliding, whose
    rim can't sit on the bore's edge, and which needs less push than there is. Stopped is one that
    lands beside the mouth, or needs more. The theory knows neither friction in the support's own
    joints nor what happens across its plane.
    """
    eps0, theta0 = np.broadcast_arrays(
        np.asarray(lateral, dtype=np.float64), np.asarray(tilt, dtype=np.float64)
    )
    within = limits(parts, support_at, eps0, theta0)
    axial, enough = _forces(parts, support_at, push_at, eps0, theta0, depth)
    onset = _onset(parts, support_at, eps0, theta0, depth)
    return FeedPrediction(
        verdict=np.where(enough, within.verdict, FeedVerdict.STOPPED).astype(np.int64),
        limits=within,
        axial=np.where(within.misses, np.inf, axial),
        onset=np.where(within.misses, np.nan, onset),
    )


def largest_push(
    parts: PegHoleGeometry,
    support_at: SupportAt,
    lateral: ArrayLike,
    tilt: ArrayLike,
    *,
    depth: float,
    looks: int = 9,
) -> Array:
    """Return the largest push that slides pegs down to a depth, N; infinite: none does."""
    eps0, theta0 = np.broadcast_arrays(
        np.asarray(lateral, dtype=np.float64), np.asarray(tilt, dtype=np.float64)
    )
    return _forces(parts, support_at, None, eps0, theta0, depth, looks)[0]


def _reach(parts: PegHoleGeometry, theta0: Array) -> Array:
    """Return the lateral error, m, at which the corner of a tilted tip meets the face."""
    tip = parts.peg_radius - parts.peg_chamfer.width
    reach: Array = parts.chamfer_limit + tip * (1 - np.cos(theta0))
    return reach


def _forces(
    parts: PegHoleGeometry,
    support_at: SupportAt,
    push_at: PushAt | None,
    eps0: Array,
    theta0: Array,
    depth: float,
    looks: int = _FORCES,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the largest push on the way, N, and whether there is more all along."""
    largest, enough = np.zeros_like(eps0), np.ones(eps0.shape, dtype=bool)
    for tip in np.linspace(0.0, depth, looks)[1:].tolist():
        found = equilibrium(parts, support_at(tip), eps0, theta0, tip - parts.chamfer_height)
        force = found.insertion_force
        largest = np.maximum(largest, force)
        if push_at is not None:
            enough &= force < push_at(np.array(tip))
    return largest, enough


def _onset(
    parts: PegHoleGeometry, support_at: SupportAt, eps0: Array, theta0: Array, depth: float
) -> Array:
    """Return the depth l, m, at which two points touch on the support that is there.

    That is where the onset for the support at a depth is this depth; in between it is a line.
    """
    depths = np.linspace(0.0, depth - parts.chamfer_height, _ONSETS)
    found = np.full(eps0.shape, np.nan)
    before = np.full(eps0.shape, np.inf)
    for k, at in enumerate(depths.tolist()):
        support = support_at(at + parts.chamfer_height)
        beyond = two_point_onset(parts, support, eps0, theta0) - at
        beyond = np.where(np.isnan(beyond), np.inf, beyond)
        first = np.isnan(found) & (beyond <= 0)
        if k:
            step = depths[k] - depths[k - 1]
            with np.errstate(invalid="ignore"):
                there = depths[k - 1] + step * before / (before - beyond)
            found = np.where(first, np.where(np.isinf(before), at, there), found)
        before = beyond
    return found
