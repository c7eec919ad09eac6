"""Drawn edges under distortion against OpenCV's projection of the edges in space."""

import dataclasses
from itertools import pairwise

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.scene import SceneStyle, scene_shapes, through_lens
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.cameras.solids_camera import Lens, Solid, render_solids

Array = np.ndarray

BARREL = (-0.6, 0.2, 0.01, -0.02, 0.1)
PINCUSHION = (0.9, 0.0, -0.01, 0.01, 0.0)


def camera(distortion: tuple[float, ...], view: str = "xz") -> Camera:
    # 500 pixels of focal length: the corners are at 22 degrees.
    k1, k2, p1, p2, k3 = distortion
    placement = CameraPlacement(view=view, pixel_size=0.001)  # type: ignore[arg-type]
    return dataclasses.replace(placement.camera, distortion=(k1, k2, p1, p2, k3))


def opencvs(at: Camera, points: Array) -> Array:
    rotation, _ = cv2.Rodrigues(at.R_WC.T)
    pixels, _ = cv2.projectPoints(
        points, rotation, -at.R_WC.T @ at.p_WC, at.matrix, np.array(at.distortion)
    )
    return np.array(pixels[:, 0])


def distance(points: Array, polygon: Array) -> Array:
    """How far points are from the nearest edge of a closed polygon, pixels."""
    nearest = np.full(len(points), np.inf)
    for a, b in pairwise(np.vstack([polygon, polygon[:1]])):
        way = b - a
        share = np.clip((points - a) @ way / (way @ way), 0, 1)
        nearest = np.minimum(
            nearest, np.linalg.norm(points - a - share[:, np.newaxis] * way, axis=1)
        )
    return nearest


@pytest.mark.parametrize("distortion", [BARREL, PINCUSHION])
@pytest.mark.parametrize("view", ["xz", "xy"])
def test_drawn_edges_are_the_true_ones_of_opencv(distortion: tuple[float, ...], view: str) -> None:
    at = camera(distortion, view)
    pose = RigidTransform(RollPitchYaw(0.3, 0.1, -0.15), [0.05, 0.05, 0.05])
    parts = ColouredParts()
    (drawn,) = through_lens(
        at, scene_shapes(parts, at.without_distortion(), pose, None, SceneStyle())
    )
    # The lines along the peg between two of its circles that are seen edge-on, in space.
    (x0, radius), (x1, same) = parts.peg.profile[:2]
    assert radius == same
    to_camera = pose.inverse() @ at.p_WC
    turn = np.arctan2(to_camera[2], to_camera[1])
    half = np.arccos(radius / np.hypot(to_camera[1], to_camera[2]))
    for angle in (turn - half, turn + half):
        along = np.linspace(x0, x1, 200)[:, np.newaxis]
        edge = np.hstack(
            [along, np.tile([radius * np.cos(angle), radius * np.sin(angle)], (200, 1))]
        )
        pixels = opencvs(at, (pose @ edge.T).T)
        assert distance(pixels, pixels[[0, -1]]).max() > 0.07  # it is bent
        assert distance(pixels, drawn.outline.polygon).max() < 0.02


def test_an_edge_in_the_image_is_where_opencv_projects_it() -> None:
    at = dataclasses.replace(camera(BARREL).placed(np.eye(3), np.zeros(3)))
    # A plate at 0.5 m, below y = 0.06 m, of which only that edge is in the image.
    vertices = np.array([[x, y, z] for x in (-1, 1) for y in (0.06, 0.4) for z in (0.5, 0.50001)])
    plate = Solid(name="plate", vertices=vertices, colour=(0, 0, 0))
    image = render_solids(
        at, [plate], {"plate": RigidTransform()}, Lens(background=(200, 200, 200), blur=0.0)
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
    image = render_solids(at, [plate], {"plate": RigidTransform()}, Lens(blur=0.0))
    v, u = np.mgrid[:240, :320]
    away = np.hypot(u - at.centre[0], v - at.centre[1])
    assert (image[away < 77] == 0).all()
    assert (image[away > 80] == 200).all()


def test_zero_distortion_draws_the_same_bytes() -> None:
    pinhole = CameraPlacement().camera
    pose = RigidTransform([-0.015, 0.0, 0.01])
    nearly = dataclasses.replace(pinhole, distortion=(1e-12, 0.0, 0.0, 0.0, 0.0))
    images = [render(ColouredParts(), at, pose, None) for at in (pinhole, nearly)]
    # The way through the lens adds corners, nothing else.
    assert np.abs(images[0].astype(int) - images[1]).max() <= 1
