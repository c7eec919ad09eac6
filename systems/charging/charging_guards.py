"""When the charging cycle's chart goes on, and when it stops."""

import math
from collections.abc import Callable
from typing import Final

from chamfer.models.validation import known
from chamfer.systems.charging.charging_memory import ChargingInputs, ChargingMemory, Trouble
from chamfer.systems.charging.charging_motions import Motions
from chamfer.systems.charging.charging_params import ChargingParams
from chamfer.systems.statechart.chart import TIME_TOLERANCE, Tick

ChargingTick = Tick[ChargingInputs, ChargingMemory]
Guard = Callable[[ChargingTick], bool]

_ARRIVED: Final = 1 - 1e-9  # of the progress
_HOMING: Final = 2.0  # s, in which the encoders' zeros settle behind the last mark
_AT_REST: Final = 1e-9  # m/s and rad/s, of the command
_SWINGING: Final = 0.1  # s, for which a nugget swings on in the gripper
_MORE: Final = 2.0  # by which what the nugget's inertia shows at most is exceeded


class Readings:
    """What the sensors say at a tick, and troubles in a row: noise alone decides nothing."""

    def __init__(self, params: ChargingParams, motions: Motions) -> None:
        self._params, self._motions = params, motions
        self._detect = known("detection.detect", params.detection.detect)
        self._release = params.detection.release
        self._speeding_up = params.seek_speed / params.acceleration + _SWINGING

    def count(self, tick: ChargingTick) -> ChargingMemory:
        """Return the memory with the present readings counted."""
        memory, inputs, params = tick.memory, tick.inputs, self._params
        acquires = (memory.left or memory.at).startswith("acquire")
        limit = params.grip_limit if acquires else params.force_limit
        alive = inputs.alive is None or inputs.alive[0] > 0.5
        gone = memory.carries and not inputs.held[0] > 0.5
        off = self._off(memory, inputs) > params.position_limit
        return memory._replace(
            above_limit=_next(memory.above_limit, math.hypot(*inputs.measured_force) > limit),
            dead=not alive,
            dropped=_next(memory.dropped, gone),
            off_path=_next(memory.off_path, off),
        )

    def at_wall(self, tick: ChargingTick) -> bool:
        """Whether the nugget pushes the wall."""
        least = self._detect
        if not tick.memory.mode and tick.time_in_state < self._speeding_up:
            # Meanwhile the sensor feels the nugget's inertia.
            least += _MORE * self._params.acceleration * self._motions.mass(tick.memory.item)
        return self._push(tick) > least

    def off_wall(self, tick: ChargingTick) -> bool:
        """Whether contact with the wall is lost."""
        return self._push(tick) <= self._release

    def on_below(self, tick: ChargingTick) -> bool:
        """Whether something below is pushed."""
        down = -tick.inputs.mean_force[2]
        if not tick.memory.carries:
            return down > self._params.touch_force
        # Sliding down, the wall holds the nugget up.
        friction = self._params.wall_friction * max(self._push(tick), 0.0)
        return down - friction > self._params.layer_force

    def _push(self, tick: ChargingTick) -> float:
        x, y, _ = tick.inputs.mean_force
        return x * tick.memory.normal[0] + y * tick.memory.normal[1]

    def _off(self, memory: ChargingMemory, inputs: ChargingInputs) -> float:
        """Return how far the arm is from its command, m, but for what is under force control."""
        pairs = zip(inputs.endpoint_motion[:3], inputs.desired_position[:3], strict=True)
        error = [arm - command for arm, command in pairs]
        if memory.mode:
            along = sum(n * e for n, e in zip(memory.normal, error, strict=True))
            error = [e - along * n for n, e in zip(memory.normal, error, strict=True)]
        return math.hypot(*error)


class Guards:
    """What is true at a tick."""

    def __init__(self, params: ChargingParams, motions: Motions) -> None:
        self._params, self._motions = params, motions
        readings = Readings(params, motions)
        self.at_wall, self.off_wall = readings.at_wall, readings.off_wall
        self.on_below = readings.on_below

    def arrived(self, tick: ChargingTick) -> bool:
        """Whether the segment's goal is reached; not of the segment before."""
        late = tick.time_in_state >= 1.5 * self._params.period
        return late and tick.inputs.progress[0] >= _ARRIVED

    def stands(self, tick: ChargingTick) -> bool:
        """Whether the command has come to rest."""
        return all(abs(one) < _AT_REST for one in tick.inputs.desired_velocity)

    def stays(self, tick: ChargingTick) -> bool:
        """Whether it stands and is not to be moved: by the operator, or not knowing why it is off.

        A dead sensor or too much force are answered by backing off.
        """
        unsure = tick.memory.trouble in (Trouble.OFF_PATH, Trouble.LATE)
        return (unsure or self.stop_asked(tick)) and self.stands(tick)

    def rested(self, tick: ChargingTick) -> bool:
        """Whether the state has lasted for its rest."""
        return tick.time_in_state >= self._params.rest - TIME_TOLERANCE

    def late(self, tick: ChargingTick) -> bool:
        """Whether the state has lasted longer than any should."""
        return tick.time_in_state > self._params.patience

    def homed(self, tick: ChargingTick) -> bool:
        """Whether the encoders' zeros are known."""
        return tick.inputs.homed is None or tick.inputs.homed[0] > 0.5

    def never_homed(self, tick: ChargingTick) -> bool:
        """Whether they should be known by now."""
        return tick.time_in_state >= _HOMING and not self.homed(tick)

    def held(self, tick: ChargingTick) -> bool:
        """Whether the gripper has a part, closed for a while."""
        return self.rested(tick) and tick.inputs.held[0] > 0.5

    def not_held(self, tick: ChargingTick) -> bool:
        """Whether it has none, after a while."""
        return self.rested(tick) and not tick.inputs.held[0] > 0.5

    def is_kind(self, kind: str) -> Guard:
        """Return the guard of an arrival with an item of a kind."""
        return lambda tick: self.arrived(tick) and self._motions.kind(tick.memory.item) == kind

    def weighed_bulk(self, tick: ChargingTick) -> bool:
        """Whether the bulk filler is taken up; it is not scanned."""
        return self.rested(tick) and self._motions.kind(tick.memory.item) == "bulk"

    def last(self, tick: ChargingTick) -> bool:
        """Whether the arm is back, with nothing left to lay."""
        return self.arrived(tick) and tick.memory.item + 1 >= self._motions.items

    def back_to(self, state: str) -> Guard:
        """Return the guard of a contact that was found again, in that state."""
        return lambda tick: tick.memory.lost_from == state and self.at_wall(tick)

    def lost_for_long(self, tick: ChargingTick) -> bool:
        """Whether contact is not found again."""
        return tick.time_in_state >= self._params.most_lost - TIME_TOLERANCE

    def lost_often(self, tick: ChargingTick) -> bool:
        """Whether contact was found again often enough."""
        return tick.memory.losses > self._params.most_losses

    def stop_asked(self, tick: ChargingTick) -> bool:
        """Whether the operator wants all to stand still."""
        return tick.inputs.halt is not None and tick.inputs.halt[0] > 0.5

    def halted(self, tick: ChargingTick) -> bool:
        """Whether the cycle is to be halted; what is stopped by a failure stays so."""
        return self.stop_asked(tick) and not tick.memory.trouble

    def resumed(self, state: str) -> Guard:
        """Return the guard of the end of a halt that began in that state."""
        return lambda tick: tick.memory.left == state and not self.stop_asked(tick)

    def trouble(self, tick: ChargingTick) -> Trouble:
        """Return what may happen in any state; NONE once the cycle is being stopped."""
        memory = tick.memory
        if memory.trouble:
            return Trouble.NONE
        if memory.dead:
            return Trouble.SENSOR_DEAD
        for trouble, count in (
            (Trouble.TOO_MUCH_FORCE, memory.above_limit),
            (Trouble.DROPPED, memory.dropped),
            (Trouble.OFF_PATH, memory.off_path),
        ):
            if count >= self._params.trouble_readings:
                return trouble
        if not memory.left and self.late(tick):
            return Trouble.LATE
        return Trouble.NONE

    def has(self, trouble: Trouble) -> Guard:
        """Return the guard of one kind of trouble."""
        return lambda tick: self.trouble(tick) is trouble


def _next(count: int, again: bool) -> int:
    return count + 1 if again else 0
