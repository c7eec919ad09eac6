"""Two calibrated cameras: parts in space, against where they were drawn."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.spatial.transform import Rotation

from chamfer.analysis.cli import main
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.detection_overlay import SeenParts
from chamfer.analysis.track.part_finder import SPACE_COLUMNS, PartFinder, in_space, read_cameras
from chamfer.models.cameras.camera import Camera, CameraPlacement
from chamfer.models.cameras.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    camera_text,
)
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG
from chamfer.systems.vision.part_detection import detect_parts

PARTS = ColouredParts()
LENSES = ((-3.0, 1.0, 0.01, -0.005, 0.0), (2.0, 0.0, 0.0, 0.01, 0.0))
# Looking along Y and down, and the right one not quite so.
LEFT, STRAIGHT = (
    replace(
        CameraPlacement(view=view, roll=roll, width=640, height=480, pixel_size=0.00025).camera,
        distortion=lens,
    )
    for view, roll, lens in (("xz", 0.1, LENSES[0]), ("xy", -0.2, LENSES[1]))
)
R_WR = STRAIGHT.R_WC @ Rotation.from_rotvec([0.05, 0.02, 0]).as_matrix()
RIGHT = STRAIGHT.placed(R_WR, [0.005, 0.002, 0.01] - 0.5 * R_WR[:, 2])

Rows = Callable[[Path], list[dict[str, str]]]


def poses(k: int) -> tuple[RigidTransform, RigidTransform]:
    peg = RigidTransform(RollPitchYaw(0.3, 0.08 - 0.01 * k, 0.06), [-0.02 + 0.001 * k, 0, 0.003])
    hole = RigidTransform(RollPitchYaw(0, -0.03, 0.02), [0.02, 0.001, 0.002])
    return peg, hole


def in_left(p_W: np.ndarray) -> np.ndarray:
    moved: np.ndarray = (p_W - LEFT.p_WC) @ LEFT.R_WC
    return moved


def calibrated(camera: Camera) -> CalibratedCamera:
    return CalibratedCamera(
        width=camera.width,
        height=camera.height,
        focal_length=camera.focal,
        principal_point=camera.centre,
        distortion=camera.distortion,
    )


def model() -> CameraFile:
    turn = Rotation.from_matrix(LEFT.R_WC.T @ RIGHT.R_WC).as_rotvec()
    pose = FramePose(
        rotation_vector=tuple(turn.tolist()), translation=tuple(in_left(RIGHT.p_WC).tolist())
    )
    return CameraFile(left=calibrated(LEFT), right=calibrated(RIGHT), pose=pose)


def write_frames(folder: Path, camera: Camera, number: int) -> Path:
    folder.mkdir()
    for k in range(number):
        image = render(PARTS, camera, *poses(k))
        assert cv2.imwrite(str(folder / f"{k}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return folder


@pytest.fixture
def recorded(tmp_path: Path) -> tuple[str, ...]:
    """The arguments for three frames of both cameras."""
    file = tmp_path / "camera.yaml"
    file.write_text(camera_text(model()))
    left, right = (
        write_frames(tmp_path / name, camera, 3)
        for name, camera in (("left", LEFT), ("right", RIGHT))
    )
    return ("track", str(left), "--right", str(right), "--camera-model", str(file))


def vector(row: dict[str, str], names: Sequence[str]) -> np.ndarray:
    return np.array([float(row[name]) for name in names])


def test_tips_axes_and_error_in_the_left_cameras_frame(
    rows: Rows, recorded: tuple[str, ...], out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*recorded, "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "both parts valid in 3" in printed.out
    assert "right hole part  3  valid" in printed.out
    for k, row in enumerate(rows(out)):
        for part, X_WP in zip(("peg", "hole"), poses(k), strict=True):
            tip = vector(row, [f"{part}_{axis}" for axis in "xyz"])
            np.testing.assert_allclose(tip, in_left(X_WP.translation()), atol=5e-5)
            axis = vector(row, [f"{part}_axis_{axis}" for axis in "xyz"])
            true = X_WP.rotation().matrix()[:, 0] @ LEFT.R_WC
            assert math.acos(min(axis @ true, 1.0)) < 2e-3
            assert float(row[f"{part}_disagreement"]) < 1e-4
        peg, hole = poses(k)
        gap = in_left(hole.translation()) - in_left(peg.translation())
        into = hole.rotation().matrix()[:, 0] @ LEFT.R_WC
        along = gap @ into
        expected = [along, *(gap - along * into)[1:]]
        found = vector(row, [f"metric_{name}" for name in ("along", "down", "ahead")])
        np.testing.assert_allclose(found, expected, atol=1e-4)
        turn = vector(row, [f"metric_turn_{axis}" for axis in "xyz"])
        true_turn = np.cross(peg.rotation().matrix()[:, 0] @ LEFT.R_WC, into)
        np.testing.assert_allclose(turn, true_turn, atol=3e-3)


def test_what_one_camera_does_not_see_is_not_known_in_space() -> None:
    finder = PartFinder(PEG, HOLE_PART, [LEFT, RIGHT])
    peg, hole = poses(0)
    images = [render(PARTS, LEFT, peg, hole), render(PARTS, RIGHT, peg, None)]
    found = dict(zip(finder.columns, finder.find(images, 0.0).values, strict=True))
    assert np.isfinite([found["peg_x"], found["peg_axis_z"], found["hole_tip_u"]]).all()
    assert np.isnan([found["hole_x"], found["hole_disagreement"], found["metric_along"]]).all()
    assert found["right_hole_status"] == Status.NO_COLOUR


def test_cameras_in_one_plane_with_the_axis_know_nothing_in_space() -> None:
    left = CameraPlacement(roll=0.0).camera
    cameras = [left, left.placed(left.R_WC, left.p_WC + np.array([0.05, 0, 0]))]
    finder = PartFinder(PEG, HOLE_PART, cameras)
    pair = RigidTransform([-0.02, 0, 0.001]), RigidTransform([0.02, 0, 0.002])
    found = finder.find([render(PARTS, camera, *pair) for camera in cameras], 0.0)
    values = dict(zip(finder.columns, found.values, strict=True))
    assert values["peg_status"] == values["right_hole_status"] == Status.VALID
    assert all(math.isnan(values[name]) for name in SPACE_COLUMNS)
    assert found.note == "in space: -"


def test_cameras_that_disagree_on_the_tip_know_nothing_in_space() -> None:
    below = CameraPlacement(view="xy", roll=math.pi).camera
    cameras = [CameraPlacement().camera, below]
    turned = [replace(PEG, front=-1), replace(HOLE_PART, front=1)]
    peg, hole = RigidTransform([-0.02, 0, 0]), RigidTransform([0.02, 0, 0])
    images = [render(PARTS, camera, peg, hole) for camera in cameras]
    looks = [(PEG, HOLE_PART), turned]
    seen = [
        SeenParts(image, *detect_parts(image, *look))
        for image, look in zip(images, looks, strict=True)
    ]
    assert seen[1].peg.status == Status.VALID
    assert np.isnan(in_space(cameras, seen)).all()


def test_a_file_of_one_camera_for_two(tmp_path: Path) -> None:
    file = tmp_path / "camera.yaml"
    file.write_text(camera_text(CameraFile(left=calibrated(LEFT))))
    (camera,) = read_cameras(file, 1)
    assert camera.distortion == LENSES[0]
    with pytest.raises(UserError, match="holds one camera, allowed with --right: a file of two"):
        read_cameras(file, 2)
    with pytest.raises(UserError, match="No such file"):
        read_cameras(tmp_path / "no.yaml", 1)


def test_recordings_that_are_no_pair(
    recorded: tuple[str, ...], out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command, left, option, right, *camera = recorded
    (Path(right) / "2.png").unlink()
    arguments = ["--out", str(out)]
    for given, said in (
        ([left, option, right, *camera], "--right has 2 images, allowed: 3 as FILES"),
        ([left, option, right], "--right is given without --camera-model"),
        (
            ["--device", "0", option, right, *camera],
            "--right and --device are given, allowed: --right with FILES",
        ),
    ):
        assert main([command, *given, *arguments]) == 2
        assert capsys.readouterr().err == f"chamfer: {said}\n"
    assert not out.exists()
