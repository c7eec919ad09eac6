"""Detection near alignment, where edges are nearly parallel to the rows of pixels."""

import functools
import math
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import add_noise
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.cameras.vtk_camera import VtkCamera, missing_graphics
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import Status, detect_parts

PARTS = ColouredParts()
LOOKS = appearances(PARTS)

VIEWS: Any = ("xz", "xy")
POSES = 15


@functools.lru_cache
def vtk(view: Any, roll: float) -> tuple[VtkCamera, Any]:
    reason = missing_graphics()
    if reason:
        pytest.skip(reason)
    camera = VtkCamera(PARTS, CameraPlacement(view=view, roll=roll).camera)
    return camera, camera.CreateDefaultContext()


def errors(view: Any, roll: float, images: str) -> np.ndarray:
    """Return rms of peg and hole part along and across, pixels, and of the angle, mrad.

    Of poses within 1 mm and 5 mrad, from the pinhole projection of tip and axis.
    """
    camera = CameraPlacement(view=view, roll=roll).camera
    generator = np.random.default_rng(11)
    found = []
    for _ in range(POSES):
        poses = [
            RigidTransform(
                RollPitchYaw(generator.uniform(-0.005, 0.005, 3)),
                np.array([x, 0, 0]) + generator.uniform(-0.001, 0.001, 3),
            )
            for x in (-0.015, 0.015)
        ]
        if images == "vtk":
            block, context = vtk(view, roll)
            for name, X_WP in zip(("peg_pose", "hole_pose"), poses, strict=True):
                block.GetInputPort(name).FixValue(context, pose_vector(X_WP))
            image = block.GetOutputPort("image").Eval(context).data[..., :3].copy()
        else:
            image = render(PARTS, camera, *poses, style=SceneStyle(blur=0.7))
            if images == "noisy":
                image = add_noise(image, 4.0, generator)
        for part, X_WP in zip(detect_parts(image, *LOOKS), poses, strict=True):
            assert part.status == Status.VALID
            p_WP, axis = X_WP.translation(), X_WP.rotation().matrix()[:, 0]
            origin, front = camera.project(np.array([p_WP, p_WP + 0.01 * axis]))
            way = (front - origin) / np.linalg.norm(front - origin)
            off = np.subtract(part.tip, origin)
            turned = part.angle - math.atan2(way[1], way[0])
            found.append([way @ off, way[0] * off[1] - way[1] * off[0], 1e3 * turned])
    rms: np.ndarray = np.sqrt((np.reshape(found, (POSES, 2, 3)) ** 2).mean(axis=0))
    return rms


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("roll", [0.0, 0.1])
def test_software_camera(view: Any, roll: float) -> None:
    peg, hole = errors(view, roll, "clean")
    assert (peg < [0.03, 0.005, 0.04]).all()
    assert (hole < [0.04, 0.008, 0.06]).all()
    peg, hole = errors(view, roll, "noisy")
    assert (peg < [0.09, 0.017, 0.2]).all()
    assert (hole < [0.09, 0.02, 0.4]).all()


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
def test_vtk_camera_needs_its_roll(view: Any) -> None:
    peg, hole = errors(view, 0.1, "vtk")
    assert (peg < [0.5, 0.03, 0.4]).all()
    assert (hole < [0.3, 0.05, 0.9]).all()
    straight = errors(view, 0.0, "vtk")
    assert (straight[:, 1] > 0.1).all()
    assert (straight[:, 2] > 1.5).all()
