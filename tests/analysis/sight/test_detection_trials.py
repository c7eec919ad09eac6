"""Errors of detections against a truth that OpenCV projects."""

import math
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.analysis.sight.detection_trials import (
    PARTS,
    STATUSES,
    UNITS,
    Poses,
    TrialCamera,
    kinds,
    measure,
)
from chamfer.diagrams.cell.cell_vision import VIEWS, Renderer
from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.peg_and_hole import BLUE, RED, ColouredParts
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts

SHAPES = ColouredParts()
LOOKS = appearances(SHAPES, 0.0005)

PIXEL = CameraPlacement().pixel_size
CAMERAS: Any = {view: CameraPlacement(view=view).camera for view in VIEWS}


def some_poses(seed: int) -> Poses:
    generator = np.random.default_rng(seed)
    peg, hole = (
        RigidTransform(
            RollPitchYaw(generator.uniform(-0.1, 0.1, 3)),
            np.array([x, 0, 0]) + generator.uniform(-0.01, 0.01, 3),
        )
        for x in (-0.017, 0.017)
    )
    return Poses(peg, hole)


def drawn(poses: Poses) -> dict[Any, Image]:
    return {view: render(SHAPES, CAMERAS[view], *poses) for view in VIEWS}


def projected(camera: Camera, points: np.ndarray) -> np.ndarray:
    rotation, _ = cv2.Rodrigues(camera.R_WC.T)
    pixels, _ = cv2.projectPoints(
        points, rotation, -camera.R_WC.T @ camera.p_WC, camera.matrix, None
    )
    return pixels[:, 0]


def truth(camera: Camera, X_WP: RigidTransform) -> tuple[np.ndarray, float]:
    """Return the pixel of a part's origin and the angle of its axis, by OpenCV."""
    ends = np.array([X_WP @ np.array([x, 0.0, 0.0]) for x in (0.0, -0.02, 0.02)])
    origin, back, front = projected(camera, ends)
    du, dv = front - back
    return origin, math.atan2(dv, du)


@pytest.mark.parametrize("seed", range(3))
def test_errors_are_found_minus_true(seed: int) -> None:
    poses = some_poses(seed)
    images = drawn(poses)
    found = measure(SHAPES, CAMERAS, images, poses, pixel_size=PIXEL)
    assert set(found) == {*STATUSES, *UNITS}
    for view in VIEWS:
        camera = CAMERAS[view]
        detected, true = detect_parts(images[view], *LOOKS), [truth(camera, X) for X in poses]
        for name, one, (origin, angle) in zip(PARTS, detected, true, strict=True):
            assert found[f"{view}.{name}.status"] == Status.VALID
            way = np.array([math.cos(angle), math.sin(angle)])
            right = np.array([-way[1], way[0]])  # v is down
            off = np.subtract(one.tip, origin)
            target = f"{view}.{name}"
            assert found[f"{target}.axial"] == pytest.approx(way @ off, abs=1e-7)
            assert found[f"{target}.lateral"] == pytest.approx(right @ off, abs=1e-7)
            assert found[f"{target}.angle"] == pytest.approx(one.angle - angle, abs=1e-8)

        # The error signal: where the mouth is from the tip, along and across the hole's axis.
        (tip, peg_angle), (mouth, angle) = true
        way = np.array([math.cos(angle), math.sin(angle)])
        peg, hole = detected
        found_way = np.array([math.cos(hole.angle), math.sin(hole.angle)])
        gap = np.subtract(hole.tip, peg.tip)
        across = np.subtract(hole.point, peg.tip)
        signal = found_way @ gap, found_way[0] * across[1] - found_way[1] * across[0]
        expected = way @ (mouth - tip), way[0] * (mouth - tip)[1] - way[1] * (mouth - tip)[0]
        target = f"{view}.error"
        assert found[f"{target}.axial"] == pytest.approx(signal[0] - expected[0], abs=1e-6)
        assert found[f"{target}.lateral"] == pytest.approx(signal[1] - expected[1], abs=1e-6)
        turn = (hole.angle - peg.angle) - (angle - peg_angle)
        assert found[f"{target}.angle"] == pytest.approx(turn, abs=1e-8)

        # Without calibration: what a ruler in the plane of the picture says.
        plane = {"xz": [0, 2], "xy": [0, 1]}[view]
        mouth_m, tip_m = (X.translation()[plane] for X in (poses.X_WM, poses.X_WT))
        (ax, ay), (bx, by) = (
            X.rotation().matrix()[plane, 0] / np.linalg.norm(X.rotation().matrix()[plane, 0])
            for X in (poses.X_WM, poses.X_WT)
        )
        x, y = mouth_m - tip_m
        target = f"{view}.scaled"
        # Up in the plane is against v.
        assert found[f"{target}.axial"] == pytest.approx(
            PIXEL * signal[0] - (ax * x + ay * y), abs=1e-9
        )
        assert found[f"{target}.lateral"] == pytest.approx(
            PIXEL * signal[1] + (ax * y - ay * x), abs=1e-9
        )
        assert found[f"{target}.angle"] == pytest.approx(
            hole.angle - peg.angle + math.asin(bx * ay - by * ax), abs=1e-9
        )


def test_errors_in_space_are_those_of_the_poses_said_to_be_true() -> None:
    poses = some_poses(2)
    images = drawn(poses)
    exact = measure(SHAPES, CAMERAS, images, poses, pixel_size=PIXEL)
    moved = RigidTransform(RollPitchYaw(0.0, 0.02, 0.0), [0.0, 0.001, 0.002])
    told = Poses(
        RigidTransform(
            moved.rotation() @ poses.X_WT.rotation(),
            poses.X_WT.translation() + moved.translation(),
        ),
        poses.X_WM,
    )
    found = measure(SHAPES, CAMERAS, images, told, pixel_size=PIXEL)
    assert found["space.peg.tip"] == pytest.approx(1e-3 * math.sqrt(5), abs=5e-5)
    assert found["space.relative.tip"] == pytest.approx(1e-3 * math.sqrt(5), abs=1e-4)
    # A turn about Y, of an axis that is nearly along X.
    assert found["space.peg.axis"] == pytest.approx(0.02, rel=0.02)
    assert found["space.relative.axis"] == pytest.approx(0.02, rel=0.02)
    for name in ("space.hole.tip", "space.hole.axis"):
        assert found[name] == exact[name] < 1e-3


def test_what_is_not_found_has_no_error() -> None:
    poses = some_poses(1)
    images = drawn(poses)
    images["xy"][...] = 200
    found = measure(SHAPES, CAMERAS, images, poses, pixel_size=PIXEL)
    for part in PARTS:
        assert found[f"xy.{part}.status"] == Status.NO_COLOUR
        assert found[f"xz.{part}.status"] == Status.VALID
    for name in UNITS:
        assert math.isnan(found[name]) == (not name.startswith("xz")), name


def test_images_of_a_camera_by_kind() -> None:
    assert [kinds(renderer) for renderer in get_args(Renderer)] == [
        ("clean", "noisy", "sampled"),
        ("clean", "noisy"),
    ]
    camera, poses = CAMERAS["xz"], some_poses(0)
    images = TrialCamera(SHAPES, camera, "software", 0.7).images(
        poses, 4.0, np.random.default_rng(0)
    )
    assert tuple(images) == kinds("software")
    np.testing.assert_array_equal(images["clean"], render(SHAPES, camera, *poses))
    difference = images["noisy"].astype(int) - images["clean"]
    assert difference.std() == pytest.approx(4.0, rel=0.03)
    colours = np.unique(images["sampled"].reshape(-1, 3), axis=0)
    assert sorted(map(tuple, colours.tolist())) == sorted([RED, BLUE, (200, 200, 200)])
    # A pixel is the part's if more than half of it is.
    sharp = TrialCamera(SHAPES, camera, "software", 0.0).images(
        poses, 0.0, np.random.default_rng(0)
    )
    np.testing.assert_array_equal(sharp["noisy"], sharp["clean"])
    np.testing.assert_array_equal(sharp["sampled"], images["sampled"])
    share = (200.0 - sharp["clean"][..., 1]) / 160  # of the red peg, where that is seen
    left = np.s_[:, :140]
    assert ((share[left] > 0.6) <= (images["sampled"][left][..., 1] == 40)).all()
    assert ((share[left] < 0.4) <= (images["sampled"][left][..., 1] == 200)).all()
