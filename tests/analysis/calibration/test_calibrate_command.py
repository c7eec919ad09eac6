"""The command ``chamfer calibrate``: what it prints and writes, and every mistake in one line."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import parse_board
from chamfer.analysis.calibration.calibration_accuracy import (
    BoardPicture,
    BoardPoses,
    draw_board,
)
from chamfer.analysis.calibration.camera_fit import transform
from chamfer.analysis.cli import main
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import read_camera

BOARD = ["--board", "chessboard:9x6:25mm"]
NAMES = ("camera.yaml", "residuals.png", "residuals.svg")

Place = Callable[..., list[Camera]]


@pytest.fixture(scope="session")
def drawn(tmp_path_factory: pytest.TempPathFactory, place: Place) -> Path:
    """Five pictures each of two cameras, the right one 50 mm beside the left one."""
    folder, random = tmp_path_factory.mktemp("drawn"), np.random.default_rng(2)
    for name, beside in (("left", 0.0), ("right", 0.05)):
        (folder / name).mkdir()
        for k, one in enumerate(place(5, poses=BoardPoses(extent=(0.35, 0.5)))):
            there = one.placed(one.R_WC, one.p_WC + one.R_WC @ [beside, 0.0, 0.0])
            image = draw_board(parse_board(BOARD[1]), there, BoardPicture(), random)
            assert cv2.imwrite(str(folder / name / f"{name}{k}.png"), image)
    return folder


@pytest.fixture
def left(tmp_path: Path, drawn: Path) -> Path:
    return Path(shutil.copytree(drawn / "left", tmp_path / "left"))


def test_photographs(photographs: Path, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (out / "calibrate").mkdir(parents=True)
    (out / "calibrate" / "camera.yaml").touch()
    assert main(["calibrate", str(photographs), *BOARD, "--out", str(out)]) == 0
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert lines[0].startswith("13 of 13 pictures, 640 x 480 pixels, reprojection error 0.17")
    assert lines[1].split() == ["standard", "deviation"]
    assert lines[2].split()[0::3] == ["fx", "pixels"]
    assert lines[11].split()[0::2] == ["left01.jpg", "pixels"]
    # No photograph shows the board there.
    said = "in the picture's corners the distortion is known to 23 pixels only"
    assert lines[-4].startswith(said)
    assert lines[-3:] == [f"{out}/calibrate/{name}" for name in NAMES]
    assert printed.err == f"chamfer: files in {out}/calibrate are replaced\n"
    found = read_camera(out / "calibrate" / "camera.yaml").left
    # OpenCV's own calibration; its rms is 0.244, with corners that are not as exact.
    assert (found.width, found.height) == (640, 480)
    assert found.focal_length == pytest.approx((532.4, 532.4), abs=1.5)
    assert found.principal_point == pytest.approx((341.9, 232.7), abs=3)
    assert found.distortion[0] == pytest.approx(-0.3, abs=0.03)
    assert found.sd is not None
    assert 0.3 < found.sd.focal_length[0] < 1.0
    assert sorted(path.name for path in (out / "calibrate").iterdir()) == sorted(NAMES)


def test_pictures_that_can_t_be_used_are_named(
    left: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(left / "left0.png", left / "left5.png")
    (left / "left6.png").write_text("no image")
    for name, size in (("left7.png", (480, 640)), ("left10.png", (240, 320))):
        assert cv2.imwrite(str(left / name), np.full(size, 127, np.uint8))
    assert main(["calibrate", str(left), *BOARD, "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {one["name"]: one["left_out"] for one in document["pictures"]["left"]} == {
        **{f"left{k}.png": None for k in range(5)},
        "left5.png": "the same picture as left0.png",
        "left6.png": "can't be decoded, allowed: an image that is whole",
        "left7.png": "the board is not found",
        "left10.png": "it is 320 x 240 pixels, most are 640 x 480",
    }
    assert list(document) == ["camera", "pictures", "pairs", "notes", "files"]
    text = (out / "calibrate" / "camera.yaml").read_text()
    assert yaml.safe_load(text) == document["camera"]


@pytest.mark.slow
def test_two_cameras_in_the_world(
    drawn: Path, left: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    right = Path(shutil.copytree(drawn / "right", left.parent / "right"))
    cv2.imwrite(str(right / "right4.png"), np.full((480, 640), 127, np.uint8))
    pose = ["--board-picture", str(left / "left1.png"), "--board-pose=-0.1,0.2,0,3.14,0,0.5"]
    arguments = ["calibrate", str(left), "--right", str(right), *BOARD, *pose, "--out", str(out)]
    assert main(arguments) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "right4.png left out: the board is not found" in printed
    assert "left camera: 5 of 5 pictures" in printed
    assert "right camera: 4 of 5 pictures" in printed
    assert "pixels for this camera alone: without the right camera's" in printed
    assert "the right camera in the left one's frame, from 4 pairs" in printed
    assert "the left camera in the world" in printed
    file = read_camera(out / "calibrate" / "camera.yaml")
    assert file.pose is not None
    assert file.world_pose is not None
    assert file.pose.translation == pytest.approx((0.05, 0, 0), abs=1e-3)
    assert file.eye("right").focal_length == pytest.approx((560, 565), abs=5)


def test_the_picture_of_the_known_place_may_be_one_more(
    left: Path, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = os.fsdecode(b"there$\xff.png")  # no text
    other = (left / "left4.png").rename(tmp_path / name)
    arguments = ["calibrate", str(left), *BOARD, "--out", str(out), "--json"]
    arguments += ["--board-picture", str(other), "--board-pose", "0,0,0,0,0,0"]
    assert main(arguments) == 0
    document = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in document["pictures"]["left"]][-1] == "there$\\xff.png"
    assert (
        document["camera"]["world_pose"]["translation"][2] < -0.1
    )  # in front of the board, whose z points away


def test_a_camera_in_a_hand(
    left: Path, place: Place, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    X_TC = transform(np.array([0.1, -0.2, 1.5, 0.05, 0.02, 0.1]))
    lines = ["file,x,y,z,qw,qx,qy,qz"]
    for k, one in enumerate(place(5, poses=BoardPoses(extent=(0.35, 0.5)))):
        X_BC = np.vstack([np.column_stack([one.R_WC, one.p_WC]), [0, 0, 0, 1]])
        X_WT = X_BC @ np.linalg.inv(X_TC)
        quaternion = Rotation.from_matrix(X_WT[:3, :3]).as_quat(scalar_first=True)
        lines.append(",".join([f"left{k}.png", *map(str, [*X_WT[:3, 3], *quaternion])]))
    poses = left.parent / "poses.csv"
    poses.write_text("\n".join(lines))
    arguments = ["calibrate", str(left), *BOARD, "--poses", str(poses), "--out", str(out)]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "the camera in the arm's tool\n" in printed
    assert "hand-eye: 5 poses, of standard deviations of " in printed
    assert f"{out}/calibrate/hand-eye.png\n" in printed
    found = read_camera(out / "calibrate" / "camera.yaml").hand_eye
    assert found is not None
    assert found.sd is not None
    off = np.subtract(found.translation, X_TC[:3, 3])
    assert np.linalg.norm(off / found.sd.translation) < 4
    assert max(found.sd.translation) < 1e-3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["left"], "the following arguments are required: --board, see chamfer calibrate --help"),
        (
            ["left", "--board", "chess"],
            "--board is 'chess', allowed: chessboard:9x6:25mm (inner corners, side of a square) "
            "or charuco:8x6:30mm:22mm:DICT_5X5_100 (squares, side of a square, side of a marker, "
            "OpenCV's dictionary)",
        ),
        (
            ["left", "--right", "left/left0.png", *BOARD],
            "--right is 1 pictures, allowed: 5, as of the left camera",
        ),
        (
            ["left", "--right", "left", "--board", "chessboard:8x6:25mm"],
            "--board is 'chessboard:8x6:25mm', allowed with two cameras, a known place or poses: "
            "one of the two numbers odd and the other even, so that its ends differ",
        ),
        (
            ["left", "--right", "left", *BOARD],
            "right camera: 0 of 5 pictures show the board (left0.png: the same picture as "
            "the left camera's left0.png), allowed: at least 3",
        ),
        (
            ["left/left0.png", "left/left1.png", *BOARD],
            "2 of 2 pictures show the board, allowed: at least 3",
        ),
        (
            ["left", *BOARD, "--board-pose", "0,0,0,0,0,0"],
            "--board-pose is given without --board-picture, allowed: both",
        ),
        (
            ["left", *BOARD, "--board-picture", "left/left0.png"],
            "--board-picture is given without --board-pose, allowed: both",
        ),
        *(
            (
                ["left", *BOARD, "--board-picture", "left/left0.png", "--board-pose", text],
                f"--board-pose is {text!r}, allowed: six numbers, x,y,z,roll,pitch,yaw, m and rad",
            )
            for text in ("0,0,0", "0,0,0,0,0,x", "0,0,0,0,0,nan", "0,0,0,0,0,1e9", "")
        ),
        (
            ["left", *BOARD, "--board-picture", "blank.png", "--board-pose", "0,0,0,0,0,0"],
            "blank.png can't tell where the camera stands: the board is not found",
        ),
        (["a.avi", *BOARD], "a.avi is a video, allowed: an image folder, image files"),
    ],
)
def test_mistakes_end_in_one_line(
    left: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(left.parent)
    cv2.imwrite("blank.png", np.full((480, 640), 127, np.uint8))
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter("a.avi", cv2.CAP_FFMPEG, code, 30.0, (320, 240))
    writer.write(np.zeros((240, 320, 3), np.uint8))
    writer.release()
    assert main(["calibrate", *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"chamfer: {message}\n"
    assert not Path("out", "calibrate").exists()


def test_a_calibration_that_fails_replaces_nothing_and_does_not_say_so(
    left: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (out / "calibrate").mkdir(parents=True)
    (out / "calibrate" / "camera.yaml").write_text("earlier")
    for picture in left.iterdir():
        assert cv2.imwrite(str(picture), np.full((480, 640), 127, np.uint8))
    assert main(["calibrate", str(left), *BOARD, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "replaced" not in said
    assert (out / "calibrate" / "camera.yaml").read_text() == "earlier"
