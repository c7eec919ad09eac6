"""The detector blocks, straightened images, and the alignment error in an image."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import ImageRgba8U

from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import Image, add_noise, write_image
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Detection, Status, pack_detections, unpack_detections
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, Appearance, appearances
from chamfer.systems.vision.part_detection import detect_parts
from chamfer.systems.vision.part_detector import (
    ImageMeasurement,
    PartDetector,
    PartsDetector,
    Undistortion,
    alignment_error,
    measurement_spread,
)

PARTS = ColouredParts()
LOOKS = appearances(PARTS)


def seen(u: float, v: float, angle: float, back: float = 30.0) -> Detection:
    """Return a detection; the point on the axis is ``back`` pixels behind the tip."""
    point = (u - back * math.cos(angle), v - back * math.sin(angle))
    return Detection(status=Status.VALID, tip=(u, v), angle=angle, point=point)


def hidden(u: float, v: float, angle: float) -> Detection:
    whole = seen(u, v, angle)
    return Detection(status=Status.OCCLUDED, angle=angle, point=whole.point)


angles = st.floats(-0.6, 0.6)
pixels = st.floats(-150, 150)


@given(turn=angles, along=pixels, across=pixels, angle=angles)
def test_error_is_in_the_directions_of_the_holes_axis(
    turn: float, along: float, across: float, angle: float
) -> None:
    e = np.array([math.cos(turn), math.sin(turn)])
    n = np.array([-math.sin(turn), math.cos(turn)])
    mouth = np.array([160.0, 120.0])
    u, v = mouth - along * e - across * n
    error = alignment_error(seen(u, v, turn - angle), seen(160, 120, turn, back=-40))
    np.testing.assert_allclose(error, [along, across, angle], atol=1e-9)


@given(turn=angles, deep=st.floats(0, 80), angle=st.floats(-0.5, 0.5), offset=pixels)
def test_hidden_tip_the_error_is_that_of_the_axis_at_the_mouth(
    turn: float, deep: float, angle: float, offset: float
) -> None:
    n = np.array([-math.sin(turn), math.cos(turn)])
    mouth = np.array([160.0, 120.0])
    way = np.array([math.cos(turn - angle), math.sin(turn - angle)])
    u, v = mouth - offset * n + deep * way
    error = alignment_error(hidden(u, v, turn - angle), seen(160, 120, turn, back=-40))
    assert math.isnan(error[0])
    np.testing.assert_allclose(error[1:], [offset, angle], atol=1e-9)


@pytest.mark.parametrize("status", [status for status in Status if status.lost])
def test_error_of_a_lost_part_is_nan(status: Status) -> None:
    part = seen(100, 120, 0.0)
    lost = Detection(status=status)
    for peg, hole in ((lost, part), (part, lost), (hidden(100, 120, 0.0), lost)):
        assert np.isnan(alignment_error(peg, hole)).all()


def test_hole_whose_mouth_is_hidden_still_has_an_axis() -> None:
    error = alignment_error(seen(100, 110, 0.01), hidden(160, 120, 0.0))
    assert math.isnan(error[0])
    np.testing.assert_allclose(error[1:], [10, -0.01], atol=1e-12)


def test_layout_of_the_vector() -> None:
    peg = Detection(status=Status.OCCLUDED, angle=0.1, point=(3.0, 4.0))
    hole = Detection(status=Status.VALID, tip=(5.0, 6.0), angle=-0.2, point=(7.0, 8.0))
    vector = pack_detections(peg, hole)
    np.testing.assert_array_equal(
        vector, [1, math.nan, math.nan, 0.1, 3, 4, 0, 5, 6, -0.2, 7, 8], strict=True
    )
    back = unpack_detections(vector)
    np.testing.assert_array_equal(pack_detections(*back), vector)
    assert back[0].status is Status.OCCLUDED
    assert back[1] == hole


def scene(gap: float) -> np.ndarray:
    X_WT = RigidTransform(RollPitchYaw(0, 0.03, 0), [-gap / 2, 0, 0.004])
    return render(PARTS, CAMERA, X_WT, RigidTransform([gap / 2, 0, 0]))


def looked_at(block: ImageMeasurement, rgb: Image | None, context: Any = None) -> list[np.ndarray]:
    """Return a block's outputs for an image; None: for a frame that did not arrive."""
    context = block.CreateDefaultContext() if context is None else context
    value = block.GetInputPort("image").Allocate()
    if rgb is None:
        value = Value(ImageRgba8U(value.get_value().width(), value.get_value().height(), 0))
    else:
        write_image(value, rgb)
    block.GetInputPort("image").FixValue(context, value)
    ports = [block.get_output_port(i) for i in range(block.num_output_ports())]
    return [port.Eval(context).copy() for port in ports]


def test_block_gives_what_the_functions_return_and_holds_nothing_back() -> None:
    image, block = scene(0.03), PartDetector(*LOOKS)
    context = block.CreateDefaultContext()
    detections, error = looked_at(block, image, context)
    expected = detect_parts(image, *LOOKS)
    np.testing.assert_array_equal(detections, pack_detections(*expected), strict=True)
    np.testing.assert_array_equal(error, alignment_error(*expected), strict=True)
    # 4 mm too high and pitched down by 0.03 rad, at 0.5 mm a pixel.
    np.testing.assert_allclose(error, [60, 8, -0.03], atol=0.15)
    detections, error = looked_at(block, None, context)
    assert detections[[0, 6]].tolist() == [Status.NO_IMAGE] * 2
    assert np.isnan(np.delete(detections, [0, 6])).all()
    assert np.isnan(error).all()


def test_parts_are_found_in_the_order_in_which_they_are_asked_for() -> None:
    image = scene(0.03)
    block = PartsDetector([HOLE_PART, Appearance(hue=85, front=1), PEG])
    peg, hole = detect_parts(image, *LOOKS)
    found = unpack_detections(looked_at(block, image)[0])
    assert (found[0], found[1].status, found[2]) == (hole, Status.NO_COLOUR, peg)
    missing = unpack_detections(looked_at(block, None)[0])
    assert [part.status for part in missing] == [Status.NO_IMAGE] * 3


class Brightness(ImageMeasurement):
    """Counts how often it looked."""

    def __init__(self) -> None:
        super().__init__("brightness", 2)
        self.looks = 0

    def measure(self, image: Image | None) -> np.ndarray:
        self.looks += image is not None
        return np.full(2, -1.0 if image is None else float(image.mean()))


CAMERA = CameraPlacement().camera


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
    lens = dataclasses.replace(CAMERA, distortion=(k1, k2, p1, p2, k3))
    straighten = Undistortion(lens)
    bent = 0.0
    for seed in range(8):
        X_WT, X_WM = poses(seed)
        image = render(PARTS, lens, X_WT, X_WM)
        expected = detect_parts(render(PARTS, CAMERA, X_WT, X_WM), *LOOKS)
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
        seen = camera.shown_by(straight, camera.project(X.translation()))
        np.testing.assert_allclose(seen, straight.project(X.translation()), atol=1e-6)


def test_square_pixels_stay_as_they_are() -> None:
    assert Undistortion.of(CAMERA) is None
    pixel = np.array([3.0, 4.0])
    np.testing.assert_array_equal(CAMERA.shown_by(CAMERA.straight(), pixel), pixel)
    assert CAMERA.straight().centre == CAMERA.centre


def test_what_the_lens_cant_show_is_the_border() -> None:
    lens = dataclasses.replace(CAMERA, distortion=(-20.0, 0.0, 0.0, 0.0, 0.0))
    image: Image = np.zeros((240, 320, 3), np.uint8)
    image[0, :], image[-1, :], image[:, 0], image[:, -1] = 1, 2, 3, 4
    straight = Undistortion(lens)(image)
    # It folds back at 129 pixels.
    np.testing.assert_array_equal(straight[120, [0, 319], 0], [3, 4])
    assert straight[120, 160, 0] == 0


def test_drawn_pictures_spread_as_the_law_says() -> None:
    scenario = resolve(AlignmentScenario())
    random = np.random.default_rng(0)
    look = StillVision(scenario, lambda image: add_noise(image, 8.0, random))
    poses = scenario.nominal_pose("peg"), scenario.nominal_pose("hole")
    errors = np.array([look.error(*poses) for _ in range(12)])
    spread = np.sqrt(errors[:, [1, 2, 4, 5]].var(axis=0, ddof=1).reshape(2, 2).mean(axis=1))
    law = measurement_spread(8.0, peg=116, hole=80, gap=60)
    pixel = scenario.cameras.pixel_size
    assert spread[0] == pytest.approx(pixel * law.lateral, rel=0.4)
    assert spread[1] == pytest.approx(law.rotational, rel=0.4)


def test_the_block_reports_what_a_straight_image_shows() -> None:
    lens = dataclasses.replace(CAMERA, distortion=(-1.0, 0.0, 0.0, 0.0, 0.0))
    image = render(PARTS, lens, *poses(1))
    block = PartDetector(*LOOKS, undistortion=Undistortion(lens))
    expected = detect_parts(Undistortion(lens)(image), *LOOKS)
    np.testing.assert_array_equal(block.measure(image), pack_detections(*expected))
    raw = unpack_detections(PartDetector(*LOOKS).measure(image))
    assert raw[0].angle != expected[0].angle


def test_the_same_image_is_looked_at_once() -> None:
    block = Brightness()
    first, second = block.CreateDefaultContext(), block.CreateDefaultContext()
    for context, level in ((first, 10), (second, 10), (first, None), (first, 10), (first, 20)):
        image = None if level is None else np.full((6, 8, 3), level, np.uint8)
        (seen,) = looked_at(block, image, context)
        assert seen.tolist() == [-1 if level is None else level] * 2
    assert block.looks == 2
