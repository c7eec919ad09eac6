"""Parts in space from two images against where they are."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Detection, Status, pack_detections
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts
from chamfer.systems.vision.two_plane_stereo import (
    PartInSpace,
    TwoPlaneStereo,
    locate,
    metric_error,
)

PARTS = ColouredParts()
LOOKS = appearances(PARTS)

CAMERAS = (CameraPlacement(view="xz").camera, CameraPlacement(view="xy").camera)
seeds = st.integers(0, 2**32 - 1)


def random_pose(generator: np.random.Generator, x: float, tilt: float = 0.1) -> RigidTransform:
    return RigidTransform(
        RollPitchYaw(generator.uniform(-tilt, tilt, 3)),
        np.array([x, 0, 0]) + generator.uniform(-0.01, 0.01, 3),
    )


def exact(camera: Camera, X_WP: RigidTransform, status: Status = Status.VALID) -> Detection:
    """Return what a perfect detector would find."""
    axis = X_WP.rotation().matrix()[:, 0]
    tip, point = camera.project(X_WP.translation() + np.outer([0, -0.02], axis))
    du, dv = tip - point
    return Detection(
        status=status,
        tip=tuple(tip) if status == Status.VALID else (math.nan, math.nan),
        angle=math.atan2(dv, du),
        point=tuple(point),
    )


def assert_at(part: PartInSpace, X_WP: RigidTransform, tip: float, angle: float) -> None:
    """Check the tip within m and the direction within rad."""
    assert part.status == Status.VALID
    assert np.linalg.norm(np.subtract(part.tip, X_WP.translation())) < tip
    axis = X_WP.rotation().matrix()[:, 0]
    assert np.linalg.norm(np.subtract(part.direction, axis)) < angle


@given(seed=seeds)
def test_geometry_is_exact(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X_WP = random_pose(generator, 0.0, tilt=0.5)
    cameras = tuple(
        CameraPlacement(
            view=view, roll=generator.uniform(-0.3, 0.3), distance=generator.uniform(0.2, 1)
        ).camera
        for view in ("xz", "xy")
    )
    part = locate(cameras, [exact(camera, X_WP) for camera in cameras])
    assert_at(part, X_WP, 1e-9, 1e-9)
    assert np.linalg.norm(part.direction) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("hidden", [[0], [1], [0, 1]])
def test_a_tip_in_one_image_is_enough_and_without_any_the_direction_is_left(
    hidden: list[int],
) -> None:
    X_WP = random_pose(np.random.default_rng(1), 0.0)
    seen = [exact(camera, X_WP) for camera in CAMERAS]
    for k in hidden:
        seen[k] = exact(CAMERAS[k], X_WP, Status.OCCLUDED)
    part = locate(CAMERAS, seen)
    if len(hidden) == 1:
        assert_at(part, X_WP, 1e-9, 1e-9)
    else:
        assert part.status == Status.OCCLUDED
        assert np.isnan(part.tip).all()
        np.testing.assert_allclose(part.direction, X_WP.rotation().matrix()[:, 0], atol=1e-9)


@pytest.mark.parametrize("missing", [0, 1])
def test_lost_in_one_image_is_lost(missing: int) -> None:
    seen = [exact(camera, RigidTransform()) for camera in CAMERAS]
    seen[missing] = Detection(status=Status.BLURRED)
    part = locate(CAMERAS, seen)
    assert part.status == Status.BLURRED
    assert np.isnan([*part.tip, *part.direction]).all()


def test_clean_images_give_the_tip_within_a_twentieth_of_a_millimetre() -> None:
    generator = np.random.default_rng(5)
    tips = []
    for _ in range(40):
        parts = random_pose(generator, -0.017), random_pose(generator, 0.017)
        seen = zip(*(detect_parts(render(PARTS, c, *parts), *LOOKS) for c in CAMERAS), strict=True)
        for X_WP, detections in zip(parts, seen, strict=True):
            part = locate(CAMERAS, detections)
            assert_at(part, X_WP, 7e-5, 3e-4)
            tips.append(np.subtract(part.tip, X_WP.translation()))
    assert np.sqrt((np.array(tips) ** 2).sum(axis=1).mean()) < 5e-5
    # Across the axis, which is what an alignment needs.
    assert np.abs(np.array(tips)[:, 1:]).max() < 2.5e-5


def in_space(X_WP: RigidTransform) -> PartInSpace:
    x, y, z = X_WP.translation()
    a, b, c = X_WP.rotation().matrix()[:, 0]
    return PartInSpace(status=Status.VALID, tip=(x, y, z), direction=(a, b, c))


@given(seed=seeds)
def test_metric_error_moves_and_turns_the_peg_into_the_hole(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X_WT, X_WM = random_pose(generator, -0.02, 0.6), random_pose(generator, 0.02, 0.6)
    error = metric_error(in_space(X_WT), in_space(X_WM))
    axis = X_WM.rotation().matrix()[:, 0]
    across = np.array([-(error[1:3] @ axis[1:]) / axis[0], *error[1:3]])
    found = X_WT.translation() + error[0] * axis + across
    np.testing.assert_allclose(found, X_WM.translation(), atol=1e-12)
    turned = Rotation.from_rotvec(error[3:]).apply(X_WT.rotation().matrix()[:, 0])
    np.testing.assert_allclose(turned, X_WM.rotation().matrix()[:, 0], atol=1e-12)
    assert error[3:] @ X_WT.rotation().matrix()[:, 0] == pytest.approx(0, abs=1e-12)


def test_metric_error_of_unknown_parts_is_nan() -> None:
    known = in_space(RigidTransform())
    lost = PartInSpace(status=Status.NO_COLOUR)
    assert np.isnan(metric_error(known, lost)).all()
    assert np.isnan(metric_error(lost, known)).all()
    hidden = PartInSpace(status=Status.OCCLUDED, direction=(1.0, 0.0, 0.0))
    error = metric_error(hidden, known)
    assert np.isnan(error[:3]).all()
    np.testing.assert_array_equal(error[3:], 0)


def test_block() -> None:
    block = TwoPlaneStereo(*CAMERAS)
    context: Any = block.CreateDefaultContext()
    X_WT, X_WM = (random_pose(np.random.default_rng(3), x) for x in (-0.02, 0.02))
    for name, camera in zip(("detections_xz", "detections_xy"), CAMERAS, strict=True):
        detections = pack_detections(exact(camera, X_WT), exact(camera, X_WM))
        block.GetInputPort(name).FixValue(context, detections)
    parts = block.GetOutputPort("parts").Eval(context)
    expected = [[0, *X_WP.translation(), *X_WP.rotation().matrix()[:, 0]] for X_WP in (X_WT, X_WM)]
    np.testing.assert_allclose(parts, np.ravel(expected), atol=1e-9)
    error = block.GetOutputPort("alignment_error").Eval(context)
    np.testing.assert_allclose(error, metric_error(in_space(X_WT), in_space(X_WM)), atol=1e-9)
    lost = Detection(status=Status.AT_BORDER)
    block.GetInputPort("detections_xy").FixValue(context, pack_detections(lost, lost))
    parts = block.GetOutputPort("parts").Eval(context)
    assert parts[[0, 7]].tolist() == [Status.AT_BORDER] * 2
    assert np.isnan(np.delete(parts, [0, 7])).all()
    assert all(block.HasDirectFeedthrough(i, j) for i in range(2) for j in range(2))
