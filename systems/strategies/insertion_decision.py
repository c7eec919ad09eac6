"""The decision to insert: the measured errors with their uncertainty, and the wedging limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.models.validation import ParameterError, require_one_of, require_positive

Array = NDArray[np.float64]

DecisionKind = Literal["margin", "wait", "at_once"]

_MOST_FRAMES: Final = 1000
SURE: Final = 2.0  # standard deviations, of a frame's errors, that count as their uncertainty
_LOOKS: Final = 201  # lateral errors at which a region's tilts are known


@dataclass(frozen=True, kw_only=True)
class DecisionParams:
    """Parameters of the decision to insert."""

    kind: DecisionKind = "margin"
    # margin: as soon as the errors are small enough; wait: after the time of the compensation,
    # whatever the errors are, as in section 5; at_once: with the first frame
    margin: float = 0.3
    # of the region, least distance of the errors with their uncertainty; assumed
    frames: int = 8  # over which errors are averaged and their spread is measured; assumed
    timeout: float = 8.0  # s, of aligning, after which it has failed; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(DecisionKind))
        require_positive(self, "timeout")
        if not self.margin < 1:
            raise ParameterError("margin", self.margin, "a number < 1")
        if not 2 <= self.frames <= _MOST_FRAMES:
            raise ParameterError("frames", self.frames, f"2 to {_MOST_FRAMES}")


class MeasuredErrors(NamedTuple):
    """Errors of alignment over some frames, with their uncertainty."""

    lateral: float  # m, distance of the tip from the hole's axis
    rotational: float  # rad, angle between the axes
    lateral_uncertainty: float  # m
    rotational_uncertainty: float  # rad


def measured_errors(frames: Sequence[Sequence[float]], pixel_size: float) -> MeasuredErrors:
    """Return the mean errors and twice their standard deviation over frames, at least one.

    Errors that still change increase the spread. Each of the ``frames`` has the errors
    along Y and Z, pixels, and about Y and Z, rad; ``pixel_size`` is in m.
    """
    n = len(frames)
    means, variances = [], []
    for values in zip(*frames, strict=True):
        mean = math.fsum(values) / n
        means.append(mean)
        squares = math.fsum((value - mean) ** 2 for value in values)
        variances.append(squares / (n - 1) if n > 1 else 0.0)
    y, z, pitch, yaw = means
    return MeasuredErrors(
        pixel_size * math.hypot(y, z),
        math.hypot(pitch, yaw),
        SURE * pixel_size * math.sqrt(variances[0] + variances[1]),
        SURE * math.sqrt(variances[2] + variances[3]),
    )


class InsertionRegion:
    """The errors with which a peg finds its hole and does not wedge in it.

    The planes of the lateral error and of the tilt, and their signs, are the worst ones. The
    parts are the believed ones; the support holds the peg against the hole.
    """

    def __init__(self, parts: PegHoleGeometry, support: Support) -> None:
        self.lateral_limit = parts.chamfer_limit
        self.rotation_limit = parts.rotation_limit
        self.lateral = np.linspace(0.0, parts.chamfer_limit, _LOOKS)
        lower, upper = rotation_bounds(parts, support, self.lateral)
        self.tilt = np.minimum(upper, -lower)

    def tilt_at(self, lateral: float) -> float:
        """Return the largest tilt, rad, for a lateral error, m."""
        return float(self.tilts_at(np.array(lateral)))

    def tilts_at(self, lateral: Array) -> Array:
        """Return the same of many errors at once."""
        return np.interp(lateral, self.lateral, self.tilt)

    def margin(self, lateral: float, rotational: float) -> float:
        """Return the distance to the limits, as a share of them; below zero outside; m and rad."""
        return float(self.margins(np.array(lateral), np.array(rotational)))

    def margins(self, lateral: Array, rotational: Array) -> Array:
        """Return the same of many errors at once, of one shape."""
        tilt = (self.tilts_at(lateral) - rotational) / self.rotation_limit
        return np.minimum(1 - lateral / self.lateral_limit, tilt)

    def sure_margin(self, errors: MeasuredErrors) -> float:
        """Return the margin of the largest errors within their uncertainty."""
        return self.margin(
            errors.lateral + errors.lateral_uncertainty,
            errors.rotational + errors.rotational_uncertainty,
        )
