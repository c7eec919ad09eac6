"""What cameras and their images refuse, in one line each."""

import math
import re
from typing import Any

import numpy as np
import pytest

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import RED
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import SensorParams
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.solids_camera import Solid, SolidsCamera

NAN = math.nan
GAINS = "three finite numbers > 0"


@pytest.mark.parametrize(
    ("what", "name", "value", "allowed"),
    [
        (SensorParams, "white_balance", (1.0, 0.0, 1.0), GAINS),
        (SceneStyle, "background", (0, 0, 256), "three numbers from 0 to 255"),
    ],
)
def test_a_field_is_named_with_what_is_allowed(
    what: Any, name: str, value: Any, allowed: str
) -> None:
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        what(**{name: value})


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"name": "a b"}, "name is 'a b', allowed: letters"),
        ({"vertices": np.zeros((3, 3))}, "vertices of one is (3, 3), allowed: shape (n, 3)"),
        ({"vertices": np.full((4, 3), NAN)}, "vertices of one is "),
        ({"colour": (0, 0, 256)}, "colour is (0, 0, 256), allowed: three numbers"),
    ],
)
def test_solids_that_cannot_be(changes: dict[str, Any], text: str) -> None:
    fields = {"name": "one", "vertices": np.zeros((4, 3)), "colour": RED, **changes}
    with pytest.raises(ParameterError, match=f"^{re.escape(text)}"):
        Solid(**fields)


@pytest.mark.parametrize("names", [[], ["one", "one"], ["camera"]])
def test_names_of_solids_are_those_of_ports(names: list[str]) -> None:
    solids = [Solid(name=name, vertices=np.eye(4, 3), colour=RED) for name in names]
    with pytest.raises(ParameterError, match=r"^solids is .*, allowed: one or more, of different"):
        SolidsCamera(CameraPlacement().camera, solids)
