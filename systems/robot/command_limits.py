"""The limits of each kind of command, and its way to rest.

Every limit is of each axis: a tool has six, about X, Y, Z and along them, a joint has one. Braking
is planned so that no border is crossed. The robot may go on for a time T with the last command, so
that a velocity v towards a border at the distance d has to satisfy
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
    """The state of a command."""

    command: Array | None = None  # sent last
    velocity: Array = np.zeros(1)  # of it, of each axis; of an effort, its distance from rest
    room: Array = np.full((2, 1), np.inf)  # of each axis, to the lower and the upper border
    asked: Array | None = None  # requested position


@dataclass(frozen=True, kw_only=True)
class VelocityLimits:
    """Limits of a velocity: of a tool, rad/s above m/s in the world's axes, or of joints.

    ``low`` and ``high`` are borders of the last axes' positions, for a tool x, y and z. The last
    elements of the input ``measured`` are these positions. Between measurements the guard assumes
    that the robot moves as commanded; leave a margin for a measurement's delay.
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
        """Least number of elements of the measurement."""
        return len(self.low)

    @property
    def stopping_time(self) -> float:
        """Longest time, s, to come to rest, with steps without end."""
        return float(np.divide(self.speed, self.acceleration).max())

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, elapsed: float, hold: float
    ) -> tuple[Moving, list[Held]]:
        """Return the command to send, and the limits that changed it.

        ``asked`` is None to come to rest. ``seen`` is the measured input, None without a new one.
        The robot may go on for a time, ``hold``, with the command.
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
    """Limits of joint positions, rad or m, which start from the ``measured`` ones.

    They are limited as velocities are, those of the steps over the period: robots execute a
    position a period, however much before or after its time it was sent.
    """

    @property
    def reads(self) -> int:
        """Least number of elements of the measurement."""
        return self.size

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, elapsed: float, hold: float
    ) -> tuple[Moving, list[Held]]:
        """Return the command to send, and the limits that changed it; None while it is unknown."""
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
    """Limits of a tool's pose: quaternion w, x, y, z and position, m, in the world.

    A quaternion and its negative are the same rotation: the guard goes to the nearer one.
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
    """Limits of joint torques, or a wrench. It starts from that at ``rest``, and stops there."""

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
        """Return the command to send, and the limits that changed it."""
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
    """Return the largest velocity that can brake, after a hold, within a distance."""
    left = 2 * np.maximum(distance, 0) / braking
    velocity: Array = braking * (np.sqrt(hold**2 + left) - hold)
    return velocity


def _held(wanted: Array, **ranges: tuple[Array, Array]) -> tuple[Array, list[Held]]:
    """Return the request, limited to one range after the other, and the ranges that changed it."""
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
