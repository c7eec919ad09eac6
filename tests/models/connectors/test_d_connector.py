"""The D connector: its section, its clearance, and what its insertion takes."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix

from chamfer.models.arms.wrist import WristParams
from chamfer.models.connectors.d_connector import EDGES, DConnector, DSection

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


CLASSES = ("nominal", "worst")
X, Y = 3, 4
MILLI = 1e-3


def normals(section):
    return np.stack([np.cos(section.directions), np.sin(section.directions)], axis=-1)


@pytest.mark.parametrize(
    ("tolerance", "clearance", "tilt"),
    [("nominal", (0.29, 0.23), (0.104, 0.082)), ("worst", (0.165, 0.10), (0.059, 0.036))],
)
def test_clearances_and_tilts_are_those_of_the_table(tolerance, clearance, tilt):
    connector = DConnector(tolerance=tolerance)
    np.testing.assert_allclose(connector.clearance / MILLI, clearance, atol=3e-3)
    # Below it both walls never touch: wedging takes two contacts.
    np.testing.assert_allclose(2 * connector.clearance / connector.travel, tilt, atol=8e-4)


@pytest.mark.parametrize("tolerance", CLASSES)
def test_play_of_the_pieces_is_that_of_the_sections(geometry_of, tolerance):
    connector = DConnector(tolerance=tolerance)
    plug, socket = connector.plug_section, connector.socket_section
    gaps = np.einsum("ij,ij->i", plug.edges[:, 0] - socket.edges[:, 0], normals(plug))
    geometry = geometry_of(connector)
    for angle in np.radians([0, 40, 90, 150, 180, 225, 270, 315]):
        direction = np.array([math.cos(angle), math.sin(angle)])
        # The plug moves against the normal of the wall that meets first.
        along = -normals(plug) @ direction
        expected = min(gap / a for gap, a in zip(gaps, along, strict=True) if a > 1e-9)
        assert geometry.free(RotationMatrix(), 2e-3, direction) == pytest.approx(
            expected, abs=2e-6
        )


@pytest.mark.parametrize(("axis", "tilt"), [(0, 0.05), (0, -0.08), (1, 0.09), (1, -0.13)])
def test_first_contact_of_both_walls_is_where_the_geometry_has_it(geometry_of, axis, tilt):
    connector = DConnector(tolerance="worst")
    depth = two_point_depth(connector, axis, tilt)
    R = RotationMatrix.MakeXRotation(tilt) if axis == 0 else RotationMatrix.MakeYRotation(tilt)
    across = np.eye(2)[1 - axis]
    geometry = geometry_of(connector)

    def fits(at):
        places = np.linspace(-0.5e-3, 0.5e-3, 500)
        return any(
            not geometry.meet(RigidTransform(R, [*(place * across), -at])) for place in places
        )

    assert fits(depth - 0.1e-3)
    assert not fits(depth + 0.1e-3)


def two_point_depth(connector, axis, tilt):
    """Depth at which a tilted plug touches both walls across an axis, m; round rims included."""
    rim, cosine, sine = connector.lead_in, math.cos(tilt), math.sin(abs(tilt))
    plug, socket = connector.plug_section, connector.socket_section
    outer, inner = plug.height / 2, socket.height / 2
    if axis == 1:
        outer, inner = support_of_side(plug), support_of_side(socket)
        sine *= math.cos(connector.side_angle)  # along the normal of the side
    # The plug's rim lies against one wall of the socket, the socket's other rim nears a wall.
    across = cosine * (outer + rim) + sine * rim - inner - rim
    return rim + (outer - rim - cosine * (inner - rim - across)) / sine


def support_of_side(section):
    """Distance of a side from the middle, m."""
    return section.edges[3, 0] @ normals(section)[3]


@pytest.mark.parametrize(("tolerance", "low", "high"), [("nominal", 40, 50), ("worst", 45, 83)])
def test_slow_insertion_takes_the_mating_force_and_no_force_across(insert, tolerance, low, high):
    connector = DConnector(tolerance=tolerance)
    assert low < connector.mating_force < high
    run = insert(connector, [0, 0, 0, 0, 0, -2.3e-3], -6.6e-3, 2.0, hold=0.01)
    assert np.max(run.push) == pytest.approx(connector.mating_force, rel=0.04)
    assert np.max(np.abs(run.wrench[:5])) < 0.02
    slides = (run.depth > 4.6e-3) & (run.depth < 5.2e-3)
    friction = connector.pin_force(run.depth[slides])
    np.testing.assert_allclose(run.push[slides], friction, rtol=0.05)


@pytest.mark.parametrize(("tolerance", "axis"), list(product(CLASSES, (X, Y))))
def test_plug_drops_in_over_clearance_and_lead_ins(insert, tolerance, axis):
    connector = DConnector(tolerance=tolerance)
    # Where the rims' crests would slide off each other but for friction.
    slide = 2 * connector.lead_in * (1 - math.sin(math.atan(connector.material.friction)))
    edge = connector.clearance[axis - X] + slide
    soft = WristParams(stiffness=(20.0, 20.0, 20.0, 2e3, 2e3, 2e4))
    depths = []
    for offset in (edge - 0.1e-3, edge + 0.2e-3):
        start = np.array([0, 0, 0, 0, 0, 0.2e-3])
        start[axis] = offset
        depths.append(insert(connector, start, -1.2e-3, 0.2, wrist=soft).depth[-1])
    assert depths[0] > 1e-3
    assert depths[1] < 0.5e-3


@pytest.mark.parametrize("tolerance", CLASSES)
@pytest.mark.parametrize(
    "error", [(0.01, 0.02, 0.01, 0.4e-3, 0.3e-3), (-0.02, -0.01, -0.02, -0.3e-3, 0.2e-3)]
)
def test_wrist_lets_a_plug_in_that_is_a_little_tilted_and_beside(insert, tolerance, error):
    connector = DConnector(tolerance=tolerance)
    run = insert(connector, [*error, 0.5e-3], -8e-3, 0.8)
    assert run.depth[-1] == pytest.approx(connector.mated_depth, abs=0.1e-3)
    assert np.max(run.push) < 1.5 * connector.mating_force
