"""Camera geometry against OpenCV's, and where the work cell's cameras look."""

import dataclasses
import math
import re
from typing import Any, get_args

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from models.camera import Camera, CameraPlacement, View
from models.validation import ParameterError

seeds = st.integers(0, 2**32 - 1)


def any_camera(generator: np.random.Generator) -> Camera:
    return Camera(
        width=320,
        height=240,
        focal=(generator.uniform(200, 2000), generator.uniform(200, 2000)),
        centre=(generator.uniform(0, 320), generator.uniform(0, 240)),
        R_WC=Rotation.random(rng=generator).as_matrix(),
        p_WC=generator.normal(size=3),
    )


def before(camera: Camera, generator: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Return points in front of a camera, world frame."""
    p_C = generator.uniform([-0.3, -0.3, 0.2], [0.3, 0.3, 1.0], (*shape, 3))
    return p_C @ camera.R_WC.T + camera.p_WC


@given(seed=seeds)
def test_projection_is_opencvs(seed: int) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator)
    points = before(camera, generator, (9,))
    rotation, _ = cv2.Rodrigues(camera.R_WC.T)
    expected, _ = cv2.projectPoints(
        points, rotation, -camera.R_WC.T @ camera.p_WC, camera.matrix, None
    )
    np.testing.assert_allclose(camera.project(points), expected[:, 0], rtol=0, atol=1e-7)


@given(seed=seeds)
def test_ray_leads_through_what_was_projected(seed: int) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator)
    points = before(camera, generator, (2, 3))
    rays = camera.ray(camera.project(points))
    ways = points - camera.p_WC
    np.testing.assert_allclose(
        rays, ways / np.linalg.norm(ways, axis=-1, keepdims=True), rtol=0, atol=1e-12
    )


def test_single_points_and_pixels() -> None:
    camera = CameraPlacement().camera
    pixel = camera.project(np.zeros(3))
    assert pixel.shape == (2,)
    np.testing.assert_allclose(camera.ray(pixel), camera.R_WC[:, 2], atol=1e-15)


def test_what_is_not_in_front_has_no_pixel() -> None:
    camera = CameraPlacement(view="xz", distance=0.5).camera
    pixels = camera.project(np.array([[0, -0.5, 0.0], [0, -0.6, 0], [0, -0.4, 0]]))
    np.testing.assert_array_equal(np.isnan(pixels), [[True] * 2, [True] * 2, [False] * 2])


@pytest.mark.parametrize(
    ("view", "up"), [("xz", np.array([0.0, 0.0, 1.0])), ("xy", np.array([0.0, 1.0, 0.0]))]
)
@pytest.mark.parametrize("target", [(0.0, 0.0, 0.0), (0.3, -0.2, 0.158)])
def test_x_is_to_the_right_and_the_other_axis_up_in_the_image(
    view: Any, up: np.ndarray, target: tuple[float, float, float]
) -> None:
    camera = CameraPlacement(view=view, target=target, roll=0.0).camera
    p_W = np.array(target)
    # The middle of 320 x 240 is between four pixels.
    np.testing.assert_allclose(camera.project(p_W), [159.5, 119.5], atol=1e-9)
    # Half a millimetre is a pixel.
    right = camera.project(p_W + np.array([0.0005, 0, 0]))
    np.testing.assert_allclose(right, [160.5, 119.5], atol=1e-9)
    higher = camera.project(p_W + 0.0005 * up)
    np.testing.assert_allclose(higher, [159.5, 118.5], atol=1e-9)
    assert np.linalg.norm(camera.p_WC - p_W) == pytest.approx(0.5)


def test_roll_turns_the_image_about_its_middle() -> None:
    straight, rolled = (CameraPlacement(roll=roll).camera for roll in (0.0, 0.1))
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    middle = [159.5, 119.5]
    cos, sin = math.cos(0.1), math.sin(0.1)
    # The camera turns from its x axis to its y axis, and what it sees the other way.
    turned = (straight.project(points) - middle) @ np.array([[cos, -sin], [sin, cos]]) + middle
    np.testing.assert_allclose(rolled.project(points), turned, atol=1e-9)


def test_defaults_are_the_papers_image_rolled() -> None:
    placement = CameraPlacement()
    assert (placement.width, placement.height, placement.roll) == (320, 240, 0.1)
    np.testing.assert_array_equal(
        placement.camera.matrix, [[1000, 0, 159.5], [0, 1000, 119.5], [0, 0, 1]]
    )


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"view": "zx"}, "xz, xy, yz"),
        ({"target": (0.0, math.nan, 0.0)}, "three finite numbers"),
        ({"target": (0.0, 0.0)}, "three finite numbers"),
        ({"distance": 0.0}, "a finite number > 0"),
        ({"pixel_size": -1.0}, "a finite number > 0"),
        ({"roll": math.inf}, "a finite number"),
        ({"width": 0}, "a whole number >= 1"),
        ({"height": -3}, "a whole number >= 1"),
    ],
)
def test_placement_errors(changes: dict[str, Any], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        CameraPlacement(**changes)


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"width": 0}, "a whole number >= 1"),
        ({"height": 0}, "a whole number >= 1"),
        ({"focal": (1000.0, 0.0)}, "two finite numbers > 0"),
        ({"focal": (math.nan, 1.0)}, "two finite numbers > 0"),
        ({"centre": (0.0, math.inf)}, "two finite numbers"),
        ({"R_WC": 2 * np.eye(3)}, "a rotation matrix"),
        ({"R_WC": np.eye(2)}, "a rotation matrix"),
        ({"R_WC": np.diag([1.0, 1.0, -1.0])}, "a rotation, not a reflection"),
        ({"p_WC": np.array([0.0, 0.0, math.nan])}, "three finite numbers"),
        ({"p_WC": np.zeros(2)}, "three finite numbers"),
    ],
)
def test_camera_errors(changes: dict[str, Any], allowed: str) -> None:
    (name,) = changes
    with pytest.raises(ParameterError, match=rf"^{name} is .*, allowed: {re.escape(allowed)}$"):
        dataclasses.replace(CameraPlacement().camera, **changes)


@given(seed=seeds)
def test_point_is_the_inverse_of_project(seed: int) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator)
    p_W = before(camera, generator, ())
    depth = float((p_W - camera.p_WC) @ camera.R_WC[:, 2])
    np.testing.assert_allclose(camera.point(camera.project(p_W), depth), p_W, atol=1e-9)


@given(seed=seeds)
def test_point_jacobian_is_the_derivative_of_project(seed: int) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator)
    p_W = before(camera, generator, ())
    depth = float((p_W - camera.p_WC) @ camera.R_WC[:, 2])
    step = 1e-6
    moved = [
        camera.project(p_W + step * axis) - camera.project(p_W - step * axis) for axis in np.eye(3)
    ]
    expected = np.transpose(moved) / (2 * step)
    found = camera.point_jacobian(camera.project(p_W), depth)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-3)


def test_where_the_views_have_the_worlds_axes() -> None:
    step = np.eye(3) * 0.01
    # Right and down in the image of a step along X, Y and Z, pixels, seen from 0.5 m.
    ways = {
        view: CameraPlacement(view=view, roll=0.0).camera.project(step)
        - CameraPlacement(view=view, roll=0.0).camera.project(np.zeros(3))
        for view in get_args(View)
    }
    np.testing.assert_allclose(ways["xz"], [[20, 0], [0, 0], [0, -20]], atol=1e-9)
    np.testing.assert_allclose(ways["xy"], [[20, 0], [0, -20], [0, 0]], atol=1e-9)
    np.testing.assert_allclose(ways["yz"], [[0, 0], [-20, 0], [0, -20]], atol=1e-9)
    # What is seen is before the camera, not behind it.
    assert CameraPlacement(view="yz").camera.p_WC[0] == pytest.approx(-0.5)


def test_miscalibrated_camera_is_at_its_place_but_turned_and_scaled() -> None:
    camera = CameraPlacement(view="yz", roll=0.3).camera
    believed = camera.miscalibrated(focal_factor=1.2, turn=(0.0, 0.0, 0.1))
    np.testing.assert_array_equal(believed.p_WC, camera.p_WC)
    assert believed.focal == pytest.approx((1200, 1200))
    # About its own optical axis, to which it is as to a roll of the placement.
    np.testing.assert_allclose(
        believed.R_WC, CameraPlacement(view="yz", roll=0.4).camera.R_WC, atol=1e-12
    )
    tilted = camera.miscalibrated(turn=(0.1, -0.1, 0.0))
    assert tilted.R_WC[:, 2] @ camera.R_WC[:, 2] == pytest.approx(math.cos(math.hypot(0.1, 0.1)))


def test_placed_camera_keeps_its_lens() -> None:
    camera = CameraPlacement(view="xz").camera
    other = CameraPlacement(view="xy", distance=0.5).camera
    moved = camera.placed(other.R_WC, other.p_WC)
    np.testing.assert_array_equal(moved.project(np.zeros(3)), other.project(np.zeros(3)))
    assert moved.focal == camera.focal


@pytest.mark.parametrize(
    "changes",
    [{"focal_factor": 0.0}, {"focal_factor": math.nan}, {"turn": (0.0, math.inf, 0.0)}],
)
def test_miscalibration_errors(changes: dict[str, Any]) -> None:
    ((name, value),) = changes.items()
    with pytest.raises(ParameterError, match=f"^{name} is {re.escape(repr(value))}, allowed: "):
        CameraPlacement().camera.miscalibrated(**changes)
