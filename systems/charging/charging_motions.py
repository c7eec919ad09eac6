"""Motions of the charging cycle: segments for each item, from the believed cell."""

import math
from typing import Final, Literal

from chamfer.models.charging.packing import ItemPlace, LaidNugget, Nugget
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ChargingParams,
)
from chamfer.systems.trajectory.segment import LINE, SLEW, Segment, Vector3, Vector7, hold

_CENTRED: Final = 1e-3  # m, from the middle of what lies below, that is on it
_INSIDE: Final = 0.01  # m, of the nugget's lowest point below the rim where a slew ends

Motion = Literal[
    "stay",  # where the command is, soon
    "home",  # past the joints' index marks
    "above",  # over the nugget in the feeder
    "descend",  # down to it, and somewhat further
    "run_in",  # to where the scan's motion begins
    "scan",  # over the scanner
    "slew",  # with the item into the crucible
    "lower",  # to the height from which it is laid
    "approach",  # near the wall
    "seek_wall",  # slowly to the wall, and somewhat further
    "slide",  # down the wall, near to the layer
    "descend_to_layer",  # likewise without wall
    "follow",  # along what was laid before, to the place
    "seek_layer",  # slowly down to the layer, and somewhat further
    "lift",  # out of the feeder
    "retreat",  # upwards out of the crucible
    "back",  # over the feeder again
    "away",  # off the wall where it was near, else upwards
]


class ChargingMotions:
    """The segments that the chart requests.

    Each starts at the present command, so that the command never jumps. Directions that were
    under force control start at the arm's position.
    """

    def __init__(self, params: ChargingParams, beliefs: ChargingBeliefs) -> None:
        self._params, self._beliefs = params, beliefs

    def normal(self, item: int) -> Vector3:
        """Return the direction into the wall at an item's place."""
        azimuth = self._beliefs.places[item].azimuth
        return math.cos(azimuth), math.sin(azimuth), 0.0

    def kind(self, item: int) -> str:
        """Return an item's kind: wall, crown or bulk."""
        return self._beliefs.plan[item].kind

    @property
    def items(self) -> int:
        """Return how many items there are."""
        return len(self._beliefs.plan)

    def followed(self, item: int) -> LaidNugget | None:
        """Return the nugget that an item is laid on and follows to its place, if any."""
        on = self._place(item).on
        return on if on and on.nugget.mass >= self._params.follow_mass else None

    def mass(self, item: int) -> float:
        """Return an item's believed mass, kg."""
        return self._nugget(item).mass

    def segment(self, motion: Motion, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Return the segment of a motion of the present item."""
        params, station, item = self._params, self._beliefs.station, memory.item
        now, number = self._now(memory, inputs), memory.segment.id + 1
        if motion == "stay":
            return hold(now, number)._replace(acceleration=params.stop_acceleration)
        top = station.rim_height + params.clearance
        if motion not in ("slew", "back"):
            goal, speed = self._line(motion, now, top, memory)
            return Segment(
                id=number,
                kind=LINE,
                start=now,
                goal=goal,
                speed=speed,
                turn_speed=params.turn_speed,
                acceleration=params.acceleration,
            )
        goal = self._feeder(item, params.lift_height)
        if motion == "slew":
            drop = self._place(item).layer + params.drop
            goal = self._over_place(item, max(station.rim_height - _INSIDE, drop))
            top += self._nugget(item).height
        return Segment(
            id=number,
            kind=SLEW,
            start=now,
            goal=goal,
            duration=params.slew_time,
            via_height=max(top, goal[2], inputs.desired_position[2]),
        )

    def _line(
        self, motion: Motion, now: Vector7, top: float, memory: ChargingMemory
    ) -> tuple[Vector7, float]:
        """Return goal and speed, m/s, of a straight motion; ``top``, m, is clear of the rim."""
        params, item = self._params, memory.item
        layer = self._place(item).layer
        match motion:
            case "home":
                return self._beliefs.home, params.travel_speed
            case "above":
                return self._feeder(item, params.lift_height), params.travel_speed
            case "descend":
                return self._feeder(item, -params.search), params.descend_speed
            case "lift":
                return self._feeder(item, params.lift_height), params.lift_speed
            case "run_in":
                return self._scan_end(item, -1.0), params.travel_speed
            case "scan":
                return self._scan_end(item, 1.0), params.scan_speed
            case "lower":
                return self._over_place(item, layer + params.drop), params.approach_speed
            case "approach":
                return self._towards_wall(now, item, -params.near), params.approach_speed
            case "seek_wall":
                return self._towards_wall(now, item, params.search), params.seek_speed
            case "retreat":
                return _at_height(now, max(top, now[2])), params.approach_speed
            case "follow":
                return (*self._place(item).position, *now[2:]), params.follow_speed
            case "away" if memory.trouble_at.startswith("wall"):
                return _along(now, memory.normal, -params.near), params.slide_speed
            case "away":
                return _at_height(now, now[2] + params.near), params.slide_speed
        over, speed = {
            "slide": (params.near, params.slide_speed),
            "descend_to_layer": (params.near, params.approach_speed),
            "seek_layer": (-params.search, params.land_speed),
        }[motion]
        return _at_height(now, layer + self._nugget(item).height + over), speed

    def _nugget(self, item: int) -> Nugget:
        return self._beliefs.nuggets[item]

    def _place(self, item: int) -> ItemPlace:
        return self._beliefs.places[item]

    def _pose(self, x: float, y: float, lowest: float, item: int, yaw: float = 0.0) -> Vector7:
        height = self._nugget(item).height
        return x, y, lowest + height, yaw, 0.0, 0.0, self._params.lean

    def _feeder(self, item: int, over: float) -> Vector7:
        x, y, z = self._beliefs.station.feeder
        return self._pose(x, y, z + over, item)

    def _scan_end(self, item: int, side: float) -> Vector7:
        station = self._beliefs.station
        x, y, z = station.scanner
        return self._pose(x, y + side * (station.scan_length / 2 + self._params.run_in), z, item)

    def _over_place(self, item: int, lowest: float) -> Vector7:
        place, n = self._place(item), self.normal(item)
        off = self._params.standoff if self.kind(item) == "wall" else 0.0
        x, y = (a - off * b for a, b in zip(self._landing(item), n[:2], strict=True))
        return self._pose(x, y, lowest, item, math.remainder(place.azimuth, 2 * math.pi))

    def _landing(self, item: int) -> tuple[float, float]:
        """Return where an item lands, m: on a nugget, before its place, nearer to the middle."""
        (x, y), (nx, ny, _) = self._place(item).position, self.normal(item)
        on = self.followed(item)
        if on is None:
            return x, y
        dx, dy = x - on.middle[0], y - on.middle[1]
        if self.kind(item) == "wall":  # along the wall alone
            along = ny * dx - nx * dy
            dx, dy = along * ny, -along * nx
        far = math.hypot(dx, dy)
        if far < _CENTRED:
            dx, dy, far = ny, -nx, 1.0
        way = self._params.follow / far
        return x - way * dx, y - way * dy

    def _towards_wall(self, now: Vector7, item: int, beyond: float) -> Vector7:
        at_place = (*self._landing(item), *now[2:])
        return _along(at_place, self.normal(item), beyond)

    def _now(self, memory: ChargingMemory, inputs: ChargingInputs) -> Vector7:
        """Return the command; in the force domain, the arm's position."""
        command = inputs.desired_position
        for n in memory.pressed:
            off = zip(n, inputs.endpoint_motion[:3], command[:3], strict=True)
            command = _along(command, n, sum(one * (a - c) for one, a, c in off))
        return command


def _at_height(pose: Vector7, z: float) -> Vector7:
    return (*pose[:2], z, *pose[3:])


def _along(pose: Vector7, direction: Vector3, way: float) -> Vector7:
    x, y, z = (a + way * n for a, n in zip(pose[:3], direction, strict=True))
    return x, y, z, *pose[3:]
