"""What the theory of assembly needs to know of a peg and its hole."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from chamfer.models.validation import ParameterError, require_not_negative, require_positive


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
        require_positive(self, "hole_radius", "peg_radius", "friction")
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
