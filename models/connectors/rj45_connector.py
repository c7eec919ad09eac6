"""The RJ45 plug (8P8C, IEC 60603-7) and its jack in contact.

The plug is a block with a round leading rim, the jack a cavity with a round mouth and a stop at
its end, flush in a plate. Spheres at the rim's corners touch the jack, spheres along the mouth
touch the plug's sides.

The latch is two noses on the plug, beside its tab, whose contacts have the stiffness of the lever
that they stand for. On the way in each rides up a ramp, and behind the ramp's edge
it springs back, which is the click; pulled, it meets the edge. Opposed along x, the noses leave no
force across. The eight contacts are two soft spheres in the jack, which press on one side of the
plug alone.

Not modelled: the slots between the contacts and the key way of the latch, in which the plug has
more clearance than in the cavity.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import ClassVar, Final

import numpy as np
from pydrake.geometry import Box, Capsule, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.connectors.connector import (
    SETBACK,
    Array,
    ConnectorPart,
    ContactMaterial,
    ConvexPiece,
    Range,
    SprungConnector,
    at,
    block,
    box_corners,
)
from chamfer.models.validation import ParameterError

_SIDES: Final = (1.0, -1.0)
_WALL: Final = 0.004  # m, thickness of what is touched on one side
_PLATE: Final = 0.025  # m, half the side of the plate that the jack is flush with; assumed
_CONTACT_PLACE: Final = 0.0025  # m, along x, of each of the spheres that stand for four contacts
_NOSE_PLACE: Final = 0.0025  # m, along x, of each nose of the latch, when it is free
_NOSE_BELOW: Final = 0.0015  # m, of the noses below the plug's body, along y
_PLASTIC: Final = np.array([0.75, 0.8, 0.85, 0.6])
_JACK: Final = np.array([0.25, 0.25, 0.28, 0.6])
_GOLD: Final = np.array([0.85, 0.65, 0.2, 1.0])


@dataclass(frozen=True, kw_only=True)
class Rj45Connector(SprungConnector):
    """A plug and a jack; pairs are the smallest and the largest dimension allowed.

    The widths and heights are those of the miniature 8-position plug and jack, which are drawn in
    47 CFR 68.500 (68.502 is about their wiring) and, later, in TIA-1096 and IEC 60603-7. They are
    written here from memory: public copies of the rule that were searched have its text without
    the drawings. In inches, which the text says are the original units, they come to 0.456 to
    0.464 and 0.256 to 0.260 of the plug, 0.468 to 0.474 and 0.263 to 0.269 of the jack. Forces:
    Neutrik's data sheet of the RJ45 receptacle NE8FDV-Y110 allows 20 N for the insertion of a
    plug, and 20 N to withdraw it. In the standard a latched plug holds 50 N, from memory; this
    latch, of two springs, gives way at less, :attr:`retention`.
    """

    plug_width: Range = (11.58e-3, 11.79e-3)  # m, of the body, least and most; from memory
    plug_height: Range = (6.50e-3, 6.60e-3)  # m, of the body without its latch; from memory
    jack_width: Range = (11.89e-3, 12.04e-3)  # m, of the cavity; from memory
    jack_height: Range = (6.68e-3, 6.83e-3)  # m, of the cavity; from memory
    lead_in: float = 0.5e-3  # m, radius of the plug's rim and of the jack's mouth, each; assumed
    travel: float = 9.5e-3  # m, from first touch in line to the stop; assumed
    plug_length: float = 21.5e-3  # m, of the body; from memory
    latch_force: float = 10.0  # N, of each of two noses on its ramp, bent the most; assumed
    latch_deflection: float = 0.84e-3  # m, of a nose at the ramp's edge; assumed
    latch_radius: float = 1.2e-3  # m, of a nose's round end; assumed
    latch_angle: float = math.radians(20)  # rad, of the ramps from the insertion; assumed
    latch_place: float = 6e-3  # m, of the noses behind the plug's leading face; assumed
    latch_play: float = 0.2e-3  # m, of a pull on a mated plug until the latch holds it; assumed
    contact_force: float = 1.0  # N, of each of eight contacts; 0.98 N (100 gf) from memory
    contact_deflection: float = 0.3e-3  # m, of a contact, by a plug on the wall opposite; assumed
    contact_depth: float = 5e-3  # m, of the contacts in the jack; assumed
    contact_radius: float = 1e-3  # m, of a contact's bend; assumed
    mass: float = 0.003  # kg, of the plug; assumed

    NAME: ClassVar[str] = "RJ45"
    PARTNERS: ClassVar[Sequence[tuple[str, str]]] = (
        ("plug rim", "jack cavity"),
        ("plug body", "jack mouth"),
        ("plug body", "jack contacts"),
        ("plug latch", "jack ledge"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for plug, jack in (("plug_width", "jack_width"), ("plug_height", "jack_height")):
            least = getattr(self, jack)[0]
            if not getattr(self, plug)[1] < least:
                raise ParameterError(plug, getattr(self, plug), f"less than the jack's, {least} m")
        if not self.jack_width[1] + 2 * self.lead_in < 2 * _PLATE:
            allowed = f"less than the plate's, {2 * _PLATE} m, with its round edges"
            raise ParameterError("jack_width", self.jack_width, allowed)
        if not 4 * self.lead_in < self.plug_height[0]:
            raise ParameterError("lead_in", self.lead_in, "less than a quarter of plug_height")
        if not self.travel < self.plug_length:
            raise ParameterError("travel", self.travel, f"less than {self.plug_length} m")
        if not self.latch_deflection < self.latch_radius:
            allowed = f"less than latch_radius, {self.latch_radius} m"
            raise ParameterError("latch_deflection", self.latch_deflection, allowed)
        if not 0 < self.latch_angle < math.pi / 4:
            raise ParameterError("latch_angle", self.latch_angle, "0 < angle < pi/4 rad")
        if not 0 < self.latch_place < self.click_depth:
            allowed = (
                f"less than {self.click_depth:.3g} m, so that the ramps' edges are in the jack"
            )
            raise ParameterError("latch_place", self.latch_place, allowed)
        if not self.contact_deflection < min(self.contact_radius, self.lead_in):
            allowed = "less than contact_radius and lead_in"
            raise ParameterError("contact_deflection", self.contact_deflection, allowed)
        if not self.contact_radius < self.contact_depth < self.travel - self.contact_radius:
            allowed = "between contact_radius and travel - contact_radius"
            raise ParameterError("contact_depth", self.contact_depth, allowed)

    @property
    def mated_depth(self) -> float:
        """Depth at which the plug meets the stop of the jack, m."""
        return self.travel

    @property
    def click_depth(self) -> float:
        """Depth at which the noses pass the edges of their ramps, m."""
        return self.travel - self._reach - self.latch_play

    @property
    def clearance(self) -> Array:
        """Clearance per side along x and y, m, shape (2,)."""
        return (self._jack_size - self._plug_size) / 2

    @property
    def mating_force(self) -> float:
        """Largest force of the insertion of a plug in line, N."""
        return float(self.insertion_force(np.linspace(0.0, self.travel, 1000)).max())

    def with_mating_force(self, force: float) -> "Rj45Connector":
        """Return the same connector with springs for another force, N."""
        share = force / self.mating_force
        return replace(
            self, latch_force=share * self.latch_force, contact_force=share * self.contact_force
        )

    @property
    def retention(self) -> float:
        """Largest pull that the latch holds, N, without the contacts' friction."""
        below = self.click_depth + np.linspace(1e-6, self.latch_radius, 500)
        return float(-self._latch(below, -1.0).min())

    @property
    def plug_outline(self) -> Array:
        """Corners of the convex body that a camera sees, m, in P, shape (8, 3)."""
        width, height = self._plug_size.tolist()
        return box_corners(width, height, 0.0, self.plug_length)

    @property
    def socket_outline(self) -> Array:
        """Likewise of the jack behind its plate, in S."""
        width, height = (self._jack_size + 0.012).tolist()  # assumed
        return box_corners(width, height, -self.travel - _WALL, 0.0)

    def insertion_force(self, depth: Array) -> Array:
        """Return the force against a slow insertion in line, N, at depths in m."""
        mu = self.material.friction
        height = np.clip(self.contact_depth + self.lead_in - depth, 0.0, None)
        side = self.contact_radius - self.contact_deflection
        distance = np.hypot(height, side)
        press = 2 * self._contact_stiffness * np.clip(self.contact_radius - distance, 0.0, None)
        axial, lateral = height / distance, side / distance
        # What they press across, the wall opposite bears.
        contacts = press * (axial + mu * lateral + mu * (lateral - mu * axial))
        force: Array = self._latch(depth, 1.0) + contacts
        return force

    def _latch(self, depth: Array, way: float) -> Array:
        """Return both noses' force against the insertion, N, on the way in, 1, or out, -1."""
        mu, stiffness = way * self.material.friction, 2 * self._latch_stiffness
        sine, cosine = math.sin(self.latch_angle), math.cos(self.latch_angle)
        above = self.click_depth - depth  # of the noses' centres above the edges
        bent = np.clip(self.latch_radius - self._side * cosine - above * sine, 0.0, None)
        ramp = stiffness * bent * (sine + mu * cosine)
        distance = np.hypot(above, self._side)
        bent = np.clip(self.latch_radius - distance, 0.0, None)
        edge = stiffness * bent * (above + mu * self._side) / distance
        force: Array = np.where(above * cosine > self._side * sine, ramp, edge)
        return force

    def plug_parts(self) -> list[ConnectorPart]:
        """Return rim, body and latch, in P."""
        hard, latch, _ = self._materials
        return [
            ConnectorPart("plug rim", self._rim(), hard, _PLASTIC),
            ConnectorPart("plug body", self._body(), hard, _PLASTIC),
            ConnectorPart("plug latch", self._noses(), latch, _GOLD),
        ]

    def socket_parts(self) -> list[ConnectorPart]:
        """Return the jack's cavity, mouth, ledges and contacts, in S."""
        hard, latch, contact = self._materials
        return [
            ConnectorPart("jack cavity", self._cavity(), hard, _JACK),
            ConnectorPart("jack mouth", self._mouth(), hard, _JACK),
            ConnectorPart("jack ledge", self._ledges(), latch, _JACK),
            ConnectorPart("jack contacts", self._bends(), contact, _GOLD),
        ]

    def _size(self, width: Range, height: Range, tight: int) -> Array:
        return np.array([self.pick(width, tight=tight), self.pick(height, tight=tight)])

    @property
    def _plug_size(self) -> Array:
        return self._size(self.plug_width, self.plug_height, 1)

    @property
    def _jack_size(self) -> Array:
        return self._size(self.jack_width, self.jack_height, 0)

    @property
    def _latch_stiffness(self) -> float:
        """Of each nose on its ramp, N/m."""
        return self.latch_force / self.latch_deflection

    @property
    def _contact_stiffness(self) -> float:
        """Of four contacts, which one bend stands for, N/m."""
        return 4 * self.contact_force / self.contact_deflection

    @property
    def _materials(self) -> tuple[ContactMaterial, ContactMaterial, ContactMaterial]:
        """Of plug and jack, latch and contacts; two pieces that touch are springs in series."""
        latch = self.spring(2 * self._latch_stiffness)
        return self.material, latch, self.spring(self._contact_stiffness)

    @property
    def _side(self) -> float:
        """From a nose's centre to the edge of its ramp, along x, m."""
        return self.latch_radius - self.latch_deflection

    @property
    def _reach(self) -> float:
        """Distance of a nose's centre behind the edge at which the nose leaves it, m."""
        return math.sqrt(self.latch_radius**2 - self._side**2)

    def _rim(self) -> list[ConvexPiece]:
        """Return spheres at the corners of the plug's leading face."""
        x, y = self._plug_size / 2 - self.lead_in
        return [
            ConvexPiece(f"{i:+g}_{j:+g}", Sphere(self.lead_in), at(i * x, j * y, self.lead_in))
            for i, j in product(_SIDES, _SIDES)
        ]

    def _body(self) -> list[ConvexPiece]:
        """Return the plug's body behind its round rim, and the end within the rim."""
        x, y = self._plug_size / 2
        e, length = self.lead_in, self.plug_length
        return [
            block("side", (-x, -y, e), (x, y, length)),
            block("end", (e - x, e - y, SETBACK), (x - e, y - e, length)),
        ]

    def _noses(self) -> list[ConvexPiece]:
        y = -self._plug_size[1] / 2 - _NOSE_BELOW
        nose = Sphere(self.latch_radius)
        return [
            ConvexPiece(f"{i:+g}", nose, at(i * _NOSE_PLACE, y, self.latch_place)) for i in _SIDES
        ]

    def _ledges(self) -> list[ConvexPiece]:
        """Return a ramp outside of each nose, whose lower end is the edge."""
        y = -self._plug_size[1] / 2 - _NOSE_BELOW
        length = 2 * self.latch_radius / math.tan(self.latch_angle)
        ramp = Box(_WALL, 4 * self.latch_radius, length)
        pieces = []
        for i in _SIDES:
            # In the ramp's axes it begins at the origin, its surface towards the nose.
            R = RotationMatrix.MakeYRotation(i * self.latch_angle)
            edge = [i * (_NOSE_PLACE + self._side), y, self.latch_place - self.click_depth]
            middle = np.array(edge) + R.matrix() @ [i * _WALL / 2, 0.0, length / 2]
            pieces.append(ConvexPiece(f"{i:+g}", ramp, RigidTransform(R, middle)))
        return pieces

    def _bends(self) -> list[ConvexPiece]:
        """Return the contacts' bends, deflected by a plug that lies on the wall opposite."""
        top = self._plug_size[1] - self._jack_size[1] / 2
        y = top + self.contact_radius - self.contact_deflection
        bend = Sphere(self.contact_radius)
        return [
            ConvexPiece(f"{i:+g}", bend, at(i * _CONTACT_PLACE, y, -self.contact_depth))
            for i in _SIDES
        ]

    def _cavity(self) -> list[ConvexPiece]:
        """Return the walls below the mouth, its round edges, the face around it and the stop."""
        (x, y), far, high, e = self._jack_size / 2, _PLATE, _PLATE, self.lead_in
        low = -self.travel - _WALL
        pieces = [block("stop", (-far, -high, low), (far, high, -self.travel))]
        for i in _SIDES:
            pieces += [
                block(f"wall_x{i:+g}", (i * x, -high, low), (i * far, high, -e)),
                block(f"wall_y{i:+g}", (-far, i * y, low), (far, i * high, -e)),
                block(f"face_x{i:+g}", (i * (x + e), -high, low), (i * far, high, 0.0)),
                block(f"face_y{i:+g}", (-far, i * (y + e), low), (far, i * high, 0.0)),
                _line(f"edge_x{i:+g}", e, (i * (x + e), 0.0, -e), 2 * (y + e), along_x=False),
                _line(f"edge_y{i:+g}", e, (0.0, i * (y + e), -e), 2 * (x + e), along_x=True),
            ]
        return pieces

    def _mouth(self) -> list[ConvexPiece]:
        """Return spheres at both ends of every edge of the mouth."""
        (x, y), e = self._jack_size / 2, self.lead_in
        places = [(i * x, j * (y + e)) for i, j in product(_SIDES, _SIDES)]
        places += [(i * (x + e), j * y) for i, j in product(_SIDES, _SIDES)]
        return [ConvexPiece(f"{k}", Sphere(e), at(*place, -e)) for k, place in enumerate(places)]


def _line(
    name: str, radius: float, middle: Sequence[float], length: float, *, along_x: bool
) -> ConvexPiece:
    """Return a capsule along x or y, m."""
    quarter = math.pi / 2
    turn = RotationMatrix.MakeYRotation if along_x else RotationMatrix.MakeXRotation
    return ConvexPiece(
        name, Capsule(radius, length), RigidTransform(turn(quarter), np.array(middle))
    )
