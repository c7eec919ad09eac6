"""What a connector is to whoever inserts it: a plug, a socket, and what they touch with.

Frame P of the plug: the origin in the middle of its leading face, z against the direction of
insertion, x the long axis of a D. Frame S of the socket: the origin in the middle of the face that
the plug reaches first, z out of the socket. P and S coincide where the plug, in line, just
touches; the depth is how far P's origin is below S's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import AddContactMaterial, ProximityProperties, Shape
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody

from chamfer.models.validation import require_not_negative, require_positive

Array = NDArray[np.float64]
Tolerance = Literal["nominal", "worst"]

# m, of a flat end behind the spheres round it: what is in the way meets the spheres, in a closed
# form, and not the end.
SETBACK: Final = 5e-5


class Piece(NamedTuple):
    """A convex piece of a part."""

    name: str
    shape: Shape
    X_BP: RigidTransform  # of the shape in the part's frame


@dataclass(frozen=True, kw_only=True)
class Material:
    """How pieces touch; all of it is assumed."""

    stiffness: float = 4e6  # N/m, of a point contact
    dissipation: float = 20.0  # s/m, of a point contact, as Hunt and Crossley
    friction: float = 0.2  # mu, Coulomb's

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "dissipation", "friction")


class Connector(Protocol):
    """A connector in contact."""

    @property
    def name(self) -> str:
        """What it is called."""

    @property
    def mated_depth(self) -> float:
        """Depth of a plug that is fully in, m."""

    @property
    def mating_force(self) -> float:
        """Largest force that the insertion of a plug in line takes, N."""

    @property
    def lead_in(self) -> float:
        """Depth up to which a plug beside its place still slides off sideways, m."""

    @property
    def mated_turn(self) -> float | None:
        """Turn of a mated plug about z, rad, or half a turn from that; None: as it went in."""

    @property
    def largest_force(self) -> float:
        """What plug and socket stand along any axis, N."""

    @property
    def largest_torque(self) -> float:
        """What plug and socket stand about any axis, N m."""

    @property
    def mass(self) -> float:
        """Of the plug, kg."""

    @property
    def material(self) -> Material:
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
    pieces: Sequence[Piece],
    material: Material,
    rgba: Array | None,
) -> None:
    """Add the pieces of a part to a body, to be touched and to be seen.

    Args:
        plant: Not yet finalized.
        body: Which holds them.
        X_BP: Place of the part's frame on the body.
        pieces: Convex ones.
        material: Of their contacts.
        rgba: Colour to be seen in, 0 to 1, shape (4,); None: they are not seen.
    """
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=material.dissipation,
        point_stiffness=material.stiffness,
        friction=CoulombFriction(material.friction, material.friction),
        properties=properties,
    )
    for piece in pieces:
        X = X_BP @ piece.X_BP
        plant.RegisterCollisionGeometry(body, X, piece.shape, piece.name, properties)
        if rgba is not None:
            plant.RegisterVisualGeometry(body, X, piece.shape, piece.name, rgba)
