"""Peg and hole as Drake's collision geometry: convex pieces that touch at points.

The round peg is one convex prism with a chamfer, the hole a ring of convex wedges around the
bore, each with its facet of chamfer and bore, and a plate below a blind one. The wedges' facets
are as far from the axis as the round hole's wall, the peg's corners as far as its side, and both
stand in the frames' y and z: in these planes of insertion the parts are exactly the round ones,
and between two of the peg's corners the clearance differs by what :func:`sagitta` says.

A square peg is one piece with its own four faces. Each wall of its hole is a row of wedges side by
side, each of which touches it at a point: where faces are parallel the row carries them upright.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    AddContactMaterial,
    Box,
    Convex,
    Cylinder,
    GeometryId,
    ProximityProperties,
    Shape,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RigidBody
from scipy.special import lambertw

from chamfer.models.peg.part_surfaces import SQUARE, around, swept
from chamfer.models.peg.peg_and_hole import HolePart, PegAndHole, PegHoleGeometry
from chamfer.models.validation import ParameterError, require_not_negative, require_positive

Array = NDArray[np.float64]

FEWEST: Final = 64  # facets
_MOST: Final = 4096
_FINE: Final = 0.1  # of the clearance, the largest sagitta
_BESIDE: Final = 4  # pieces of each wall of a square hole
_MULTIPLE: Final = 4  # so that a facet faces each of +-y and +-z


@dataclass(frozen=True, kw_only=True)
class ContactMaterial:
    """How stiff the points are at which the pieces touch.

    Not a material constant: rigid parts, made just soft enough for the solver. What depends on
    it is in the experiment contact-convergence.
    """

    stiffness: float = 2e6  # N/m, of each part; two in series at a point; assumed
    dissipation: float = 20.0  # s/m, of Hunt and Crossley; assumed
    facets: int | None = None
    # of a round bore and peg, or pieces of a square bore's walls; None: derived from the parts

    def __post_init__(self) -> None:
        require_positive(self, "stiffness")
        require_not_negative(self, "dissipation")
        if self.facets is not None and self.facets not in range(_MULTIPLE, _MOST + 1, _MULTIPLE):
            allowed = f"a multiple of {_MULTIPLE} up to {_MOST}, or null"
            raise ParameterError("facets", self.facets, allowed)

    def restitution(self, speed: float) -> float:
        """Return e of a body that strikes a plate at a speed, m/s, whatever mass and stiffness.

        Of ``k x (1 + d v)`` energy says ``d v - ln(1 + d v) = -d e v - ln(1 - d e v)``.
        """
        if not (x := self.dissipation * speed):
            return 1.0
        return float((1 + lambertw(-np.exp(np.log1p(x) - x - 1)).real) / x)

    def over(self, parts: PegAndHole) -> "ContactMaterial":
        """Return this with the facets, if they are left open, that the parts ask for."""
        if self.facets is not None:
            if parts.section == "square" and self.facets != facets_needed(parts):
                raise ParameterError("contact.facets", self.facets, "null of square parts")
            return self
        return replace(self, facets=facets_needed(parts))


def sagitta(radius: float, facets: int) -> float:
    """Return how far the middle of a polygon's side is inside of its corners' circle, m."""
    return radius * (1 - math.cos(math.pi / facets))


def facets_needed(parts: PegAndHole) -> int:
    """Return how many facets keep the sagitta below a tenth of the clearance, at least 64.

    Square parts have no sagitta: as many as stand side by side on the four walls.
    """
    if parts.section == "square":
        return 4 * _BESIDE
    tenth = _FINE * parts.clearance
    facets = FEWEST
    while sagitta(parts.hole_radius, facets) > tenth and facets < _MOST:
        facets += _MULTIPLE
    return facets


def add_peg_contact(
    plant: MultibodyPlant,
    body: RigidBody,
    X_BT: RigidTransform,
    parts: PegAndHole,
    material: ContactMaterial,
) -> list[GeometryId]:
    """Add a peg, to be touched, to the body that holds it, at X_BT, before Finalize."""
    ring = around(_facets(material), "round") if parts.section == "round" else SQUARE
    shape = Convex(swept(parts.peg.profile, ring).reshape(-1, 3).T, "peg")
    return _add(plant, body, X_BT, [("peg", shape, RigidTransform())], parts, material)


def add_hole_contact(
    plant: MultibodyPlant,
    body: RigidBody,
    X_BM: RigidTransform,
    parts: PegAndHole,
    material: ContactMaterial,
) -> list[GeometryId]:
    """Add the part with the hole likewise; X_BM is its frame on the body."""
    facets, hole = _facets(material), parts.hole
    pieces: list[tuple[str, Shape, RigidTransform]] = []
    walls, sides = facets, np.array([-1.0, 1.0]) * math.tan(math.pi / facets)
    if parts.section == "square":
        walls, sides = 4, np.linspace(-1.0, 1.0, facets // 4 + 1)
    for k in range(walls):
        R_MW = RotationMatrix.MakeXRotation(2 * math.pi * k / walls)
        for beside in pairwise(sides.tolist()):
            wedge = Convex(_wedge_points(hole, beside), "wedge")
            pieces.append((f"wedge {len(pieces)}", wedge, RigidTransform(R_MW, np.zeros(3))))
    if hole.bore_depth is not None:
        thickness = hole.depth - hole.bore_depth
        R_MC = RotationMatrix.MakeYRotation(math.pi / 2)
        X_MC = RigidTransform(R_MC, [hole.bore_depth + thickness / 2, 0.0, 0.0])
        bottom: Shape = Cylinder(hole.outer_radius, thickness)
        if parts.section == "square":
            bottom = Box(2 * hole.outer_radius, 2 * hole.outer_radius, thickness)
        pieces.append(("bottom", bottom, X_MC))
    return _add(plant, body, X_BM, pieces, parts, material)


def _facets(material: ContactMaterial) -> int:
    if material.facets is None:
        raise ParameterError("facets", None, "a number, see ContactMaterial.over")
    return material.facets


def require_resolved_clearance(parts: PegHoleGeometry, speed: float, step: float) -> None:
    """Refuse steps, s, in which a feed, m/s, can cross the clearance and feel no wall."""
    across = 2 * parts.clearance
    if not speed <= resolved_speed(parts, step):
        sides = f"a feed by the clearance of both sides, {across:g} m"
        raise ParameterError("step", step, f"at most {across / speed:g} s: {sides}")


def resolved_speed(parts: PegHoleGeometry, step: float) -> float:
    """Return the fastest feed, m/s, that does not cross both sides' clearance in a step, s."""
    return 2 * parts.clearance / step


def _wedge_points(hole: HolePart, beside: tuple[float, float]) -> Array:
    """Return the corners of a wedge that faces +y, m, shape (3, n).

    It is as long along z as ``beside`` says, in shares of its distance from the axis along y.
    """
    profile = np.vstack([hole.bore, hole.outside])
    sides = [np.stack([profile[:, 0], profile[:, 1], one * profile[:, 1]]) for one in beside[::-1]]
    return np.concatenate(sides, axis=1)


def point_contact(stiffness: float, dissipation: float, friction: float) -> ProximityProperties:
    """Return the contact of points: N/m, Hunt-Crossley dissipation in s/m, and Coulomb's mu."""
    properties = ProximityProperties()
    AddContactMaterial(
        dissipation=dissipation,
        point_stiffness=stiffness,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    return properties


def _add(
    plant: MultibodyPlant,
    body: RigidBody,
    X_BP: RigidTransform,
    pieces: list[tuple[str, Shape, RigidTransform]],
    parts: PegAndHole,
    material: ContactMaterial,
) -> list[GeometryId]:
    properties = point_contact(material.stiffness, material.dissipation, parts.friction)
    return [
        plant.RegisterCollisionGeometry(body, X_BP @ X_PS, shape, name, properties)
        for name, shape, X_PS in pieces
    ]
