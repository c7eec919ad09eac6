"""Rendered images against rays cast through the same solids, OpenCV and closed forms."""

import dataclasses
import functools
import math
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import SensorParams, shaded
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import (
    AT_OPENING,
    SoftwareCamera,
    render,
    render_moving,
)
from chamfer.systems.cameras.solids_camera import Solid, render_solids
from chamfer.systems.pose import pose_vector

PARTS = ColouredParts()
STRAIGHT = CameraPlacement(roll=0.0).camera

Pose = RigidTransform
VIEWS: Any = ("xz", "xy")
FLAT = SceneStyle(face=1.0, bore=1.0, blur=0.0)
RAYS = 4  # per pixel, in both directions


def pose(x: float, y: float, z: float, pitch: float = 0.0, yaw: float = 0.0) -> Pose:
    """Return a pose from mm and rad."""
    return RigidTransform(RollPitchYaw(0.3, pitch, yaw), np.array([x, y, z]) / 1000)


def along(X: Pose, distance: float) -> Pose:
    """Return a pose that is further along its x axis, mm."""
    return X @ RigidTransform([distance / 1000, 0, 0])


def hits(start: np.ndarray, way: np.ndarray, profile: np.ndarray) -> np.ndarray:
    """Return how far along rays, shape (n, 3), a solid of revolution is; infinite: it is not."""
    nearest = np.full(len(way), np.inf)
    for (x0, r0), (x1, r1) in pairwise(profile):
        with np.errstate(divide="ignore", invalid="ignore"):
            if x0 == x1:
                t = (x0 - start[0]) / way[:, 0]
                radius = np.linalg.norm(start[1:] + t[:, np.newaxis] * way[:, 1:], axis=1)
                inside = (radius > min(r0, r1)) & (radius < max(r0, r1))
                found = [np.where(inside, t, np.inf)]
            else:
                slope = (r1 - r0) / (x1 - x0)
                base, rate = r0 + slope * (start[0] - x0), slope * way[:, 0]
                a = (way[:, 1:] ** 2).sum(axis=1) - rate**2
                b = way[:, 1:] @ start[1:] - base * rate
                c = start[1:] @ start[1:] - base**2
                root = np.sqrt(b**2 - a * c)
                found = []
                for t in ((-b - root) / a, (-b + root) / a):
                    x = start[0] + t * way[:, 0]
                    ok = (x >= min(x0, x1)) & (x <= max(x0, x1)) & (base + t * rate >= 0)
                    found.append(np.where(ok, t, np.inf))
        for t in found:
            nearest = np.minimum(nearest, np.where(t > 0, t, np.inf))
    return nearest


@functools.lru_cache
def placed(view: Any) -> tuple[Camera, np.ndarray]:
    """Return a camera with few pixels and the rays, RAYS by RAYS of each, shape (n, 3)."""
    camera = CameraPlacement(view=view, pixel_size=0.0015, width=104, height=72).camera
    sub = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    u = (np.arange(camera.width)[:, np.newaxis] + sub).ravel()
    v = (np.arange(camera.height)[:, np.newaxis] + sub).ravel()
    return camera, camera.ray(np.stack(np.meshgrid(u, v), axis=-1)).reshape(-1, 3)


def cast(
    parts: ColouredParts,
    camera: Camera,
    rays: np.ndarray,
    X_WT: Pose | None,
    X_WM: Pose | None,
    style: SceneStyle,
) -> np.ndarray:
    """Return the image that single rays make, without shades."""
    colours = np.array([style.background, parts.peg_colour, parts.hole_colour], dtype=float)
    which, depth = np.zeros(len(rays), int), np.full(len(rays), np.inf)
    for k, (X, profile) in enumerate(
        ((X_WT, parts.peg.closed_profile), (X_WM, parts.hole.closed_profile)), start=1
    ):
        if X is not None:
            to_part = X.inverse()
            start = to_part @ camera.p_WC
            way = rays @ to_part.rotation().matrix().T
            # Only rays through a ball around the part can hit it.
            middle = np.array([profile[:, 0].min() + profile[:, 0].max(), 0, 0]) / 2
            radius = np.hypot(profile[:, 0] - middle[0], profile[:, 1]).max()
            gap = middle - start
            (near,) = np.nonzero(gap @ gap - (way @ gap) ** 2 < radius**2)
            t = hits(start, way[near], profile)
            which[near[t < depth[near]]] = k
            depth[near] = np.minimum(depth[near], t)
    shape = (camera.height, RAYS, camera.width, RAYS, 3)
    return colours[which].reshape(shape).mean(axis=(1, 3))


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize(
    ("X_WT", "X_WM"),
    [
        (pose(-15, 0, 0), pose(15, 0, 0)),
        (pose(-9, 5, -8, 0.1, -0.1), pose(16, -7, 3, -0.08, 0.1)),
        (pose(5, 0, 0, 0.3, 0.3), None),
        (None, pose(5, 0, 0, 0.5, -0.5)),
        (None, pose(5, 0, 0, -0.6, 0.4)),
        # In the hole: little of the mouth in sight, the mouth towards a camera or away from it.
        (pose(25, 0, 0), pose(15, 0, 0)),
        (pose(-5, 0, 0), pose(-15, 0, 0)),
        (along(pose(5, 0, 0, -0.4, 0.4), 6), pose(5, 0, 0, -0.4, 0.4)),
        (along(pose(5, 0, 0, 0.3, -0.4), 0.7), pose(5, 0, 0, 0.3, -0.4)),
        # Beside the hole part, behind it for one camera and before it for the other.
        (pose(10, 0, 40), pose(-5, 0, 0)),
        (pose(10, 40, 0), pose(-5, 0, 0)),
        (pose(10, -40, 0), pose(-5, 0, 0)),
        # Before the mouth but overlapping in the image.
        (along(pose(5, 0, 0, -0.7, 0.7), -2), pose(5, 0, 0, -0.7, 0.7)),
        (along(pose(-5, 0, 0, 0.7, -0.7), -2), pose(-5, 0, 0, 0.7, -0.7)),
        # Partly outside of the image.
        (pose(-70, 0, 30), pose(60, -55, 50)),
    ],
)
def test_image_is_what_rays_see(view: Any, X_WT: Pose | None, X_WM: Pose | None) -> None:
    camera, rays = placed(view)
    image = render(PARTS, camera, X_WT, X_WM, style=FLAT)
    expected = cast(PARTS, camera, rays, X_WT, X_WM, FLAT)
    difference = np.abs(image - expected).max(axis=2)
    # 16 rays know the share of a pixel within about 1/8, 25 of 200 grey levels; where the edges
    # of both parts coincide the pixel shows too much of the background.
    assert difference.max() < 50
    assert (difference > 25).sum() < 8
    assert np.abs(image.mean(axis=(0, 1)) - expected.mean(axis=(0, 1))).max() < 0.1


def test_end_faces_and_bore_are_darker() -> None:
    camera = CameraPlacement(view="xz", roll=0.0).camera
    style = SceneStyle(blur=0.0, face=0.8, bore=0.5)
    X_WT, X_WM = pose(-15, 0, 0, 0, -0.6), pose(25, 0, 0, 0, 0.8)
    image = render(PARTS, camera, X_WT, X_WM, style=style)
    u, v = np.rint(camera.project(X_WT.translation())).astype(int)
    np.testing.assert_array_equal(image[v, u], np.rint(0.8 * np.array(PARTS.peg_colour)))
    np.testing.assert_array_equal(image[v, u - 30], PARTS.peg_colour)
    u, v = np.rint(camera.project(X_WM.translation())).astype(int)
    np.testing.assert_array_equal(image[v, u], np.rint(0.5 * np.array(PARTS.hole_colour)))
    p_W = X_WM @ np.array([0, 0, 0.013])  # on the face between mouth and outside
    u, v = np.rint(camera.project(p_W)).astype(int)
    np.testing.assert_array_equal(image[v, u], np.rint(0.8 * np.array(PARTS.hole_colour)))


def test_blur_is_gaussian_and_keeps_the_sum() -> None:
    camera = CameraPlacement(roll=0.0).camera
    X_WT = pose(20, 0, 0)
    sharp, soft = (
        render(PARTS, camera, X_WT, None, style=dataclasses.replace(FLAT, blur=blur)).astype(float)
        for blur in (0.0, 1.5)
    )
    assert (200 - soft[..., 1]).sum() == pytest.approx((200 - sharp[..., 1]).sum(), rel=1e-3)
    # Across the long edge, in the middle of the bar: the moments of the edge's derivative.
    edge = np.diff(soft[60:119, 130, 1])
    original = np.diff(sharp[60:119, 130, 1])
    rows = np.arange(len(edge))

    def variance(weights: np.ndarray) -> float:
        mean = (rows * weights).sum() / weights.sum()
        return float(((rows - mean) ** 2 * weights).sum() / weights.sum())

    assert variance(edge) - variance(original) == pytest.approx(1.5**2, rel=0.05)


def test_nothing_in_view_is_background() -> None:
    style = SceneStyle(background=(10, 20, 30))
    camera = CameraPlacement().camera
    far = RigidTransform([5.0, 0, 0])
    behind = RigidTransform([0.0, -0.5, 0])  # reaches through the plane of the camera
    for poses in ((None, None), (far, far), (behind, None)):
        image = render(PARTS, camera, *poses, style=style)
        assert image.shape == (240, 320, 3)
        assert image.dtype == np.uint8
        assert (image == [10, 20, 30]).all()


def test_block_shows_what_render_returns() -> None:
    camera = CameraPlacement(view="xy").camera
    block = SoftwareCamera(PARTS, camera)
    context = block.CreateDefaultContext()
    X_WT, X_WM = pose(-12, 3, 4, 0.1, 0.05), pose(13, 0, 0, -0.1)
    block.GetInputPort("peg_pose").FixValue(context, pose_vector(X_WT))
    port = block.GetOutputPort("image")
    np.testing.assert_array_equal(
        port.Eval(context).data[..., :3], render(PARTS, camera, X_WT, None), strict=True
    )
    block.GetInputPort("hole_pose").FixValue(context, pose_vector(X_WM))
    image = port.Eval(context).data
    np.testing.assert_array_equal(image[..., :3], render(PARTS, camera, X_WT, X_WM))
    assert (image[..., 3] == 255).all()
    assert block.HasDirectFeedthrough(0, 0)
    assert block.HasDirectFeedthrough(1, 0)


def grey(level: int, shape: tuple[int, int] = (5, 7)) -> np.ndarray:
    return np.full((*shape, 3), level, np.uint8)


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
    assert not SensorParams().shades
    assert SensorParams(vignetting=0.1).shades
    assert SensorParams(white_balance=(1.0, 1.0, 1.1)).shades


def test_an_edge_that_moves_across_becomes_a_ramp_as_long_as_its_way() -> None:
    begin, end = RigidTransform([-0.01, 0, 0]), RigidTransform([0.0, 0, 0])
    image = render_moving(PARTS, STRAIGHT, (begin, None), (end, None), style=FLAT)
    row = image[119].astype(float)[:, 1]
    level = PARTS.peg_colour[1]
    # Of the edge's circle the one nearer to the camera is seen first.
    first, last = 110, 170
    share = (200.0 - row) / (200.0 - level)
    assert share[60:first].min() == 1.0
    assert share[last:].max() == 0.0
    # The area is that of the edge in the middle of its way.
    mean = share[first:last].sum() + first - 0.5
    still = render(PARTS, STRAIGHT, RigidTransform([-0.005, 0, 0]), None, style=FLAT)
    rested = (200.0 - still[119].astype(float)[:, 1]) / (200.0 - level)
    expected = rested[first:last].sum() + first - 0.5
    assert mean == pytest.approx(expected, abs=0.02)
    # A ramp of 20 pixels has a standard deviation of 20 / sqrt(12).
    slope, place = -np.diff(share[60:]), np.arange(60, 319) + 0.5
    middle = (slope * place).sum()
    deviation = math.sqrt((slope * (place - middle) ** 2).sum())
    assert deviation == pytest.approx(20 / math.sqrt(12), rel=0.02)


def test_what_rests_is_as_in_a_picture_without_exposure() -> None:
    poses = RigidTransform([-0.015, 0.0, 0.0]), RigidTransform([0.015, 0.0, 0.0])
    expected = render(PARTS, STRAIGHT, *poses)
    np.testing.assert_array_equal(render_moving(PARTS, STRAIGHT, poses, poses), expected)
    np.testing.assert_array_equal(render_moving(PARTS, STRAIGHT, (None, None), poses), expected)


def test_the_block_shows_the_motion_light_and_colours() -> None:
    sensor = SensorParams(exposure=0.01, vignetting=0.3, white_balance=(1.1, 1.0, 0.9))
    block = SoftwareCamera(PARTS, STRAIGHT, sensor=sensor)
    context = block.CreateDefaultContext()
    begin, end = RigidTransform([-0.018, 0.0, 0.001]), RigidTransform([-0.015, 0.0, 0.0])
    block.GetInputPort("peg_pose").FixValue(context, pose_vector(end))
    opening = block.GetInputPort(f"peg_pose{AT_OPENING}")
    port = block.GetOutputPort("image")

    def expected(X_begin: RigidTransform) -> np.ndarray:
        moving = render_moving(PARTS, STRAIGHT, (X_begin, None), (end, None))
        return shaded(moving, 0.3, (1.1, 1.0, 0.9))

    np.testing.assert_array_equal(port.Eval(context).data[..., :3], expected(end))
    opening.FixValue(context, np.zeros(7))  # of a hold that has not sampled yet
    np.testing.assert_array_equal(port.Eval(context).data[..., :3], expected(end))
    opening.FixValue(context, pose_vector(begin))
    np.testing.assert_array_equal(port.Eval(context).data[..., :3], expected(begin))
    assert (expected(begin) != expected(end)).any()


BARREL = (-0.6, 0.2, 0.01, -0.02, 0.1)


def camera(distortion: tuple[float, ...]) -> Camera:
    # 500 pixels of focal length: the corners are at 22 degrees.
    k1, k2, p1, p2, k3 = distortion
    placement = CameraPlacement(view="xz", pixel_size=0.001)
    return dataclasses.replace(placement.camera, distortion=(k1, k2, p1, p2, k3))


def opencvs(at: Camera, points: np.ndarray) -> np.ndarray:
    rotation, _ = cv2.Rodrigues(at.R_WC.T)
    pixels, _ = cv2.projectPoints(
        points, rotation, -at.R_WC.T @ at.p_WC, at.matrix, np.array(at.distortion)
    )
    return np.array(pixels[:, 0])


def test_an_edge_in_the_image_is_where_opencv_projects_it() -> None:
    at = dataclasses.replace(camera(BARREL).placed(np.eye(3), np.zeros(3)))
    # A plate at 0.5 m, below y = 0.06 m, of which only that edge is in the image.
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (0.06, 0.4) for z in (0.5, 0.50001)])
    plate = Solid(name="plate", vertices=vertices, colour=(0, 0, 0))
    image = render_solids(
        at, [plate], {"plate": RigidTransform()}, SceneStyle(background=(200, 200, 200), blur=0.0)
    )
    free = (image[..., 0] / 200.0).sum(axis=0) - 0.5  # of each column, down to the edge
    x = np.linspace(-0.3, 0.3, 4001)
    edge = opencvs(at, np.column_stack([x, np.full_like(x, 0.06), np.full_like(x, 0.5)]))
    columns = np.arange(20, 300)
    expected = np.interp(columns, edge[:, 0], edge[:, 1])
    assert np.ptp(expected) > 3
    # The last column's grey levels are whole numbers.
    assert np.abs(free[columns] - expected).max() < 0.02


def test_what_the_lens_would_fold_back_is_not_drawn() -> None:
    at = camera((-6.0, 0.0, 0.0, 0.0, 0.0))  # folds back at 118 pixels, seen at 79
    plate = Solid(
        name="plate",
        vertices=np.array([[x, y, z] for x in (-1, 1) for y in (0, 0.1) for z in (-1, 1)]),
        colour=(0, 0, 0),
    )
    image = render_solids(at, [plate], {"plate": RigidTransform()}, SceneStyle(blur=0.0))
    v, u = np.mgrid[:240, :320]
    away = np.hypot(u - at.centre[0], v - at.centre[1])
    assert (image[away < 77] == 0).all()
    assert (image[away > 80] == 200).all()
