"""Measurements of the cell's cameras of parts at rest, without noise, frames or a diagram."""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_vision import (
    VIEWS,
    believed_camera,
    looks_in,
    true_camera,
    undistortion_of,
)
from chamfer.models.cameras.camera import View
from chamfer.systems.cameras.camera_image import Image, shaded
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_from_vector, pose_vector
from chamfer.systems.vision.cell_error import AXES, image_plane_error
from chamfer.systems.vision.detections import Detection
from chamfer.systems.vision.part_detection import detect_parts
from chamfer.systems.vision.part_detector import alignment_error
from chamfer.systems.vision.two_plane_stereo import locate, metric_error

Array = NDArray[np.float64]

_ROLL: Final = AXES.index("roll")
_AT_REST: Final = 1e-6  # m and rad, that the peg still moves
_MOST: Final = 40  # moves
_FAR: Final = 0.3  # m and rad, from the aligned pose


class StillVision:
    """The measurement of the alignment's diagram, of poses instead of frames.

    Args:
        scenario: Resolved, with the software camera.
        picture: What else becomes of an image before the parts are looked for.
    """

    def __init__(
        self, scenario: AlignmentScenario, picture: Callable[[Image], Image] | None = None
    ) -> None:
        settings = scenario.cameras
        self._scenario = scenario
        self._picture = picture
        self._cameras = {view: true_camera(settings, scenario, view) for view in VIEWS}
        self._looks = {view: looks_in(settings, scenario, view) for view in VIEWS}
        self._straight = {view: undistortion_of(settings, scenario, view) for view in VIEWS}
        believed = [believed_camera(settings, scenario, view) for view in VIEWS]
        self._believed = [camera.straight() for camera in believed]

    def image(self, view: View, X_WT: RigidTransform, X_WM: RigidTransform) -> Image:
        """Return a camera's image of peg and hole part, shape (height, width, 3)."""
        sensor = self._scenario.cameras.view(view).sensor
        image = render(self._scenario.parts, self._cameras[view], X_WT, X_WM)
        if sensor.shades:
            image = shaded(image, sensor.vignetting, sensor.white_balance)
        return image if self._picture is None else self._picture(image)

    def error(self, X_WT: RigidTransform, X_WM: RigidTransform) -> Array:
        """Return the measured error, shape (6,), in m and rad along and about the hole's axes.

        The gap to be kept is left out; NaN is what was not measured.
        """
        settings = self._scenario.cameras
        found = [self._found(view, X_WT, X_WM) for view in VIEWS]
        if settings.measured == "metric":
            peg, hole = (locate(self._believed, part) for part in zip(*found, strict=True))
            error = metric_error(peg, hole)
        else:
            scales = [np.array([s, s, 1.0]) for s in map(settings.pixel_scale, VIEWS)]
            xz, xy = (alignment_error(*f) * s for f, s in zip(found, scales, strict=True))
            error = image_plane_error(xz, xy) * ([settings.pixel_size] * 3 + [1.0] * 3)
        error[0] -= self._scenario.gap
        error[_ROLL] = 0.0
        return error

    def _found(
        self, view: View, X_WT: RigidTransform, X_WM: RigidTransform
    ) -> tuple[Detection, Detection]:
        image, straight = self.image(view, X_WT, X_WM), self._straight[view]
        return detect_parts(image if straight is None else straight(image), *self._looks[view])

    def aligned(self) -> RigidTransform | None:
        """Return X_WT where nothing is measured to be wrong, the hole part at its place.

        It is where a loop without dead zones comes to rest; None if the peg gets lost on the way
        there, or further away at every move.
        """
        X_WM = self._scenario.nominal_pose("hole")
        nominal = pose_vector(self._scenario.nominal_pose("peg"))
        axes = np.kron(np.eye(2), self._scenario.hole_axes.matrix())
        moved = np.zeros(len(AXES))
        for _ in range(_MOST):
            X_WT = pose_from_vector(compensate(nominal, axes @ moved))
            error = self.error(X_WT, X_WM)
            moved = moved + error
            if not np.abs(moved).max() < _FAR:  # or NaN
                return None
            if np.abs(error).max() < _AT_REST:
                return X_WT
        # To and fro between the shades that a pixel may have.
        return X_WT if np.abs(error).max() < 100 * _AT_REST else None
