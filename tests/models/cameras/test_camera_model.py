"""Models beside a camera against OpenCV's projection, and what a file says of one."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.cameras.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    camera_text,
)
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.validation import ParameterError

STAND = CameraPlacement(view="xy", target=(0.1, -0.2, 0.3)).camera
ALL = CameraModel(
    focal_length=(900.0, 1100.0),
    principal_point=(150.0, 130.0),
    distortion=(-0.3, 0.1, 0.01, -0.02, 0.05),
    position=(0.01, -0.02, 0.03),
    tilt=(0.04, -0.06),
    roll=0.3,
)
LIKE = CameraModel.like(STAND)
POINTS = np.array([0.1, -0.2, 0.3]) + np.random.default_rng(0).uniform(-0.06, 0.06, (20, 3))

small = st.floats(-0.4, 0.4)


def projected(camera: Camera, points: np.ndarray, model: CameraModel) -> np.ndarray:
    """What OpenCV makes of points that were moved and turned as the model says, step by step."""
    p_C = (points - camera.p_WC) @ camera.R_WC - np.array(model.position)
    tilt, _ = cv2.Rodrigues(np.array([*(model.tilt or ()), 0.0]))
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, model.roll]))
    p_C = p_C @ tilt @ roll
    (fx, fy), (cx, cy) = model.focal_length or (0, 0), model.principal_point or (0, 0)
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    pixels, _ = cv2.projectPoints(
        p_C, np.zeros(3), np.zeros(3), matrix, np.array(model.distortion)
    )
    return np.array(pixels[:, 0])


def same(one: Camera, other: Camera) -> bool:
    return all(np.array_equal(value, getattr(other, name)) for name, value in vars(one).items())


def test_an_open_model_is_the_camera_itself_bit_by_bit() -> None:
    assert same(CameraModel().of(STAND), STAND)
    assert same(LIKE.of(STAND), STAND)


_FIELDS = [name for name, value in vars(ALL).items() if value is not None]


@pytest.mark.parametrize("name", [*_FIELDS, "all"])
def test_every_field_does_what_opencv_makes_of_it(name: str) -> None:
    given = ALL if name == "all" else CameraModel(**{name: getattr(ALL, name)})
    pixels = given.of(STAND).project(POINTS)
    expected = projected(STAND, POINTS, given.over(LIKE))
    np.testing.assert_allclose(pixels, expected, rtol=0, atol=1e-8)
    assert np.abs(pixels - STAND.project(POINTS)).max() > 0.5


@given(
    tilt=st.tuples(small, small),
    roll=st.floats(-3.0, 3.0),
    position=st.tuples(small, small, small),
)
def test_a_pose_in_the_world_is_found_beside_the_camera(
    tilt: tuple[float, float], roll: float, position: tuple[float, float, float]
) -> None:
    camera = CameraModel(tilt=tilt, roll=roll, position=position).of(STAND)
    found = CameraModel.beside(STAND, camera.R_WC, camera.p_WC)
    np.testing.assert_allclose(found.tilt or (), tilt, atol=1e-9)
    np.testing.assert_allclose(found.position or (), position, atol=1e-9)
    assert found.roll == pytest.approx(roll, abs=1e-9)


LEFT = CalibratedCamera(
    width=320,
    height=240,
    focal_length=(950.0, 960.0),
    principal_point=(161.0, 118.0),
    distortion=(-0.2, 0.0, 0.0, 0.0, 0.0),
)
RIGHT = replace(LEFT, focal_length=(970.0, 980.0), distortion=(0.1, 0.0, 0.0, 0.0, 0.0))


def pose(rotation: Rotation, translation: np.ndarray) -> FramePose:
    x, y, z = rotation.as_rotvec().tolist()
    u, v, w = translation.tolist()
    return FramePose(rotation_vector=(x, y, z), translation=(u, v, w))


def written(path: Path, **more: Any) -> str:
    path.write_text(camera_text(CameraFile(left=LEFT, **more)))
    return str(path)


def test_a_file_says_what_is_open(tmp_path: Path) -> None:
    file = written(tmp_path / "camera.yaml")
    found = CameraModel(file=file, principal_point=(1.0, 2.0), roll=0.1).read(STAND)
    assert found == CameraModel(
        focal_length=(950.0, 960.0),
        principal_point=(1.0, 2.0),
        distortion=(-0.2, 0.0, 0.0, 0.0, 0.0),
        roll=0.1,
    )
    assert CameraModel(roll=0.1).read(STAND) == CameraModel(roll=0.1)


def test_a_file_may_say_where_in_the_world_both_cameras_are(tmp_path: Path) -> None:
    left = CameraModel(tilt=(0.1, 0.0), position=(0.01, 0.0, 0.1)).of(STAND)
    right = CameraModel(tilt=(0.0, -0.2), position=(-0.1, 0.02, 0.0), roll=0.4).of(STAND)
    of_left = pose(
        Rotation.from_matrix(left.R_WC.T @ right.R_WC), left.R_WC.T @ (right.p_WC - left.p_WC)
    )
    world = pose(Rotation.from_matrix(left.R_WC), left.p_WC)
    file = written(tmp_path / "two.yaml", right=RIGHT, pose=of_left, world_pose=world)
    for eye, there, said in (("left", left, LEFT), ("right", right, RIGHT)):
        camera = CameraModel(file=file, camera=eye).read(STAND).of(STAND)  # type: ignore[arg-type]
        np.testing.assert_allclose(camera.R_WC, there.R_WC, atol=1e-9)
        np.testing.assert_allclose(camera.p_WC, there.p_WC, atol=1e-9)
        assert camera.focal == said.focal_length
        assert camera.distortion == said.distortion


def test_files_that_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path / "camera.yaml")
    wide = CameraPlacement(width=640).camera
    with pytest.raises(ParameterError, match=r"640 x 240 pixels; its has 320 x 240$"):
        CameraModel(file=file).read(wide)
    with pytest.raises(ParameterError, match=r"^camera is 'right', allowed: left"):
        CameraModel(file=file, camera="right").read(STAND)
    with pytest.raises(
        ParameterError,
        match=r"^file is .*no\.yaml', allowed: one that can be read; .*content is .No such file",
    ):
        CameraModel(file=str(tmp_path / "no.yaml")).read(STAND)
    back = STAND.R_WC @ Rotation.from_rotvec([math.pi, 0, 0]).as_matrix()
    world = pose(Rotation.from_matrix(back), STAND.p_WC)
    away = written(tmp_path / "away.yaml", world_pose=world)
    with pytest.raises(ParameterError, match=r"^file is .*does not look the other way"):
        CameraModel(file=away).read(STAND)
    with pytest.raises(ParameterError, match=r"^file is .*null where it is used"):
        CameraModel(file=file).of(STAND)
