"""The common parts of the vision primitives: control law, believed cameras, and end conditions.

Sources: Morrow, Nelson and Khosla, section 3.1: errors on the image plane drive the manipulator,
its cameras poorly calibrated. The law is that of Nelson, Papanikolopoulos and Khosla, their [13].

A primitive uses the last detections: between two frames its velocity stays. Frames are counted by
time, because detections do not say when the next frame comes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError, require_positive, require_whole
from chamfer.systems.primitives.primitive import STILL, Event, Observation, Vector
from chamfer.systems.statechart.chart import TIME_TOLERANCE
from chamfer.systems.vision.detections import DETECTION_SIZE, Detection, unpack_detections

Array = NDArray[np.float64]

_MOVED: Final = (0.005, 0.001)  # rad, m, after which a live image cannot be the same


def limited(velocity: Array, most: float) -> Array:
    """Return a velocity, shortened to a length of ``most`` if it is longer."""
    length = float(np.linalg.norm(velocity))
    short: Array = velocity * min(1.0, most / length) if length > 0 else velocity
    return short


def slowest_root(share: complex, *, delay: int = 1) -> float:
    """Return the size of the largest root of a loop that removes a share of each frame's error.

    ``e[k + 1] = e[k] - share e[k - delay]``: it settles if the result is below 1. The share is
    the gain times an eigenvalue of the true motion per deviation times the inverse of the belief.
    """
    polynomial = np.zeros(delay + 2, dtype=complex)
    polynomial[0], polynomial[1] = 1.0, -1.0
    polynomial[-1] += share
    return float(np.abs(np.roots(polynomial)).max())


class Watch(NamedTuple):
    """The memory of a vision primitive: the frames so far."""

    settled: float | None = None  # s, since when the error is small
    missing: float | None = None  # s, since when something was not found
    features: Vector = ()  # of the last frame
    since: float = 0.0  # s, time of that frame
    carriage: Vector = STILL  # rad above m, pose at that time


@dataclass(frozen=True, kw_only=True)
class ServoingParams:
    """Speed of a vision primitive, and its end conditions.

    With one frame of delay, a gain up to 1/4 settles without overshoot, and one below 1 settles.
    The true gain is larger if the focal length is believed too short.

    Where a part is not found, the primitive stands still; after ``lost_frames`` such frames it is
    lost. It is lost as well if as many frames stay the same while the carriage moves.
    """

    gain: float = 0.2  # lambda T, share of the error that is removed in a frame's period; assumed
    settled_frames: int = 5  # with a small error, until it is done, m; assumed
    lost_frames: int = 10  # without a needed feature, until it is lost, n; assumed

    def __post_init__(self) -> None:
        if not 0 < self.gain < 1:
            raise ParameterError("gain", self.gain, "a number between 0 and 1")
        require_whole(self, "settled_frames", "lost_frames")

    def with_frames(self, period: float) -> "Servoing":
        """Return the law for frames of a period, s."""
        return Servoing(**vars(self), period=period)


@dataclass(frozen=True, kw_only=True)
class Servoing(ServoingParams):
    """The control law of a primitive for a period of the frames."""

    period: float = 1 / 30  # s, of the frames; assumed
    ends: bool = True  # False: never done, it holds the reached pose until it is lost

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "period")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events of a primitive with this law, each with the earliest time, s."""
        lost: dict[Event, float] = {"lost": self.lost_frames * self.period}
        return {**lost, "done": self.settled_frames * self.period} if self.ends else lost

    def solve(self, J: Array, deviation: Array) -> Array:
        """Return the velocity that removes the share ``gain`` of a deviation in a period.

        ``u = -(T J' T J + L)^-1 T J' (x - x_D)``, eq. of [13] with Q = 1, makes ``|x + T J u -
        x_D|^2 + u' L u`` least: the error that is expected a period T later and the cost of the
        motion. With ``L = (1 / gain - 1) T J' T J`` all directions have the same ``lambda T``. J,
        the motion of the features with u, has the shape (m, n), m >= n, the deviation x - x_D
        (m,).
        """
        step = self.period * J
        damping = (1 / self.gain - 1) * step.T @ step
        u: Array = np.asarray(np.linalg.solve(step.T @ step + damping, -step.T @ deviation))
        return u

    def reducible(self, J: Array, velocity: Array) -> Array:
        """Return the part of the deviation that a velocity of :meth:`solve` removes in time.

        The rest has no effect: with more features than axes and a wrong calibration, the features
        can't reach their goals all at once.
        """
        part: Array = -(self.period / self.gain) * J @ velocity
        return part

    def found(
        self, watch: Watch, sensed: Observation, features: Vector, small: bool, time: float
    ) -> tuple[Watch, Event | None]:
        """Return the memory and the event of a tick at which all features were found."""
        since, carriage = watch.since, watch.carriage
        if features != watch.features:
            since, carriage = time, sensed.carriage
        settled = None
        if small:
            settled = time if watch.settled is None else watch.settled
        event: Event | None = None
        if self.ends and settled is not None and self._lasted(time - settled, self.settled_frames):
            event = "done"
        elif self._lasted(time - since, self.lost_frames) and _moved(carriage, sensed.carriage):
            event = "lost"
        return Watch(settled, None, features, since, carriage), event

    def missing(self, watch: Watch, time: float) -> tuple[Watch, Event | None]:
        """Return the memory and the event of a tick at which a feature was not found."""
        first = time if watch.missing is None else watch.missing
        event: Event | None = "lost" if self._lasted(time - first, self.lost_frames) else None
        return watch._replace(settled=None, missing=first), event

    def _lasted(self, duration: float, frames: int) -> bool:
        return duration >= frames * self.period - TIME_TOLERANCE


def _moved(before: Vector, after: Vector) -> bool:
    way = np.abs(np.subtract(after, before))
    return bool(way[:3].max() > _MOVED[0] or way[3:].max() > _MOVED[1])


@dataclass(frozen=True, kw_only=True)
class StaticCameras:
    """The two static cameras as a primitive believes them to be."""

    xz: Camera | None = None  # looks along Y
    yz: Camera | None = None  # looks along X
    depth: float = 0.5  # m, of the parts from the cameras; assumed

    def __post_init__(self) -> None:
        require_positive(self, "depth")

    def views(self, names: Sequence[str]) -> list[Camera]:
        """Return cameras by the names of their views; all have to be there."""
        cameras = []
        for name in names:
            camera: Camera | None = getattr(self, name)
            if camera is None:
                raise ParameterError(f"cameras.{name}", None, "a camera, the axes need it")
            cameras.append(camera)
        return cameras


def seen_part(sensed: Observation, view: str, part: int) -> Detection | None:
    """Return the detection of a part in a static camera, by its place; None: not detected.

    Raises:
        ParameterError: If the camera looks for fewer parts.
    """
    detections: Vector | None = getattr(sensed, f"{view}_detections")
    if detections is None:
        return None
    first = DETECTION_SIZE * part
    if not 0 <= first < len(detections):
        allowed = f"0 to {len(detections) // DETECTION_SIZE - 1}, as many parts are looked for"
        raise ParameterError("part", part, allowed)
    (detection,) = unpack_detections(detections[first : first + DETECTION_SIZE])
    return None if detection.status.lost else detection


def half_turn(angle: float) -> float:
    """Return the angle between two lines without direction, from -pi/2 to pi/2."""
    return math.remainder(angle, math.pi)
