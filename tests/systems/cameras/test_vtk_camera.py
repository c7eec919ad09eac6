"""VTK's images of the parts against those of the software camera."""

import subprocess
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras import vtk_camera
from chamfer.systems.cameras.vtk_camera import VtkCamera, missing_graphics
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts

PARTS = ColouredParts()
LOOKS = appearances(PARTS)


def test_part_that_is_not_connected_is_not_in_view() -> None:
    if reason := missing_graphics():
        pytest.skip(reason)
    camera = VtkCamera(PARTS, CameraPlacement(view="xz").camera)

    def drawn(**poses: RigidTransform) -> np.ndarray:
        context: Any = camera.CreateDefaultContext()
        for name, X_WP in poses.items():
            camera.GetInputPort(name).FixValue(context, pose_vector(X_WP))
        image = camera.GetOutputPort("image").Eval(context).data.copy()
        assert image.shape == (240, 320, 4)
        assert (image[..., 3] == 255).all()
        return np.array(image[..., :3])

    X_WP = RigidTransform([-0.015, 0, 0])
    peg, hole = detect_parts(drawn(peg_pose=X_WP), *LOOKS)
    assert (peg.status, hole.status) == (Status.VALID, Status.NO_COLOUR)
    peg, hole = detect_parts(drawn(hole_pose=X_WP), *LOOKS)
    assert (peg.status, hole.status) == (Status.NO_COLOUR, Status.VALID)
    assert (drawn() == 200).all()


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
