"""Force and tilt on the way into the hole."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.insertion_statics import (
    MOUTH_LEFT,
    MOUTH_RIGHT,
    TIP_LEFT,
    TIP_RIGHT,
    bore_contact,
    chamfer_depth,
    cross_chamfer,
    enters,
    two_point_onset,
)
from chamfer.models.peg_theory.planar_statics import Contact
from chamfer.models.peg_theory.wedging import (
    assembles,
    box_margin,
    chamfer_needed,
    jamming_vertices,
    jams,
    least_margin,
    require_stiff,
    rotation_bounds,
    rotation_margin,
    sliding_bounds,
    wedges,
    wedging_bounds,
)
from chamfer.models.validation import ParameterError

Held = tuple[PegHoleGeometry, Support]

PAPER: Held = (PegHoleGeometry(), Support())
OTHER: Held = (
    PegHoleGeometry(
        hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.003, chamfer_angle=0.9
    ),
    Support(lateral_stiffness=900.0, angular_stiffness=7.0, centre_distance=0.06),
)
START = (0.003, 0.022)  # of the worked example

holdings = st.builds(
    lambda clearance, friction, K_x, K_theta, L_g: (
        PegHoleGeometry(peg_radius=PegHoleGeometry.hole_radius - clearance, friction=friction),
        Support(lateral_stiffness=K_x, angular_stiffness=K_theta, centre_distance=L_g),
    ),
    st.floats(1e-4, 5e-4),
    st.floats(0.05, 1.0),
    st.floats(50.0, 5e3),
    st.floats(2.0, 100.0),
    st.floats(0.0, 0.5),
)
errors = st.floats(-0.008, 0.008)
tilts = st.floats(-0.1, 0.1)
depths = st.floats(0.0, 0.08)


# The worked example.


def test_worked_example() -> None:
    end = cross_chamfer(*PAPER, *START, chamfer_depth(PAPER[0], START[0]))
    assert end.insertion_force == pytest.approx(1.82, abs=0.005)
    assert end.insertion_force / end.lateral_force == pytest.approx(2.64, abs=0.005)
    at_mouth = bore_contact(*PAPER, *START, 0.0)
    assert at_mouth.insertion_force == pytest.approx(0.28, abs=0.001)
    onset = two_point_onset(*PAPER, *START)
    assert onset == pytest.approx(0.0147, abs=5e-5)
    depth = np.linspace(0.0, 0.06, 6001)
    force = bore_contact(*PAPER, *START, depth).insertion_force
    assert force.max() == pytest.approx(4.4, abs=0.01)
    assert depth[force.argmax()] == pytest.approx(0.0274, abs=1e-4)


def test_which_side_touches() -> None:
    cases = {
        (0.003, 0.022): (Contact.MOUTH, [MOUTH_RIGHT]),
        (-0.003, -0.022): (Contact.MOUTH, [MOUTH_LEFT]),
        (0.003, -0.06): (Contact.TIP, [TIP_RIGHT]),
        (-0.003, 0.06): (Contact.TIP, [TIP_LEFT]),
        (0.0001, 0.001): (Contact.NONE, []),
        (0.003, -0.0117): (Contact.ALONG_WALL, [MOUTH_RIGHT, TIP_RIGHT]),
        (-0.003, 0.0117): (Contact.ALONG_WALL, [MOUTH_LEFT, TIP_LEFT]),
    }
    for start, (contact, pressed) in cases.items():
        got = bore_contact(*PAPER, *start, 0.005)
        assert got.contact == contact, start
        assert np.flatnonzero(got.normal_forces).tolist() == pressed
    deep = bore_contact(*PAPER, [0.003, -0.003], [0.022, -0.022], 0.03)
    np.testing.assert_array_equal(deep.normal_forces[0] > 0, [True, False, False, True])
    np.testing.assert_array_equal(deep.normal_forces[1] > 0, [False, True, True, False])


def test_a_peg_along_the_wall_is_upright_and_in_balance() -> None:
    eps0, theta0, depth = 0.003, -0.0117, 0.005
    got = bore_contact(*PAPER, eps0, theta0, depth)
    assert got.contact == Contact.ALONG_WALL
    assert got.tilt == pytest.approx(0.0, abs=1e-12)
    assert got.tip == pytest.approx(PAPER[0].clearance)
    centre_moved = eps0 + 0.1 * theta0 - PAPER[0].clearance
    push = got.normal_forces[MOUTH_RIGHT] + got.normal_forces[TIP_RIGHT]
    assert push == pytest.approx(400 * centre_moved)
    friction = 0.45 * push * PAPER[0].peg_radius
    turning = 0.095 * got.normal_forces[MOUTH_RIGHT] + 0.1 * got.normal_forces[TIP_RIGHT]
    assert turning - friction == pytest.approx(-5.0 * theta0)


@given(held=holdings, eps0=errors, theta0=tilts, depth=depths)
def test_every_state_is_in_balance_and_in_the_hole(
    held: Held, eps0: float, theta0: float, depth: float
) -> None:
    parts, support = held
    got = bore_contact(*held, eps0, theta0, depth)
    assert np.all(got.normal_forces >= -1e-7)
    at_mouth = got.tip + depth * got.tilt
    room = parts.clearance * (1 + 1e-6) + 1e-12
    assert abs(got.tip) <= room
    assert abs(at_mouth) <= room
    gaps = parts.clearance - np.array([at_mouth, -at_mouth, got.tip, -got.tip])
    pressed = got.normal_forces > 1e-6
    np.testing.assert_allclose(gaps[pressed], 0.0, atol=1e-9)
    sides = np.array([-1.0, 1.0, -1.0, 1.0])
    arms = support.centre_distance - np.array([depth, depth, 0.0, 0.0]) - parts.friction_radius
    centre_moved = got.tip - eps0 + support.centre_distance * (got.tilt - theta0)
    total = got.normal_forces.sum()
    assert sides @ got.normal_forces == pytest.approx(
        support.lateral_stiffness * centre_moved, abs=1e-6 * (1 + total)
    )
    assert -sides * arms @ got.normal_forces == pytest.approx(
        support.angular_stiffness * (got.tilt - theta0), abs=1e-6 * (1 + total)
    )
    assert got.insertion_force == pytest.approx(parts.friction * total)


# Onset of two-point contact and the wedging diagram.


@given(held=holdings, eps0=errors, theta0=tilts)
def test_onset_is_where_two_points_touch_first(held: Held, eps0: float, theta0: float) -> None:
    parts, _ = held
    onset = float(two_point_onset(*held, eps0, theta0))
    end = 0.2 if math.isnan(onset) else min(onset, 0.2)
    before = bore_contact(*held, eps0, theta0, np.linspace(0.0, end, 200)[:-1])
    assert Contact.TWO_POINT not in before.contact.tolist()
    if onset < 1.0:  # m, deeper ones are rounding
        at = bore_contact(*held, eps0, theta0, onset)
        assert onset * abs(at.tilt) == pytest.approx(2 * parts.clearance, rel=1e-6)
        assert at.tip + np.sign(at.tilt) * parts.clearance == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("held", [PAPER, OTHER])
@pytest.mark.parametrize("step", [-1e-18, 0.0, 1e-18])
def test_onset_of_a_peg_whose_tip_is_on_the_wall_from_the_start(held: Held, step: float) -> None:
    parts, _ = held
    eps0, theta0 = parts.clearance + step, -0.03
    expected = 2 * parts.clearance / 0.03
    assert two_point_onset(*held, eps0, theta0) == pytest.approx(expected, rel=1e-6)
    assert two_point_onset(*held, -eps0, -theta0) == pytest.approx(expected, rel=1e-6)


# The chamfer.


@pytest.mark.parametrize("held", [PAPER, OTHER])
@pytest.mark.parametrize("start", [(0.0031, 0.01), (-0.0031, 0.01), (0.002, -0.05)])
def test_chamfer_crossing_is_in_balance(held: Held, start: tuple[float, float]) -> None:
    parts, support = held
    eps0, theta0 = start
    z = 0.4 * float(chamfer_depth(parts, eps0))
    got = cross_chamfer(*held, eps0, theta0, z)
    side = math.copysign(1.0, eps0)
    slope = np.array([-side * math.cos(parts.chamfer_angle), -math.sin(parts.chamfer_angle)])
    normal = np.array([-side * math.sin(parts.chamfer_angle), math.cos(parts.chamfer_angle)])
    force = normal - parts.friction * slope  # friction is against the sliding down the slope
    force *= got.insertion_force / force[1]
    assert got.lateral_force == pytest.approx(-side * force[0])
    turned = got.tilt - theta0
    arm = np.array([side * parts.peg_radius, -support.centre_distance])
    moment = arm[1] * force[0] - arm[0] * force[1]
    assert moment == pytest.approx(support.angular_stiffness * turned)
    tip_moved = -side * z / math.tan(parts.chamfer_angle)
    centre_moved = tip_moved + support.centre_distance * turned
    assert force[0] == pytest.approx(support.lateral_stiffness * centre_moved)


def test_the_chamfer_ends_where_the_tip_is_in_the_hole() -> None:
    end = chamfer_depth(OTHER[0], [-0.0013, 0.0013, 0.0002])
    np.testing.assert_allclose(end, [0.001 * math.tan(0.9)] * 2 + [0.0])
    got = cross_chamfer(*OTHER, 0.0013, 0.01, [-1e-9, 0.0, end[0], end[0] + 1e-9])
    np.testing.assert_array_equal(np.isnan(got.insertion_force), [True, False, False, True])
    np.testing.assert_array_equal(np.isnan(got.tilt), [True, False, False, True])
    assert got.insertion_force[1] == 0.0
    assert got.tilt[1] == 0.01


@pytest.mark.parametrize(
    "parts",
    [
        PegHoleGeometry(friction=1.0, chamfer_angle=math.pi / 4 - 1e-9),
        PegHoleGeometry(friction=0.95),  # slides, but turns out of the way
    ],
)
def test_a_chamfer_that_the_peg_sticks_to(parts: PegHoleGeometry) -> None:
    message = (
        f"chamfer_angle is {parts.chamfer_angle!r}, allowed: steeper, or with less friction: "
        "the peg sticks to the chamfer"
    )
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        cross_chamfer(parts, Support(), 0.003, 0.0, 0.001)


def test_entry_needs_a_chamfer_and_an_upright_peg() -> None:
    widest = OTHER[0].chamfer_limit
    got = enters(*OTHER, [widest - 1e-9, widest + 1e-9, -widest + 1e-9, -widest - 1e-9], 0.0)
    np.testing.assert_array_equal(got, [True, False, True, False])
    limit = OTHER[0].mouth_tilt_limit
    np.testing.assert_array_equal(
        enters(*OTHER, 0.0, [limit - 1e-9, limit + 1e-9, -limit + 1e-9, -limit - 1e-9]),
        [True, False, True, False],
    )
    # The chamfer tilts a peg further, or upright.
    assert not enters(*OTHER, 0.003, limit - 1e-3)
    assert enters(*OTHER, -0.003, limit - 1e-3)


@pytest.mark.parametrize("depth", [-1e-9, math.nan, math.inf])
def test_depth_in_the_bore(depth: float) -> None:
    message = re.escape(f"depth is {depth!r}, allowed: finite numbers >= 0")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        bore_contact(*PAPER, 0.0, 0.0, depth)


# Every number differs from the paper's, so that no two can be mixed up unseen.

thin_holdings = st.builds(
    lambda clearance, friction, K_x, K_theta, L_g: (
        PegHoleGeometry(peg_radius=PegHoleGeometry.hole_radius - clearance, friction=friction),
        Support(lateral_stiffness=K_x, angular_stiffness=K_theta, centre_distance=L_g),
    ),
    st.floats(1e-5, 5e-4),
    st.floats(0.05, 1.0),
    st.floats(50.0, 5e3),
    st.floats(2.0, 100.0),
    st.floats(0.0, 0.5),
)
wide_errors = st.floats(-0.02, 0.02)
wide_tilts = st.floats(-0.2, 0.2)


def test_chamfers_for_the_published_errors() -> None:
    needed = chamfer_needed(PAPER[0], [0.0025, -0.0032, 0.0001, 0.019814])
    np.testing.assert_allclose(needed, [0.002244, 0.002944, 0.0, 0.019558], atol=1e-12)


# The worst published pair, its errors of one sign.


def test_margins_to_the_box_are_those_of_section_5() -> None:
    lateral, rotation = box_margin(PAPER[0], [0.0032, -0.0032], [-0.040, 0.040])
    np.testing.assert_allclose(100 * lateral, 83.85, atol=0.005)
    np.testing.assert_allclose(100 * rotation, 31.24, atol=0.005)


def test_margin_to_the_parallelogram_at_the_worst_compliance_centre() -> None:
    parts, support = PAPER
    worst = replace(support, centre_distance=support.worst_centre_distance)
    margin = rotation_margin(parts, worst, 0.0032, 0.040, "simple")
    used = (1 - margin) * parts.rotation_limit
    assert used == pytest.approx(0.0532, abs=5e-5)
    assert 100 * margin == pytest.approx(8.6, abs=0.05)
    assert 100 * rotation_margin(parts, worst, 0.0032, 0.040) == pytest.approx(12.69, abs=0.01)


# The sides of the diagram.


def test_simple_sides_begin_at_the_clearance() -> None:
    S = 0.06 / (0.06**2 + 7.0 / 900.0)
    lower, upper = rotation_bounds(*OTHER, [-0.0003, 0.0, 0.0003, 0.0013, -0.0013], "simple")
    limit = OTHER[0].rotation_limit
    expected = limit + S * np.array([0.0, 0.0, 0.0, -0.001, 0.001])
    np.testing.assert_allclose(upper, expected, rtol=1e-12)
    np.testing.assert_allclose(lower, expected - 2 * limit, rtol=1e-12)


def test_both_forms_agree_for_thin_clearances() -> None:
    parts, support = OTHER
    tight = replace(parts, peg_radius=parts.hole_radius - 2e-6, chamfer_width=0.0)
    eps0 = np.linspace(-1e-5, 1e-5, 7)
    for got, expected in zip(
        wedging_bounds(tight, support, eps0),
        wedging_bounds(tight, support, eps0, "simple"),
        strict=True,
    ):
        np.testing.assert_allclose(got, expected, rtol=0.1)


def test_the_exact_region_is_free_of_wedging_and_slides() -> None:
    parts = PegHoleGeometry(
        hole_radius=0.0052, peg_radius=0.005, friction=0.3, chamfer_width=0.001
    )
    support = Support(lateral_stiffness=521.7, angular_stiffness=1.5, centre_distance=0.04)
    lower, upper = rotation_bounds(parts, support, [0.0, 0.001])
    np.testing.assert_allclose(np.degrees(upper), [6.85, 6.37], atol=0.01)
    np.testing.assert_array_equal((lower, upper), sliding_bounds(parts, support, [0.0, 0.001]))
    assert not wedges(parts, support, 0.0, np.radians(9.0))
    assert wedges(parts, support, 0.0, np.radians(12.0))
    got = assembles(parts, support, [0.0, 0.0, 0.00119, 0.00121], np.radians([6.8, 6.9, 0, 0]))
    np.testing.assert_array_equal(got, [True, False, True, False])


@settings(deadline=None, max_examples=20)
@given(held=thin_holdings, eps0=wide_errors)
def test_aligned_rotation_is_free_and_far_rotation_is_not(held: Held, eps0: float) -> None:
    lower, upper = wedging_bounds(*held, eps0)
    assert lower < upper
    assert not wedges(*held, eps0, (lower + upper) / 2)
    assert wedges(*held, eps0, upper)  # the boundary wedges
    assert wedges(*held, eps0, lower)


@settings(deadline=None, max_examples=20)
@given(held=thin_holdings, eps0=wide_errors, theta0=wide_tilts)
def test_the_margin_says_on_which_side(held: Held, eps0: float, theta0: float) -> None:
    lower, upper = rotation_bounds(*held, eps0)
    margin = rotation_margin(*held, eps0, theta0) * held[0].rotation_limit
    assert margin == pytest.approx(min(upper - theta0, theta0 - lower), rel=1e-9, abs=1e-15)


@pytest.mark.parametrize("form", ["simple", "exact"])
def test_no_compliance_centre_leaves_less_than_the_least_margin(form: Any) -> None:
    parts, support = PAPER
    lateral, rotation = 0.0032, 0.040
    least, at = least_margin(parts, support, lateral, rotation, form)
    for distance in np.linspace(0.0, 1.0, 51).tolist():
        there = replace(support, centre_distance=distance)
        _, upper = wedging_bounds(parts, there, lateral, form)
        assert (upper - rotation) / parts.rotation_limit >= least - 1e-7
    _, upper = wedging_bounds(parts, replace(support, centre_distance=at), lateral, form)
    assert (upper - rotation) / parts.rotation_limit == pytest.approx(least)
    if form == "simple":
        assert at == pytest.approx(math.sqrt(5 / 400), rel=1e-2)


def test_a_support_that_friction_turns_over_is_refused() -> None:
    message = re.escape(
        "support.angular_stiffness is 0.017, allowed: > 0.0174284 = K_x (3 mu r / 2)^2, softer "
        "supports turn over in contact"
    )
    with pytest.raises(ParameterError, match=f"^{message}$"):
        require_stiff(PegHoleGeometry(), Support(angular_stiffness=0.017))
    require_stiff(PegHoleGeometry(), Support(angular_stiffness=0.018))


Array = NDArray[np.float64]
PAPER_PARTS = PegHoleGeometry()
OTHER_PARTS = PegHoleGeometry(
    hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.003, chamfer_angle=0.9
)


def contact_forces(
    places: list[tuple[float, float, float]], mu: float, load: Array, squeeze: float = 0.0
) -> Any:
    """Balance a load by forces at places (x, z, direction of the normal along x).

    Unknown are a normal and a tangential force a place; the first normal force is made as large
    as allowed. ``load`` is F_x, F_z (up) and the moment about the origin, counter-clockwise.
    """
    balance, cones = [], []
    for i, (x, z, n) in enumerate(places):
        balance += [(n, 0.0, -z * n), (0.0, 1.0, x)]
        for sign in (1.0, -1.0):
            row = np.zeros(2 * len(places))
            row[2 * i], row[2 * i + 1] = -mu, sign
            cones.append(row)
    bounds = [(0.0, squeeze or None), (None, None)] * len(places)
    goal = np.zeros(2 * len(places))
    goal[0] = -1.0 if squeeze else 0.0
    return linprog(
        goal,
        A_ub=np.array(cones),
        b_ub=np.zeros(len(cones)),
        A_eq=np.array(balance).T,
        b_eq=-load,
        bounds=bounds,
    )


@pytest.mark.parametrize("parts", [PAPER_PARTS, OTHER_PARTS])
def test_two_points_hold_a_squeezed_peg_above_the_wedging_depth_only(
    parts: PegHoleGeometry,
) -> None:
    """Without any load they can press on each other, that is what a wedge is."""
    for ratio, held in ((0.2, True), (0.9, True), (0.999, True), (1.001, False), (2.0, False)):
        depth = ratio * parts.wedging_depth
        mouth_right = (parts.peg_radius, depth, -1.0)
        tip_left = (-parts.peg_radius, 0.0, 1.0)
        found = contact_forces([mouth_right, tip_left], parts.friction, np.zeros(3), squeeze=1.0)
        assert found.status == 0
        assert -found.fun == pytest.approx(1.0 if held else 0.0, abs=1e-9)


def held_by_contacts(parts: PegHoleGeometry, load: tuple[float, float], depth: float) -> bool:
    """Whether one pair of places at a time can hold a load F_x / F_z and M / (r F_z)."""
    r = parts.peg_radius
    mouth = [(r, depth, -1.0), (-r, depth, 1.0)]
    tip = [(r, 0.0, -1.0), (-r, 0.0, 1.0)]
    applied = np.array([load[0], -1.0, r * load[1]])
    return any(
        contact_forces([one, other], parts.friction, applied).status == 0
        for one in mouth
        for other in tip
    )


@pytest.mark.parametrize(
    ("parts", "ratio"),
    [
        (PAPER_PARTS, 1.0),
        (OTHER_PARTS, 1.3),
        (PAPER_PARTS, 4.0),
    ],
)
def test_jamming_diagram(parts: PegHoleGeometry, ratio: float) -> None:
    depth = ratio * parts.wedging_depth
    rng = np.random.default_rng(7)
    across = rng.uniform(-1.5, 1.5, 60) / parts.friction
    turned = rng.uniform(-1.4, 1.4, 60) * (2 * ratio + 1)
    # And close to the sides, on both of them.
    corners = jamming_vertices(parts, depth)
    sides = (corners + np.roll(corners, -1, axis=0)) / 2
    near = np.concatenate([0.99 * sides, 1.01 * sides, 0.99 * corners, 1.01 * corners])
    loads = np.concatenate([np.column_stack([across, turned]), near])
    said = jams(parts, loads[:, 0], loads[:, 1], depth)
    held = [held_by_contacts(parts, (load[0], load[1]), depth) for load in loads]
    np.testing.assert_array_equal(said, held)
    assert 10 < np.sum(said) < len(loads) - 10


def test_jamming_vertices_are_the_corners_of_the_loads_that_slide() -> None:
    depth = 1.7 * OTHER_PARTS.wedging_depth
    corners = jamming_vertices(OTHER_PARTS, depth)
    expected = [[-1 / 0.3, 4.4], [-1 / 0.3, 1.0], [1 / 0.3, -4.4], [1 / 0.3, -1.0]]
    np.testing.assert_allclose(corners, expected, rtol=1e-12)
    np.testing.assert_array_equal(jams(OTHER_PARTS, *(0.999 * corners).T, depth), [False] * 4)
    np.testing.assert_array_equal(jams(OTHER_PARTS, *(1.001 * corners).T, depth), [True] * 4)
    # Counter-clockwise.
    following = np.roll(corners, -1, axis=0)
    area = np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]) / 2
    assert area == pytest.approx(2 / 0.3 * 2 * 1.7)


@pytest.mark.parametrize("depth", [0.0, -0.01, math.nan, math.inf])
def test_jamming_needs_a_depth(depth: float) -> None:
    message = re.escape(f"depth is {depth!r}, allowed: finite numbers > 0")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        jams(PAPER_PARTS, 0.0, 0.0, depth)
    with pytest.raises(ParameterError, match=f"^{message}$"):
        jamming_vertices(PAPER_PARTS, depth)
