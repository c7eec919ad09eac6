"""The packing plan: nuggets, their places, and the nuggets below them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from chamfer.models.charging.station import StationLayout
from chamfer.models.surfaces.composed import Placed, Union
from chamfer.models.surfaces.rounds import Ellipsoid
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_numbers,
    require_one_of,
    require_positive,
)

Array = NDArray[np.float64]

SILICON: Final = 2330.0  # kg/m^3, appendix B.1
ASPECT: Final = (1.0, 0.9, 0.8)  # of a nugget: towards the wall, along it, up; assumed


@dataclass(frozen=True, kw_only=True)
class Nugget:
    """An ellipsoid whose axes are those of the endpoint's frame while it is held.

    The gripper holds it by the middle of its top, the origin of the endpoint's frame.
    """

    mass: float  # kg
    semi_axes: tuple[float, float, float]  # m, towards the wall, along it, up

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_numbers(self, 3, "semi_axes")
        if not min(self.semi_axes) > 0:
            raise ParameterError("semi_axes", self.semi_axes, "3 finite numbers > 0")

    @property
    def reach(self) -> float:
        """From the grip point to the side that meets the wall, m."""
        return self.semi_axes[0]

    @property
    def height(self) -> float:
        """From the grip point down to the point that meets the layer below, m."""
        return 2 * self.semi_axes[2]

    @property
    def centre(self) -> tuple[float, float, float]:
        """Centre of mass in the endpoint's frame, m."""
        return 0.0, 0.0, -self.semi_axes[2]

    @property
    def wall_point(self) -> tuple[float, float, float]:
        """The point that meets the wall in the endpoint's frame, m."""
        return self.semi_axes[0], 0.0, -self.semi_axes[2]

    @property
    def layer_point(self) -> tuple[float, float, float]:
        """The point that meets the surface below, in the endpoint's frame, m."""
        return 0.0, 0.0, -2 * self.semi_axes[2]

    @property
    def inertia(self) -> Array:
        """Rotational inertia about the centre, endpoint's axes, kg m^2, shape (3, 3)."""
        a, b, c = (one**2 for one in self.semi_axes)
        return self.mass / 5 * np.diag([b + c, a + c, a + b])


def nugget_of(mass: float, *, size: float = 1.0) -> Nugget:
    """Return the nugget of a mass, kg, of solid silicon with the usual proportions.

    By ``size`` its lengths, not its mass, are larger than those of an ellipsoid: a nugget is
    irregular, and what matters is where it touches.

    Raises:
        ParameterError: If a number is not finite and > 0.
    """
    for name, value in (("mass", mass), ("size", size)):
        if not 0 < value < math.inf:
            raise ParameterError(name, value, "a finite number > 0")
    unit = (3 * mass / (4 * math.pi * SILICON * math.prod(ASPECT))) ** (1 / 3)
    a, b, c = (size * unit * one for one in ASPECT)
    return Nugget(mass=mass, semi_axes=(a, b, c))


ItemKind = Literal["wall", "crown", "bulk"]

_CLEAR: Final = 0.01  # m, of a crown nugget from the wall
_TOUCHING: Final = 1e-9  # m


@dataclass(frozen=True, kw_only=True)
class PlanItem:
    """One nugget, or one load of the bulk filler, and its place."""

    kind: ItemKind = "wall"
    mass: float = 0.085  # kg, of the nugget, or of the filler's load; 14 to 185 g in app. C
    azimuth: float = 0.0  # rad, of its place about the crucible's axis
    radius: float | None = None
    # m, of its middle from the crucible's axis; None: at the wall, a crown nugget 1 cm from it,
    # bulk on the axis
    size: float = 1.0  # true lengths over those of an ellipsoid of its mass
    scanned_size: float | None = None  # the scanner's value for that; None: the true one
    tilt: float = 0.0  # rad, of the nugget after it is released; the controller does not know it
    tilt_azimuth: float = 0.0  # rad, direction in which its top then leans

    def __post_init__(self) -> None:
        require_one_of(self, "kind", ("wall", "crown", "bulk"))
        require_positive(self, "mass", "size")
        require_finite(self, "azimuth", "tilt", "tilt_azimuth")
        if self.radius is not None:
            require_finite(self, "radius")
            if self.radius < 0:
                raise ParameterError("radius", self.radius, "a finite number >= 0")
            if self.kind == "wall":
                raise ParameterError("radius", self.radius, "None for wall: it lies at the wall")
        if self.scanned_size is not None:
            require_positive(self, "scanned_size")

    @property
    def true_nugget(self) -> Nugget:
        """The true nugget."""
        return nugget_of(self.mass, size=self.size)

    @property
    def believed_nugget(self) -> Nugget:
        """The nugget that the scanner measures."""
        size = self.size if self.scanned_size is None else self.scanned_size
        return nugget_of(self.mass, size=size)


@dataclass(frozen=True, kw_only=True)
class LaidNugget:
    """A nugget in the crucible: one ellipsoid for contact, measurement and drawing."""

    nugget: Nugget
    middle: tuple[float, float, float]  # m, in the world
    azimuth: float  # rad, with which it was laid
    tilt: float  # rad, off that
    tilt_azimuth: float  # rad, direction in which its top leans
    name: str  # in the plan
    floor: float  # m, height of the cylinder about it in the packing

    @property
    def rotation(self) -> Array:
        """Its orientation, R_WN, shape (3, 3)."""
        angles = self.tilt, self.tilt_azimuth, self.azimuth - self.tilt_azimuth
        (c1, c2, c), (s1, s2, s) = map(math.cos, angles), map(math.sin, angles)
        lean = np.array([[c2 * c1, -s2, c2 * s1], [s2 * c1, c2, s2 * s1], [-s1, 0.0, c1]])
        turned: Array = lean @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return turned

    def surface(self, upper: Nugget) -> Surface:
        """Return the surface at which the lowest point of a nugget above it stops.

        Two ellipsoids touch where the middle of one is on the sum of both. The sum is taken for
        an ellipsoid of the summed semi-axes, which it is where both are alike and aligned.
        """
        x, y, z = self.middle
        return Placed(
            surface=Ellipsoid(semi_axes=self._summed(upper)),
            point=(x, y, z - upper.semi_axes[2]),
            axes=tuple(map(tuple, self.rotation.tolist())),
        )

    def height(self, place: tuple[float, float], upper: Nugget) -> float:
        """Return the height of that surface at a place, m; -inf outside of it."""
        R = self.rotation
        form = R @ np.diag(np.power(self._summed(upper), -2.0)) @ R.T
        across = np.subtract(place, self.middle[:2])
        # form of (across, h) is 1
        half = float(form[2, :2] @ across) / form[2, 2]
        square = half**2 - (float(across @ form[:2, :2] @ across) - 1) / form[2, 2]
        if square < 0:
            return -math.inf
        return float(self.middle[2] - half + math.sqrt(square) - upper.semi_axes[2])

    def _summed(self, upper: Nugget) -> tuple[float, float, float]:
        a, b, c = np.add(self.nugget.semi_axes, upper.semi_axes).tolist()
        return a, b, c


@dataclass(frozen=True, kw_only=True)
class ItemPlace:
    """Place of an item: that of the nugget's middle, in the world."""

    position: tuple[float, float]  # m, x and y
    azimuth: float  # rad, direction to the wall
    layer: float  # m, height of the surface below
    laid: tuple[LaidNugget, ...]  # nuggets in the crucible by then
    on: LaidNugget | None  # of it, on which the item lies; None: on the bed
    lies: LaidNugget  # the item itself, once it is laid

    def below(self, nugget: Nugget, bed: Surface) -> Surface:
        """Return the surface that a nugget's lowest point meets: the bed, or an earlier nugget."""
        return Union(parts=(bed, *(one.surface(nugget) for one in self.laid)))


def places(
    plan: Sequence[PlanItem],
    station: StationLayout,
    *,
    believed: bool,
    laid: Sequence[PlanItem] = (),
) -> tuple[ItemPlace, ...]:
    """Return the place of each item of a plan, and the height of the surface below it by then.

    ``laid`` is what lies in the crucible before. An item lies on the bed, or on the highest of the
    wall and crown nuggets that were laid before it and whose outline, seen from above as a circle,
    holds the middle of its own. ``believed``: nuggets have the scanner's size, with flat
    tops; else the surface below is the true one.

    Raises:
        ParameterError: If a nugget does not fit into the crucible, would overlap one that was
            laid before, or is to be laid at the wall where the wall has ended.
    """
    found: list[ItemPlace] = []
    lying: list[LaidNugget] = []
    names = [
        f"{of}[{i}]" for of, items in (("laid", laid), ("plan", plan)) for i in range(len(items))
    ]
    for name, item in zip(names, (*laid, *plan), strict=True):
        nugget = item.believed_nugget if believed else item.true_nugget
        at_wall = station.crucible_radius - nugget.reach
        if not at_wall > 0:
            most = item.mass * (station.crucible_radius / nugget.reach) ** 3
            allowed = f"less than {most:.3g} kg, to fit into the crucible"
            raise ParameterError(f"{name}.mass", item.mass, allowed)
        radius = item.radius
        if radius is None:
            # The plan is made with what the scanner shows; at the wall, the wall is what stops.
            crown = station.crucible_radius - item.believed_nugget.reach - _CLEAR
            radius = {"wall": at_wall, "crown": crown, "bulk": 0.0}[item.kind]
        if not 0 <= radius <= at_wall + 1e-12:
            raise ParameterError(
                f"{name}.radius", radius, f"0 to {at_wall:g} m, inside the crucible"
            )
        position = station.place(item.azimuth, radius)
        holding = [one for one in lying if math.dist(one.middle[:2], position) < one.nugget.reach]
        on = max(holding, key=lambda one: one.floor + one.nugget.height, default=None)
        floor = station.bed_height if on is None else on.floor + on.nugget.height
        layer = floor if believed else station.bed_height
        for one in lying:
            way, beside = math.dist(one.middle[:2], position), nugget.reach + one.nugget.reach
            under = floor + nugget.height <= one.floor + _TOUCHING
            above = floor >= one.floor + one.nugget.height - _TOUCHING
            if not (believed or under):
                layer = max(layer, one.height(position, nugget))
            if way < beside - _TOUCHING and not (above or under):
                allowed = (
                    f"one that brings it beside {one.name}, at least {beside:.4f} m from "
                    f"its middle (now {way:.4f} m), or on it, less than {one.nugget.reach:.4f} m"
                )
                raise ParameterError(f"{name}.azimuth", item.azimuth, allowed)
        middle = layer + nugget.height / 2
        if item.kind == "wall" and not middle < station.rim_height:
            allowed = (
                f"one where its middle, {middle:.3f} m high, is below the rim, "
                f"{station.rim_height:g} m"
            )
            raise ParameterError(f"{name}.azimuth", item.azimuth, allowed)
        here = LaidNugget(
            nugget=nugget,
            middle=(*position, middle),
            azimuth=item.azimuth,
            tilt=0.0 if believed else item.tilt,
            tilt_azimuth=item.tilt_azimuth,
            name=name,
            floor=floor,
        )
        found.append(
            ItemPlace(
                position=position,
                azimuth=item.azimuth,
                layer=layer,
                laid=tuple(lying),
                on=on,
                lies=here,
            )
        )
        if item.kind != "bulk":
            lying.append(here)
    return tuple(found[len(laid) :])
