"""Moments and edges of cross-sections against closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.common.value import Value
from pydrake.systems.sensors import ImageRgba8U

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import RED
from chamfer.systems.cameras.camera_image import write_image
from chamfer.systems.cameras.scene import Patch, SceneStyle, Shape
from chamfer.systems.cameras.software_camera import paint_shapes
from chamfer.systems.vision.cross_section import CrossSectionDetector, cross_section
from chamfer.systems.vision.detections import (
    CrossSection,
    Status,
    pack_cross_section,
    unpack_cross_section,
)


def drawn(polygon: np.ndarray, colour: Any = RED) -> np.ndarray:
    shape = Shape(Patch(polygon, np.array(colour, dtype=float)), ())
    return paint_shapes(CameraPlacement().camera, [shape], SceneStyle())


def turned(points: Any, angle: float, centre: tuple[float, float]) -> np.ndarray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.asarray(points, dtype=float) @ np.array([[cos, sin], [-sin, cos]]) + centre


def rectangle(length: float, width: float, angle: float, centre: tuple[float, float]) -> Any:
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * (length / 2, width / 2)
    return turned(corners, angle, centre)


def ellipse(a: float, b: float, angle: float, centre: tuple[float, float]) -> Any:
    t = np.linspace(0, 2 * math.pi, 200, endpoint=False)
    return turned(np.column_stack([a * np.cos(t), b * np.sin(t)]), angle, centre)


angles = st.floats(-1.5, 1.5)
centres = st.tuples(st.floats(100, 220), st.floats(90, 150))


@settings(deadline=None, max_examples=40)
@given(angle=angles, centre=centres, width=st.floats(15, 40))
def test_rectangle(angle: float, centre: tuple[float, float], width: float) -> None:
    length = 1.6 * width + 10
    found = cross_section(drawn(rectangle(length, width, angle, centre)))
    assert found.status is Status.VALID
    np.testing.assert_allclose(found.centroid, centre, atol=0.02)
    assert math.remainder(found.angle - angle, math.pi) == pytest.approx(0, abs=0.002)
    np.testing.assert_allclose(found.edges, np.repeat([length, width], 2) / 2, atol=0.25)
    np.testing.assert_allclose(found.middle, centre, atol=0.2)


@settings(deadline=None, max_examples=20)
@given(angle=angles, centre=centres)
def test_ellipse(angle: float, centre: tuple[float, float]) -> None:
    found = cross_section(drawn(ellipse(40, 22, angle, centre)))
    np.testing.assert_allclose(found.centroid, centre, atol=0.02)
    assert math.remainder(found.angle - angle, math.pi) == pytest.approx(0, abs=0.002)
    np.testing.assert_allclose(found.edges, [40, 40, 22, 22], atol=0.25)
    nearly, longer = (cross_section(drawn(ellipse(a, 30, angle, centre))) for a in (30.4, 31.0))
    assert math.isnan(nearly.angle)
    assert not math.isnan(longer.angle)
    disc = cross_section(drawn(ellipse(30, 30, 0.0, centre)))
    assert math.isnan(disc.angle)
    np.testing.assert_allclose(disc.edges, [30] * 4, atol=0.2)


def test_middle_and_centroid_of_a_lopsided_section_differ() -> None:
    # A trapezoid, 32 px wide at one end and 16 at the other, 60 long: its centroid is 60 / 3
    # (32 + 2 16) / (32 + 16) from the wide end.
    wide = 60 / 3 * 64 / 48
    points = [[-wide, -16], [60 - wide, -8], [60 - wide, 8], [-wide, 16]]
    found = cross_section(drawn(turned(points, 0.3, (160, 120))))
    np.testing.assert_allclose(found.centroid, (160, 120), atol=0.05)
    assert found.angle == pytest.approx(0.3, abs=0.005)
    across = 16 - 8 * wide / 60
    np.testing.assert_allclose(found.edges, [60 - wide, wide, across, across], atol=0.2)
    expected = (30 - wide) * np.array([math.cos(0.3), math.sin(0.3)])
    np.testing.assert_allclose(np.subtract(found.middle, found.centroid), expected, atol=0.2)


def test_a_section_whose_centroid_is_outside_has_no_edges() -> None:
    rim = [(-30, -30), (30, -30), (30, 30), (-30, 30), (-30, 22), (22, 22), (22, -22), (-30, -22)]
    found = cross_section(drawn(turned(rim, 0.2, (160, 120))))
    assert found.status is Status.VALID
    assert np.isnan(found.edges).any()


def test_the_largest_section_is_taken() -> None:
    image = drawn(rectangle(60, 28, 0.0, (100, 100)))
    image[200:212, 200:212] = RED
    np.testing.assert_allclose(cross_section(image).centroid, (100, 100), atol=0.1)


@pytest.mark.parametrize(
    ("image", "status"),
    [
        (np.full((240, 320, 3), 200, np.uint8), Status.NO_COLOUR),
        (drawn(rectangle(14, 12, 0.0, (100, 100))), Status.NO_COLOUR),  # too small
        (drawn(rectangle(60, 28, 0.0, (20, 100))), Status.AT_BORDER),
        (drawn(rectangle(60, 28, 0.0, (160, 230))), Status.AT_BORDER),
        (np.zeros((240, 320, 3), np.uint8), Status.NO_CONTRAST),
    ],
)
def test_why_nothing_is_known(image: np.ndarray, status: Status) -> None:
    found = cross_section(image)
    assert found.status is status
    assert np.isnan([*found.centroid, found.angle, *found.edges]).all()


def test_layout_of_the_vector() -> None:
    section = CrossSection(
        status=Status.VALID, centroid=(1.0, 2.0), angle=0.3, edges=(4.0, 5.0, 6.0, 7.0)
    )
    vector = pack_cross_section(section)
    assert vector.tolist() == [0, 1, 2, 0.3, 4, 5, 6, 7]
    assert unpack_cross_section(tuple(vector.tolist())) == section


def test_block() -> None:
    image = drawn(rectangle(60, 28, 0.2, (150, 110)))
    block = CrossSectionDetector()
    context: Any = block.CreateDefaultContext()
    value = Value(ImageRgba8U(320, 240, 0))
    block.GetInputPort("image").FixValue(context, value)
    output = block.GetOutputPort("cross_section")
    assert unpack_cross_section(output.Eval(context)).status is Status.NO_IMAGE
    write_image(value, image)
    block.GetInputPort("image").FixValue(context, value)
    np.testing.assert_array_equal(
        output.Eval(context), pack_cross_section(cross_section(image)), strict=True
    )
