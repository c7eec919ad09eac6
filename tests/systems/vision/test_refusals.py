"""What the parameters of vision refuse, in one line each."""

import dataclasses
import math
import re
from typing import Any

import pytest

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.vision.cell_error import ExpectedError
from chamfer.systems.vision.part_appearance import PEG, appearances
from chamfer.systems.vision.part_detector import PartsDetector
from chamfer.systems.vision.two_plane_stereo import TwoPlaneStereo

INF = math.inf
COLOUR = "brighter than 40 of 255, with more than 90 of 255 sat"
HUE = "a hue that differs more from the peg's, (205, 40, 40"
LIMITS = "the least one first, or null"

Row = tuple[Any, str, tuple[Any, ...], str]
ROWS: list[Row] = [
    (PartsDetector, "parts", ([],), "one or more"),
    (PEG, "front", (0, 2), ""),
    (PEG, "half_width", ((0.0, 1.0), (2.0, 1.0), (1.0, INF)), LIMITS),
    (PEG, "aspect", ((0.0, 1.0), (2.0, 1.0), (1.0, INF)), LIMITS),
]


@pytest.mark.parametrize(
    ("what", "name", "value", "allowed"),
    [(what, name, value, allowed) for what, name, values, allowed in ROWS for value in values],
)
def test_a_field_is_named_with_what_is_allowed(
    what: Any, name: str, value: Any, allowed: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is .*{re.escape(allowed)}"):
        what(**{name: value}) if callable(what) else dataclasses.replace(what, **{name: value})


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"peg_colour": (205, 140, 140)}, COLOUR),
        ({"hole_colour": (5, 5, 35)}, COLOUR),
        ({"hole_colour": (205, 90, 40)}, HUE),
        ({"hole_colour": (205, 40, 90)}, HUE),
    ],
)
def test_colours_that_no_filter_tells_apart(changes: dict[str, Any], allowed: str) -> None:
    (name,) = changes
    with pytest.raises(ParameterError, match=f"^{name} is .*, allowed: {re.escape(allowed)}"):
        appearances(ColouredParts(**changes))


def test_sizes_that_are_none_and_cameras_along_one_axis() -> None:
    for sizes, name in (((0.0, 9.0), "half_width"), ((9.0, -1.0), "length")):
        with pytest.raises(ParameterError, match=f"^{name} is "):
            PEG.sized(*sizes)
    with pytest.raises(ParameterError, match="pixel_size is 0"):
        ExpectedError(pixel_size=0, gap=0.0)
    cameras = [CameraPlacement(view="xz", roll=roll).camera for roll in (0.1, 0.5)]
    message = r"^camera_xy is .*, allowed: not along the other camera's optical"
    with pytest.raises(ParameterError, match=message):
        TwoPlaneStereo(*cameras)
