"""A segment of a trajectory: the motion that a chart requests, as a vector of fixed size."""

import math
from typing import Final, NamedTuple

from chamfer.models.validation import ParameterError

Vector3 = tuple[float, float, float]
Vector7 = tuple[float, ...]

HOLD: Final = 0  # at the goal
LINE: Final = 1  # straight to the goal, speed trapezoidal in time
CIRCLE: Final = 2  # an arc to the goal about an axis, likewise
SLEW: Final = 3  # in a given time over a via height, no acceleration at the ends

COORDINATES: Final = 7  # of the endpoint vector
SIZE: Final = 25  # of the vector
POSITION: Final = ("m",) * 3 + ("rad",) * 4  # units of the endpoint vector
VELOCITY: Final = ("m/s",) * 3 + ("rad/s",) * 4


class Segment(NamedTuple):
    """One motion of the endpoint vector from ``start`` to ``goal``, from rest to rest.

    On a line or circle the point moves in space with ``speed``; the other coordinates move in
    proportion to it. If these need longer at ``turn_speed``, or if the point stays, they set the
    time. The acceleration of any kind also limits the transition from the motion before it.
    """

    id: float  # changes with each new segment
    kind: float  # HOLD, LINE, CIRCLE or SLEW
    start: Vector7  # m and rad
    goal: Vector7  # m and rad
    centre: Vector3 = (0.0, 0.0, 0.0)  # m, on the axis of a circle
    turn: float = 0.0  # rad, about z, that a circle takes
    speed: float = 0.0  # m/s, of line and circle
    turn_speed: float = 0.0  # rad/s, of each angle, at most; 0: the follower's
    acceleration: float = 0.0  # m/s^2; 0: the follower's
    duration: float = 0.0  # s, of a slew
    via_height: float = 0.0  # m, z at the middle of a slew

    def vector(self) -> tuple[float, ...]:
        """Return the segment as numbers, shape (SIZE,), in the units ``SEGMENT``."""
        head = (self.id, self.kind, *self.start, *self.goal, *self.centre)
        return (*head, *self[5:])


SEGMENT: Final = ("", "", *POSITION * 2, *["m"] * 3, "rad", "m/s", "rad/s", "m/s^2", "s", "m")


def segment_of(vector: tuple[float, ...]) -> Segment:
    """Return the segment of a vector, shape (SIZE,).

    Raises:
        ParameterError: If the vector has another size, or a number is not finite.
    """
    if len(vector) != SIZE or not all(map(math.isfinite, vector)):
        raise ParameterError("segment", vector, f"{SIZE} finite numbers")
    x, y, z = vector[16:19]
    return Segment(vector[0], vector[1], vector[2:9], vector[9:16], (x, y, z), *vector[19:])


def hold(point: Vector7, number: float) -> Segment:
    """Return the segment that stays at a point."""
    return Segment(number, HOLD, point, point)


def circle(
    start: Vector7,
    number: float,
    *,
    centre: Vector3,
    turn: float,
    rise: float = 0.0,
    speed: float,
    acceleration: float = 0.0,
) -> Segment:
    """Return an arc about a vertical axis; the yaw turns with it.

    Args:
        start: m and rad.
        number: Of the segment.
        centre: m, on the axis.
        turn: rad, from x to y; any number of turns.
        rise: m, upwards on the way.
        speed: m/s, along the arc, at most.
        acceleration: m/s^2, along the arc; 0: the follower's.
    """
    x, y, z, yaw, *others = start
    c, s = math.cos(turn), math.sin(turn)
    across, along = x - centre[0], y - centre[1]
    goal = (
        centre[0] + c * across - s * along,
        centre[1] + s * across + c * along,
        z + rise,
        yaw + turn,
        *others,
    )
    limits = {"speed": speed, "acceleration": acceleration}
    return Segment(number, CIRCLE, start, goal, centre, turn, **limits)
