"""What a command may be, of each kind: its limits, and how it comes to rest.

Every limit is of each axis: a tool has six, about X, Y, Z and along them, a joint has one. Brakes
are planned so that no border is crossed: the robot may go on for a time T with what it was sent
last, so that a velocity v towards a border at the distance d has to satisfy
v^2 / (2 a) + v T <= d, with the acceleration a.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_numbers

Array = NDArray[np.float64]
Ranges: TypeAlias = Mapping[str, tuple[Array, Array]]  # by what an intervention calls it
Held: TypeAlias = tuple[str, float, float]  # by what it is called, what was asked, what is sent

_ROUNDING: Final = 1e-12  # of velocities, ways and efforts


class Moving(NamedTuple):
    """What is remembered of a command."""

    command: Array | None = None  # sent last
    velocity: Array | None = None  # of it, of each axis; of an effort, how far it is from rest
    place: Array | None = None  # the lowest and the highest to where velocities may have led
    asked: Array | None = None  # the place that was asked for


class Times(NamedTuple):
    """Times of a step, s."""

    elapsed: float  # since the step before, by the clock
    period: float  # between steps, as planned
    hold: float  # for which the robot may go on with what it was sent


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
    _starts: ClassVar[bool] = False

    def __post_init__(self) -> None:
        _require_positive(self, len(self.speed), "speed", "acceleration")
        require_numbers(self, min(len(self.low), len(self.speed)), "low", "high")
        if not all(low < high for low, high in zip(self.low, self.high, strict=True)):
            raise ParameterError("high", self.high, f"numbers above low, {self.low}")
        if (self.low or self._starts) and not self.measured:
            raise ParameterError("measured", "", "the input that says where it is")

    @property
    def size(self) -> int:
        """Elements of the command."""
        return len(self.speed)

    @property
    def reads(self) -> int:
        """Elements of what is measured, at least."""
        return self.size if self._starts else len(self.low)

    @property
    def stopping_time(self) -> float:
        """Time, s, that coming to rest takes at most, if steps came without end."""
        return float(np.divide(self.speed, self.acceleration).max())

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, times: Times
    ) -> tuple[Moving, list[Held]]:
        """Return what is sent, and to what it was held.

        What is ``asked`` is None to come to rest, what is ``seen``, the input that is measured,
        where nothing is new.
        """
        last = np.zeros(self.size) if moving.velocity is None else moving.velocity
        place = moving.place
        if seen is not None and self.low:
            place = np.array([seen[-len(self.low) :]] * 2)
        elif place is not None:
            way = last[-len(self.low) :] * times.elapsed
            place = place + np.array([np.minimum(way, 0), np.maximum(way, 0)])
        wanted = np.zeros(self.size) if asked is None else asked
        velocity, held = _held(wanted, self._ranges(last, place, times.elapsed, times.hold))
        return Moving(velocity, velocity, place), held

    def _ranges(self, last: Array, place: Array | None, elapsed: float, hold: float) -> Ranges:
        """Return what a velocity may be; without a known place it leads nowhere."""
        ranges = {"velocity": _around(0.0, self.speed)}
        if borders := len(self.low):
            low, high = _around(0.0, np.full(len(last), np.inf))
            braking, room = np.array(self.acceleration)[-borders:], np.zeros((2, borders))
            if place is not None:
                room = np.array([place[0] - self.low, self.high - place[1]])
            low[-borders:], high[-borders:] = _braked(room, braking, hold) * [[-1], [1]]
            ranges["workspace"] = low, high
        ranges["acceleration"] = _around(last, np.array(self.acceleration) * elapsed)
        return ranges


@dataclass(frozen=True, kw_only=True)
class PositionLimits(VelocityLimits):
    """Of positions of joints, rad or m, that start from what is ``measured``.

    Their velocity is the way of a step over the period: robots take a place a period, however
    much before or after its time it was sent.
    """

    _starts: ClassVar[bool] = True

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, times: Times
    ) -> tuple[Moving, list[Held]]:
        """Return what is sent, and to what it was held; nothing before it is known where it is."""
        period, axes = times.period, len(self.speed)
        place = seen if moving.command is None else moving.command
        if place is None:
            return moving, []
        last = np.zeros(axes) if moving.velocity is None else moving.velocity
        wanted = direct = np.zeros(axes) if asked is None else self._way(place, asked) / period
        if asked is not None and moving.asked is not None and moving.asked is not place:
            # It got away from what is asked for: that is caught up with, and not overrun.
            way, braking = self._way(place, moving.asked), np.array(self.acceleration)
            near = np.abs(way) <= braking * period**2 / 2
            speed = np.where(near, np.abs(way) / period, _braked(np.abs(way), braking, period))
            wanted = self._way(moving.asked, asked) / period + np.sign(way) * speed
        border = np.array([place[-len(self.low) :]] * 2)
        elapsed = max(period, times.elapsed)
        velocity, held = _held(wanted, self._ranges(last, border, elapsed, period))
        i = int((off := np.abs(velocity - direct) * period).argmax())
        if asked is not None and off[i] <= _ROUNDING:
            return Moving(asked, direct, None, asked), held
        held = held or [("behind", float(direct[i]), float(velocity[i]))]
        return Moving(self._moved(place, velocity * period), velocity, None, asked), held

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
        _require_positive(self, 6, "speed", "acceleration")

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
    """Of joint torques, or a wrench. In a stop it goes to that at ``rest``."""

    most: tuple[float, ...]  # N m or N, largest size
    rate: tuple[float, ...]  # N m/s or N/s
    rest: tuple[float, ...] = ()  # N m or N; (): 0, for a robot that carries its own weight
    measured: ClassVar[str] = ""
    reads: ClassVar[int] = 0

    def __post_init__(self) -> None:
        _require_positive(self, len(self.most), "most", "rate")
        require_numbers(self, len(self.rest and self.most), "rest")
        if any(abs(one) > most for one, most in zip(self.rest, self.most, strict=False)):
            raise ParameterError("rest", self.rest, f"sizes of at most {self.most}")

    @property
    def size(self) -> int:
        """Elements of the command."""
        return len(self.most)

    @property
    def stopping_time(self) -> float:
        """Time, s, from the largest effort to rest."""
        return float(((np.array(self.most) + np.abs(self._rest)) / self.rate).max())

    @property
    def _rest(self) -> Array:
        return np.array(self.rest or (0.0,) * self.size)

    def step(
        self, moving: Moving, asked: Array | None, seen: Array | None, times: Times
    ) -> tuple[Moving, list[Held]]:
        """Return what is sent, and to what it was held."""
        ranges = {"effort": _around(0.0, self.most)}
        if moving.command is not None:
            ranges["rate"] = _around(moving.command, np.array(self.rate) * times.elapsed)
        effort, held = _held(self._rest if asked is None else asked, ranges)
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


def _held(wanted: Array, ranges: Ranges) -> tuple[Array, list[Held]]:
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
