"""The 25-pin D connector (Fig. 3) in contact.

The plug's shell goes over the socket's. Both rims are round: spheres along the plug's rim touch
the socket's walls and rim, spheres along the socket's rim touch the plug's walls and the bottom
of its shell. Every such pair has a closed form. The ends of the straight edges, where a tilted
or turned D touches first, are among the spheres.

The pin field is lumped into four pins, each between two tines. A tine is a block whose contact has
the stiffness of the springs that it stands for; the gap between two tines is smaller than the pin.
Two of the four are held along x, two along y, so that a plug in line feels no force across.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import ClassVar, Final

import numpy as np
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.connectors.connector import (
    Array,
    ConnectorPart,
    ContactMaterial,
    ConvexPiece,
    Range,
    SprungConnector,
    at,
    box_corners,
    capsule,
)
from chamfer.models.validation import ParameterError, require_not_negative, require_positive

LUMPS: Final = 4  # pins that stand for all contacts, evenly along the row
CHORDS: Final = 2  # of the socket's rim in each corner
WALL: Final = 0.003  # m, thickness of the plug's walls, outwards, where nothing else is
METAL: Final = np.array([0.75, 0.75, 0.78, 1.0])
GOLD: Final = np.array([0.85, 0.65, 0.2, 1.0])
EDGES: Final = range(4)


@dataclass(frozen=True, kw_only=True)
class DSection:
    """The section of a D, measured over all: a trapezoid with rounded corners.

    Edges and corners are counted to the left, from the wide edge: 0 wide, 1 left, 2 narrow, 3
    right; corner ``i`` is where edge ``i`` begins. x is along the D, y towards its wide edge.
    """

    width: float  # m, between the outermost points of the wide corners
    height: float  # m, between the wide and the narrow edge
    corner_radius: float  # m
    side_angle: float  # rad, of each side from y

    def __post_init__(self) -> None:
        require_positive(self, "width", "height", "corner_radius")
        if not 0 <= self.side_angle < math.pi / 4:
            raise ParameterError("side_angle", self.side_angle, "0 <= angle < pi/4 rad")
        if not 2 * self.corner_radius < self.height:
            allowed = f"less than half the height, {self.height / 2:.3g} m"
            raise ParameterError("corner_radius", self.corner_radius, allowed)
        if not self.centres[3, 0] > 0:
            raise ParameterError("width", self.width, "enough for a narrow edge")

    def grown(self, by: float) -> "DSection":
        """Return the section whose outline is further out by ``by``, m, everywhere."""
        return replace(
            self,
            width=self.width + 2 * by,
            height=self.height + 2 * by,
            corner_radius=self.corner_radius + by,
        )

    @property
    def centres(self) -> Array:
        """Centres of the corners' arcs, m, shape (4, 2)."""
        x = self.width / 2 - self.corner_radius
        y = self.height / 2 - self.corner_radius
        narrow = x - 2 * y * math.tan(self.side_angle)
        return np.array([[x, y], [-x, y], [-narrow, -y], [narrow, -y]])

    @property
    def directions(self) -> Array:
        """Directions of the edges' outward normals, rad from x to y, shape (4,)."""
        quarters = np.array([1.0, 2.0, 3.0, 4.0]) * math.pi / 2
        lean = np.array([0.0, self.side_angle, 0.0, -self.side_angle])
        directions: Array = quarters + lean
        return directions

    @property
    def edges(self) -> Array:
        """First and last point of the straight part of each edge, m, shape (4, 2, 2)."""
        ends = np.stack([self.centres, np.roll(self.centres, -1, axis=0)], axis=1)
        edges: Array = ends + self.corner_radius * _unit(self.directions)[:, None, :]
        return edges

    def arc(self, corner: int, chords: int) -> Array:
        """Return points along a corner's arc, to the left, m, shape (chords + 1, 2)."""
        last = self.directions[corner]
        first = self.directions[corner - 1] - (2 * math.pi if corner == 0 else 0)
        directions = np.linspace(first, last, chords + 1)
        points: Array = self.centres[corner] + self.corner_radius * _unit(directions)
        return points


def _unit(direction: Array) -> Array:
    """Return unit vectors, shape (n, 2)."""
    unit: Array = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    return unit


@dataclass(frozen=True, kw_only=True)
class DConnector(SprungConnector):
    """A plug and a socket; lengths from the reference table unless assumed."""

    plug_width: Range = (38.84e-3, 39.09e-3)  # m, of the shell, inside
    plug_height: Range = (8.23e-3, 8.48e-3)  # m, of the shell, inside
    plug_length: Range = (5.82e-3, 6.05e-3)  # m, of the shell along the insertion
    socket_width: Range = (38.25e-3, 38.51e-3)  # m, of the shell, outside; from memory
    socket_height: Range = (7.77e-3, 8.03e-3)  # m, of the shell, outside
    socket_length: Range = (6.05e-3, 6.30e-3)  # m, of the shell along the insertion
    side_angle: float = math.radians(10)  # rad, of both shells' sides from y
    plug_corner: float = 2.62e-3  # m, radius of the shell's corners, inside
    socket_corner: float = 2.59e-3  # m, radius of the shell's corners, outside
    lead_in: float = 0.5e-3  # m, radius of each rim; assumed
    travel: float = 5.6e-3  # m, from first touch in line to mated
    contacts: int = 25  # number of pins, and of tines
    pitch: float = 2.77e-3  # m, between neighbours in a row of contacts
    pin_diameter: Range = (0.991e-3, 1.041e-3)  # m, of each pin
    pin_funnel: float = 0.5e-3  # m, largest error at which a pin still enters; assumed
    pin_recess: float = 1.0e-3  # m, of the pins' tips behind the plug's rim; assumed
    pin_depth: float = 2.5e-3  # m, of the plug where pins and tines first touch; assumed
    tine_force: float = 2.55  # N, of each of the two tines on a contact's pin; assumed, for 45 N
    tine_deflection: float = 0.15e-3  # m, spread of each tine by a pin of middle diameter; assumed
    largest_force: float = 200.0  # N, that plug and socket withstand along any axis; assumed
    largest_torque: float = 5.0  # N m, that they withstand about any axis; assumed
    mass: float = 0.04  # kg, of the plug with its hood; assumed

    NAME: ClassVar[str] = "25-pin D"
    PARTNERS: ClassVar[Sequence[tuple[str, str]]] = (
        ("plug rim", "socket walls"),
        ("plug walls", "socket rim"),
        ("plug pins", "socket tines"),
    )
    MAY_BE_ZERO: ClassVar[Sequence[str]] = (
        *SprungConnector.MAY_BE_ZERO,
        "pin_funnel",
        "side_angle",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "contacts")
        require_not_negative(self, "pin_funnel")
        if not np.all(self.clearance > 0):
            allowed = f"more than the socket's, {self.socket_width} x {self.socket_height} m"
            raise ParameterError("plug_width", (self.plug_width, self.plug_height), allowed)
        if not self.lead_in < self.socket_corner:
            allowed = f"less than the socket's corner radius, {self.socket_corner} m"
            raise ParameterError("lead_in", self.lead_in, allowed)
        if not 2 * self.lead_in < self.travel < (longest := min(self._lengths)):
            allowed = f"more than two lead-ins, less than the shells' length, {longest:.3g} m"
            raise ParameterError("travel", self.travel, allowed)
        if not self._tine_spread < self._pin_radius:
            allowed = f"less than the pin's radius with its funnel, {self._pin_radius:.3g} m"
            raise ParameterError("tine_deflection", self.tine_deflection, allowed)
        least = self.pin_recess + self._pin_radius - self._tine_reach
        if not least < self.pin_depth < self.travel:
            allowed = f"between the tips' reach, {least:.3g} m, and the travel, {self.travel} m"
            raise ParameterError("pin_depth", self.pin_depth, allowed)
        # The sections check the angle and the radii.
        _ = self.plug_section, self.socket_section.grown(-self.lead_in)

    @property
    def mated_depth(self) -> float:
        """Depth at which the socket's rim meets the bottom of the plug's shell, m."""
        return self.travel

    @property
    def mating_force(self) -> float:
        """Largest force of the insertion of a plug in line, N: where the tines spread."""
        return float(self.pin_force(self.pin_depth + np.linspace(0, self._tine_reach, 500)).max())

    def with_mating_force(self, force: float) -> "DConnector":
        """Return the same connector with tines for another force, N."""
        return replace(self, tine_force=self.tine_force * force / self.mating_force)

    @property
    def plug_section(self) -> DSection:
        """Inside of the plug's shell."""
        return DSection(
            width=self.pick(self.plug_width, tight=0),
            height=self.pick(self.plug_height, tight=0),
            corner_radius=self.plug_corner,
            side_angle=self.side_angle,
        )

    @property
    def socket_section(self) -> DSection:
        """Outside of the socket's shell."""
        return DSection(
            width=self.pick(self.socket_width, tight=1),
            height=self.pick(self.socket_height, tight=1),
            corner_radius=self.socket_corner,
            side_angle=self.side_angle,
        )

    @property
    def clearance(self) -> Array:
        """Clearance per side along x and y, m, shape (2,)."""
        plug, socket = self.plug_section, self.socket_section
        return np.array([plug.width - socket.width, plug.height - socket.height]) / 2

    @property
    def plug_outline(self) -> Array:
        """Corners of the convex body that a camera sees, m, in P, shape (8, 3); assumed."""
        return box_corners(0.040, 0.013, 0.0, 0.030)

    @property
    def socket_outline(self) -> Array:
        """Likewise of the socket, in S; assumed."""
        return box_corners(0.040, 0.0125, -0.025, 0.0)

    def pin_force(self, depth: Array) -> Array:
        """Return the force against a slow insertion in line by all tines, N; depth in m."""
        height = np.clip(self._tine_reach - (depth - self.pin_depth), 0, None)
        distance = np.hypot(self._pin_radius - self._tine_spread, height)
        press = self._tine_stiffness * np.clip(self._pin_radius - distance, 0, None)
        sine, cosine = height / distance, (self._pin_radius - self._tine_spread) / distance
        force: Array = 2 * LUMPS * press * (sine + self.material.friction * cosine)
        return force

    def plug_parts(self) -> list[ConnectorPart]:
        """Return rim, walls and pins, in P."""
        shell, spring = self._materials
        rim = self._rim(self.plug_section.grown(self.lead_in), 1)
        return [
            ConnectorPart("plug rim", rim, shell, METAL),
            ConnectorPart("plug walls", self._plug_walls(), shell, METAL),
            ConnectorPart("plug pins", self._pins(), spring, GOLD),
        ]

    def socket_parts(self) -> list[ConnectorPart]:
        """Return rim, walls and tines, in S."""
        shell, spring = self._materials
        rim = self._rim(self.socket_section.grown(-self.lead_in), -1)
        return [
            ConnectorPart("socket rim", rim, shell, METAL),
            ConnectorPart("socket walls", self._socket_walls(), shell, METAL),
            ConnectorPart("socket tines", self._tines(), spring, GOLD),
        ]

    @property
    def _lengths(self) -> tuple[float, float]:
        """Of the plug's shell and of the socket's, m."""
        return self.pick(self.plug_length, tight=0), self.pick(self.socket_length, tight=0)

    @property
    def _pin_radius(self) -> float:
        """Of the round end that stands for a pin and the funnel that it enters, m."""
        return self.pick(self.pin_diameter, tight=1) / 2 + self.pin_funnel

    @property
    def _tine_spread(self) -> float:
        """Spread of each tine by a pin, m."""
        thicker = self.pick(self.pin_diameter, tight=1) - sum(self.pin_diameter) / 2
        return self.tine_deflection + thicker / 2

    @property
    def _tine_reach(self) -> float:
        """Height of a pin's centre above the tines at their first contact, m."""
        inner = self._pin_radius - self._tine_spread
        return math.sqrt(self._pin_radius**2 - inner**2)

    @property
    def _tine_stiffness(self) -> float:
        """Of all contacts that one lump stands for, on one side, N/m."""
        return self.contacts / LUMPS * self.tine_force / self.tine_deflection

    @property
    def _materials(self) -> tuple[ContactMaterial, ContactMaterial]:
        """Of shells, and of pins and tines: two pieces that touch are springs in series."""
        return self.material, self.spring(2 * self._tine_stiffness)

    @property
    def _pin_places(self) -> Array:
        """Places of the lumped pins along x, m, shape (LUMPS,)."""
        row = self.pitch * (self.contacts + 1) / 2  # of 13
        places: Array = row * ((np.arange(LUMPS) + 0.5) / LUMPS - 0.5)
        return places

    def _rim(self, centreline: DSection, side: int) -> list[ConvexPiece]:
        """Return spheres at the ends of a rim's straight edges; it is on the side of z."""
        return [
            ConvexPiece(
                f"{edge}_{end}", Sphere(self.lead_in), at(*point.tolist(), side * self.lead_in)
            )
            for edge in EDGES
            for end, point in enumerate(centreline.edges[edge])
        ]

    def _plug_walls(self) -> list[ConvexPiece]:
        """Return the walls above the rim, and the bottom of the shell."""
        section = self.plug_section
        pieces = [
            _wall(f"side_{edge}", section, edge, (0.0, WALL), (self.lead_in, self._lengths[0]))
            for edge in EDGES
        ]
        # The straight rim, which the socket's meets where an end of the plug hangs beside it.
        for edge, line in enumerate(section.grown(self.lead_in).edges):
            ends = [np.append(point, self.lead_in) for point in line]
            pieces.append(capsule(f"lead_in_{edge}", self.lead_in, *ends))
        bottom = Box(section.width, section.height, WALL)
        pieces.append(ConvexPiece("bottom", bottom, at(0.0, 0.0, self.travel + WALL / 2)))
        return pieces

    def _socket_walls(self) -> list[ConvexPiece]:
        """Return a D with its round rim, and the flange."""
        outside, rim = self.socket_section, self.socket_section.grown(-self.lead_in)
        length = self._lengths[1]
        pieces = []
        for label, section, top in (("low", outside, -self.lead_in), ("high", rim, 0.0)):
            inward, up = (-section.height / 2, 0.0), (-length, top)
            for edge in EDGES:
                pieces.append(_wall(f"{label}_{edge}", section, edge, inward, up))
                corner = Cylinder(section.corner_radius, up[1] - up[0])
                X_SC = at(*section.centres[edge].tolist(), sum(up) / 2)
                pieces.append(ConvexPiece(f"{label}_corner_{edge}", corner, X_SC))
        lines = [tuple(rim.edges[edge]) for edge in EDGES]
        lines += [chord for corner in EDGES for chord in pairwise(rim.arc(corner, CHORDS))]
        for number, (first, last) in enumerate(lines):
            ends = [np.append(point, -self.lead_in) for point in (first, last)]
            pieces.append(capsule(f"lead_in_{number}", self.lead_in, *ends))
        flange = Box(0.053, 0.0125, WALL)  # assumed
        pieces.append(ConvexPiece("flange", flange, at(0.0, 0.0, -length - WALL / 2)))
        return pieces

    def _pins(self) -> list[ConvexPiece]:
        z = self.pin_recess + self._pin_radius
        return [
            ConvexPiece(f"{lump}", Sphere(self._pin_radius), at(x, 0.0, z))
            for lump, x in enumerate(self._pin_places)
        ]

    def _tines(self) -> list[ConvexPiece]:
        """Return a pair of tines for each pin, along y for the outer ones, along x inside."""
        top = self.pin_recess + self._pin_radius - self.pin_depth - self._tine_reach
        bottom = self.pin_recess - self.travel - WALL
        gap = self._pin_radius - self._tine_spread
        pieces = []
        for (lump, x), side in product(enumerate(self._pin_places), (1, -1)):
            outer = lump in (0, LUMPS - 1)
            block = Box(2 * gap, WALL, top - bottom) if outer else Box(WALL, 2 * gap, top - bottom)
            shift = side * (gap + WALL / 2) * np.array([not outer, outer])
            X_ST = at(x + shift[0], shift[1], (top + bottom) / 2)
            pieces.append(ConvexPiece(f"{lump}_{side:+d}", block, X_ST))
        return pieces


def _wall(name: str, section: DSection, edge: int, outward: Range, up: Range) -> ConvexPiece:
    """Return a block along an edge, between two distances outward of it and two heights."""
    first, last = section.edges[edge]
    R = RotationMatrix.MakeZRotation(section.directions[edge])
    size = abs(outward[1] - outward[0]), float(np.linalg.norm(last - first)), up[1] - up[0]
    middle = np.array([*(first + last) / 2, sum(up) / 2])
    return ConvexPiece(
        name, Box(*size), RigidTransform(R, middle + R.matrix()[:, 0] * sum(outward) / 2)
    )
