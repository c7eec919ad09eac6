"""A block that follows segments, one after the other, and can be halted at any instant."""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from chamfer.models.validation import require_positive
from chamfer.systems.trajectory.paths import Motion, Path, path_of
from chamfer.systems.trajectory.segment import COORDINATES, SIZE, Segment, hold, segment_of

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class PathFollowerParams:
    """Parameters of :class:`PathFollower`."""

    period: float = 0.005  # s, sample period; thesis, section 1.1.2
    halt_time: float = 0.25  # s, to come to rest in a halt, and back to speed; assumed
    acceleration: float = 1.0  # m/s^2, of a segment without its own; assumed
    turn_speed: float = 1.0  # rad/s, of each angle, of a segment without its own; assumed
    turn_acceleration: float = 4.0  # rad/s^2, of each angle along lines and circles; assumed

    def __post_init__(self) -> None:
        require_positive(self, *(field.name for field in fields(self)))


class FollowerMemory(NamedTuple):
    """The discrete states of the follower."""

    segment: Array  # (SIZE,), that is followed
    path_time: Array  # (1,), s, since its start, slower than time during a halt
    rate: Array  # (1,), of the path's time, 0 halted to 1
    offset: Array  # (7,), m and rad, of the last position from the segment's start
    drift: Array  # (7,), m/s and rad/s, last velocity
    settling: Array  # (1,), s, in which offset and drift are removed
    desired_position: Array  # (7,), m and rad
    desired_velocity: Array  # (7,), m/s and rad/s
    desired_acceleration: Array  # (7,), m/s^2 and rad/s^2
    progress: Array  # (1,), 0 to 1


class PathFollower(LeafSystem):
    """Follows segments with continuous position and velocity, and halts on the path.

    .. pydrake_system::

        name: PathFollower
        input_ports:
        - segment
        - halt (optional)
        output_ports:
        - desired_position
        - desired_velocity
        - desired_acceleration
        - progress

    Inputs:

    - ``segment``, shape (SIZE,): see :class:`chamfer.systems.trajectory.segment.Segment`. A change
      of its id begins the segment. Position and velocity continue without a jump from any motion
      before. A cubic in time removes the difference to the new segment's start. Its acceleration
      is at most the segment's, and adds to that of the segment itself.
    - ``halt``, size 1: while it is not 0, the path's time slows down to a stop, and afterwards
      returns to speed. The endpoint stays on its path, and the velocity is continuous.

    Outputs, held over the period:

    - ``desired_position``, shape (7,), m and rad.
    - ``desired_velocity``, shape (7,): its derivative.
    - ``desired_acceleration``, shape (7,): the change of the velocity over the last period.
    - ``progress``, size 1: from 0 to 1, where the segment is ended and at rest.

    The update is a discrete one, which Drake runs after the unrestricted ones of the same instant.
    A segment from a state machine therefore begins in the tick of the machine.

    Args:
        params: Period and limits.
        start: The place before the first segment, m and rad, shape (7,).

    Raises:
        ParameterError: If an input is not finite, or a segment can't be followed.
    """

    def __init__(self, params: PathFollowerParams, start: Array) -> None:
        super().__init__()
        self._params = params
        self._segment = self.DeclareVectorInputPort("segment", SIZE)
        self._halt = self.DeclareVectorInputPort("halt", 1)
        first = FollowerMemory(
            segment=np.array(hold(tuple(start.tolist()), 0.0).vector()),
            path_time=np.zeros(1),
            rate=np.ones(1),
            offset=np.zeros(COORDINATES),
            drift=np.zeros(COORDINATES),
            settling=np.zeros(1),
            desired_position=start,
            desired_velocity=np.zeros(COORDINATES),
            desired_acceleration=np.zeros(COORDINATES),
            progress=np.ones(1),
        )
        for name, value in first._asdict().items():
            group = self.DeclareDiscreteState(value)
            if name.startswith("desired") or name == "progress":
                self.DeclareStateOutputPort(name, group)
        self._path: tuple[bytes, Path] | None = None  # the last one made; a cache
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        held = context.get_discrete_state()
        memory = FollowerMemory(*(held.value(i) for i in range(len(FollowerMemory._fields))))
        halt = self._halt.Eval(context)[0] if self._halt.HasValue(context) else 0.0
        after = self.step(memory, self._segment.Eval(context), halt=halt != 0)
        for i, value in enumerate(after):
            values.set_value(i, value)

    def step(self, memory: FollowerMemory, segment: Array, *, halt: bool) -> FollowerMemory:
        """Return the memory after one period."""
        params = self._params
        if segment[0] != memory.segment[0]:
            # From where the motion is, so that this period goes on with it: halted, from rest.
            position, velocity = self._motion(memory)
            velocity = float(memory.rate[0]) * velocity
            start, _ = self._along(segment).at(0.0)
            offset = position - start
            memory = memory._replace(
                segment=segment,
                path_time=np.zeros(1),
                rate=np.ones(1),
                offset=offset,
                drift=velocity,
                settling=np.array([self._settling(segment, offset, velocity)]),
            )
        change = params.period / params.halt_time
        before = float(memory.rate[0])
        rate = max(before - change, 0.0) if halt else min(before + change, 1.0)
        time = memory.path_time + params.period * (before + rate) / 2
        memory = memory._replace(path_time=time, rate=np.array([rate]))
        position, velocity = self._motion(memory)
        whole = max(self._along(memory.segment).duration, float(memory.settling[0]))
        done = time[0] >= whole - 1e-9 * params.period
        velocity = rate * velocity
        return memory._replace(
            desired_position=position,
            desired_velocity=velocity,
            desired_acceleration=(velocity - memory.desired_velocity) / params.period,
            progress=np.array([1.0 if done else time[0] / whole]),
        )

    def _along(self, segment: Array) -> Path:
        key = segment.tobytes()
        if self._path is None or self._path[0] != key:
            turning = self._params.turn_acceleration
            self._path = key, path_of(self._filled(segment), turn_acceleration=turning)
        return self._path[1]

    def _filled(self, vector: Array) -> Segment:
        """Return the segment of a vector with the limits that it leaves to the follower."""
        segment, params = segment_of(tuple(vector.tolist())), self._params
        return segment._replace(
            acceleration=segment.acceleration or params.acceleration,
            turn_speed=segment.turn_speed or params.turn_speed,
        )

    def _settling(self, segment: Array, offset: Array, drift: Array) -> float:
        """Return the time, s, in which the cubic's acceleration is just what is allowed."""
        limits = self._filled(segment).acceleration, self._params.turn_acceleration
        times = []
        for part, a in zip((slice(3), slice(3, None)), limits, strict=True):
            d, v = np.linalg.norm(offset[part]), np.linalg.norm(drift[part])
            times.append(float(2 * v + np.sqrt(4 * v * v + 6 * a * d)) / a)
        return max(times)

    def _motion(self, memory: FollowerMemory) -> Motion:
        """Return position and, at rate 1, velocity."""
        time = float(memory.path_time[0])
        position, velocity = self._along(memory.segment).at(time)
        duration = float(memory.settling[0])
        if time >= duration:
            return position, velocity
        u = time / duration
        stay, push = (1 - u) ** 2 * (1 + 2 * u), u * (1 - u) ** 2
        stay_rate, push_rate = -6 * u * (1 - u) / duration, (1 - u) * (1 - 3 * u)
        return (
            position + stay * memory.offset + duration * push * memory.drift,
            velocity + stay_rate * memory.offset + push_rate * memory.drift,
        )
