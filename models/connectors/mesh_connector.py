"""A part of one's own: plug and socket of convex pieces out of mesh files.

Each object of a Wavefront file (``o`` or ``g``, vertices ``v``, faces ``f``) is one convex piece;
what isn't convex is divided first, by :func:`chamfer.models.connectors.convex_pieces.divide`. The
plug's file is in frame P, the socket's in frame S, as :mod:`chamfer.models.connectors.connector`
has
them: z against the direction of insertion, both origins where the parts in line just touch.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from pydrake.geometry import Convex
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from chamfer.models.connectors.connector import Array, Material, Piece, add_pieces
from chamfer.models.connectors.obj_file import Solid, read_solids
from chamfer.models.validation import ParameterError, require_positive

_PLUG_COLOUR: Final = np.array([0.8, 0.16, 0.16, 1.0])
_SOCKET_COLOUR: Final = np.array([0.16, 0.28, 0.8, 0.5])
_LARGEST: Final = 1.0  # m, of a part: beyond it the unit is wrong


@dataclass(frozen=True, kw_only=True)
class MeshConnector:
    """A plug and a socket from two files."""

    plug: str  # path of the .obj file of the plug
    socket: str  # path of the .obj file of the socket
    unit: float = 0.001  # m, of the files' lengths
    mated_depth: float  # m, of a plug that is fully in
    mating_force: float  # N, largest that the insertion of a plug in line takes
    lead_in: float = (
        0.0005  # m, depth up to which a plug beside its place still slides off sideways
    )
    largest_force: float = 100.0  # N, that plug and socket stand along any axis; assumed
    largest_torque: float = 1.5  # N m, that they stand about any axis; assumed
    mass: float = 0.02  # kg, of the plug; assumed
    material: Material = Material()  # of both

    def __post_init__(self) -> None:
        require_positive(self, "unit", "mated_depth", "mating_force", "lead_in")
        require_positive(self, "largest_force", "largest_torque", "mass")
        for name in ("plug", "socket"):
            path = getattr(self, name)
            try:
                solids = _solids(path)
            except (OSError, ValueError) as error:
                told = error.strerror if isinstance(error, OSError) else error
                allowed = f"a Wavefront file of convex objects ({told})"
                raise ParameterError(name, path, allowed) from error
            size = self.unit * float(np.ptp(_corners(solids), axis=0).max())
            if not size <= _LARGEST:
                allowed = f"lengths for which {path} is at most {_LARGEST:g} m large, not {size:g}"
                raise ParameterError("unit", self.unit, allowed)

    @property
    def name(self) -> str:
        """What it is called: as the plug's file."""
        return Path(self.plug).stem

    @property
    def plug_outline(self) -> Array:
        """Corners of the plug, m, in P, shape (n, 3); cameras see their convex hull."""
        return self.unit * _corners(_solids(self.plug))

    @property
    def socket_outline(self) -> Array:
        """Likewise of the socket, in S."""
        return self.unit * _corners(_solids(self.socket))

    @property
    def mated_turn(self) -> None:
        """It mates as it went in."""

    def with_mating_force(self, force: float) -> "MeshConnector":
        """Return the same parts with another mating force, N."""
        return replace(self, mating_force=force)

    def add_plug(self, plant: MultibodyPlant, body: RigidBody, X_BP: RigidTransform) -> None:
        """Add the plug to a body that holds it, X_BP its place there."""
        add_pieces(plant, body, X_BP, self._pieces(self.plug), self.material, _PLUG_COLOUR)

    def add_socket(self, plant: MultibodyPlant, X_WS: RigidTransform) -> None:
        """Add the socket, fixed to the world."""
        world = plant.world_body()
        add_pieces(plant, world, X_WS, self._pieces(self.socket), self.material, _SOCKET_COLOUR)

    def _pieces(self, path: str) -> list[Piece]:
        """Return the convex hull of each object, its origin in its middle."""
        pieces = []
        for i, solid in enumerate(_solids(path)):
            corners = self.unit * solid.corners
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
            shape = Convex((corners - middle).T, solid.name)
            pieces.append(Piece(f"{i} {solid.name}", shape, RigidTransform(middle)))
        return pieces


@lru_cache(maxsize=8)
def _solids(path: str) -> tuple[Solid, ...]:
    solids = read_solids(Path(path))
    for solid in solids:
        if not solid.convex:
            raise ValueError(f"{solid.name!r} is not convex, divide it first")
    return solids


def _corners(solids: tuple[Solid, ...]) -> Array:
    return np.vstack([solid.corners for solid in solids])
