import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.connectors.d_section import EDGES, DSection
from chamfer.models.validation import ParameterError

SOCKET = {
    "width": 38.38e-3,
    "height": 7.9e-3,
    "corner_radius": 2.59e-3,
    "side_angle": math.radians(10),
}

sections = st.builds(
    DSection,
    width=st.floats(0.03, 0.05),
    height=st.floats(6e-3, 1e-2),
    corner_radius=st.floats(1e-3, 2.9e-3),
    side_angle=st.floats(0, 0.5),
)


def outline(section):
    return np.vstack([section.arc(corner, 300) for corner in EDGES])


@given(sections)
def test_outline_has_the_width_and_height_over_all(section):
    extent = np.ptp(outline(section), axis=0)
    np.testing.assert_allclose(extent, [section.width, section.height], rtol=1e-6)


@given(sections)
def test_arcs_join_the_edges_without_a_corner(section):
    for corner in EDGES:
        arc = section.arc(corner, 3)
        np.testing.assert_allclose(arc[0], section.edges[corner - 1, 1], atol=1e-12)
        np.testing.assert_allclose(arc[-1], section.edges[corner, 0], atol=1e-12)


@given(sections)
def test_every_edge_bounds_the_whole_section(section):
    points = outline(section)
    for edge, direction in zip(section.edges, section.directions, strict=True):
        normal = np.array([math.cos(direction), math.sin(direction)])
        assert np.max(points @ normal) == pytest.approx(edge[0] @ normal, abs=1e-12)
        assert edge[1] @ normal == pytest.approx(edge[0] @ normal, abs=1e-12)


def test_sides_lean_by_their_angle_and_the_wide_edge_is_on_the_side_of_y():
    wide, left, narrow, right = DSection(**SOCKET).edges
    slope = left[1] - left[0]
    assert math.atan2(slope[0], -slope[1]) == pytest.approx(math.radians(10))
    np.testing.assert_allclose(right, left[::-1] * [-1, 1], atol=1e-15)
    assert wide[0, 1] == pytest.approx(3.95e-3)
    assert narrow[0, 1] == pytest.approx(-3.95e-3)
    assert np.ptp(wide[:, 0]) > np.ptp(narrow[:, 0])


@given(sections, st.floats(-5e-4, 5e-4))
def test_grown_moves_every_edge_out(section, by):
    grown = section.grown(by)
    for before, after, direction in zip(
        section.edges, grown.edges, section.directions, strict=True
    ):
        normal = np.array([math.cos(direction), math.sin(direction)])
        np.testing.assert_allclose(after - before, by * np.tile(normal, (2, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [("width", 5e-3), ("height", 5e-3), ("corner_radius", math.nan), ("side_angle", -0.1)],
)
def test_impossible_sections_are_refused(name, value):
    with pytest.raises(ParameterError):
        DSection(**(SOCKET | {name: value}))
