"""Calibrated cameras as files: reads and writes ``camera.yaml``.

.. code-block:: yaml

    width: 640 # pixels
    height: 480
    focal_length: [532.8, 532.9] # pixels, along u and v
    principal_point: [342.4, 233.9] # pixels, u and v
    distortion: [-0.281, 0.025, 0.0012, -0.0001, 0.163] # k1, k2, p1, p2, k3
    reprojection_error: 0.195 # pixels, root of the mean square of the distances
    sd: {focal_length: [0.4, 0.5], ...} # standard deviations, under the same names

A file of two cameras has the left one at the top level, the other one under ``right`` (with its
own ``sd``), and ``pose: {rotation_vector, translation}`` of the right camera in the left one's
frame, rad and m. ``world_pose`` is that of the (left) camera in the world, ``hand_eye`` that in
the tool of the arm that holds it. Their standard deviations, ``sd.pose`` and so on, are those of
small rotations about the axes, and of the place along the axes, of the frame in which the pose is
given. What is said of errors
(``reprojection_error``, ``sd``) may be missing. Pixels and the camera's frame are those of
:mod:`chamfer.models.cameras.camera`.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera, Coefficients, Matrix
from chamfer.models.validation import ParameterError

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Eye = Literal["left", "right"]

_LARGEST_SIZE: Final = 100_000  # pixels
_LARGEST_FILE: Final = 100_000  # bytes
_FACTS: Final = ("width", "height", "focal_length", "principal_point", "distortion")
_INTRINSIC: Final = {"focal_length": 2, "principal_point": 2, "distortion": 5}  # numbers of each
_POSE: Final = {"rotation_vector": 3, "translation": 3}
_POSES: Final = ("pose", "world_pose", "hand_eye")
_WORDS: Final = {2: "two", 3: "three", 5: "five"}


@dataclass(frozen=True, kw_only=True)
class FramePose:
    """Where a frame is, seen from another one."""

    rotation_vector: Triple  # rad
    translation: Triple  # m
    sd: "FramePose | None" = None  # its standard deviations, None where they are not known

    @property
    def rotation(self) -> Matrix:
        """From the frame's axes to those of the other, shape (3, 3)."""
        return np.asarray(Rotation.from_rotvec(self.rotation_vector).as_matrix())


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """The intrinsic parameters of a camera, or their standard deviations."""

    focal_length: Pair  # pixels, along u and v
    principal_point: Pair  # pixels, where the optical axis meets the image
    distortion: Coefficients  # k1, k2, p1, p2, k3 of OpenCV's model


@dataclass(frozen=True, kw_only=True)
class CalibratedCamera(Intrinsics):
    """The result of a camera's calibration, independent of its pose."""

    width: int  # pixels
    height: int  # pixels
    reprojection_error: float | None = None  # pixels, root of the mean square
    sd: Intrinsics | None = None

    def placed(self, pose: FramePose) -> Camera:
        """Return the camera at a place in the world."""
        return Camera(
            width=self.width,
            height=self.height,
            focal=self.focal_length,
            centre=self.principal_point,
            R_WC=pose.rotation,
            p_WC=np.array(pose.translation),
            distortion=self.distortion,
        )


@dataclass(frozen=True, kw_only=True)
class CameraFile:
    """One calibrated camera, which is the left one, or two."""

    left: CalibratedCamera
    right: CalibratedCamera | None = None
    pose: FramePose | None = None  # of the right camera in the left one's frame
    world_pose: FramePose | None = None  # of the left camera in the world
    hand_eye: FramePose | None = None  # of the left camera in the tool of the arm that holds it

    def eye(self, which: Eye) -> CalibratedCamera:
        """Return the left or the right camera.

        Raises:
            ParameterError: If there is no such camera.
        """
        found = {"left": self.left, "right": self.right}.get(which)
        if found is None:
            allowed = "left" if self.right is None else "left, right"
            raise ParameterError("camera", which, f"{allowed}, which the file has")
        return found


def read_camera(path: Path) -> CameraFile:
    """Return the one or two cameras of a file.

    Raises:
        ParameterError: If the file can't be read, or a field is missing, unknown or not
            allowed; its name is the file's and the field's.
    """
    try:
        return _file(_document(path))
    except ParameterError as error:
        raise ParameterError(f"{path}: {error.name}", error.value, error.allowed) from error


def camera_text(file: CameraFile) -> str:
    """Return a file's text, which :func:`read_camera` reads back unchanged."""
    document = _plain(file.left, _FACTS)
    deviations = document.pop("sd", {})
    if file.right is not None:
        document["right"] = _plain(file.right, _FACTS)
    for name in _POSES:
        if getattr(file, name) is not None:
            document[name] = plain_pose(getattr(file, name))
            if "sd" in document[name]:
                deviations[name] = document[name].pop("sd")
    if deviations:
        document["sd"] = deviations
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=math.inf)


def plain_pose(pose: FramePose) -> dict[str, Any]:
    """Return a pose as plain data, its standard deviations under ``sd``."""
    return _plain(pose, _POSE)


def _plain(of: Any, names: Iterable[str]) -> dict[str, Any]:
    """Return fields as plain data, and what is known of their errors."""
    values = {name: getattr(of, name) for name in names}
    plain = {
        name: [float(one) for one in value] if isinstance(value, tuple) else value
        for name, value in values.items()
    }
    if getattr(of, "reprojection_error", None) is not None:
        plain["reprojection_error"] = of.reprojection_error
    if getattr(of, "sd", None) is not None:
        plain["sd"] = _plain(of.sd, [name for name in names if name in (_INTRINSIC | _POSE)])
    return plain


def _document(path: Path) -> Any:
    """Return what a YAML file holds."""
    allowed = "a camera file, as chamfer calibrate writes it"
    try:
        with path.open("rb") as file:
            begin = file.read(_LARGEST_FILE + 1)
        if len(begin) > _LARGEST_FILE:
            raise ParameterError("size", "large", f"{allowed}, of at most {_LARGEST_FILE} bytes")
        return yaml.safe_load(begin.decode())
    except (OSError, ValueError, RecursionError, yaml.YAMLError, LookupError) as error:
        if isinstance(error, ParameterError):
            raise
        if isinstance(error, OSError):
            reason = error.strerror or str(error)
        elif isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
            reason = f"not YAML in line {error.problem_mark.line + 1}"
        else:
            reason = "not a text in YAML"
        raise ParameterError("content", reason, allowed) from error


def _file(document: Any) -> CameraFile:
    given = _fields(document, "content", (*_FACTS, "reprojection_error", "sd", "right", *_POSES))
    deviations = given.get("sd")
    if deviations is not None:
        deviations = _fields(deviations, "sd", (*_INTRINSIC, *_POSES))
    left = _camera({**given, "sd": deviations}, "")
    right = None
    if given.get("right") is not None:
        names = (*_FACTS, "reprojection_error", "sd")
        right = _camera(_fields(given["right"], "right", names), "right.")
    poses = {}
    for name in _POSES:
        pose = _pose(given.get(name), name)
        sd = _pose((deviations or {}).get(name), f"sd.{name}", " >= 0")
        poses[name] = pose and replace(pose, sd=sd)
    if (right is None) != (poses["pose"] is None):
        lacks, has = ("right", "pose") if right is None else ("pose", "right")
        raise ParameterError(lacks, None, f"given, as {has} is")
    return CameraFile(left=left, right=right, **poses)


def _camera(given: Mapping[str, Any], path: str) -> CalibratedCamera:
    values: dict[str, Any] = {}
    for name in ("width", "height"):
        size = values[name] = given.get(name)
        if isinstance(size, bool) or not isinstance(size, int) or not 1 <= size <= _LARGEST_SIZE:
            raise ParameterError(
                f"{path}{name}", size, f"a whole number from 1 to {_LARGEST_SIZE}"
            )
    for name, count in _INTRINSIC.items():
        sign = " > 0" if name == "focal_length" else ""
        values[name] = _numbers(given.get(name), f"{path}{name}", count, sign)
    error = given.get("reprojection_error")
    if error is not None:
        values["reprojection_error"] = _number(error)
        if not 0 <= values["reprojection_error"] < math.inf:
            raise ParameterError(f"{path}reprojection_error", error, "a finite number >= 0")
    if given.get("sd") is not None:
        sd = _fields(given["sd"], f"{path}sd", (*_INTRINSIC, *_POSES))
        if sd.keys() & _INTRINSIC.keys():
            values["sd"] = Intrinsics(**_group(sd, f"{path}sd.", _INTRINSIC, " >= 0"))
    return CalibratedCamera(**values)


def _pose(given: Any, path: str, sign: str = "") -> FramePose | None:
    if given is None:
        return None
    return FramePose(**_group(_fields(given, path, tuple(_POSE)), f"{path}.", _POSE, sign))


def _group(
    given: Mapping[str, Any], path: str, counts: Mapping[str, int], sign: str = ""
) -> dict[str, Any]:
    return {
        name: _numbers(given.get(name), f"{path}{name}", count, sign)
        for name, count in counts.items()
    }


def _fields(value: Any, path: str, names: tuple[str, ...]) -> Mapping[str, Any]:
    """Return a mapping of which all names are known."""
    if not isinstance(value, dict):
        raise ParameterError(path, value, f"a mapping of {', '.join(names)}")
    for name in value:
        if name not in names:
            raise ParameterError(
                path if path != "content" else "field", name, f"the fields {', '.join(names)}"
            )
    return value


def _number(value: Any) -> float:
    """Return a number, NaN for what is none; YAML 1.1 takes 1e-3 for a text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


def _numbers(value: Any, path: str, count: int, sign: str) -> Any:
    """Return so many numbers, which are finite and, with a sign " > 0" or " >= 0", so."""
    listed = isinstance(value, list) and len(value) == count
    numbers = tuple(_number(one) for one in value) if listed else (math.nan,)
    allowed = np.isfinite(numbers).all() and not (sign and min(numbers) < 0)
    if not allowed or (sign == " > 0" and 0 in numbers):
        raise ParameterError(path, value, f"{_WORDS[count]} finite numbers{sign}")
    return numbers
