"""Onset of two-point contact, wedging and the last push that slides: exact limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_limits import (
    Springs,
    largest_tilt,
    sits_on_edge,
    sliding_tilt,
    two_point_onset,
    two_points,
    wedging_tilt,
)
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium

PARTS = PegHoleGeometry(hole_radius=0.0052, peg_radius=0.005, friction=0.3, chamfer_width=0.001)
SUPPORT = Support(lateral_stiffness=521.7, angular_stiffness=1.5, centre_distance=0.04)


def squeeze(parts: PegHoleGeometry, tilt: float) -> float:
    """Return the largest force with which two points can press on each other, at most 1 N.

    Contact forces within their cones that balance each other: a linear program.
    """
    at = two_points(parts, tilt)
    c, s, mu = math.cos(tilt), math.sin(tilt), parts.friction
    columns = []
    for (x, z), normal, along in (
        ((at.mouth.x, at.mouth.z), (-c, s), (s, c)),
        ((at.across.x, at.across.z), (1.0, 0.0), (0.0, 1.0)),
    ):
        for sign in (1.0, -1.0):
            fx, fz = (n + sign * mu * a for n, a in zip(normal, along, strict=True))
            columns.append([fx, fz, float(z) * fx - float(x) * fz])
    found = linprog(
        [-1.0] * 4, A_eq=np.array(columns).T, b_eq=np.zeros(3), bounds=[(0.0, 1.0)] * 4
    )
    assert found.status == 0
    return float(-found.fun)


@pytest.mark.parametrize(
    "parts", [PARTS, PegHoleGeometry(), PegHoleGeometry(friction=0.6, chamfer_width=0.0)]
)
def test_two_points_hold_a_squeezed_peg_from_the_wedging_tilt_on(parts: PegHoleGeometry) -> None:
    limit = wedging_tilt(parts)
    assert limit < parts.mouth_tilt_limit
    assert squeeze(parts, 1.001 * limit) > 0.1
    assert squeeze(parts, 0.999 * limit) == pytest.approx(0.0, abs=1e-9)


def test_without_much_friction_nothing_wedges() -> None:
    slippery = replace(PARTS, friction=0.1)
    assert wedging_tilt(slippery) == slippery.mouth_tilt_limit
    assert squeeze(slippery, 0.9999 * slippery.mouth_tilt_limit) == pytest.approx(0.0, abs=1e-9)


def test_the_exact_wedging_tilt_is_above_that_of_small_angles() -> None:
    """The normal at the mouth tilts with the peg, which makes it harder to hold."""
    assert math.degrees(PARTS.rotation_limit) == pytest.approx(7.64, abs=0.005)
    assert math.degrees(wedging_tilt(PARTS)) == pytest.approx(11.66, abs=0.005)
    slim = replace(PARTS, peg_radius=0.00519)
    assert wedging_tilt(slim) == pytest.approx(slim.rotation_limit, rel=0.02)


@pytest.mark.parametrize(
    ("lateral", "degrees", "onset"),
    [(0.0, 3.0, 7.44), (0.0, 5.0, 4.49), (0.001, 5.0, 4.11), (0.0, 7.0, 3.21), (0.0, 9.0, 2.49)],
)
def test_onsets_of_the_reference(lateral: float, degrees: float, onset: float) -> None:
    """Those that it measured in Drake."""
    found = two_point_onset(PARTS, SUPPORT, lateral, math.radians(degrees))
    assert 1e3 * found == pytest.approx(onset, abs=0.06)


@pytest.mark.parametrize("lateral", [0.0, 0.001, -0.001])
def test_beyond_the_sliding_tilt_no_push_slides_the_peg(lateral: float) -> None:
    limit = largest_tilt(PARTS, Springs.of(SUPPORT), lateral, sliding_tilt(PARTS, SUPPORT))
    depth = np.linspace(0.002, 0.006, 4001)
    for share, stuck in ((0.998, False), (1.002, True)):
        got = equilibrium(PARTS, SUPPORT, lateral, share * limit, depth)
        assert (Contact.STUCK in got.contact.tolist()) == stuck


@settings(max_examples=15, deadline=None)
@given(eps0=st.floats(-0.0011, 0.0011), limit=st.floats(0.03, 0.2))
def test_the_largest_tilt_is_that_whose_onset_is_at_the_limit(eps0: float, limit: float) -> None:
    largest = float(largest_tilt(PARTS, Springs.of(SUPPORT), eps0, limit))
    deepest = float(two_points(PARTS, limit).depth)
    for share, touched in ((0.995, False), (1.005, True)):
        onset = float(two_point_onset(PARTS, SUPPORT, eps0, share * largest))
        assert (onset <= deepest) == touched


@pytest.mark.parametrize(
    ("lateral", "rotation", "expected"),
    [
        (0.002, -0.10, True),  # where the reference's arms are stuck
        (0.004, -0.10, True),
        (0.002, -0.06, True),  # and inserted with 31 N, where planar statics ask for a tenth
        (0.002, -0.02, False),  # the rim comes to rest within the clearance
        (0.002, 0.10, False),  # the chamfer touches the lower side
        (0.0, -0.10, False),
        (0.0003, -0.10, False),  # no chamfer touches
        (-0.002, 0.10, True),
    ],
)
def test_where_a_tilted_rim_may_sit_on_the_edge(
    lateral: float, rotation: float, expected: bool
) -> None:
    assert sits_on_edge(PegHoleGeometry(), lateral, rotation) == expected


def test_a_square_rim_does_not_sit_on_the_edge() -> None:
    errors = 0.004, -0.1
    assert sits_on_edge(PegAndHole(), *errors)
    assert not sits_on_edge(PegAndHole(section="square"), *errors)
