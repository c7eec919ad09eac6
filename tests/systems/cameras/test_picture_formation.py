"""Exposures, vignettes and colours against closed forms."""

import math
import re
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import SensorParams, mean_image, shaded
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import (
    AT_OPENING,
    SoftwareCamera,
    between,
    render,
    render_moving,
)
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect

PARTS = ColouredParts()
CAMERA = CameraPlacement(roll=0.0).camera
SHARP = SceneStyle(face=1.0, bore=1.0, blur=0.0)
PEG, _ = appearances(PARTS)


def grey(level: int, shape: tuple[int, int] = (5, 7)) -> np.ndarray:
    return np.full((*shape, 3), level, np.uint8)


# Light and colours


def test_the_corners_lose_light_with_the_square_of_the_distance() -> None:
    image = shaded(grey(200, (241, 321)), 0.5, (1.0, 1.0, 1.0))
    assert (image[120, 160] == 200).all()
    for corner in (image[0, 0], image[-1, 0], image[0, -1], image[-1, -1]):
        assert (corner == 100).all()
    # 80 pixels of the corner's 200 are 0.16 of the loss.
    assert (image[120, 80] == 200 - 16).all()


def test_gains_are_of_red_green_and_blue_up_to_white() -> None:
    image = shaded(grey(100), 0.0, (1.25, 0.5, 3.0))
    np.testing.assert_array_equal(image[2, 3], [125, 50, 255])


def test_no_loss_and_even_gains_change_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (24, 32, 3)).astype(np.uint8)
    np.testing.assert_array_equal(shaded(image, 0.0, (1.0, 1.0, 1.0)), image)
    assert not SensorParams().shades
    assert SensorParams(vignetting=0.1).shades
    assert SensorParams(white_balance=(1.0, 1.0, 1.1)).shades


def test_the_mean_of_images() -> None:
    np.testing.assert_array_equal(mean_image([grey(10), grey(20), grey(60)]), grey(30))
    np.testing.assert_array_equal(mean_image([grey(10)]), grey(10))


# Exposure


def test_an_edge_that_moves_across_becomes_a_ramp_as_long_as_its_way() -> None:
    begin, end = RigidTransform([-0.01, 0, 0]), RigidTransform([0.0, 0, 0])
    image = render_moving(PARTS, CAMERA, (begin, None), (end, None), style=SHARP)
    row = image[119].astype(float)[:, 1]
    level = PARTS.peg_colour[1]
    tip = CAMERA.project(np.array([0.0, 0.0, 0.0]))[0]
    # Of the edge's circle the one nearer to the camera is seen first.
    first, last = 110, 170
    share = (200.0 - row) / (200.0 - level)
    assert share[60:first].min() == 1.0
    assert share[last:].max() == 0.0
    # The area is that of the edge in the middle of its way.
    mean = share[first:last].sum() + first - 0.5
    still = render(PARTS, CAMERA, RigidTransform([-0.005, 0, 0]), None, style=SHARP)
    rested = (200.0 - still[119].astype(float)[:, 1]) / (200.0 - level)
    expected = rested[first:last].sum() + first - 0.5
    assert mean == pytest.approx(expected, abs=0.02)
    # A ramp of 20 pixels has a standard deviation of 20 / sqrt(12).
    slope, place = -np.diff(share[60:]), np.arange(60, 319) + 0.5
    middle = (slope * place).sum()
    deviation = math.sqrt((slope * (place - middle) ** 2).sum())
    assert deviation == pytest.approx(20 / math.sqrt(12), rel=0.02)
    assert abs(middle - (tip - 10)) < 1.0


@pytest.mark.parametrize("way", [0.001, 0.002])
def test_a_part_is_found_where_it_was_in_the_middle_of_the_exposure(way: float) -> None:
    begin = RigidTransform(RollPitchYaw(0, 0.02, 0), [0, 0, 0])
    end = RigidTransform(RollPitchYaw(0, 0.04, 0), [0, 0, way])
    image = render_moving(PARTS, CAMERA, (begin, None), (end, None))
    found = detect(image, PEG)
    still = detect(render(PARTS, CAMERA, between(begin, end, 0.5), None), PEG)
    assert found.tip == pytest.approx(still.tip, abs=0.08)
    assert found.angle == pytest.approx(still.angle, abs=5e-4)


def test_between_is_even_in_place_and_turn() -> None:
    begin = RigidTransform(RollPitchYaw(0.1, 0.2, 0.3), [0.1, 0.2, 0.3])
    turn = RigidTransform(RollPitchYaw(0.0, 0.0, 0.6), [0.0, 0.0, 0.0])
    end = RigidTransform(begin.rotation() @ turn.rotation(), [0.3, 0.2, -0.1])
    middle = between(begin, end, 0.5)
    assert middle is not None
    np.testing.assert_allclose(middle.translation(), [0.2, 0.2, 0.1], atol=1e-12)
    half = RollPitchYaw(0.0, 0.0, 0.3).ToRotationMatrix()
    expected = begin.rotation() @ half
    np.testing.assert_allclose(middle.rotation().matrix(), expected.matrix(), atol=1e-12)
    assert between(None, end, 0.5) is end
    assert between(begin, None, 0.5) is None


def test_what_rests_is_as_in_a_picture_without_exposure() -> None:
    poses = RigidTransform([-0.015, 0.0, 0.0]), RigidTransform([0.015, 0.0, 0.0])
    expected = render(PARTS, CAMERA, *poses)
    np.testing.assert_array_equal(render_moving(PARTS, CAMERA, poses, poses), expected)
    np.testing.assert_array_equal(render_moving(PARTS, CAMERA, (None, None), poses), expected)


def test_the_block_shows_the_motion_light_and_colours() -> None:
    sensor = SensorParams(exposure=0.01, vignetting=0.3, white_balance=(1.1, 1.0, 0.9))
    block = SoftwareCamera(PARTS, CAMERA, sensor=sensor)
    context = block.CreateDefaultContext()
    begin, end = RigidTransform([-0.018, 0.0, 0.001]), RigidTransform([-0.015, 0.0, 0.0])
    block.GetInputPort("peg_pose").FixValue(context, pose_vector(end))
    opening = block.GetInputPort(f"peg_pose{AT_OPENING}")
    port = block.GetOutputPort("image")

    def expected(X_begin: RigidTransform) -> np.ndarray:
        moving = render_moving(PARTS, CAMERA, (X_begin, None), (end, None))
        return shaded(moving, 0.3, (1.1, 1.0, 0.9))

    np.testing.assert_array_equal(port.Eval(context).data[..., :3], expected(end))
    opening.FixValue(context, np.zeros(7))  # of a hold that has not sampled yet
    np.testing.assert_array_equal(port.Eval(context).data[..., :3], expected(end))
    opening.FixValue(context, pose_vector(begin))
    np.testing.assert_array_equal(port.Eval(context).data[..., :3], expected(begin))
    assert (expected(begin) != expected(end)).any()


def test_without_exposure_there_is_no_opening() -> None:
    block = SoftwareCamera(PARTS, CAMERA, sensor=SensorParams(vignetting=0.3))
    assert not block.HasInputPort(f"peg_pose{AT_OPENING}")


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"exposure": -0.1}, "a finite number >= 0"),
        ({"exposure": math.nan}, "a finite number >= 0"),
        ({"vignetting": 1.1}, "a share, from 0 to 1"),
        ({"vignetting": math.nan}, "a share, from 0 to 1"),
        ({"white_balance": (1.0, 1.0)}, "three finite numbers > 0"),
        ({"white_balance": (1.0, 0.0, 1.0)}, "three finite numbers > 0"),
    ],
)
def test_sensors_that_cannot_be(changes: dict[str, Any], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        SensorParams(**changes)
