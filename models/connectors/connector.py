"""The interface of a connector: a plug, a socket, and the convex pieces that touch.

Frame P of the plug: the origin in the middle of its leading face, z against the direction of
insertion, x the long axis of a D. Frame S of the socket: the origin in the middle of the face that
the plug reaches first, z out of the socket. P and S coincide where the plug, in line, just
touches; the depth is the distance of P's origin below S's.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import ClassVar, Final, Literal, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    Role,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from chamfer.models.peg.bore_contact import point_contact
from chamfer.models.validation import (
    MOST_FRICTION,
    ParameterError,
    require_all_positive,
    require_between,
    require_not_negative,
    require_one_of,
    require_positive,
)

Array = NDArray[np.float64]
Tolerance = Literal["nominal", "worst"]
Range = tuple[float, float]  # smallest and largest dimension allowed, m

# m, of a flat end behind the spheres round it: what is in the way meets the spheres, in a closed
# form, and not the end.
SETBACK: Final = 5e-5
OUTLINE_SIDES: Final = 16  # of a prism that stands for a cylinder


class ConvexPiece(NamedTuple):
    """A convex piece of a part."""

    name: str
    shape: Shape
    X_BP: RigidTransform  # of the shape in the part's frame


@dataclass(frozen=True, kw_only=True)
class ContactMaterial:
    """Contact parameters of pieces; all of them are assumed."""

    stiffness: float = 4e6  # N/m, of a point contact
    dissipation: float = 20.0  # s/m, of a point contact, of Hunt and Crossley
    friction: float = 0.2  # mu, Coulomb's

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "dissipation")
        require_between(self, 0, MOST_FRICTION, "friction")


class Connector(Protocol):
    """A connector in contact."""

    @property
    def name(self) -> str:
        """Name of the connector."""

    @property
    def mated_depth(self) -> float:
        """Depth of a plug that is fully in, m."""

    @property
    def mating_force(self) -> float:
        """Largest force of the insertion of a plug in line, N."""

    @property
    def lead_in(self) -> float:
        """Depth up to which a plug beside its place still slides off sideways, m."""

    @property
    def mated_turn(self) -> float | None:
        """Turn of a mated plug about z, rad, or half a turn from that; None: unturned."""

    @property
    def largest_force(self) -> float:
        """Force that plug and socket withstand along any axis, N."""

    @property
    def largest_torque(self) -> float:
        """Torque that plug and socket withstand about any axis, N m."""

    @property
    def mass(self) -> float:
        """Of the plug, kg."""

    @property
    def material(self) -> ContactMaterial:
        """Of its pieces."""

    def with_mating_force(self, force: float) -> Self:
        """Return the same connector with another mating force, N."""

    @property
    def plug_outline(self) -> Array:
        """Corners of the convex body that a camera sees, m, in P, shape (n, 3)."""

    @property
    def socket_outline(self) -> Array:
        """Likewise of the socket, in S."""

    def add_plug(self, plant: MultibodyPlant, body: RigidBody, X_BP: RigidTransform) -> None:
        """Add the plug to a body that holds it, X_BP its place there."""

    def add_socket(self, plant: MultibodyPlant, X_WS: RigidTransform) -> None:
        """Add the socket, fixed to the world."""


def add_pieces(
    plant: MultibodyPlant,
    body: RigidBody,
    X_BP: RigidTransform,
    pieces: Sequence[ConvexPiece],
    material: ContactMaterial,
    rgba: Array | None,
) -> None:
    """Add the pieces of a part to a body, for contact, and visible if they have a colour.

    X_BP is the place of the part's frame on the body; the plant is not yet finalized.
    """
    properties = point_contact(material.stiffness, material.dissipation, material.friction)
    for piece in pieces:
        X = X_BP @ piece.X_BP
        plant.RegisterCollisionGeometry(body, X, piece.shape, piece.name, properties)
        if rgba is not None:
            plant.RegisterVisualGeometry(body, X, piece.shape, piece.name, rgba)


class ConnectorPart(NamedTuple):
    """A part of a plug or a socket, by which collision filters find its pieces."""

    name: str
    pieces: list[ConvexPiece]
    material: ContactMaterial
    rgba: Array | None  # None: invisible


@dataclass(frozen=True, kw_only=True)
class PartsConnector:
    """A connector of parts with tolerances; pairs define which parts touch."""

    tolerance: Tolerance = "nominal"  # nominal: means of the pairs; worst: the least clearance
    largest_force: float = 100.0  # N, that plug and socket withstand along any axis; assumed
    largest_torque: float = 1.5  # N m, that they withstand about any axis; assumed
    material: ContactMaterial = ContactMaterial()  # of all pieces but the springs

    NAME: ClassVar[str]
    PARTNERS: ClassVar[Sequence[tuple[str, str]]]  # of the plug and of the socket, that touch
    MAY_BE_ZERO: ClassVar[Sequence[str]] = ()  # all other floats are positive
    SHORT: ClassVar[Mapping[str, tuple[str, str]]] = {"friction": ("material", "friction")}

    def __post_init__(self) -> None:
        require_one_of(self, "tolerance", ("nominal", "worst"))
        require_all_positive(self, *self.MAY_BE_ZERO)
        for one in fields(self):
            limits = getattr(self, one.name)
            if one.type == Range and not (
                len(limits) == 2 and 0 < limits[0] <= limits[1] < math.inf
            ):
                allowed = "two finite numbers, 0 < least <= largest"
                raise ParameterError(one.name, limits, allowed)

    @property
    def name(self) -> str:
        """Name of the connector."""
        return self.NAME

    @property
    def mated_turn(self) -> float | None:
        """No turn."""
        return None

    def pick(self, limits: Range, *, tight: int) -> float:
        """Return the middle of a range, or the end that makes the tightest fit."""
        return limits[tight] if self.tolerance == "worst" else sum(limits) / 2

    def plug_parts(self) -> list[ConnectorPart]:
        """Return the parts of the plug, in P."""
        raise NotImplementedError

    def socket_parts(self) -> list[ConnectorPart]:
        """Return the parts of the socket, in S."""
        raise NotImplementedError

    def add_plug(self, plant: MultibodyPlant, body: RigidBody, X_BP: RigidTransform) -> None:
        """Add the plug to a body that holds it, X_BP its place there."""
        self._add(plant, body, X_BP, self.plug_parts())

    def add_socket(self, plant: MultibodyPlant, X_WS: RigidTransform) -> None:
        """Add the socket, fixed to the world."""
        self._add(plant, plant.world_body(), X_WS, self.socket_parts())

    def _add(
        self,
        plant: MultibodyPlant,
        body: RigidBody,
        X: RigidTransform,
        parts: Sequence[ConnectorPart],
    ) -> None:
        for part in parts:
            # The name of its part in front, by which a filter finds a piece.
            named = [one._replace(name=f"{part.name}:{one.name}") for one in part.pieces]
            add_pieces(plant, body, X, named, part.material, part.rgba)
        let_touch(plant, self.PARTNERS)


@dataclass(frozen=True, kw_only=True)
class SprungConnector(PartsConnector):
    """A connector with springs among its parts: their stiffness is that of their contact."""

    spring_dissipation: float = 0.0
    # s/m, of every spring, of Hunt and Crossley: dependence of its force on speed; assumed

    MAY_BE_ZERO: ClassVar[Sequence[str]] = ("spring_dissipation",)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "spring_dissipation")

    def spring(self, stiffness: float) -> ContactMaterial:
        """Return the material of a spring of a stiffness, N/m, with the friction of the others."""
        return replace(self.material, stiffness=stiffness, dissipation=self.spring_dissipation)


def let_touch(plant: MultibodyPlant, pairs: Sequence[tuple[str, str]]) -> None:
    """Filter collisions between the parts of a plug and a socket, except for the pairs.

    Call it after the plug and after the socket was added, in any order: a call filters the
    existing pieces. Pieces of no part are left alone. Each of the ``pairs`` is a part of the plug
    and a part of the socket that touch.
    """
    scene_graph = Parser(plant).scene_graph()  # the only way from a plant to its geometry
    inspector = scene_graph.model_inspector()
    parts: dict[str, list[GeometryId]] = {}
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        # A geometry's name has that of its model in front.
        part = inspector.GetName(geometry).rpartition("::")[2].partition(":")[0]
        parts.setdefault(part, []).append(geometry)
    plugs, sockets = zip(*pairs, strict=True)
    for pair in product(plugs, sockets):
        if pair not in pairs:
            first, second = (GeometrySet(parts.get(part, [])) for part in pair)
            strangers = CollisionFilterDeclaration().ExcludeBetween(first, second)
            scene_graph.collision_filter_manager().Apply(strangers)


def block(name: str, one: Sequence[float], other: Sequence[float]) -> ConvexPiece:
    """Return a box between two opposite corners, m."""
    size = np.abs(np.subtract(other, one))
    return ConvexPiece(name, Box(*size), RigidTransform(np.add(one, other) / 2))


def turns(number: int) -> list[RotationMatrix]:
    """Return the rotations about z that divide a turn."""
    return [RotationMatrix.MakeZRotation(2 * math.pi * i / number) for i in range(number)]


def prism(radius: float, bottom: float, top: float) -> Array:
    """Return the corners of an upright prism that stands for a cylinder, m, shape (32, 3)."""
    angle = 2 * math.pi * np.arange(OUTLINE_SIDES) / OUTLINE_SIDES
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.insert(ring, 2, z, axis=1) for z in (bottom, top)])


def box_corners(width: float, height: float, bottom: float, top: float) -> Array:
    """Return the corners of an upright box about z, m, shape (8, 3)."""
    corners = product((-width / 2, width / 2), (-height / 2, height / 2), (bottom, top))
    return np.array(list(corners))


def at(*place: float) -> RigidTransform:
    """Return the pose of a piece at x, y and z, m, without a turn."""
    return RigidTransform(np.array(place))


def capsule(name: str, radius: float, first: Array, last: Array) -> ConvexPiece:
    """Return a capsule between two points, m, shape (3,) each."""
    R = RotationMatrix.MakeFromOneVector(last - first, 2)
    length = float(np.linalg.norm(last - first))
    return ConvexPiece(name, Capsule(radius, length), RigidTransform(R, (first + last) / 2))
