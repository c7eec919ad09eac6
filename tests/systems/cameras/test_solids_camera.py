"""Solids in an image: against the software camera, the pinhole model, and each other."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.peg.part_surfaces import rings
from chamfer.models.peg.peg_and_hole import BLUE, RED, ColouredParts
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.cameras.solids_camera import Solid, SolidsCamera, render_solids
from chamfer.systems.pose import pose_vector

PARTS = ColouredParts()

FLAT = SceneStyle(face=1.0, bore=1.0, blur=0.7)
GREY = (200, 200, 200)


def cube(name: str, side: float, colour: Any) -> Solid:
    corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    return Solid(name=name, vertices=np.array(corners) * side / 2, colour=colour)


def camera(view: Any = "xz", **changes: Any) -> Camera:
    return CameraPlacement(view=view, roll=0.0, **changes).camera


@pytest.mark.parametrize("view", ["xz", "xy", "yz"])
def test_a_peg_as_a_solid_is_the_software_cameras_peg(view: Any) -> None:
    X_WT = RigidTransform(RollPitchYaw(0.1, 0.3, 0.2), [0.01, -0.02, 0.01])
    vertices = rings(PARTS.peg.profile, 128).reshape(-1, 3)
    peg = Solid(name="peg", vertices=vertices, colour=RED)
    found = render_solids(camera(view), [peg], {"peg": X_WT})
    np.testing.assert_array_equal(found, render(PARTS, camera(view), X_WT, None, style=FLAT))


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_covers_the_farther_whatever_their_order(order: int) -> None:
    solids = [cube("near", 0.01, RED), cube("far", 0.02, BLUE)][::order]
    poses = {"near": RigidTransform([0, -0.03, 0]), "far": RigidTransform([0, 0.03, 0])}
    image = render_solids(camera(), solids, poses)
    assert image[119, 159].tolist() == list(RED)
    # From behind it is the other way round.
    behind = camera().placed(np.diag([-1.0, 1.0, -1.0]) @ camera().R_WC, -camera().p_WC)
    assert (render_solids(behind, solids, poses) == RED).all(axis=2).sum() == 0


def test_a_sleeve_covers_what_it_is_put_over() -> None:
    solids = [cube("plug", 0.01, RED), cube("sleeve", 0.02, BLUE)]
    poses = {name: RigidTransform() for name in ("plug", "sleeve")}
    image = render_solids(camera(), solids, poses)
    assert (image == RED).all(axis=2).sum() == 0
    assert image[119, 159].tolist() == list(BLUE)


def eval_image(block: SolidsCamera, **poses: RigidTransform) -> np.ndarray:
    context: Any = block.CreateDefaultContext()
    for name, pose in poses.items():
        block.GetInputPort(f"{name}_pose").FixValue(context, pose_vector(pose))
    return np.array(block.GetOutputPort("image").Eval(context).data[:, :, :3])


def test_block_draws_what_the_function_draws() -> None:
    solids = [cube("one", 0.02, RED), cube("other", 0.015, BLUE)]
    poses = {
        "one": RigidTransform(RollPitchYaw(0.1, 0.5, 0.3), [0.01, 0, 0]),
        "other": RigidTransform([-0.03, 0.01, 0.02]),
    }
    block = SolidsCamera(camera(), solids)
    np.testing.assert_array_equal(
        eval_image(block, **poses), render_solids(camera(), solids, poses)
    )
    del poses["other"]
    np.testing.assert_array_equal(
        eval_image(block, **poses), render_solids(camera(), solids, poses)
    )


def test_a_moving_camera_sees_what_one_sees_that_stands_there() -> None:
    solid = cube("one", 0.02, RED)
    place = camera("xy", target=(0.01, 0.02, 0.0), distance=0.4)
    # Another camera with the lens of that one.
    lens = camera("xz", distance=0.4)
    X_WC = RigidTransform(
        RollPitchYaw(RigidTransform(np.column_stack([place.R_WC, place.p_WC])).rotation()),
        place.p_WC,
    )
    found = eval_image(SolidsCamera(lens, [solid]), one=RigidTransform(), camera=X_WC)
    np.testing.assert_array_equal(found, render_solids(place, [solid], {"one": RigidTransform()}))
    assert (found != GREY).any()


def test_what_is_not_posed_or_behind_the_camera_is_not_drawn() -> None:
    solids = [cube("one", 0.02, RED), cube("other", 0.02, BLUE)]
    away = {"other": RigidTransform([0, -0.495, 0])}  # the camera is within it
    for poses in ({}, away):
        assert (render_solids(camera(), solids, poses) == GREY).all()
