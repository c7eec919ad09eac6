"""Detections in an image, as values and as the vectors of ports and logs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DETECTION_SIZE: Final = 6  # of one part
DETECTIONS_SIZE: Final = 2 * DETECTION_SIZE  # of the peg, then of the hole part
CROSS_SECTION_SIZE: Final = 8
DETECTION_UNITS: Final = ("", "pixels", "pixels", "rad", "pixels", "pixels")
CROSS_SECTION_UNITS: Final = ("", "pixels", "pixels", "rad", *("pixels",) * 4)


class Status(IntEnum):
    """The detection of a part, or the reason why it was not found."""

    VALID = 0  # tip and axis
    OCCLUDED = 1  # the axis; no background is seen beyond the end, which may not be the part's
    NO_IMAGE = 2  # no frame arrived
    NO_COLOUR = 3  # not enough pixels of the part's colour together
    AT_BORDER = 4  # the image ends before the part does
    NOT_STRAIGHT = 5  # without two long straight edges
    NO_CONTRAST = 6  # the background is too dark or too alike to measure edges
    WRONG_SIZE = 7  # wider or narrower than the part can be
    WRONG_SHAPE = 8  # longer or shorter than the part, or with another end
    SHARED = 9  # its pixels are taken for the other part's, too
    AMBIGUOUS = 10  # more than one thing looks like the part
    JUMPED = 11  # too far from where the part was a moment ago
    BLURRED = 12  # its edges are wider than the window in which they are measured

    @property
    def lost(self) -> bool:
        """Whether the part is lost."""
        return self > Status.OCCLUDED


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Position of a part in an image; NaN for values that were not found.

    Pixel coordinates u to the right, v down, (0, 0) in the middle of the first pixel.
    """

    status: Status
    tip: tuple[float, float] = (math.nan, math.nan)  # pixels, the middle of the end face
    angle: float = math.nan  # rad, of the frame's x axis, from u to v
    point: tuple[float, float] = (math.nan, math.nan)  # pixels, on the axis, in what was seen


def pack_detections(*parts: Detection) -> Array:
    """Return the detections of n parts as a vector, shape (6 n,).

    Of each part: status (the number of :class:`Status`), u and v of the tip in pixels, the axis'
    angle in rad, u and v of a point on the axis in pixels.
    """
    values = [(part.status, *part.tip, part.angle, *part.point) for part in parts]
    return np.array(values, dtype=float).ravel()


def unpack_detections(detections: Array | Sequence[float]) -> tuple[Detection, ...]:
    """Return the detections that :func:`pack_detections` put together, shape (6 n,)."""
    return tuple(
        Detection(status=Status(int(s)), tip=(tu, tv), angle=angle, point=(pu, pv))
        for s, tu, tv, angle, pu, pv in np.reshape(detections, (-1, DETECTION_SIZE)).tolist()
    )


@dataclass(frozen=True, kw_only=True)
class CrossSection:
    """The detection of a cross-section; unknown values are NaN.

    Pixel coordinates u to the right, v down, (0, 0) in the middle of the first pixel.
    """

    status: Status  # VALID, NO_IMAGE, NO_COLOUR, AT_BORDER or NO_CONTRAST
    centroid: tuple[float, float] = (math.nan, math.nan)  # pixels
    # rad, of the longer principal axis from u to v, > -pi/2, <= pi/2; NaN where none is longer.
    angle: float = math.nan
    # Pixels from the centroid to the edges: along the longer axis (u where none is) ahead and
    # back, then along the axis a quarter turn further.
    edges: tuple[float, float, float, float] = (math.nan,) * 4

    @property
    def middle(self) -> tuple[float, float]:
        """Half-way between the edges along both axes, pixels."""
        ahead, back, right, left = self.edges
        along, across = (ahead - back) / 2, (right - left) / 2
        angle = self.angle if math.isfinite(self.angle) else 0.0
        cos, sin = math.cos(angle), math.sin(angle)
        u, v = self.centroid
        return u + cos * along - sin * across, v + sin * along + cos * across


def pack_cross_section(section: CrossSection) -> Array:
    """Return a cross-section as a vector: status, centroid, angle and edges, shape (8,)."""
    values = (section.status, *section.centroid, section.angle, *section.edges)
    return np.array(values, dtype=float)


def unpack_cross_section(vector: Array | tuple[float, ...]) -> CrossSection:
    """Return the cross-section that :func:`pack_cross_section` made a vector of."""
    status, u, v, angle, ahead, back, right, left = map(float, vector)
    edges = ahead, back, right, left
    return CrossSection(status=Status(int(status)), centroid=(u, v), angle=angle, edges=edges)
