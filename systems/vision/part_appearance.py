"""The appearance of a part in an image: its colour, size and shape.

Everything is in pixels: what is known of the parts in metres becomes what is expected of them in
an image by the size of a pixel alone, as in the paper, without calibration.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import cv2
import numpy as np

from chamfer.models.peg.peg_and_hole import Colour, ColouredParts
from chamfer.models.validation import ParameterError, require_one_of, require_positive

Range = tuple[float, float]  # least and most

_SLACK: Final = 0.03  # of a part's length over its width, relative to it


def _in_order(limits: Range | None) -> bool:
    return limits is None or 0 < limits[0] <= limits[1] < math.inf


class Looks(NamedTuple):
    """The edge properties of an :class:`Appearance`, for compiled code."""

    front: int
    end_ratio: float
    band: float
    seen: float
    length: int
    flat: bool
    straight: float
    window: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class Appearance:
    """The appearance of a part to find."""

    hue: int  # 0 to 255 once around the colours: 0 red, 85 green, 171 blue
    front: int  # 1: the tip is the right end; -1: the left one
    end_ratio: float = 1.0  # radius of the end face, relative to the sides
    band: float = 0.9  # share of the end face's width at which its edge is measured
    seen: float = 0.6  # share of that edge that has to be in sight
    hue_width: int = 20  # to either side, of 256
    saturation: int = 90  # of 255, at least
    value: int = 40  # of 255, at least
    area: int = 400  # pixels, at least
    length: int = 15  # pixels of straight edges, at least
    half_width: Range | None = None  # pixels, least and most; None: of any size
    aspect: Range | None = None
    # length over width, least and most, where both ends are in the image; None: of any length
    squareness: float = 1.35
    # factor by which pixels may be less square than believed, where both parts agree on it
    end_angle: float | None = None
    # rad, of the chamfer that makes the end face narrower, from that; None: not checked
    flat: bool = False  # whether the end faces have straight edges: of square parts
    straight: float = 0.6  # pixels, by which a straight edge may bend
    window: tuple[int, int] = (3, 14)
    # pixels beyond an edge that are measured, as many as it is blurred: least and most

    def __post_init__(self) -> None:
        require_one_of(self, "front", (1, -1))
        require_positive(self, "straight")
        chamfer, (least, most) = self.end_angle, self.window
        share, count = "a number > 0 and <= 1", "a whole number >= 2"
        limits = "two numbers > 0, the least one first, or null"
        for name, good, allowed in (
            ("hue", 0 <= self.hue <= 255, "a whole number from 0 to 255"),
            ("hue_width", 0 <= self.hue_width <= 127, "a whole number from 0 to 127"),
            ("saturation", 0 <= self.saturation <= 255, "a whole number from 0 to 255"),
            ("value", 1 <= self.value <= 255, "a whole number from 1 to 255"),
            ("end_ratio", 0 < self.end_ratio <= 1, share),
            ("band", 0 < self.band <= 1, share),
            ("seen", 0 < self.seen <= 1, share),
            ("area", self.area >= 2, count),
            ("length", self.length >= 2, count),
            ("half_width", _in_order(self.half_width), limits),
            ("aspect", _in_order(self.aspect), limits),
            ("squareness", 1 <= self.squareness < math.inf, "a finite number >= 1"),
            ("end_angle", chamfer is None or 0 < chamfer < math.pi / 2, "from 0 to pi/2, or null"),
            ("end_angle", chamfer is None or self.end_ratio != 1, "null where end_ratio is 1"),
            ("window", 3 <= least <= most <= 50, "two whole numbers from 3 to 50, in order"),
        ):
            if not good:
                raise ParameterError(name, getattr(self, name), allowed)

    @cached_property
    def looks(self) -> Looks:
        """The properties of edges, for compiled code."""
        return Looks._make(getattr(self, name) for name in Looks._fields)

    def oblong(self) -> "Appearance":
        """Return this as it may look in pixels that are less square than believed.

        It is meant for two parts at once: :func:`agree` says whether the pixels explain both.
        """
        if self.aspect is None:
            return self
        low, high = self.aspect
        return replace(self, aspect=(low / self.squareness, high * self.squareness))

    def sized(
        self, half_width: float, length: float | None = None, *, slack: float = _SLACK
    ) -> "Appearance":
        """Return this with the limits that follow from a part's size in an image.

        The width may be 1.5 times what is expected, or as much less: a believed focal length may
        be wrong by a factor of 1.3, and a part be nearer or farther than believed by a tenth. The
        ratio of length to width depends on neither, and how much the axis is turned towards the
        camera is seen by the ends; so it says whether an end is covered. It depends on how much
        less square than believed the pixels are, as that of another part in the image does.

        Half the width of the sides, and the length if it is known, are in pixels; the slack is
        that of the ratio of length to width, relative to it.

        Raises:
            ParameterError: If they are not positive.
        """
        for name, value in (("half_width", half_width), ("length", length)):
            if value is not None and not 0 < value < math.inf:
                raise ParameterError(name, value, "a finite number > 0")
        turned = _TURNED if self.flat else 0.0  # its end face is seen, beside the part's length
        ratio = None if length is None else length / (2 * half_width)
        area = edges = math.inf
        if length is not None:
            area, edges = _WHOLE * 2 * half_width * length, _EDGES * length
        return replace(
            self,
            area=max(round(min(self.area, area)), 2),
            length=max(round(min(self.length, edges)), 2),
            half_width=(half_width / _WIDTH, half_width * _WIDTH),
            aspect=None if ratio is None else (ratio * (1 - slack), ratio * (1 + slack) + turned),
        )


class Proportions(NamedTuple):
    """How long and how wide a part is in an image, as if it were not turned from the camera."""

    aspect: float  # length over width; NaN if it was not measured
    half_width: float  # pixels
    whole: bool  # whether the image holds both ends; else it is longer


def agree(looks: tuple[Appearance, Appearance], seen: tuple[Proportions, Proportions]) -> bool:
    """Return whether two parts are out of proportion by one factor, that of the pixels.

    Where the image cuts off the far end of one of them, the other has to be longer than believed,
    which no cover over an end makes it, and not narrower beside it, as by a cover along its side.
    """
    factors, widths, slack = [], [], math.inf
    for look, one in zip(looks, seen, strict=True):
        if look.aspect is None or look.half_width is None or not one.aspect > 0:
            return False
        factors.append(math.log(one.aspect) - _middle(look.aspect))
        widths.append(math.log(one.half_width) - _middle(look.half_width))
        slack = min(slack, math.log(look.aspect[1] / look.aspect[0]) / 2)
    if seen[0].whole and seen[1].whole:
        return abs(factors[0] - factors[1]) <= slack
    if not (seen[0].whole or seen[1].whole) or abs(widths[0] - widths[1]) > _BESIDE:
        return False
    whole, cut = factors if seen[0].whole else factors[::-1]
    return whole > 0 and cut <= whole + slack


def _middle(limits: Range) -> float:
    return math.log(limits[0] * limits[1]) / 2


_TURNED: Final = 0.12  # rad, by which a square part may be turned towards the camera
_WHOLE: Final = 0.5  # share of a small part's expected area that has to have its colour
_EDGES: Final = 0.5  # share of a short part's expected length that has to be straight
_WIDTH: Final = 1.5  # factor of the expected width, more or less


_BESIDE: Final = 0.05  # by which a nearer part may be wider beside the other, relative to it


def appearances(
    parts: ColouredParts, pixel_size: float | None = None, distance: float = math.inf
) -> tuple[Appearance, Appearance]:
    """Return the appearance of peg and hole part; of any size without a pixel's size.

    ``pixel_size`` is what a pixel is believed to cover at the parts, m; ``distance``, m, that of
    the camera: the near face of a square part is nearer by half its width and looks larger.

    Raises:
        ParameterError: If a colour filter can't tell the parts from each other, or one of them
            from a grey background.
    """
    peg = parts.peg
    end_ratio = 1 - peg.chamfer.width / peg.radius
    found = (
        Appearance(hue=_hue(parts, "peg_colour"), front=1, end_ratio=end_ratio),
        # The peg hides most of the mouth's edge when it is in the hole.
        Appearance(hue=_hue(parts, "hole_colour"), front=-1, seen=0.1),
    )
    apart = abs(found[0].hue - found[1].hue)
    if min(apart, 256 - apart) <= found[0].hue_width + found[1].hue_width:
        allowed = f"a hue that differs more from the peg's, {parts.peg_colour}"
        raise ParameterError("hole_colour", parts.hole_colour, allowed)
    if pixel_size is None:
        return found
    hole = parts.hole
    angle = peg.chamfer.angle if peg.chamfer.width else None
    found = replace(found[0], end_angle=angle), found[1]
    looks = []
    for look, radius, length in zip(
        found, (peg.radius, hole.outer_radius), (peg.length, hole.depth), strict=True
    ):
        square = parts.section == "square"
        nearer = radius / distance if square else 0.0
        # The sides that are seen are those of the near face; the ends are of either face.
        sized = replace(look, flat=square).sized(
            (1 + nearer) * radius / pixel_size,
            (1 + nearer / 2) * length / pixel_size,
            slack=_SLACK + nearer / 2,
        )
        looks.append(sized)
    return looks[0], looks[1]


def _hue(parts: ColouredParts, name: str) -> int:
    colour: Colour = getattr(parts, name)
    pixel = np.array([[colour]], np.uint8)
    hue, saturation, value = cv2.cvtColor(pixel, cv2.COLOR_RGB2HSV_FULL)[0, 0].tolist()
    if not (saturation > Appearance.saturation and value > Appearance.value):
        allowed = f"brighter than {Appearance.value} of 255, with more than "
        raise ParameterError(name, colour, f"{allowed}{Appearance.saturation} of 255 saturation")
    return int(hue)


PEG, HOLE_PART = appearances(ColouredParts())
