"""The peg and the part with the hole, red and blue (section 4): round, or square.

A square one has faces in its frame's y and z; what is called a radius is half of its width from
face to face, the radius of the circle inside.

Frame T of the peg: the origin in the centre of its end face, x along its axis out of the peg.
Frame M of the hole part: the origin in the centre of the mouth, x along the bore into the
material. T and M have the same orientation where the parts are aligned.

Presets are parts that others use too, by name: ``--set parts=factory-8mm``; what one does not name
is as in the parts of the paper. Lengths are in m.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import (
    MOST_FRICTION,
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)

SEATED: Final = 0.9  # of the commanded depth, from where on a peg is seated


class Chamfer(NamedTuple):
    """A chamfer of a peg's tip or of a hole's mouth."""

    width: float  # m, across the axis
    angle: float  # rad, from the end face

    @property
    def height(self) -> float:
        """Along the axis, m."""
        return self.width * math.tan(self.angle)


@dataclass(frozen=True, kw_only=True)
class PegHoleGeometry:
    """A peg and its hole, as far as wedging and jamming depend on them in a plane."""

    hole_radius: float = 0.010035  # m, R of the bore; section 4
    peg_radius: float = 0.009779  # m, r of the peg; section 4
    friction: float = 0.45  # mu, between peg and hole; section 4
    chamfer_width: float = 0.004  # m, W, peg's and hole's together; assumed, not published
    chamfer_angle: float = math.pi / 4  # rad, of both, from the end face; assumed, not published

    def __post_init__(self) -> None:
        require_positive(self, "hole_radius", "peg_radius")
        require_positive(self, "friction", most=MOST_FRICTION)
        require_not_negative(self, "chamfer_width")
        if not self.peg_radius < self.hole_radius:
            allowed = f"less than the hole's radius, {self.hole_radius!r}"
            raise ParameterError("peg_radius", self.peg_radius, allowed)
        if not 0 < self.chamfer_angle < math.pi / 2:
            raise ParameterError("chamfer_angle", self.chamfer_angle, "between 0 and pi/2")
        if not self.peg_chamfer.width < self.peg_radius:
            allowed = f"with less than the peg's radius, {self.peg_radius!r}, on the peg"
            raise ParameterError("chamfer_width", self.chamfer_width, allowed)

    @property
    def is_round(self) -> bool:
        """Whether the parts are round, and all planes through their axes alike."""
        return True

    @property
    def peg_chamfer(self) -> Chamfer:
        """The peg's part of the chamfers: half of their width."""
        return Chamfer(self.chamfer_width / 2, self.chamfer_angle)

    @property
    def hole_chamfer(self) -> Chamfer:
        """The hole's part of them."""
        return Chamfer(self.chamfer_width - self.peg_chamfer.width, self.chamfer_angle)

    @property
    def chamfer_height(self) -> float:
        """How far below the mouth a peg's tip in line is as the bore begins to guide it, m.

        A depth of the theory, l, is that of the tip less this height.
        """
        return self.peg_chamfer.height + self.hole_chamfer.height

    @property
    def clearance(self) -> float:
        """``R - r``, m."""
        return self.hole_radius - self.peg_radius

    @property
    def clearance_ratio(self) -> float:
        """``c = (R - r) / R``."""
        return self.clearance / self.hole_radius

    @property
    def friction_radius(self) -> float:
        """``mu r``, m: how far friction shifts the line of a contact force."""
        return self.friction * self.peg_radius

    @property
    def rotation_limit(self) -> float:
        """``theta_w``, rad: the tilt at which two points that touch can hold the peg."""
        return self.clearance / self.friction_radius

    @property
    def wedging_depth(self) -> float:
        """``l_w = 2 mu r``, m: two points that touch below it can't wedge, lambda > 1."""
        return 2 * self.friction_radius

    @property
    def lateral_limit(self) -> float:
        """``r + R``, m, the published limit: beyond it peg and hole don't even overlap."""
        return self.peg_radius + self.hole_radius

    @property
    def chamfer_limit(self) -> float:
        """``W + (R - r)``, m: the lateral error that the chamfers still guide into the hole."""
        return self.chamfer_width + self.clearance

    @property
    def mouth_tilt_limit(self) -> float:
        """``acos(r / R)``, rad: a peg that leans further is too wide for the mouth."""
        return math.acos(self.peg_radius / self.hole_radius)


_INCH: Final = 0.0254

# The largest size of the NIST assembly task board's pegs, 16 mm (Kimble et al., 2020).
# Assumed: all else.
_NIST_16MM: Final[Mapping[str, object]] = {
    "peg_radius": 0.016 / 2,
    "hole_radius": 0.0161 / 2,
    "friction": 0.3,
    "chamfer_width": 0.001,
    "peg_length": 0.05,
    "hole_length": 0.025,
    "outer_radius": 0.0125,
}

PRESETS: Final[Mapping[str, Mapping[str, object]]] = {
    # Ruybal, Lumia and Wood, section 4: the defaults.
    "paper": {},
    # NISTIR 8198r1 (Cheok, Franaszek, Van Wyk and Marvel, 2018): a peg of A2 tool steel with a
    # diameter of 12.675 mm (0.499 in). Assumed: the bore of 0.500 in, friction of dry steel,
    # chamfers of 0.5 mm each, lengths.
    "nist-12.675mm": {
        "peg_radius": 0.012675 / 2,
        "hole_radius": _INCH / 4,
        "friction": 0.3,
        "chamfer_width": 0.001,
        "peg_length": 0.05,
        "hole_length": 0.025,
        "outer_radius": 0.0105,
    },
    # Isaac Lab, factory_tasks_cfg.py (after Narang et al., Factory, 2022): Peg8mm, 7.986 mm in
    # diameter and 50 mm long, Hole8mm, 8.1 mm and 25 mm deep, friction 0.75 of each. Assumed:
    # chamfers of 0.5 mm each, what is outside.
    "factory-8mm": {
        "peg_radius": 0.007986 / 2,
        "hole_radius": 0.0081 / 2,
        "friction": 0.75,
        "chamfer_width": 0.001,
        "peg_length": 0.05,
        "hole_length": 0.025,
        "outer_radius": 0.0075,
    },
    "nist-16mm": _NIST_16MM,
    # Its square one of that size.
    "nist-16mm-square": {"section": "square", **_NIST_16MM},
}


Vector = NDArray[np.float64]
Colour = tuple[int, int, int]  # red, green, blue, 0 to 255
Section = Literal["round", "square"]

RED: Final[Colour] = (205, 40, 40)  # of the peg; the shades are assumed
BLUE: Final[Colour] = (40, 70, 205)  # of the hole part


class Peg(NamedTuple):
    """A peg with a chamfer at its tip."""

    radius: float  # m, r
    chamfer: Chamfer
    length: float  # m, with the chamfer
    section: Section = "round"

    @property
    def profile(self) -> Vector:
        """Position along x_T and radius, m, from the far end to the tip, shape (3, 2).

        Without a chamfer its two ends coincide: shape (2, 2).
        """
        rim = [[-self.chamfer.height, self.radius]] if self.chamfer.width else []
        tip = [0.0, self.radius - self.chamfer.width]
        return np.array([[-self.length, self.radius], *rim, tip])

    @property
    def closed_profile(self) -> Vector:
        """The profile with its ends on the axis, shape (5, 2), m; (4, 2) without a chamfer."""
        return np.vstack([[-self.length, 0.0], self.profile, [0.0, 0.0]])


class HolePart(NamedTuple):
    """A tube: a bore with a chamfer at the mouth; its bottom may be closed."""

    radius: float  # m, R
    chamfer: Chamfer
    outer_radius: float  # m
    depth: float  # m, of the part along its axis
    bore_depth: float | None  # m, of a blind hole; None: the bore goes through
    section: Section = "round"  # of the bore and of the outside

    @property
    def mouth_radius(self) -> float:
        """Radius of the opening in the front face, m."""
        return self.radius + self.chamfer.width

    @property
    def outside(self) -> Vector:
        """Position along x_M and radius of the outside, m, from the mouth, shape (2, 2)."""
        return np.array([[0.0, self.outer_radius], [self.depth, self.outer_radius]])

    @property
    def bore(self) -> Vector:
        """Position along x_M and radius of chamfer and bore, m, from the mouth, as of a peg."""
        edge = [[self.chamfer.height, self.radius]] if self.chamfer.width else []
        end = self.depth if self.bore_depth is None else self.bore_depth
        return np.array([[0.0, self.mouth_radius], *edge, [end, self.radius]])

    @property
    def closed_profile(self) -> Vector:
        """All around the material, m, shape (6, 2) of a bore with a chamfer that goes through.

        Of a through bore the first point again at the end; a blind one ends on the axis.
        """
        if self.bore_depth is None:
            return np.vstack([self.bore[::-1], self.outside, self.bore[-1:]])
        bottom, back = [self.bore_depth, 0.0], [self.depth, 0.0]
        return np.vstack([bottom, self.bore[::-1], self.outside, back])


@dataclass(frozen=True, kw_only=True)
class PegAndHole(PegHoleGeometry):
    """A peg and the part with its hole, for theory and contact.

    The planar theory is that of square parts too, as long as errors and tilts are in a plane that
    is parallel to faces: what touches are lines across it.
    """

    section: Section = "round"  # of both parts; with square ones a radius is half the width
    peg_chamfer_share: float = 0.5  # part of the chamfers' width that is on the peg; assumed
    peg_chamfer_angle: float = math.pi / 4
    # rad, of the peg's chamfer, from the end face; chamfer_angle is the hole's; assumed
    peg_length: float = 0.06  # m, of the peg, with its chamfer; assumed
    hole_length: float = 0.04  # m, of the part with the hole, along its axis; assumed
    bore_depth: float | None = None  # m, of a blind hole; None: the bore goes through
    outer_radius: float = 0.014  # m, of the part with the hole; assumed

    PRESETS: ClassVar[Mapping[str, Mapping[str, object]]] = PRESETS

    def __post_init__(self) -> None:
        require_one_of(self, "section", get_args(Section))
        if not 0 <= self.peg_chamfer_share <= 1:
            raise ParameterError("peg_chamfer_share", self.peg_chamfer_share, "0 to 1")
        if not 0 < self.peg_chamfer_angle < math.pi / 2:
            raise ParameterError("peg_chamfer_angle", self.peg_chamfer_angle, "between 0 and pi/2")
        super().__post_init__()
        require_positive(self, "peg_length", "hole_length", "outer_radius")
        hole = self.hole
        for part, chamfer, length in (
            ("peg", self.peg_chamfer, self.peg_length),
            ("hole", self.hole_chamfer, self.hole_length),
        ):
            if not chamfer.height < length:
                allowed = f"with less than the {part}'s length, {length} m, along the {part}"
                raise ParameterError("chamfer_width", self.chamfer_width, allowed)
        if not self.outer_radius > hole.mouth_radius:
            allowed = f"more than radius + chamfer, {hole.mouth_radius} m"
            raise ParameterError("outer_radius", self.outer_radius, allowed)
        least, depth = hole.chamfer.height, self.bore_depth
        if depth is not None and not least < depth < self.hole_length:
            allowed = f"between the chamfer's height, {least:.6g} m, and the depth"
            raise ParameterError("bore_depth", depth, f"{allowed}, {self.hole_length} m")

    @property
    def is_round(self) -> bool:
        """Whether the parts are round, and all planes through their axes alike."""
        return self.section == "round"

    @property
    def peg_chamfer(self) -> Chamfer:
        """The peg's part of the chamfers."""
        return Chamfer(self.peg_chamfer_share * self.chamfer_width, self.peg_chamfer_angle)

    @property
    def peg(self) -> Peg:
        """The peg's shape."""
        return Peg(self.peg_radius, self.peg_chamfer, self.peg_length, self.section)

    @property
    def hole(self) -> HolePart:
        """The shape of the part with the hole."""
        return HolePart(
            self.hole_radius,
            self.hole_chamfer,
            self.outer_radius,
            self.hole_length,
            self.bore_depth,
            self.section,
        )

    @property
    def bore_length(self) -> float:
        """How far below the mouth the bore ends, m."""
        return self.hole_length if self.bore_depth is None else self.bore_depth

    def leading(self, tilt: float) -> float:
        """Return how far a tilted peg's rim is ahead of the middle of its tip, m."""
        s, c = math.sin(abs(tilt)), math.cos(tilt)
        chamfer = self.peg_chamfer
        return max((self.peg_radius - chamfer.width) * s, self.peg_radius * s - chamfer.height * c)


OF_CONTACT: Final = ("friction", "chamfer_angle", "bore_depth")  # that nobody sees from outside


@dataclass(frozen=True, kw_only=True)
class ColouredParts(PegAndHole):
    """Peg and hole part, with the colours that distinguish them for cameras."""

    peg_colour: Colour = RED  # red, green and blue, 0 to 255, of the peg; the shade is assumed
    hole_colour: Colour = BLUE  # likewise of the part with the hole

    def __post_init__(self) -> None:
        super().__post_init__()
        require_colour(self, "peg_colour", "hole_colour")


def require_colour(params: object, *names: str) -> None:
    """Raise :class:`ParameterError` unless every named field is a :data:`Colour`."""
    for name in names:
        colour = getattr(params, name)
        if len(colour) != 3 or not all(0 <= channel <= 255 for channel in colour):
            raise ParameterError(name, colour, "three numbers from 0 to 255")
