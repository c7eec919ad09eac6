"""A segment of a trajectory: what the chart of a task asks for, as a vector of fixed size."""

from typing import Final, NamedTuple

from models.validation import ParameterError

Vector3 = tuple[float, float, float]
Vector7 = tuple[float, ...]

HOLD: Final = 0  # at the goal
LINE: Final = 1  # straight to the goal, speed trapezoidal in time
CIRCLE: Final = 2  # an arc to the goal about an axis, likewise
SLEW: Final = 3  # in a given time over a via height, no acceleration at the ends

COORDINATES: Final = 7  # of the endpoint vector
SIZE: Final = 25  # of the vector


class Segment(NamedTuple):
    """One motion of the endpoint vector from ``start`` to ``goal``.

    Line and circle cover the way of the point in space with ``speed``; the other coordinates move
    in proportion to it. If these take longer at ``turn_speed``, or where the point stays, they
    set the time.
    """

    id: float  # changes with each new segment
    kind: float  # HOLD, LINE, CIRCLE or SLEW
    start: Vector7  # m and rad
    goal: Vector7  # m and rad
    centre: Vector3 = (0.0, 0.0, 0.0)  # m, on the axis of a circle
    turn: float = 0.0  # rad, about z, that a circle takes
    speed: float = 0.0  # m/s, of line and circle
    turn_speed: float = 0.0  # rad/s, at most, of the coordinates that are angles
    acceleration: float = 0.0  # m/s^2, of line and circle
    duration: float = 0.0  # s, of a slew
    via_height: float = 0.0  # m, z at the middle of a slew

    def vector(self) -> tuple[float, ...]:
        """Return the segment as numbers, shape (SIZE,)."""
        head = (self.id, self.kind, *self.start, *self.goal, *self.centre)
        return (*head, *self[5:])


def segment_of(vector: tuple[float, ...]) -> Segment:
    """Return the segment of a vector, shape (SIZE,).

    Raises:
        ParameterError: If the vector has another size.
    """
    if len(vector) != SIZE:
        raise ParameterError("segment", vector, f"{SIZE} numbers")
    x, y, z = vector[16:19]
    return Segment(vector[0], vector[1], vector[2:9], vector[9:16], (x, y, z), *vector[19:])


def hold(point: Vector7, number: float) -> Segment:
    """Return the segment that stays at a point."""
    return Segment(number, HOLD, point, point)
