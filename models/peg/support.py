"""The compliant support of a part: springs across and about one point of the part's axis."""

import math
from dataclasses import dataclass, replace

from chamfer.models.validation import require_finite, require_positive


@dataclass(frozen=True, kw_only=True)
class Support:
    """What holds the peg, or the hole, or both in series, in the plane of insertion.

    The defaults are those of the wedging diagram of section 5: one arm's stiffness, and a centre
    that is assumed. What the arms of a cell are to a peg follows from them, see
    :mod:`chamfer.diagrams.cell.work_cell`.
    """

    lateral_stiffness: float = 400.0  # N/m, K_x, across the axis; section 5
    angular_stiffness: float = 5.0  # N m/rad, K_theta, about the centre; section 5
    centre_distance: float = 0.1  # m, L_g, from tip to compliance centre; assumed, not published

    def __post_init__(self) -> None:
        require_positive(self, "lateral_stiffness", "angular_stiffness")
        require_finite(self, "centre_distance")

    @property
    def tilt_per_error(self) -> float:
        """``S = L_g / (L_g^2 + K_theta / K_x)``, rad/m: how far a lateral error tilts the peg.

        Zero for a centre of compliance at the tip or far from it.
        """
        ratio = self.angular_stiffness / self.lateral_stiffness
        return self.centre_distance / (self.centre_distance**2 + ratio)

    @property
    def worst_centre_distance(self) -> float:
        """``sqrt(K_theta / K_x)``, m: the L_g at which S is largest, ``1 / (2 L_g)``."""
        return math.sqrt(self.angular_stiffness / self.lateral_stiffness)


@dataclass(frozen=True, kw_only=True)
class OpenSupport:
    """A :class:`Support` that follows from what holds peg and hole where nothing is said."""

    lateral_stiffness: float | None = None  # N/m, K_x, across the axis; None: from the arms
    angular_stiffness: float | None = None  # N m/rad, K_theta, about the centre; None: likewise
    centre_distance: float | None = None  # m, L_g, from tip to compliance centre; None: likewise

    def __post_init__(self) -> None:
        self.over(Support())

    def over(self, derived: Support) -> Support:
        """Return the support, with what is left open as it is derived."""
        said = {name: value for name, value in vars(self).items() if value is not None}
        return replace(derived, **said)


def in_series(peg: Support, hole: Support, depth: float) -> Support:
    """Return the one support of the peg that two supports are, at a depth of the tip.

    Their compliances add. Seen from the tip, with a and b the heights of the two centres::

        1 / K_theta = 1 / K_theta1 + 1 / K_theta2
        L_g = (a / K_theta1 + b / K_theta2) K_theta
        1 / K_x = 1 / K_x1 + 1 / K_x2 + (a - b)^2 / (K_theta1 + K_theta2)

    Two arms of 400 N/m and 5 N m/rad with their centres at tip and mouth are
    ``1 / (1/200 + depth^2 / 10)`` N/m and 2.5 N m/rad, half of the depth above the tip.

    The peg's centre is measured from the tip, away from the hole, the hole's from the mouth, away
    from the peg. The depth, m, is that of the tip below the mouth.
    """
    above_tip = peg.centre_distance, depth - hole.centre_distance
    turning = 1 / peg.angular_stiffness, 1 / hole.angular_stiffness
    angular = 1 / sum(turning)
    arm = above_tip[0] - above_tip[1]
    across = (
        1 / peg.lateral_stiffness
        + 1 / hole.lateral_stiffness
        + arm**2 / (peg.angular_stiffness + hole.angular_stiffness)
    )
    return Support(
        lateral_stiffness=1 / across,
        angular_stiffness=angular,
        centre_distance=angular * (above_tip[0] * turning[0] + above_tip[1] * turning[1]),
    )
