"""What a command may be, of each kind: its limits, and how it comes to rest.

Every limit is of each axis: a tool has six, about X, Y, Z and along them, a joint has one. Brakes
are planned so that no border is crossed: the robot may go on for a time T with what it was sent
last, so that a velocity v towards a border at the distance d has to satisfy
v^2 / (2 a) + v T <= d, with the acceleration a.
"""

from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_numbers

Array = NDArray[np.float64]
Held: TypeAlias = tuple[str, float, float]  # by what it is called, what was asked, what is sent

_ROUNDING: Final = 1e-12  # of velocities, ways and efforts


class Moving(NamedTuple):
    """What is remembered of a command."""

    command: Array | None = None  # sent last
    velocity: Array = np.zeros(1)  # of it, of each axis; of an effort, how far it is from rest
    room: Array = np.full((2, 1), np.inf)  # of each axis, to the lower and the upper border
    asked: Array | None = None  # the place that was asked for


@dataclass(frozen=True, kw_only=True)
class VelocityLimits:
    """Of a velocity: of a tool, rad/s above m/s in the world's axes, or of joints.

    ``low`` and ``high`` are borders of where the last axes are, for a tool x, y and z; where is
    said by the last elements of the input ``measured``. Between measurements the robot is taken
    to move as it was sent; a measurement's delay has to be left as a margin.
    """

    speed: tuple[float, ...]  # rad/s or m/s
    acceleration: tuple[float, ...]  # rad/s^2 or m/s^2
    low: tuple[float, ...] = ()  # rad or m
    high: tuple[float, ...] = ()  # rad or m
    measured: str = ""

    def __post_init__(self) -> None:
        _require_positive(self, len(self.speed), "speed", "acceleration")
        require_numbers(self, min(len(self.low), len(self.speed)), "low", "high")
        if not all(low < high for low, high in zip(self.low, self.high, strict=True)):
            raise ParameterError("high", self.high, f"numbers above low, {self.low}")
        if self.reads and not self.measured:
            raise ParameterError("measured", "", "the input that says where it is")

    @property
    def size(self) -> int:
        """Elements of the command."""
        return len(self.speed)

    @property
    def reads(self) -> int:
        """Elements of what is measured, at least."""
        return len(self.low)

    @property
    def stopping_time(self) -> float:
        """Time, s, that coming to rest takes at most, if steps came without end."""
        return float(np.divide(self.speed, self.acceleration).max())

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, elapsed: float, hold: float
    ) -> tuple[Moving, list[Held]]:
        """Return what is sent, and to what it was held.

        What is ``asked`` is None to come to rest, what is ``seen``, the input that is measured,
        where nothing is new. The robot may go on for a time, to ``hold``, with what it is sent.
        """
        if seen is not None:
            room = self._room(seen)
        else:  # it may have gone on, or not: clocks may be fast
            way = moving.velocity * elapsed
            room = moving.room - np.maximum([-way, way], 0)
        acceleration = np.array(self.acceleration)
        down, up = _braked(room, acceleration, hold)
        velocity, held = _held(
            np.zeros(len(self.speed)) if asked is None else asked,
            velocity=_around(0.0, self.speed),
            workspace=(-down, up),
            acceleration=_around(moving.velocity, acceleration * elapsed),
        )
        return Moving(velocity, velocity, room), held

    def _room(self, place: Array) -> Array:
        free = (np.inf,) * (len(self.speed) - len(self.low))
        here = place[len(place) - len(self.low) :]
        return np.array([[*free, *(here - self.low)], [*free, *(self.high - here)]])


@dataclass(frozen=True, kw_only=True)
class PositionLimits(VelocityLimits):
    """Of positions of joints, rad or m, that start from what is ``measured``.

    They are held as velocities are, those of the ways of a step over the period: robots take a
    place a period, however much before or after its time it was sent.
    """

    @property
    def reads(self) -> int:
        """Elements of what is measured, at least."""
        return self.size

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, elapsed: float, hold: float
    ) -> tuple[Moving, list[Held]]:
        """Return what is sent, and to what it was held; nothing before it is known where it is."""
        place = seen if moving.command is None else moving.command
        if place is None:
            return moving, []
        wanted, behind = None, list[Held]()
        if asked is not None:
            # From what was asked for it may be away: that is caught up with, and not overrun.
            target = place if moving.asked is None else moving.asked
            way = np.abs(self._way(place, target))
            speed = _braked(way, np.array(self.acceleration), hold)
            wanted, behind = _held(
                self._way(place, asked) / hold,
                behind=_around(self._way(target, asked) / hold, speed),
            )
        moved, held = super().step(moving, wanted, place, max(hold, elapsed), hold)
        through = asked is not None and not behind + held
        command = asked if through else self._moved(place, moved.velocity * hold)
        return Moving(command, moved.velocity, asked=asked), behind + held

    def _way(self, place: Array, target: Array) -> Array:
        return target - place

    def _moved(self, place: Array, way: Array) -> Array:
        return place + way


@dataclass(frozen=True, kw_only=True)
class PoseLimits(PositionLimits):
    """Of a tool's pose: quaternion w, x, y, z and position, m, in the world.

    A quaternion and its negative turn alike: the nearer is gone to.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        require_numbers(self, 6, "speed")

    @property
    def size(self) -> int:
        """Elements of the command."""
        return 7

    def _way(self, place: Array, target: Array) -> Array:
        q = _product(target[:4], place[:4] * [1, -1, -1, -1])
        sine = float(np.linalg.norm(q[1:]))
        angle = 2 * float(np.arctan2(sine, abs(q[0])))
        turn = q[1:] * np.copysign(angle / sine if sine > 0 else 2.0, q[0])
        return np.concatenate([turn, target[4:] - place[4:]])

    def _moved(self, place: Array, way: Array) -> Array:
        angle = float(np.linalg.norm(way[:3]))
        turn = np.array([np.cos(angle / 2), *(way[:3] * (0.5 * np.sinc(angle / (2 * np.pi))))])
        return np.concatenate([_product(turn, place[:4]), place[4:] + way[3:]])


@dataclass(frozen=True, kw_only=True)
class EffortLimits:
    """Of joint torques, or a wrench. It starts from that at ``rest``, and stops there."""

    most: tuple[float, ...]  # N m or N, largest size
    rate: tuple[float, ...]  # N m/s or N/s
    rest: tuple[float, ...] = ()  # N m or N; (): 0, for a robot that carries its own weight
    measured: ClassVar[str] = ""
    reads: ClassVar[int] = 0

    def __post_init__(self) -> None:
        _require_positive(self, len(self.most), "most", "rate")
        require_numbers(self, len(self.rest and self.most), "rest")
        if np.any(np.abs(self._rest) > self.most):
            raise ParameterError("rest", self.rest, f"sizes of at most {self.most}")

    @property
    def size(self) -> int:
        """Elements of the command."""
        return len(self.most)

    @property
    def stopping_time(self) -> float:
        """Time, s, from the largest effort to rest."""
        return float(((self.most + np.abs(self._rest)) / self.rate).max())

    @property
    def _rest(self) -> Array:
        return np.array(self.rest or (0.0,) * self.size)

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, elapsed: float, hold: float
    ) -> tuple[Moving, list[Held]]:
        """Return what is sent, and to what it was held."""
        effort, held = _held(
            self._rest if asked is None else asked,
            effort=_around(0.0, self.most),
            rate=_around(self._rest + moving.velocity, np.array(self.rate) * elapsed),
        )
        return Moving(effort, effort - self._rest), held


Limits: TypeAlias = VelocityLimits | EffortLimits


def _require_positive(params: object, count: int, *names: str) -> None:
    for name in names:
        require_numbers(params, count, name)
        if not min(values := getattr(params, name), default=0) > 0:
            raise ParameterError(name, values, "numbers > 0")


def _around(middle: Array | float, most: Array | tuple[float, ...]) -> tuple[Array, Array]:
    return middle - np.array(most), middle + np.array(most)


def _braked(distance: Array, braking: Array, hold: float) -> Array:
    """Return the largest velocity of which one can brake, after a hold, within a distance."""
    left = 2 * np.maximum(distance, 0) / braking
    velocity: Array = braking * (np.sqrt(hold**2 + left) - hold)
    return velocity


def _held(wanted: Array, **ranges: tuple[Array, Array]) -> tuple[Array, list[Held]]:
    """Return what is wanted, held to one range after the other, and to which it was."""
    found = []
    for cause, (low, high) in ranges.items():
        inside = np.clip(wanted, low, high)
        i = int((over := np.abs(wanted - inside)).argmax())
        if over[i] > _ROUNDING:
            found.append((cause, float(wanted[i]), float(inside[i])))
            wanted = inside
    return wanted, found


def _product(p: Array, q: Array) -> Array:
    """Return the product of two quaternions, of length 1."""
    a, b, c, d = p.tolist()
    product = np.array([[a, -b, -c, -d], [b, a, -d, c], [c, d, a, -b], [d, -c, b, a]]) @ q
    unit: Array = product / np.linalg.norm(product)
    return unit
