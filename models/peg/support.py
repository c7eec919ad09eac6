"""The compliant support of a part: springs across and about one point of the part's axis."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import require_finite, require_positive

Array = NDArray[np.float64]

# A remote centre compliance of shear pads: 40 lb/in and 470 lb in/rad, those of the experiments of
# Whitney, Quasi-static assembly (1982), from memory. Its centre is put at the tip.
RCC: Final[Mapping[str, float]] = {
    "lateral_stiffness": 7e3,
    "angular_stiffness": 53.0,
    "centre_distance": 0.0,
}


@dataclass(frozen=True, kw_only=True)
class Support:
    """The springs that hold peg, hole or both in series, in the plane of insertion.

    The defaults are those of the wedging diagram of section 5: one arm's stiffness, and a centre
    that is assumed. What the arms of a cell are to a peg follows from them, see
    :mod:`chamfer.diagrams.cell.work_cell`.
    """

    lateral_stiffness: float = 400.0  # N/m, K_x, across the axis; section 5
    angular_stiffness: float = 5.0  # N m/rad, K_theta, about the centre; section 5
    centre_distance: float = 0.1  # m, L_g, from tip to compliance centre; assumed, not published

    PRESETS: ClassVar[Mapping[str, Mapping[str, object]]] = {"section-5": {}, "rcc": RCC}

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
    """A :class:`Support` whose open fields follow from the holders of peg and hole."""

    lateral_stiffness: float | None = None  # N/m, K_x, across the axis; None: from the arms
    angular_stiffness: float | None = None  # N m/rad, K_theta, about the centre; None: likewise
    centre_distance: float | None = None  # m, L_g, from tip to compliance centre; None: likewise

    def __post_init__(self) -> None:
        self.over(Support())

    def over(self, derived: Support) -> Support:
        """Return the support, with open fields from the derived one."""
        said = {name: value for name, value in vars(self).items() if value is not None}
        return replace(derived, **said)


def in_series(peg: Support, hole: Support, depth: float) -> Support:
    """Return the one support of the peg that two supports are, at a depth of the tip.

    The peg's centre is measured from the tip, away from the hole, the hole's from the mouth, away
    from the peg. The depth, m, is that of the tip below the mouth.
    """
    return stacked(peg, replace(hole, centre_distance=depth - hole.centre_distance))


def stacked(one: Support, other: Support) -> Support:
    """Return the one support of two in series, both centres from the tip.

    Their compliances add. Seen from the tip, with a and b the heights of the two centres::

        1 / K_theta = 1 / K_theta1 + 1 / K_theta2
        L_g = (a / K_theta1 + b / K_theta2) K_theta
        1 / K_x = 1 / K_x1 + 1 / K_x2 + (a - b)^2 / (K_theta1 + K_theta2)

    Two arms of 400 N/m and 5 N m/rad with their centres at tip and mouth are
    ``1 / (1/200 + depth^2 / 10)`` N/m and 2.5 N m/rad, half of the depth above the tip.
    """
    turning = 1 / one.angular_stiffness, 1 / other.angular_stiffness
    angular = 1 / sum(turning)
    across = (
        1 / one.lateral_stiffness
        + 1 / other.lateral_stiffness
        + (one.centre_distance - other.centre_distance) ** 2
        / (one.angular_stiffness + other.angular_stiffness)
    )
    height = one.centre_distance * turning[0] + other.centre_distance * turning[1]
    return Support(
        lateral_stiffness=1 / across,
        angular_stiffness=angular,
        centre_distance=angular * height,
    )


def strain(part: Support, whole: Support, lateral: Array, tilt: Array) -> tuple[Array, Array]:
    """Return the deflection of one of several supports in series, m at its centre, and rad.

    Small angles. The hole brings the tip back by ``lateral``, m, and ``tilt``, rad, against the
    whole; the load that this takes goes through each part.
    """
    across = whole.lateral_stiffness * (lateral + whole.centre_distance * tilt)
    lever = whole.centre_distance - part.centre_distance
    turning = whole.angular_stiffness * tilt + lever * across
    return across / part.lateral_stiffness, turning / part.angular_stiffness
