"""Where the charging cycle's motions go: segments for each item, from what is believed."""

import math
from typing import Final

from chamfer.models.charging.packing import ItemPlace, Nugget
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ChargingParams,
)
from chamfer.systems.trajectory.segment import LINE, SLEW, Segment, Vector3, Vector7, hold

_INSIDE: Final = 0.01  # m, of the nugget's lowest point below the rim where a slew ends


class ChargingMotions:
    """The segments that the chart asks for.

    Each starts where the command is now, so that it never jumps; what was under force control
    starts where the arm is.
    """

    def __init__(self, params: ChargingParams, beliefs: ChargingBeliefs) -> None:
        self._params, self._beliefs = params, beliefs

    def normal(self, item: int) -> Vector3:
        """Return the direction into the wall at an item's place."""
        azimuth = self._beliefs.places[item].azimuth
        return math.cos(azimuth), math.sin(azimuth), 0.0

    def kind(self, item: int) -> str:
        """Return what an item is: wall, crown or bulk."""
        return self._beliefs.plan[item].kind

    @property
    def items(self) -> int:
        """Return how many items there are."""
        return len(self._beliefs.plan)

    def mass(self, item: int) -> float:
        """Return an item's mass, kg, as it is believed."""
        return self._nugget(item).mass

    def stay(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Stop where the command is, soon."""
        segment = hold(self._now(memory, inputs), memory.segment.id + 1)
        return segment._replace(acceleration=self._params.stop_acceleration)

    def home(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Pass the joints' index marks."""
        return self._line(memory, inputs, self._beliefs.home, self._params.travel_speed)

    def above(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go over the nugget in the feeder."""
        goal = self._feeder(memory.item, self._params.lift_height)
        return self._line(memory, inputs, goal, self._params.travel_speed)

    def descend(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go down to the nugget in the feeder, and somewhat further."""
        goal = self._feeder(memory.item, -self._params.search)
        return self._line(memory, inputs, goal, self._params.descend_speed)

    def lift(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Lift the nugget out of the feeder."""
        goal = self._feeder(memory.item, self._params.lift_height)
        return self._line(memory, inputs, goal, self._params.lift_speed)

    def run_in(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go to where the scan's motion begins."""
        return self._line(
            memory, inputs, self._scan_end(memory.item, -1.0), self._params.travel_speed
        )

    def scan(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Pass the nugget over the scanner."""
        goal = self._scan_end(memory.item, 1.0)
        return self._line(memory, inputs, goal, self._params.scan_speed)

    def slew(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Carry the item into the crucible."""
        params, station = self._params, self._beliefs.station
        lowest = max(station.rim_height - _INSIDE, self._place(memory.item).layer + params.drop)
        goal = self._over_place(memory.item, lowest)
        via = station.rim_height + params.clearance + self._nugget(memory.item).height
        return self._slew(memory, inputs, goal, via)

    def lower(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Lower the item to the height from which it is laid."""
        layer = self._place(memory.item).layer
        goal = self._over_place(memory.item, layer + self._params.drop)
        return self._line(memory, inputs, goal, self._params.approach_speed)

    def approach(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go near the wall."""
        return self._towards_wall(
            memory, inputs, -self._params.near, speed=self._params.approach_speed
        )

    def seek_wall(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go slowly to the wall, and somewhat further."""
        return self._towards_wall(
            memory, inputs, self._params.search, speed=self._params.seek_speed
        )

    def slide(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Slide down the wall, near to the layer."""
        return self._down(memory, inputs, self._params.near, self._params.slide_speed)

    def descend_to_layer(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go down near to the layer without wall."""
        return self._down(memory, inputs, self._params.near, self._params.approach_speed)

    def seek_layer(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go slowly down to the layer, and somewhat further."""
        return self._down(memory, inputs, -self._params.search, self._params.seek_speed)

    def retreat(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Leave the crucible upwards."""
        now = self._now(memory, inputs)
        top = max(self._beliefs.station.rim_height + self._params.clearance, now[2])
        return self._line(memory, inputs, _at_height(now, top), self._params.approach_speed)

    def back(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Go back over the feeder."""
        goal = self._feeder(memory.item, self._params.lift_height)
        via = self._beliefs.station.rim_height + self._params.clearance
        return self._slew(memory, inputs, goal, via)

    def away(self, memory: ChargingMemory, inputs: ChargingInputs) -> Segment:
        """Back off: from the wall where it was near, else upwards."""
        now, far = self._now(memory, inputs), self._params.near
        if memory.trouble_at.startswith("wall"):
            x, y, _ = (a - far * n for a, n in zip(now[:3], memory.normal, strict=True))
            goal: Vector7 = (x, y, *now[2:])
        else:
            goal = _at_height(now, now[2] + far)
        return self._line(memory, inputs, goal, self._params.slide_speed)

    def _nugget(self, item: int) -> Nugget:
        return self._beliefs.nuggets[item]

    def _place(self, item: int) -> ItemPlace:
        return self._beliefs.places[item]

    def _pose(self, x: float, y: float, lowest: float, item: int, yaw: float) -> Vector7:
        height = self._nugget(item).height
        return x, y, lowest + height, yaw, 0.0, 0.0, self._params.lean

    def _feeder(self, item: int, over: float) -> Vector7:
        x, y, z = self._beliefs.station.feeder
        return self._pose(x, y, z + over, item, 0.0)

    def _scan_end(self, item: int, side: float) -> Vector7:
        station = self._beliefs.station
        x, y, z = station.scanner
        return self._pose(
            x, y + side * (station.scan_length / 2 + self._params.run_in), z, item, 0.0
        )

    def _over_place(self, item: int, lowest: float) -> Vector7:
        place, n = self._place(item), self.normal(item)
        off = self._params.standoff if self.kind(item) == "wall" else 0.0
        x, y = (a - off * b for a, b in zip(place.position, n[:2], strict=True))
        return self._pose(x, y, lowest, item, math.remainder(place.azimuth, 2 * math.pi))

    def _towards_wall(
        self, memory: ChargingMemory, inputs: ChargingInputs, beyond: float, *, speed: float
    ) -> Segment:
        now, n = self._now(memory, inputs), self.normal(memory.item)
        at = self._place(memory.item).position
        x, y = (a + beyond * b for a, b in zip(at, n[:2], strict=True))
        return self._line(memory, inputs, (x, y, *now[2:]), speed)

    def _down(
        self, memory: ChargingMemory, inputs: ChargingInputs, over: float, speed: float
    ) -> Segment:
        layer, height = self._place(memory.item).layer, self._nugget(memory.item).height
        now = self._now(memory, inputs)
        return self._line(memory, inputs, _at_height(now, layer + height + over), speed)

    def _now(self, memory: ChargingMemory, inputs: ChargingInputs) -> Vector7:
        """Return the command, but for what is under force control, where the arm is."""
        command = inputs.desired_position
        if not memory.mode:
            return command
        n = memory.normal
        arm = inputs.endpoint_motion[:3]
        along = sum(one * (a - c) for one, a, c in zip(n, arm, command[:3], strict=True))
        x, y, z = (c + along * one for c, one in zip(command[:3], n, strict=True))
        return x, y, z, *command[3:]

    def _line(
        self, memory: ChargingMemory, inputs: ChargingInputs, goal: Vector7, speed: float
    ) -> Segment:
        return Segment(
            id=memory.segment.id + 1,
            kind=LINE,
            start=self._now(memory, inputs),
            goal=goal,
            speed=speed,
            turn_speed=self._params.turn_speed,
            acceleration=self._params.acceleration,
        )

    def _slew(
        self, memory: ChargingMemory, inputs: ChargingInputs, goal: Vector7, via: float
    ) -> Segment:
        return Segment(
            id=memory.segment.id + 1,
            kind=SLEW,
            start=self._now(memory, inputs),
            goal=goal,
            duration=self._params.slew_time,
            via_height=max(via, goal[2], inputs.desired_position[2]),
        )


def _at_height(pose: Vector7, z: float) -> Vector7:
    return (*pose[:2], z, *pose[3:])
