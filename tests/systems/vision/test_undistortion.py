"""Straightened images against those of a camera without distortion."""

import dataclasses

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import Status, detect_parts
from chamfer.systems.vision.part_detector import (
    PartDetector,
    Undistortion,
    pack_detections,
    unpack_detections,
)

PARTS = ColouredParts()
PINHOLE = CameraPlacement().camera
LOOKS = appearances(PARTS)


def poses(seed: int) -> tuple[RigidTransform, RigidTransform]:
    generator = np.random.default_rng(seed)
    middle = generator.uniform(-0.03, 0.03, 3)
    turn = RollPitchYaw(generator.uniform(-0.08, 0.08, 3))
    return (
        RigidTransform(turn, middle - np.array([0.015, 0.0, 0.0])),
        RigidTransform(middle + np.array([0.015, 0.0, 0.0])),
    )


@pytest.mark.parametrize(
    "distortion", [(-1.0, 0, 0, 0, 0), (1.0, 0, 0, 0, 0), (-0.5, 0.3, 0.02, -0.03, 0.1)]
)
def test_parts_are_found_as_without_distortion(distortion: tuple[float, ...]) -> None:
    k1, k2, p1, p2, k3 = distortion
    lens = dataclasses.replace(PINHOLE, distortion=(k1, k2, p1, p2, k3))
    straighten = Undistortion(lens)
    bent = 0.0
    for seed in range(8):
        X_WT, X_WM = poses(seed)
        image = render(PARTS, lens, X_WT, X_WM)
        expected = detect_parts(render(PARTS, PINHOLE, X_WT, X_WM), *LOOKS)
        for found, raw, true in zip(
            detect_parts(straighten(image), *LOOKS),
            detect_parts(image, *LOOKS),
            expected,
            strict=True,
        ):
            assert found.status == true.status == Status.VALID
            np.testing.assert_allclose(found.tip, true.tip, rtol=0, atol=0.06)
            assert found.angle == pytest.approx(true.angle, abs=5e-4)
            bent = max(bent, abs(raw.angle - true.angle))
    assert bent > 0.004


@pytest.mark.parametrize("focal", [(800.0, 1000.0), (1000.0, 800.0)])
@pytest.mark.parametrize("bend", [0.0, -1.0])
def test_pixels_become_square(focal: tuple[float, float], bend: float) -> None:
    turned = CameraPlacement(roll=0.4).camera
    camera = dataclasses.replace(turned, focal=focal, distortion=(bend, 0, 0, 0, 0))
    straighten = Undistortion.of(camera)
    assert straighten is not None
    # The same size of the pixels' shorter sides, and all that was in the image.
    straight = camera.straight()
    assert straight.focal == (1000.0, 1000.0)
    assert (straight.width, straight.height) == ((400, 240) if focal[0] < focal[1] else (320, 300))
    X_WT, X_WM = poses(3)
    image = straighten(render(PARTS, camera, X_WT, X_WM))
    assert image.shape == (straight.height, straight.width, 3)
    expected = detect_parts(render(PARTS, straight, X_WT, X_WM), *LOOKS)
    for found, true in zip(detect_parts(image, *LOOKS), expected, strict=True):
        assert found.status == true.status == Status.VALID
        np.testing.assert_allclose(found.tip, true.tip, rtol=0, atol=0.25)
        assert found.angle == pytest.approx(true.angle, abs=2e-3)
    for X in (X_WT, X_WM):
        seen = camera.straightened(camera.project(X.translation()))
        np.testing.assert_allclose(seen, straight.project(X.translation()), atol=1e-6)


def test_square_pixels_stay_as_they_are() -> None:
    assert Undistortion.of(PINHOLE) is None
    pixel = np.array([3.0, 4.0])
    np.testing.assert_array_equal(PINHOLE.straightened(pixel), pixel)
    assert PINHOLE.straight().centre == PINHOLE.centre


def test_a_part_that_reaches_to_the_border_still_does() -> None:
    lens = dataclasses.replace(PINHOLE, distortion=(3.0, 0.0, 0.0, 0.0, 0.0))
    # A straightened pincushion is smaller than the image.
    X_WT = RigidTransform([0.08, 0.0, 0.0])
    image = render(PARTS, lens, X_WT, None)
    assert detect_parts(image, *LOOKS)[0].status == Status.AT_BORDER
    assert detect_parts(Undistortion(lens)(image), *LOOKS)[0].status == Status.AT_BORDER


def test_what_the_lens_cant_show_is_the_border() -> None:
    lens = dataclasses.replace(PINHOLE, distortion=(-20.0, 0.0, 0.0, 0.0, 0.0))
    image: Image = np.zeros((240, 320, 3), np.uint8)
    image[0, :], image[-1, :], image[:, 0], image[:, -1] = 1, 2, 3, 4
    straight = Undistortion(lens)(image)
    # It folds back at 129 pixels.
    np.testing.assert_array_equal(straight[120, [0, 319], 0], [3, 4])
    assert straight[120, 160, 0] == 0


def test_the_block_reports_what_a_straight_image_shows() -> None:
    lens = dataclasses.replace(PINHOLE, distortion=(-1.0, 0.0, 0.0, 0.0, 0.0))
    image = render(PARTS, lens, *poses(1))
    block = PartDetector(*LOOKS, undistortion=Undistortion(lens))
    expected = detect_parts(Undistortion(lens)(image), *LOOKS)
    np.testing.assert_array_equal(block.measure(image), pack_detections(*expected))
    raw = unpack_detections(PartDetector(*LOOKS).measure(image))
    assert raw[0].angle != expected[0].angle
