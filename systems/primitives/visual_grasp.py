"""The visual grasp: a camera on the gripper centres it on a cross-section (section 3.1).

Source: Morrow, Nelson and Khosla, "Visual grasping". Interaction matrices of a point and of an
angle: Chaumette and Hutchinson.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_one_of,
    require_positive,
)
from chamfer.systems.primitives.primitive import STILL, Event, Observation, Stepped
from chamfer.systems.primitives.visual_servoing import Servoing, Watch, half_turn
from chamfer.systems.vision.cross_section import CrossSection, unpack_cross_section
from chamfer.systems.vision.part_detection import Status

Array = NDArray[np.float64]

_SERVOING: Final = Servoing()
_AXES: Final = (3, 4, 2)  # of the velocity: along X and Y, about Z


@dataclass(frozen=True, kw_only=True)
class VisGrasp:
    """Moves along x and y and turns about z until a cross-section is centred and aligned.

    The camera looks down and moves with the gripper. A round cross-section has no direction:
    set ``align`` to False for it.
    """

    camera: Camera  # as believed, as it stands where the carriage is at 0
    depth: float = 0.2  # m, believed, of the cross-section from the camera; assumed
    centre: Literal["centroid", "edges"] = "centroid"  # edges: half-way between them
    goal: tuple[float, float] | None = None  # pixels, where it should be; None: image's centre
    align: bool = True
    angle: float = 0.0  # rad, that the longer axis should have in the image
    speed: float = 0.05  # m/s, at most; assumed
    turn_speed: float = 0.5  # rad/s, at most; assumed
    tolerance: float = 0.5  # pixels; assumed
    angle_tolerance: float = 0.005  # rad; assumed
    servoing: Servoing = _SERVOING

    def __post_init__(self) -> None:
        require_one_of(self, "centre", ("centroid", "edges"))
        require_positive(self, "depth", "speed", "turn_speed", "tolerance", "angle_tolerance")
        require_finite(self, "angle")
        if self.goal is not None and not all(map(math.isfinite, self.goal)):
            raise ParameterError("goal", self.goal, "two finite numbers")
        if not self.camera.R_WC[2, 2] < -0.1:
            allowed = "of a camera that looks down"
            raise ParameterError("camera", self.camera.R_WC[:, 2].tolist(), allowed)

    @property
    def label(self) -> str:
        """Of the primitive in a chart."""
        return "vis_grasp" if self.align else "vis_centre"

    @cached_property
    def _goal(self) -> Array:
        return np.array(self.camera.centre if self.goal is None else self.goal)

    def jacobian(self, pixel: Array, turned: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Array:
        """Return how a cross-section is believed to move in the image with the carriage.

        Args:
            pixel: Of its centre, shape (2,).
            turned: Of the carriage, rotation vector, rad.

        Returns:
            Rows u, v in pixels and the angle in rad; columns along X, along Y, about Z; shape
            (3, 3). The camera is taken to be right above the reference point.
        """
        camera = self.camera
        R_CW = (Rotation.from_rotvec(turned).as_matrix() @ camera.R_WC).T
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

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return self.servoing.events

    def begin(self, sensed: Observation) -> object:
        """Return the memory at the begin."""
        return Watch(carriage=sensed.carriage)

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        """Return the velocity at a tick; done when centred and aligned, lost without an image."""
        assert isinstance(memory, Watch)
        section = self._seen(sensed)
        if section is None:
            watch, event = self.servoing.missing(memory, time)
            return Stepped(watch, STILL, event)
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
        velocity[list(_AXES)] = u / share
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
