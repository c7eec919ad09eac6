"""The BNC connector: a barrel with two studs, and a sleeve that locks on them by a quarter turn.

The plug is that of Fig. 3. The socket's barrel stands still, its studs on S's x axis. The plug is
the sleeve, which the gripper holds and turns. In it an insulator on a spring meets the barrel's
face. Seen in P, the path of a stud through the sleeve is

* a slot from the leading face upwards, on x, as deep as the sleeve overlaps the studs;
* at its end a channel of 90 degrees towards y, as wide as the slot;
* a notch at the channel's end, back towards the leading face: the detent, with the end stop.

A plug in line, turned by the angle a about z, meets the slots at a = 0 (and 180 degrees), and
**locks by a turn of -90 degrees about z**: clockwise, seen from the sleeve's back. Released, the
spring lifts the sleeve until the studs lie in the notches.

Four families of pieces touch. Collision filters keep the others apart, so that every
pair has a closed form and every turned position the same clearance:

* spheres round the sleeve's leading rim against the barrel, a cylinder; their roundness stands
  for the lead-in of both parts;
* a ball in the barrel's end, as wide as the barrel, against staves round the bore: the barrel's
  rim, which limits the tilt once it is half in, at any angle of turn;
* studs, which are spheres at half their height, against boxes that leave the slots free;
* spheres of the insulator against the barrel's face: the spring is their softness, so it has no
  preload (an insulator on a joint with a stop takes as long to simulate as all the rest).

Not modelled: the centre contact, the outer conductor in the barrel, and the friction of sleeve and
insulator. A turn therefore meets only the friction of the studs and the barrel's face.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np
from pydrake.geometry import Box, Cylinder, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from chamfer.models.connectors.connector import (
    Array,
    ConnectorPart,
    ContactMaterial,
    ConvexPiece,
    Range,
    SprungConnector,
    block,
    prism,
    turns,
)
from chamfer.models.validation import ParameterError

_RIM_SPHERES: Final = 8
_STAVES: Final = 8
_SPRING_SPHERES: Final = 3
_WALL: Final = 2e-3  # m, thickness of what is touched on one side
_SLEEVE_COLOUR: Final = np.array([0.55, 0.55, 0.6, 0.5])
_BARREL_COLOUR: Final = np.array([0.8, 0.7, 0.4, 1.0])


@dataclass(frozen=True, kw_only=True)
class BncConnector(SprungConnector):
    """A BNC connector in contact; see the module for its shape.

    Pairs are the smallest and the largest dimension allowed. Nominal is their mean, worst the
    least clearance.
    """

    barrel_diameter: Range = (9.60e-3, 9.70e-3)  # m, outside; reference table
    tips_diameter: Range = (10.97e-3, 11.07e-3)
    # m, over the studs' tips; reference table
    stud_diameter: Range = (1.91e-3, 2.06e-3)  # m, of each stud; reference table
    slot_width: Range = (2.31e-3, 2.46e-3)
    # m, of the sleeve's slots; reference table
    bore_diameter: Range = (9.78e-3, 9.91e-3)
    # m, of the sleeve, inside; from memory: assumed
    setback: float = 3.25e-3  # m, of the studs' near side behind the face; reference table
    overlap: float = 8.46e-3  # m, of sleeve and barrel fully compressed; reference table
    detent: float = 0.8e-3  # m, depth of the notch below the channel; assumed
    lead_in: float = 1e-3  # m, of sleeve and barrel together, 0.5 mm each; assumed
    spring_travel: float = 3e-3  # m, from the barrel's first touch to full compression; assumed
    spring_force: float = 13.0  # N, of the spring fully compressed; from memory: assumed
    spring_radius: float = 3e-3  # m, at which the spring rests on the barrel's face; assumed
    sleeve_diameter: float = 14.5e-3  # m, outside; assumed
    sleeve_length: float = 30e-3  # m, with the part behind it; assumed
    socket_diameter: float = 14e-3  # m, of the socket's visible part; assumed
    socket_length: float = 25e-3  # m, of the socket's visible part; assumed
    mass: float = 0.02  # kg, of the plug; assumed

    NAME: ClassVar[str] = "bnc"
    PARTNERS: ClassVar[Sequence[tuple[str, str]]] = (
        ("sleeve rim", "barrel"),
        ("sleeve bore", "barrel rim"),
        ("sleeve slots", "studs"),
        ("sleeve spring", "barrel"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        least = self.barrel_diameter[1] / 2
        if not self.overlap > least:
            raise ParameterError(
                "overlap", self.overlap, f"more than the barrel's radius, {least} m"
            )
        barrel, tips = self.barrel_diameter[1], self.tips_diameter[0]
        if not self.bore_diameter[0] > barrel:
            allowed = f"more than the largest barrel, {barrel} m"
            raise ParameterError("bore_diameter", self.bore_diameter, allowed)
        if not tips > barrel:
            raise ParameterError("tips_diameter", self.tips_diameter, f"more than {barrel} m")
        if not self.slot_width[0] > self.stud_diameter[1]:
            allowed = f"more than the largest stud, {self.stud_diameter[1]} m"
            raise ParameterError("slot_width", self.slot_width, allowed)
        room = self.overlap - self.setback - self.slot_width[1]
        if not room > self.detent:
            allowed = f"less than overlap - setback - slot_width, {room:.3g} m"
            raise ParameterError("detent", self.detent, allowed)
        released = self.overlap - self.mated_depth
        if not self.spring_travel > released:
            allowed = f"more than what the sleeve rises when released, {released:.3g} m"
            raise ParameterError("spring_travel", self.spring_travel, allowed)
        if not self.spring_travel < self.overlap:
            allowed = f"less than overlap, {self.overlap} m"
            raise ParameterError("spring_travel", self.spring_travel, allowed)
        if not self.spring_radius < self.barrel_diameter[0] / 2 - self.lead_in:
            least = self.barrel_diameter[0] / 2 - self.lead_in
            raise ParameterError("spring_radius", self.spring_radius, f"less than {least} m")

    @property
    def barrel_radius(self) -> float:
        """Of the barrel, m."""
        return self.pick(self.barrel_diameter, tight=1) / 2

    @property
    def bore_radius(self) -> float:
        """Of the sleeve's bore, m."""
        return self.pick(self.bore_diameter, tight=0) / 2

    @property
    def stud_radius(self) -> float:
        """Of the studs, m."""
        return self.pick(self.stud_diameter, tight=1) / 2

    @property
    def stud_distance(self) -> float:
        """From the axis to the middle of a stud's height above the barrel, m."""
        return (self.barrel_radius + self._tips_radius) / 2

    @property
    def _tips_radius(self) -> float:
        return self.pick(self.tips_diameter, tight=1) / 2

    @property
    def slot(self) -> float:
        """Width of the slots and of the channels, m."""
        return self.pick(self.slot_width, tight=0)

    @property
    def slot_depth(self) -> float:
        """Of the slots, from the leading face to the far side of the channels, m."""
        return self.overlap - self.setback

    @property
    def turning_depth(self) -> float:
        """Depth from which the sleeve can be turned, m; ``overlap`` is the largest depth."""
        return self.overlap - (self.slot - 2 * self.stud_radius)

    @property
    def mated_depth(self) -> float:
        """Depth of a released plug whose studs lie in the detents, m."""
        return self.turning_depth - self.detent

    @property
    def mating_force(self) -> float:
        """Force of the compressed spring, N: the largest of the insertion."""
        return self.spring_force

    @property
    def mated_turn(self) -> float:
        """A quarter turn clockwise, seen from the sleeve's back."""
        return -math.pi / 2

    def with_mating_force(self, force: float) -> "BncConnector":
        """Return the same connector with another spring, N."""
        return replace(self, spring_force=force)

    @property
    def plug_outline(self) -> Array:
        """Corners of the sleeve, a prism of 16 sides, m, in P, shape (32, 3)."""
        return prism(self.sleeve_diameter / 2, 0.0, self.sleeve_length)

    @property
    def socket_outline(self) -> Array:
        """Corners of the socket, a prism of 16 sides, m, in S, shape (32, 3)."""
        return prism(self.socket_diameter / 2, -self.socket_length, 0.0)

    def add_plug(self, plant: MultibodyPlant, body: RigidBody, X_BP: RigidTransform) -> None:
        """Add the sleeve and its insulator to a body that holds it, X_BP its place there."""
        super().add_plug(plant, body, X_BP)
        _show(plant, body, X_BP, self.sleeve_diameter, 0.0, self.sleeve_length, _SLEEVE_COLOUR)

    def add_socket(self, plant: MultibodyPlant, X_WS: RigidTransform) -> None:
        """Add the barrel and its studs, fixed to the world."""
        super().add_socket(plant, X_WS)
        world, length = plant.world_body(), self.socket_length
        _show(plant, world, X_WS, 2 * self.barrel_radius, -length, 0.0, _BARREL_COLOUR)

    def spring_push(self, depth: Array) -> Array:
        """Return the force of the spring against a plug in line, N; depth in m."""
        bent = np.clip(depth - (self.overlap - self.spring_travel), 0.0, None)
        force: Array = self.spring_force / self.spring_travel * bent
        return force

    @property
    def _spring_material(self) -> ContactMaterial:
        """Of the insulator's spheres, whose softness is the spring."""
        stiffness = self.spring_force / (self.spring_travel * _SPRING_SPHERES)
        return self.spring(stiffness)

    def plug_parts(self) -> list[ConnectorPart]:
        """Return the pieces of the sleeve and its spring, in P."""
        reach, half = self._tips_radius, self.slot / 2
        channel = self.slot_depth - self.slot  # its near side
        rim = Sphere(self.lead_in)
        centre = self.bore_radius + self.lead_in
        across = 2 * math.tan(math.pi / _STAVES) * (self.bore_radius + _WALL)
        # Staves begin above the ball's dome, which the barrel hasn't, when the sleeve rests on it.
        low, high = self.barrel_radius, self.overlap + self.lead_in
        stave = Box(_WALL, across, high - low)
        middle = np.array([self.bore_radius + _WALL / 2, 0.0, (low + high) / 2])
        # So large that their centres never reach the barrel's face.
        soft = Sphere(self.spring_travel + self.lead_in)
        spring_depth = self.overlap - self.spring_travel  # where the insulator meets the face
        face = np.array([self.spring_radius, 0.0, spring_depth + soft.radius()])
        parts = {
            "sleeve rim": [
                ConvexPiece(f"rim_{i}", rim, RigidTransform(R @ [centre, 0.0, self.lead_in]))
                for i, R in enumerate(turns(_RIM_SPHERES))
            ],
            "sleeve bore": [
                ConvexPiece(f"stave_{i}", stave, RigidTransform(R, R @ middle))
                for i, R in enumerate(turns(_STAVES))
            ],
            "sleeve slots": [
                block("lip_0", (half, half, 0.0), (reach, reach, channel)),
                block("lip_180", (-reach, -reach, 0.0), (-half, -half, channel)),
                block("stop_90", (-reach, half, 0.0), (-half, reach, self.slot_depth)),
                block("stop_270", (half, -reach, 0.0), (reach, -half, self.slot_depth)),
                block("notches", (-half, -reach, 0.0), (half, reach, channel - self.detent)),
                block(
                    "ceiling",
                    (-reach, -reach, self.slot_depth),
                    (reach, reach, self.slot_depth + _WALL),
                ),
            ],
            "sleeve spring": [
                ConvexPiece(f"spring_{i}", soft, RigidTransform(R @ face))
                for i, R in enumerate(turns(_SPRING_SPHERES))
            ],
        }
        return [
            ConnectorPart(
                name, pieces, self._spring_material if "spring" in name else self.material, None
            )
            for name, pieces in parts.items()
        ]

    def socket_parts(self) -> list[ConnectorPart]:
        """Return the pieces of the barrel and its studs, in S."""
        radius, length = self.barrel_radius, self.socket_length
        height = -self.setback - self.stud_radius
        parts = {
            "barrel": [
                ConvexPiece(
                    "barrel", Cylinder(radius, length), RigidTransform([0.0, 0.0, -length / 2])
                )
            ],
            "barrel rim": [
                ConvexPiece("ball", Sphere(radius), RigidTransform([0.0, 0.0, -self.lead_in / 2]))
            ],
            "studs": [
                ConvexPiece(
                    f"stud_{i}",
                    Sphere(self.stud_radius),
                    RigidTransform(R @ [self.stud_distance, 0.0, height]),
                )
                for i, R in enumerate(turns(2))
            ],
        }
        return [
            ConnectorPart(name, pieces, self.material, _BARREL_COLOUR if name == "studs" else None)
            for name, pieces in parts.items()
        ]


def _show(
    plant: MultibodyPlant,
    body: RigidBody,
    X_BF: RigidTransform,
    diameter: float,
    low: float,
    high: float,
    rgba: Array,
) -> None:
    """Add an upright cylinder that is only visible, m."""
    X = X_BF @ RigidTransform([0.0, 0.0, (low + high) / 2])
    name = f"bnc_{body.name()}_outside"
    plant.RegisterVisualGeometry(body, X, Cylinder(diameter / 2, high - low), name, rgba)
