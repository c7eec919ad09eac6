"""A round peg and its blind hole in contact: the parts of the first paper, as a plug and a socket.

The paper's parts have chamfers; here both edges are round, with radii as wide as the chamfers
would be, so that every pair that touches has a closed form:

* spheres round the peg's rim against the face, the round edge, the walls and the bottom of the
  hole, which are boxes and capsules in as many directions as there are spheres;
* the peg's side and end, two cylinders, against spheres round the hole's edge.

In the directions of the spheres, and about any axis across, the parts are the round ones; between
two of them the clearance is 8 % larger. A round peg has no turn. Its pieces therefore stand in the
axes of the body that holds it, however the grasp has turned it, and so do the hole's pieces.
A peg that turns by 5 degrees on its way loses 0.04 mm of its radius.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from pydrake.geometry import Box, Capsule, Cylinder, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from chamfer.models.arms.wrist import tip_displacement, tip_pose
from chamfer.models.connectors.connector import (
    SETBACK,
    Array,
    ConnectorPart,
    ContactMaterial,
    ConvexPiece,
    PartsConnector,
    block,
    prism,
    turns,
)
from chamfer.models.peg.peg_and_hole import PRESETS, PegAndHole, PegHoleGeometry
from chamfer.models.validation import ParameterError

_PAPER: Final = PegHoleGeometry()
_SIDES: Final = 8  # directions in which peg and hole are exactly round
_STEEL: Final = 7850.0  # kg/m^3
_PLATE: Final = 0.035  # m, half the side of the plate that the hole is in; assumed
_WALL: Final = 0.004  # m, thickness of what is touched on one side
_PEG_COLOUR: Final = np.array([0.8, 0.16, 0.16, 1.0])
_HOLE_COLOUR: Final = np.array([0.16, 0.28, 0.8, 0.5])
_TOLERANCE_WIDTH: Final = 1e-4  # m, of the paper's parts; assumed


def _round_presets() -> dict[str, dict[str, object]]:
    """Return the fields of a skill's peg for the named round parts.

    Lengths along the axis are the gripper's and the skill's. The error of the diameters is as
    large a share of the clearance as the paper's may be.
    """
    found: dict[str, dict[str, object]] = {}
    for name, given in PRESETS.items():
        parts = PegAndHole(**given)  # type: ignore[arg-type]
        if parts.is_round and given:
            found[name] = {
                "peg_radius": parts.peg_radius,
                "hole_radius": parts.hole_radius,
                "outer_radius": parts.outer_radius,
                "lead_in": parts.hole_chamfer.width,
                "tolerance_width": parts.clearance * _TOLERANCE_WIDTH / _PAPER.clearance,
                "material": ContactMaterial(friction=parts.friction),
            }
        elif parts.is_round:
            found[name] = {}  # the paper's are the defaults
    return found


@dataclass(frozen=True, kw_only=True)
class RoundPeg(PartsConnector):
    """A round peg in contact; radii and friction of the first paper, the rest is assumed."""

    hole_radius: float = _PAPER.hole_radius  # m, R of the bore; first paper, section 4
    peg_radius: float = _PAPER.peg_radius  # m, r of the peg; first paper, section 4
    tolerance_width: float = _TOLERANCE_WIDTH  # m, largest error of each diameter; assumed
    lead_in: float = 0.5e-3  # m, radius of the peg's rim and of the hole's edge, each; assumed
    depth: float = 0.015  # m, of the blind hole; assumed
    peg_length: float = 0.024  # m, from end to end; assumed
    outer_radius: float = 0.014  # m, of the visible part with the hole; assumed
    hole_length: float = 0.03  # m, of the part with the hole; assumed
    seating_force: float = 20.0  # N, with which the peg counts as pressed home; assumed
    largest_force: float = 500.0  # N, that plug and socket withstand along any axis; assumed
    largest_torque: float = 10.0  # N m, that they withstand about any axis; assumed
    material: ContactMaterial = ContactMaterial(friction=_PAPER.friction)  # of both

    NAME: ClassVar[str] = "round peg"
    PARTNERS: ClassVar[Sequence[tuple[str, str]]] = (
        ("peg rim", "hole"),
        ("peg side", "hole edge"),
    )
    PRESETS: ClassVar[Mapping[str, Mapping[str, object]]] = _round_presets()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.peg_radius + self.tolerance_width < self.hole_radius:
            allowed = f"less than hole_radius - tolerance_width, of {self.hole_radius!r} m"
            raise ParameterError("peg_radius", self.peg_radius, allowed)
        if not 2 * self.lead_in < min(self.peg_radius, self.depth):
            raise ParameterError(
                "lead_in", self.lead_in, "less than half the peg's radius and the depth"
            )
        if not self.depth < self.peg_length:
            raise ParameterError("depth", self.depth, f"less than peg_length, {self.peg_length} m")
        if not self.depth < self.hole_length:
            raise ParameterError("hole_length", self.hole_length, f"more than {self.depth} m")
        if not self.hole_radius + self.lead_in < _PLATE:
            allowed = f"less than {_PLATE} m with lead_in, in its plate"
            raise ParameterError("hole_radius", self.hole_radius, allowed)
        if not self.outer_radius > self.hole_radius + 2 * self.lead_in:
            allowed = "more than hole_radius + 2 lead_in"
            raise ParameterError("outer_radius", self.outer_radius, allowed)

    @property
    def mated_depth(self) -> float:
        """Depth at which the peg stands on the bottom of the hole, m."""
        return self.depth

    @property
    def mating_force(self) -> float:
        """Force that presses the peg home, N: a peg in line meets nothing else."""
        return self.seating_force

    def with_mating_force(self, force: float) -> "RoundPeg":
        """Return the same parts with another force that presses the peg home, N."""
        return replace(self, seating_force=force)

    @property
    def mass(self) -> float:
        """Of the peg, of steel, kg."""
        return _STEEL * math.pi * self.peg_radius**2 * self.peg_length

    @property
    def clearance(self) -> float:
        """``R - r``, m, at this tolerance."""
        return self._bore - self._peg

    @property
    def plug_outline(self) -> Array:
        """Corners of the peg, a prism of 16 sides, m, in P, shape (32, 3)."""
        return prism(self.peg_radius, 0.0, self.peg_length)

    @property
    def socket_outline(self) -> Array:
        """Corners of the part with the hole, likewise, in S."""
        return prism(self.outer_radius, -self.hole_length, 0.0)

    def add_plug(self, plant: MultibodyPlant, body: RigidBody, X_BP: RigidTransform) -> None:
        """Add the peg to a body that holds it, X_BP its place there; its turn has no effect."""
        displacement = tip_displacement(X_BP)
        displacement[2] = 0.0
        super().add_plug(plant, body, tip_pose(displacement))

    @property
    def _spread(self) -> float:
        """Error of a radius, m."""
        return self.tolerance_width / 2 if self.tolerance == "worst" else 0.0

    @property
    def _bore(self) -> float:
        return self.hole_radius - self._spread

    @property
    def _peg(self) -> float:
        return self.peg_radius + self._spread

    def plug_parts(self) -> list[ConnectorPart]:
        """Return rim and side of the peg, in P."""
        edge, length = self.lead_in, self.peg_length
        rim = Sphere(edge)
        place = np.array([self._peg - edge, 0.0, edge])
        side = Cylinder(self._peg, length - edge)
        end = Cylinder(self._peg - edge, length - SETBACK)
        spheres = [
            ConvexPiece(f"{i}", rim, RigidTransform(R @ place))
            for i, R in enumerate(turns(_SIDES))
        ]
        cylinders = [
            ConvexPiece("side", side, RigidTransform([0.0, 0.0, (length + edge) / 2])),
            ConvexPiece("end", end, RigidTransform([0.0, 0.0, (length + SETBACK) / 2])),
        ]
        return [
            ConnectorPart("peg rim", spheres, self.material, _PEG_COLOUR),
            ConnectorPart("peg side", cylinders, self.material, _PEG_COLOUR),
        ]

    def socket_parts(self) -> list[ConnectorPart]:
        """Return the hole and its edge, in S."""
        bore, edge, depth = self._bore, self.lead_in, self.depth
        shares = 2 * math.tan(math.pi / _SIDES)  # of a side in its distance from the axis
        outer = _PLATE
        wall = Box(_WALL, shares * (bore + _WALL), depth - edge)
        wall_at = np.array([bore + _WALL / 2, 0.0, -(depth + edge) / 2])
        face = Box(outer - bore - edge, shares * outer, _WALL)
        face_at = np.array([(outer + bore + edge) / 2, 0.0, -_WALL / 2])
        line = Capsule(edge, shares * (bore + edge))
        along = RotationMatrix.MakeXRotation(math.pi / 2)
        edge_at = np.array([bore + edge, 0.0, -edge])
        wide = bore + _WALL
        hole = [block("bottom", (-wide, -wide, -self.hole_length), (wide, wide, -depth))]
        points = []
        for i, R in enumerate(turns(_SIDES)):
            hole += [
                ConvexPiece(f"wall_{i}", wall, RigidTransform(R, R @ wall_at)),
                ConvexPiece(f"face_{i}", face, RigidTransform(R, R @ face_at)),
                ConvexPiece(f"line_{i}", line, RigidTransform(R @ along, R @ edge_at)),
            ]
            points.append(ConvexPiece(f"{i}", Sphere(edge), RigidTransform(R @ edge_at)))
        return [
            ConnectorPart("hole", hole, self.material, _HOLE_COLOUR),
            ConnectorPart("hole edge", points, self.material, _HOLE_COLOUR),
        ]
