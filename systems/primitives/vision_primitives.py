"""Vision primitives: translation and rotation in the images of two static cameras, and a grasp.

Source: Morrow, Nelson and Khosla, section 3.1. The laws, gains and ends are reconstructed. In the
visual grasp a camera on the gripper centres it on a cross-section. Interaction matrices of a point
and of an angle: Chaumette and Hutchinson.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.cameras.camera import Camera
from chamfer.models.rotation import rotation_matrix
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_numbers,
    require_one_of,
    require_positive,
)
from chamfer.systems.primitives.primitive import (
    STILL,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.primitives.trajectory_primitives import AXES, Axis
from chamfer.systems.primitives.visual_servoing import (
    Servoing,
    StaticCameras,
    Watch,
    half_turn,
    limited,
    seen_part,
)
from chamfer.systems.vision.detections import CrossSection, Detection, Status, unpack_cross_section

Array = NDArray[np.float64]
View = Literal["xz", "yz"]

_NORMAL: Final[dict[View, Axis]] = {"xz": "y", "yz": "x"}  # to the image plane
_GRASP_AXES: Final = (3, 4, 2)  # of the velocity: along X and Y, about Z
_LEAST: Final = 0.05  # smallest singular value of a believed Jacobian, relative to the largest


def _check_jacobian(J: Array) -> None:
    ratio = 0.0
    if J.shape[0] >= J.shape[1]:
        singular = np.linalg.svd(J, compute_uv=False)
        ratio = float(singular[-1] / singular[0])
    if not ratio > _LEAST:
        allowed = f"cameras that see all axes, more than {_LEAST}"
        raise ParameterError("least to largest sensitivity of the cameras", ratio, allowed)


@dataclass(frozen=True, kw_only=True)
class _Servoed(Primitive):
    """A primitive with a visual servoing law, which decides when it is done or lost."""

    servoing: Servoing = Servoing()

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return self.servoing.events

    def begin(self, sensed: Observation) -> object:
        """Return the memory at the start."""
        return Watch(carriage=sensed.carriage)

    def _missing(self, memory: Watch, time: float) -> Stepped:
        """Stand still where a feature is not found."""
        watch, event = self.servoing.missing(memory, time)
        return Stepped(watch, STILL, event)


@dataclass(frozen=True, kw_only=True)
class _Compared(_Servoed):
    """A primitive that aligns a part with another along or about some axes, with the cameras."""

    axes: tuple[Axis, ...] = AXES
    cameras: StaticCameras  # as believed
    moved: int = 0  # part, its place in the detections
    target: int = 1  # part

    ALLOWED: ClassVar[tuple[Axis, ...]] = AXES

    def __post_init__(self) -> None:
        if not self.axes or [*self.axes] != [one for one in self.ALLOWED if one in self.axes]:
            allowed = f"some of {', '.join(self.ALLOWED)}, in this order"
            raise ParameterError("axes", tuple(self.axes), allowed)
        for name in ("moved", "target"):
            if not (part := getattr(self, name)) >= 0:
                allowed = "a whole number >= 0, its place in the detections"
                raise ParameterError(name, part, allowed)
        if self.moved == self.target:
            raise ParameterError("target", self.target, "another part than the moved one")
        require_positive(self, "speed", "tolerance")

    @cached_property
    def _columns(self) -> list[int]:
        return [AXES.index(axis) for axis in self.axes]

    def _pairs(
        self, sensed: Observation, views: Sequence[View]
    ) -> Iterator[tuple[Detection, Detection]]:
        """Yield the detections of both parts in each camera that sees both."""
        for view in views:
            moved = seen_part(sensed, view, self.moved)
            target = seen_part(sensed, view, self.target)
            if moved is not None and target is not None:
                yield moved, target


@dataclass(frozen=True, kw_only=True)
class VisTranslation(_Compared):
    """Moves the tip of a part to a point of another, along chosen axes, with their images.

    Along x and z it uses only the camera along Y, along y and z only the one along X. The other
    camera is not read, so that errors in axes that are not corrected do not disturb.
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, world, of the goal from its tip
    speed: float = 0.05  # m/s, at most; assumed
    tolerance: float = 0.5  # pixels, e_ok; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_numbers(self, 3, "offset")
        middle = [np.array(camera.centre) for camera in self._cameras]
        _check_jacobian(self.jacobian(middle))

    @property
    def label(self) -> str:
        """The name in a chart, such as "vis_xz"."""
        return "vis_" + "".join(self.axes)

    @cached_property
    def views(self) -> tuple[View, ...]:
        """The cameras that it needs."""
        if "y" not in self.axes:
            return ("xz",)
        return ("yz",) if "x" not in self.axes else ("xz", "yz")

    @cached_property
    def _cameras(self) -> list[Camera]:
        return self.cameras.views(self.views)

    @cached_property
    def _rows(self) -> list[int]:
        """Rows of the stacked Jacobian that respond to a chosen axis more than to any other."""
        J = self._stacked([np.array(camera.centre) for camera in self._cameras])
        return [k for k, row in enumerate(np.abs(J)) if int(row.argmax()) in self._columns]

    def _stacked(self, pixels: Sequence[Array]) -> Array:
        depth = self.cameras.depth
        return np.vstack(
            [
                camera.point_jacobian(pixel, depth)
                for camera, pixel in zip(self._cameras, pixels, strict=True)
            ]
        )

    def jacobian(self, pixels: Sequence[Array]) -> Array:
        """Return the believed motion of the features with the axes, pixels / m; relevant rows.

        The pixels are those of the tip, one for each of the ``views``, shape (2,).
        """
        return self._stacked(pixels)[np.ix_(self._rows, self._columns)]

    def deviation(self, tips: Sequence[Array], targets: Sequence[Array]) -> Array:
        """Return the distance of the tip from its set-point in the relevant rows, pixels, (m,).

        The set-point goes to the image by the believed perspective: the offset is added where the
        target's tip is seen. ``tips`` and ``targets`` are pixels, one for each view.
        """
        goals = [
            camera.project(camera.point(target, self.cameras.depth) + self.offset)
            for camera, target in zip(self._cameras, targets, strict=True)
        ]
        deviation: Array = (np.concatenate(tips) - np.concatenate(goals))[self._rows]
        return deviation

    def step(self, sensed: Observation, memory: Watch, time: float) -> Stepped:
        """Return the velocity at a tick; done within the tolerance, lost without both tips."""
        tips, targets = [], []
        for moved, target in self._pairs(sensed, self.views):
            if moved.status == target.status == Status.VALID:
                tips.append(np.array(moved.tip))
                targets.append(np.array(target.tip))
        if len(tips) < len(self.views):
            return self._missing(memory, time)
        J = self.jacobian(tips)
        deviation = self.deviation(tips, targets)
        u = self.servoing.solve(J, deviation)
        small = bool(np.abs(self.servoing.reducible(J, u)).max() <= self.tolerance)
        features = tuple(np.concatenate([*tips, *targets]).tolist())
        watch, event = self.servoing.found(memory, sensed, features, small, time)
        velocity = np.zeros(6)
        velocity[[3 + k for k in self._columns]] = limited(u, self.speed)
        return Stepped(watch, tuple(velocity.tolist()), event)


@dataclass(frozen=True, kw_only=True)
class VisRotation(_Compared):
    """Aligns the axis of a part with that of another, by the angles in the image planes."""

    axes: tuple[Axis, ...] = ("x", "y")  # that it turns about; the camera along X sees x
    speed: float = 0.3  # rad/s, at most; assumed
    tolerance: float = 0.003  # rad, e_ok; assumed

    ALLOWED: ClassVar[tuple[Axis, ...]] = ("x", "y")

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_jacobian(self.jacobian)

    @property
    def label(self) -> str:
        """The name in a chart, such as "vis_rxy"."""
        return "vis_r" + "".join(self.axes)

    @cached_property
    def views(self) -> tuple[View, ...]:
        """The cameras that it needs."""
        return tuple(view for view, normal in _NORMAL.items() if normal in self.axes)

    @cached_property
    def jacobian(self) -> Array:
        """Return the believed rotation of the angles with the axes, shape (n, n).

        A line that is parallel to the image turns in it as much as about the optical axis.
        """
        rows = [camera.R_WC[:, 2] for camera in self.cameras.views(self.views)]
        return np.array(rows)[:, self._columns]

    def step(self, sensed: Observation, memory: Watch, time: float) -> Stepped:
        """Return the velocity at a tick; done within the tolerance, lost without both axes."""
        angles = [(one.angle, other.angle) for one, other in self._pairs(sensed, self.views)]
        if len(angles) < len(self.views):
            return self._missing(memory, time)
        deviation = np.array([half_turn(moved - target) for moved, target in angles])
        small = bool(np.abs(deviation).max() <= self.tolerance)
        features = tuple(angle for pair in angles for angle in pair)
        watch, event = self.servoing.found(memory, sensed, features, small, time)
        turn = limited(self.servoing.solve(self.jacobian, deviation), self.speed)
        velocity = np.zeros(6)
        velocity[self._columns] = turn
        return Stepped(watch, tuple(velocity.tolist()), event)


class _Held(NamedTuple):
    """The memory of a rotation about a fixed point."""

    watch: Watch
    point: Vector | None = None  # pixels, where the tip was
    angle: float = 0.0  # rad, of the axis in the image, then


@dataclass(frozen=True, kw_only=True)
class FixedPointRotation(_Servoed):
    """Turns a part about the normal of an image, and holds its tip at its place in the image.

    The turn alone would move the tip if it is not the reference point. The displacement that
    follows from the believed lever is fed forward; the image corrects the error of that belief.
    """

    view: View = "xz"  # image that it turns in
    cameras: StaticCameras  # as believed
    moved: int = 0  # part, its place in the detections
    angle: float = 0.1  # rad, to turn by in the image, from u to v
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, believed, from reference point to tip
    turn_speed: float = 0.2  # rad/s, at most; assumed
    speed: float = 0.05  # m/s, at most; assumed
    angle_tolerance: float = 0.003  # rad; assumed
    tolerance: float = 0.5  # pixels; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "view", _NORMAL)
        require_finite(self, "angle")
        require_positive(self, "turn_speed", "speed", "angle_tolerance", "tolerance")
        if not self.moved >= 0:
            raise ParameterError("moved", self.moved, "a whole number >= 0")
        if not abs(self.angle) < math.pi / 2:
            raise ParameterError("angle", self.angle, "less than a quarter turn")
        require_numbers(self, 3, "lever")
        _check_jacobian(self.jacobian(np.array(self._camera.centre)))

    @property
    def label(self) -> str:
        """The name in a chart, such as "vis_fixed_ry"."""
        return f"vis_fixed_r{_NORMAL[self.view]}"

    @cached_property
    def _camera(self) -> Camera:
        (camera,) = self.cameras.views([self.view])
        return camera

    @cached_property
    def _normal(self) -> int:
        return AXES.index(_NORMAL[self.view])

    @cached_property
    def _columns(self) -> list[int]:
        return [k for k in range(3) if k != self._normal]

    def jacobian(self, pixel: Array) -> Array:
        """Return the believed motion of the tip in the image with the plane's axes, (2, 2)."""
        return self._camera.point_jacobian(pixel, self.cameras.depth)[:, self._columns]

    def begin(self, sensed: Observation) -> object:
        """Return the memory at the start; the first frame adds the place of the tip."""
        return _Held(Watch(carriage=sensed.carriage))

    def step(self, sensed: Observation, memory: _Held, time: float) -> Stepped:
        """Return the velocity at a tick; done within both tolerances, lost without the tip."""
        part = seen_part(sensed, self.view, self.moved)
        if part is None or part.status != Status.VALID:
            watch, event = self.servoing.missing(memory.watch, time)
            return Stepped(memory._replace(watch=watch), STILL, event)
        point, angle = memory.point, memory.angle
        if point is None:
            point, angle = part.tip, part.angle
        turned = half_turn(part.angle - angle)
        left = half_turn(self.angle - turned)
        deviation = np.subtract(part.tip, point)
        small = abs(left) <= self.angle_tolerance
        small = small and float(np.abs(deviation).max()) <= self.tolerance
        features = (*part.tip, part.angle)
        watch, event = self.servoing.found(memory.watch, sensed, features, small, time)

        # The optical axis and the world's axis have the same direction, nearly.
        rate = self.servoing.gain / self.servoing.period * left
        omega = np.zeros(3)
        omega[self._normal] = max(-self.turn_speed, min(rate, self.turn_speed))
        about = np.zeros(3)
        about[self._normal] = turned
        lever = rotation_matrix(about) @ self.lever
        velocity = np.concatenate([omega, -np.cross(omega, lever)])
        back = self.servoing.solve(self.jacobian(np.array(part.tip)), deviation)
        velocity[[3 + k for k in self._columns]] += back
        velocity[3:] = limited(velocity[3:], self.speed)
        return Stepped(_Held(watch, point, angle), tuple(velocity.tolist()), event)


@dataclass(frozen=True, kw_only=True)
class VisGrasp(_Servoed):
    """Moves along x and y and turns about z until a cross-section is centred and aligned.

    The camera looks down and moves with the gripper. A round cross-section has no direction:
    set ``align`` to False for it.
    """

    camera: Camera  # as believed, in its pose with the carriage at 0
    depth: float = 0.2  # m, believed, of the cross-section from the camera; assumed
    centre: Literal["centroid", "edges"] = "centroid"  # edges: half-way between them
    goal: tuple[float, float] | None = None  # pixels, place of the centre; None: image's centre
    align: bool = True
    angle: float = 0.0  # rad, goal of the longer axis in the image
    speed: float = 0.05  # m/s, at most; assumed
    turn_speed: float = 0.5  # rad/s, at most; assumed
    tolerance: float = 0.5  # pixels; assumed
    angle_tolerance: float = 0.005  # rad; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "centre", ("centroid", "edges"))
        require_positive(self, "depth", "speed", "turn_speed", "tolerance", "angle_tolerance")
        require_finite(self, "angle")
        if self.goal is not None:
            require_numbers(self, 2, "goal")
        if not self.camera.R_WC[2, 2] < -0.1:
            allowed = "of a camera that looks down"
            raise ParameterError("camera", self.camera.R_WC[:, 2].tolist(), allowed)

    @property
    def label(self) -> str:
        """The name in a chart."""
        return "vis_grasp" if self.align else "vis_centre"

    @cached_property
    def _goal(self) -> Array:
        return np.array(self.camera.centre if self.goal is None else self.goal)

    def jacobian(self, pixel: Array, turned: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Array:
        """Return the believed motion of a cross-section in the image with the carriage, (3, 3).

        Rows u, v in pixels and the angle in rad; columns along X, along Y, about Z. Its centre is
        at a pixel, shape (2,), the carriage turned by a rotation vector, rad. The camera is
        assumed to be right above the reference point.
        """
        camera = self.camera
        R_CW = (rotation_matrix(turned) @ camera.R_WC).T
        x, y = (pixel - camera.centre) / camera.focal
        fx, fy = camera.focal
        moves = np.array([[-fx, 0.0, fx * x], [0.0, -fy, fy * y]]) / self.depth
        turns = np.array(
            [[fx * x * y, -fx * (1 + x * x), fx * y], [fy * (1 + y * y), -fy * x * y, -fy * x]]
        )
        J = np.zeros((3, 3))
        J[:2, :2] = (moves @ R_CW)[:, :2]
        J[:2, 2] = turns @ R_CW[:, 2]
        J[2, 2] = -R_CW[2, 2]
        return J

    def step(self, sensed: Observation, memory: Watch, time: float) -> Stepped:
        """Return the velocity at a tick; done when centred and aligned, lost without an image."""
        section = self._seen(sensed)
        if section is None:
            return self._missing(memory, time)
        centre = section.centroid if self.centre == "centroid" else section.middle
        J = self.jacobian(np.array(centre), sensed.carriage[:3])
        deviation = np.zeros(3)
        deviation[:2] = np.subtract(centre, self._goal)
        if self.align:
            deviation[2] = half_turn(section.angle - self.angle)
        else:
            J[:, 2] = (0.0, 0.0, 1.0)  # no turn
        small = bool(np.abs(deviation[:2]).max() <= self.tolerance)
        small = small and abs(deviation[2]) <= self.angle_tolerance
        features = (*section.centroid, section.angle) if self.align else section.centroid
        watch, event = self.servoing.found(memory, sensed, features, small, time)
        u = self.servoing.solve(J, deviation)
        # Slowed down as a whole, so that the way in the image stays.
        share = max(np.hypot(u[0], u[1]) / self.speed, abs(u[2]) / self.turn_speed, 1.0)
        velocity = np.zeros(6)
        velocity[list(_GRASP_AXES)] = u / share
        return Stepped(watch, tuple(velocity.tolist()), event)

    def _seen(self, sensed: Observation) -> CrossSection | None:
        if sensed.cross_section is None:
            return None
        section = unpack_cross_section(sensed.cross_section)
        if section.status != Status.VALID:
            return None
        needed = [*section.centroid]
        needed += [section.angle] if self.align else []
        needed += [*section.edges] if self.centre == "edges" else []
        return section if all(map(math.isfinite, needed)) else None
