"""What ``camera.yaml`` holds: the same after writing and reading, and every mistake in a line."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from chamfer.models.cameras.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    Intrinsics,
    camera_text,
    read_camera,
)
from chamfer.models.validation import ParameterError

ONE = """\
width: 640
height: 480
focal_length: [532.5, 533]
principal_point: [342.0, 233.5]
distortion: [-0.28, 0.025, 1e-3, -1.5e-4, 0]
"""
TWO = f"""\
{ONE}right:
  width: 320
  height: 240
  focal_length: [266, 266]
  principal_point: [160, 120]
  distortion: [0, 0, 0, 0, 0]
pose: {{rotation_vector: [0, 0.1, 0], translation: [0.1, 0, 0]}}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "camera.yaml"


def test_a_file_by_hand_needs_no_deviations_and_may_say_1e_3(path: Path) -> None:
    path.write_text(ONE)
    file = read_camera(path)
    assert file.left == CalibratedCamera(
        width=640,
        height=480,
        focal_length=(532.5, 533.0),
        principal_point=(342.0, 233.5),
        distortion=(-0.28, 0.025, 0.001, -0.00015, 0.0),
    )
    assert (file.right, file.pose, file.world_pose) == (None, None, None)
    with pytest.raises(ParameterError, match="camera is 'right', allowed: left, which"):
        file.eye("right")


def test_what_is_written_is_read_again_with_the_public_names_at_the_top(path: Path) -> None:
    path.write_text(ONE)
    sd = Intrinsics(focal_length=(0.5, 0.5), principal_point=(0.6, 0.6), distortion=(0.1,) * 5)
    pose = FramePose(rotation_vector=(0.0, 0.1, 0.0), translation=(1.0, 0.0, 0.0))
    left = replace(read_camera(path).left, reprojection_error=0.25, sd=sd)
    measured = replace(pose, sd=pose)
    file = CameraFile(left=left, right=left, pose=measured, world_pose=measured)
    path.write_text(camera_text(file))
    assert read_camera(path) == file
    assert file.eye("right") == left
    document = yaml.safe_load(camera_text(CameraFile(left=left, right=left, pose=measured)))
    assert list(document) == [
        *("width", "height", "focal_length", "principal_point", "distortion"),
        *("reprojection_error", "right", "pose", "sd"),
    ]
    assert list(document["sd"]) == ["focal_length", "principal_point", "distortion", "pose"]
    assert document["right"]["sd"]["principal_point"] == [0.6, 0.6]
    assert document["sd"]["pose"]["rotation_vector"] == [0.0, 0.1, 0.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "content is None, allowed: a mapping of width, height, focal_length, "),
        ("[1]", "content is [1], allowed: a mapping of width"),
        ("a: [", "content is 'not YAML in line 1', allowed: "),
        ("\0", "content is 'not a text in YAML', allowed: a camera file, as chamfer calibrate"),
        (b"\xff\xfe\xfa", "content is 'not a text in YAML', allowed: a camera file"),
        ("#" * 100_001, "size is 'large', allowed: a camera file, as chamfer calibrate"),
        (ONE.replace("width: 640", ""), "width is None, allowed: a whole number from 1 to 100000"),
        (ONE.replace("640", "640.0"), "width is 640.0, allowed: a whole number"),
        (ONE.replace("480", "true"), "height is True, allowed: a whole number"),
        (ONE.replace("480", "0"), "height is 0, allowed: a whole number"),
        (
            ONE.replace("532.5", "-1"),
            "focal_length is [-1, 533], allowed: two finite numbers > 0",
        ),
        (ONE.replace("[532.5, 533]", "533"), "focal_length is 533, allowed: two finite"),
        (ONE.replace("532.5", ".inf"), "focal_length is [inf, 533], allowed: two finite"),
        (ONE.replace("0.025, ", ""), "distortion is [-0.28, '1e-3', -0.00015, 0], allowed: five"),
        (f"{ONE}focal: 3\n", "field is 'focal', allowed: the fields width, height, "),
        (f"{ONE}reprojection_error: -1\n", "reprojection_error is -1, allowed: a finite number"),
        (f"{ONE}sd: 3\n", "sd is 3, allowed: a mapping of focal_length"),
        (f"{ONE}sd: {{focal: 3}}\n", "sd is 'focal', allowed: the fields focal_length"),
        (
            f"{ONE}sd: {{focal_length: [1, 1]}}\n",
            "sd.principal_point is None, allowed: two finite numbers",
        ),
        (
            f"{ONE}sd: {{focal_length: [1, -1]}}\n",
            "sd.focal_length is [1, -1], allowed: two finite numbers >= 0",
        ),
        (
            f"{ONE}world_pose: {{rotation_vector: [0, 0, 0]}}\n",
            "world_pose.translation is None, allowed: three finite numbers",
        ),
        (TWO.replace("320", "x"), "right.width is 'x', allowed: a whole number"),
        (TWO.split("pose")[0], "pose is None, allowed: given, as right is"),
        (f"{ONE}pose{TWO.split('pose')[1]}", "right is None, allowed: given, as pose is"),
    ],
)
def test_a_mistake_is_named_with_the_file(path: Path, text: str | bytes, message: str) -> None:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ParameterError) as raised:
        read_camera(path)
    assert str(raised.value).startswith(f"{path}: {message}")
    assert "\n" not in str(raised.value)


def test_a_file_that_is_not_there(path: Path) -> None:
    with pytest.raises(ParameterError, match="content is 'No such file or directory', allowed: a"):
        read_camera(path)
