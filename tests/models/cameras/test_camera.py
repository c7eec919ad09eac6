"""Camera geometry against OpenCV's, and where the work cell's cameras look."""

import dataclasses
import math
from typing import get_args

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera, CameraPlacement, LensDistortion, View

seeds = st.integers(0, 2**32 - 1)


def any_camera(generator: np.random.Generator, *, distorted: bool = False) -> Camera:
    spread = [0.3, 0.3, 0.01, 0.01, 0.3]
    k1, k2, p1, p2, k3 = (generator.uniform(-1, 1, 5) * spread * distorted).tolist()
    return Camera(
        distortion=(k1, k2, p1, p2, k3),
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


@given(seed=seeds, distorted=st.booleans())
def test_projection_is_opencvs(seed: int, distorted: bool) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator, distorted=distorted)
    points = before(camera, generator, (9,))
    rotation, _ = cv2.Rodrigues(camera.R_WC.T)
    expected, _ = cv2.projectPoints(
        points,
        rotation,
        -camera.R_WC.T @ camera.p_WC,
        camera.matrix,
        np.array(camera.distortion) if distorted else None,
    )
    found = camera.project(points)
    seen = np.isfinite(found)
    assert seen.all() or distorted
    np.testing.assert_allclose(found[seen], expected[:, 0][seen], rtol=0, atol=1e-7)


def test_cameras_are_equal_where_all_of_them_is() -> None:
    camera = CameraPlacement().camera
    same = camera.placed(camera.R_WC.copy(), camera.p_WC.copy())
    assert (same, hash(same)) == (camera, hash(camera))
    elsewhere, turned = (0.0, 0.0, 0.0), camera.R_WC.T
    assert camera != camera.placed(camera.R_WC, np.array(elsewhere))
    assert camera != camera.placed(turned, camera.p_WC)
    assert camera != dataclasses.replace(camera, width=camera.width + 1)


@pytest.mark.parametrize("focal", [(800.0, 1000.0), (1000.0, 800.0)])
def test_square_pixels_show_the_same_from_corner_to_corner(focal: tuple[float, float]) -> None:
    camera = dataclasses.replace(CameraPlacement().camera, focal=focal)
    straight = camera.straight()
    corners = [np.array([[0, 0], [one.width, one.height]]) - 0.5 for one in (camera, straight)]
    np.testing.assert_allclose(camera.shown_by(straight, corners[0]), corners[1], atol=1e-9)


def test_what_the_lens_would_fold_back_is_refused() -> None:
    camera = dataclasses.replace(CameraPlacement().camera, distortion=(-3.0, 0, 0, 0, 0))
    # r (1 - 3 r^2) turns back at r = 1 / 3, where it is 2 / 9.
    radius = np.array([0.32, 0.3329, 0.34, 0.5])
    points = camera.p_WC + np.outer(radius, camera.R_WC[:, 0]) + camera.R_WC[:, 2]
    pixels = camera.project(points)
    np.testing.assert_array_equal(np.isnan(pixels[:, 0]), [False, False, True, True])
    middle = np.array(camera.centre)
    edge = middle + np.outer(np.array([0.2222, 0.2223]), [1000, 0])
    np.testing.assert_array_equal(np.isnan(camera.ray(edge)[:, 0]), [False, True])


def test_distortion_never_shows_two_points_at_one_place() -> None:
    for seed in range(20):
        generator = np.random.default_rng(seed)
        spread = np.array([1.0, 2.0, 0.1, 0.1, 2.0])
        k1, k2, p1, p2, k3 = (generator.uniform(-1, 1, 5) * spread).tolist()
        lens = LensDistortion((k1, k2, p1, p2, k3))
        reach = min(lens.reach, 2.0)
        turns = generator.uniform(0, 2 * math.pi, 400)
        circle = np.column_stack([np.cos(turns), np.sin(turns)])
        points = circle * reach * np.sqrt(generator.uniform(0, 1, (400, 1)))
        assert (np.linalg.eigvalsh(lens.jacobian(points)) > 0).all(), lens
        np.testing.assert_allclose(lens.undistort(lens.distort(points)), points, atol=1e-7)
        if lens.reach < 2.0:
            beyond = lens.jacobian(circle * reach / 0.999 * 1.001)
            assert np.linalg.det(beyond).min() < 0.02, lens


def test_what_is_not_in_front_has_no_pixel() -> None:
    camera = CameraPlacement(view="xz", distance=0.5).camera
    pixels = camera.project(np.array([[0, -0.5, 0.0], [0, -0.6, 0], [0, -0.4, 0]]))
    np.testing.assert_array_equal(np.isnan(pixels), [[True] * 2, [True] * 2, [False] * 2])


def test_roll_turns_the_image_about_its_middle() -> None:
    straight, rolled = (CameraPlacement(roll=roll).camera for roll in (0.0, 0.1))
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3))
    middle = [159.5, 119.5]
    cos, sin = math.cos(0.1), math.sin(0.1)
    # The camera turns from its x axis to its y axis, and what it sees the other way.
    turned = (straight.project(points) - middle) @ np.array([[cos, -sin], [sin, cos]]) + middle
    np.testing.assert_allclose(rolled.project(points), turned, atol=1e-9)


@given(seed=seeds, distorted=st.booleans())
def test_point_is_the_inverse_of_project(seed: int, distorted: bool) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator, distorted=distorted)
    p_W = before(camera, generator, ())
    assume(np.isfinite(camera.project(p_W)).all())
    depth = float((p_W - camera.p_WC) @ camera.R_WC[:, 2])
    np.testing.assert_allclose(camera.point(camera.project(p_W), depth), p_W, atol=1e-9)


@given(seed=seeds, distorted=st.booleans())
def test_point_jacobian_is_the_derivative_of_project(seed: int, distorted: bool) -> None:
    generator = np.random.default_rng(seed)
    camera = any_camera(generator, distorted=distorted)
    p_W = before(camera, generator, ())
    assume(np.isfinite(camera.project(p_W + 1e-3 * np.eye(3))).all())
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
    # The middle of 320 x 240 is between four pixels, and the target is there.
    target = np.array([0.3, -0.2, 0.158])
    camera = CameraPlacement(view="xy", target=tuple(target.tolist())).camera
    np.testing.assert_allclose(camera.project(target), [159.5, 119.5], atol=1e-9)
    assert np.linalg.norm(camera.p_WC - target) == pytest.approx(0.5)
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
