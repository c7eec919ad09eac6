"""What cameras, their places and their models refuse, in one line each."""

import dataclasses
import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.validation import ParameterError

CAMERA = CameraPlacement().camera
NAN, INF = math.nan, math.inf
camera = partial(dataclasses.replace, CAMERA)

TWO, THREE = "two finite numbers", "three finite numbers"
FIVE = "five finite numbers: k1, k2, p1, p2, k3"


@pytest.mark.parametrize(
    ("make", "name", "value", "allowed"),
    [
        (camera, "focal", (1000.0, 0.0), f"{TWO} > 0"),
        (camera, "R_WC", 2 * np.eye(3), "a rotation matrix"),
        (camera, "R_WC", np.eye(2), "a rotation matrix"),
        (camera, "R_WC", np.diag([1.0, 1.0, -1.0]), "a rotation, not a reflection"),
        (camera, "p_WC", np.array([0.0, 0.0, NAN]), THREE),
        (camera, "distortion", (0.1, 0.0), FIVE),
        (camera, "distortion", (INF, 0, 0, 0, 0), FIVE),
        (camera, "distortion", (0, 0, 0, 0, -1e200), "five numbers from -1e+30 to 1e+30"),
        (CameraModel, "focal_length", (1000.0, 0.0), f"{TWO} > 0"),
        (CameraModel, "distortion", (0.1, 0.2), FIVE),
        (CameraModel, "camera", "left", "null without a file"),
    ],
)
def test_a_field_is_named_with_what_is_allowed(
    make: Callable[..., object], name: str, value: Any, allowed: str
) -> None:
    shown = ".*" if isinstance(value, np.ndarray) else re.escape(repr(value))
    end = f"{re.escape(allowed)}$" if allowed else ""
    with pytest.raises(ParameterError, match=rf"(?s)^{name} is {shown}, allowed: {end}"):
        make(**{name: value})
