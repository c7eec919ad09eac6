"""VTK's images of the parts against those of the software camera."""

import functools
import math
import subprocess
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras import vtk_camera
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.cameras.vtk_camera import VtkCamera, missing_graphics
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import Status, detect_parts

PARTS = ColouredParts()
LOOKS = appearances(PARTS)

VIEWS: Any = ("xz", "xy")


@functools.lru_cache
def camera_and_context(view: Any) -> tuple[VtkCamera, Any]:
    reason = missing_graphics()
    if reason:
        pytest.skip(reason)
    camera = VtkCamera(PARTS, CameraPlacement(view=view).camera)
    return camera, camera.CreateDefaultContext()


def drawn(view: Any, **poses: RigidTransform) -> np.ndarray:
    """Return red, green and blue, shape (240, 320, 3)."""
    camera, shared = camera_and_context(view)
    context = shared.Clone()
    for name, X_WP in poses.items():
        camera.GetInputPort(name).FixValue(context, pose_vector(X_WP))
    image = camera.GetOutputPort("image").Eval(context).data.copy()
    assert image.shape == (240, 320, 4)
    assert (image[..., 3] == 255).all()
    return image[..., :3]


def random_pose(generator: np.random.Generator, x: float) -> RigidTransform:
    return RigidTransform(
        RollPitchYaw(generator.uniform(-0.1, 0.1, 3)),
        np.array([x, 0, 0]) + generator.uniform(-0.01, 0.01, 3),
    )


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
def test_agrees_with_the_software_camera(view: Any) -> None:
    camera_and_context(view)
    camera = CameraPlacement(view=view).camera
    generator = np.random.default_rng(4)
    found = []
    for _ in range(20):
        poses = random_pose(generator, -0.017), random_pose(generator, 0.017)
        vtk = drawn(view, peg_pose=poses[0], hole_pose=poses[1])
        software = render(PARTS, camera, *poses, style=SceneStyle(blur=0.0))
        for k in (0, 2):  # red is the peg's, blue the hole part's
            other = 2 - k
            area = [
                (image[..., k].astype(int) - image[..., other] > 30).sum()
                for image in (vtk, software)
            ]
            assert area[0] == pytest.approx(area[1], rel=0.02)
        for one, two in zip(
            detect_parts(vtk, *LOOKS), detect_parts(software, *LOOKS), strict=True
        ):
            assert one.status == two.status == Status.VALID
            cos, sin = math.cos(two.angle), math.sin(two.angle)
            du, dv = np.subtract(one.tip, two.tip)
            found.append([cos * du + sin * dv, cos * dv - sin * du, 1e3 * (one.angle - two.angle)])
    rms = np.sqrt((np.array(found) ** 2).mean(axis=0))
    # Along and across in pixels, the angle in mrad. Of a half pixel too much or too little in the
    # intrinsics the second would be 0.5.
    assert (rms < [0.6, 0.15, 3.0]).all()
    assert (np.abs(np.median(found, axis=0)) < [0.3, 0.05, 0.6]).all()


def test_part_that_is_not_connected_is_not_in_view() -> None:
    X_WP = RigidTransform([-0.015, 0, 0])
    peg, hole = detect_parts(drawn("xz", peg_pose=X_WP), *LOOKS)
    assert (peg.status, hole.status) == (Status.VALID, Status.NO_COLOUR)
    peg, hole = detect_parts(drawn("xz", hole_pose=X_WP), *LOOKS)
    assert (peg.status, hole.status) == (Status.NO_COLOUR, Status.VALID)
    assert (drawn("xz") == 200).all()


def test_machine_without_graphics_is_told_what_to_install(monkeypatch: Any) -> None:
    def end(*_: Any, **__: Any) -> Any:
        return subprocess.CompletedProcess([], -11, "", "")

    monkeypatch.setattr(vtk_camera.subprocess, "run", end)
    missing_graphics.cache_clear()
    try:
        assert missing_graphics() == (
            "VTK can't draw here (the process ended with -11); "
            "on Debian: apt-get install libegl1 libgl1-mesa-dri"
        )
    finally:
        missing_graphics.cache_clear()
