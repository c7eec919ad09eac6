"""The limits to wedging, sliding and jamming, against friction cones and statics; blind feeds."""

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

from chamfer.models.peg.peg_and_hole import PegAndHole, PegHoleGeometry
from chamfer.models.peg.support import Support, in_series
from chamfer.models.peg_theory.fed_insertion import FeedVerdict, largest_push, limits, predict_feed
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium
from chamfer.models.peg_theory.wedging import (
    assembles,
    box_margin,
    chamfer_needed,
    jamming_level,
    jamming_vertices,
    largest_tilt,
    least_margin,
    require_stiff,
    rotation_bounds,
    rotation_margin,
    sits_on_edge,
    sliding_bounds,
    sliding_tilt,
    two_point_onset,
    two_points,
    wedges,
    wedging_bounds,
    wedging_tilt,
)
from chamfer.models.validation import ParameterError

Held = tuple[PegHoleGeometry, Support]

PAPER: Held = (PegHoleGeometry(), Support())
# Every number differs from the paper's, so that no two can be mixed up unseen.
OTHER: Held = (
    PegHoleGeometry(
        hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.003, chamfer_angle=0.9
    ),
    Support(lateral_stiffness=900.0, angular_stiffness=7.0, centre_distance=0.06),
)

holdings = st.builds(
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
errors = st.floats(-0.02, 0.02)
tilts = st.floats(-0.2, 0.2)


def test_chamfers_for_the_published_errors() -> None:
    needed = chamfer_needed(PAPER[0], [0.0025, -0.0032, 0.0001, 0.019814])
    np.testing.assert_allclose(needed, [0.002244, 0.002944, 0.0, 0.019558], atol=1e-12)


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


@pytest.mark.parametrize("form", ["exact", "simple"])
@settings(deadline=None, max_examples=15)
@given(held=holdings, eps0=errors, theta0=tilts)
def test_mirroring(form: Any, held: Held, eps0: float, theta0: float) -> None:
    there, mirrored = (
        rotation_margin(*held, sign * eps0, sign * theta0, form) for sign in (1, -1)
    )
    assert there == mirrored
    assert wedges(*held, eps0, theta0) == wedges(*held, -eps0, -theta0)


@pytest.mark.parametrize("form", ["simple", "exact"])
def test_no_compliance_centre_leaves_less_than_the_least_margin(form: Any) -> None:
    parts, support = PAPER
    lateral, rotation = 0.0032, 0.040
    least, at = least_margin(parts, support, lateral, rotation, form)
    assert least_margin(parts, support, -lateral, -rotation, form) == pytest.approx((least, at))
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


def contact_forces(places: list[tuple[float, float, float]], mu: float, load: Array) -> Any:
    """Balance a load by forces at places (x, z, direction of the normal along x).

    Unknown are a normal and a tangential force a place. ``load`` is F_x, F_z (up) and the moment
    about the origin, counter-clockwise.
    """
    balance, cones = [], []
    for i, (x, z, n) in enumerate(places):
        balance += [(n, 0.0, -z * n), (0.0, 1.0, x)]
        for sign in (1.0, -1.0):
            row = np.zeros(2 * len(places))
            row[2 * i], row[2 * i + 1] = -mu, sign
            cones.append(row)
    bounds = [(0.0, None), (None, None)] * len(places)
    return linprog(
        np.zeros(2 * len(places)),
        A_ub=np.array(cones),
        b_ub=np.zeros(len(cones)),
        A_eq=np.array(balance).T,
        b_eq=-load,
        bounds=bounds,
    )


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
        (PAPER[0], 1.0),
        (OTHER[0], 1.3),
        (PAPER[0], 4.0),
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
    said = jamming_level(parts, loads[:, 0], loads[:, 1], depth) >= 1
    held = [held_by_contacts(parts, (load[0], load[1]), depth) for load in loads]
    np.testing.assert_array_equal(said, held)
    assert 10 < np.sum(said) < len(loads) - 10


@pytest.mark.parametrize("depth", [0.0, -0.01, math.nan, math.inf])
def test_jamming_needs_a_depth(depth: float) -> None:
    message = re.escape(f"depth is {depth!r}, allowed: finite numbers > 0")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        jamming_level(PAPER[0], 0.0, 0.0, depth)


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
    limit = largest_tilt(PARTS, SUPPORT, lateral, sliding_tilt(PARTS, SUPPORT))
    depth = np.linspace(0.002, 0.006, 4001)
    for share, stuck in ((0.998, False), (1.002, True)):
        got = equilibrium(PARTS, SUPPORT, lateral, share * limit, depth)
        assert (Contact.STUCK in got.contact.tolist()) == stuck


@settings(max_examples=15, deadline=None)
@given(eps0=st.floats(-0.0011, 0.0011), theta0=st.floats(-0.11, 0.11))
def test_onset_is_where_two_points_touch_first(eps0: float, theta0: float) -> None:
    onset = float(two_point_onset(PARTS, SUPPORT, eps0, theta0))
    if math.isnan(onset) or onset > 0.05:
        return
    around = onset + np.array([-2e-5, 2e-5])
    before, after = equilibrium(PARTS, SUPPORT, eps0, theta0, around).contact.tolist()
    assert before not in (Contact.TWO_POINT, Contact.STUCK)
    assert after in (Contact.TWO_POINT, Contact.STUCK)


@settings(max_examples=15, deadline=None)
@given(eps0=st.floats(-0.0011, 0.0011), limit=st.floats(0.03, 0.2))
def test_the_largest_tilt_is_that_whose_onset_is_at_the_limit(eps0: float, limit: float) -> None:
    largest = float(largest_tilt(PARTS, SUPPORT, eps0, limit))
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
    assert sits_on_edge(PegAndHole(), lateral, rotation) == expected
    assert not sits_on_edge(PegAndHole(section="square"), lateral, rotation)


ARM = Support(lateral_stiffness=400.0, angular_stiffness=5.0, centre_distance=0.0)
DEPTH = 0.04


def support_at(depth: float) -> Support:
    return in_series(ARM, ARM, depth)


def plenty(depth: Array) -> Array:
    return np.full_like(depth, 100.0)


STARTS = (
    (0.0, 0.0, FeedVerdict.SAFE),
    (0.002, 0.03, FeedVerdict.SAFE),
    (-0.002, -0.03, FeedVerdict.SAFE),
    (0.0042, 0.0, FeedVerdict.SAFE),  # the chamfers reach 4.256 mm
    (0.0043, 0.0, FeedVerdict.STOPPED),
    (-0.0043, 0.0, FeedVerdict.STOPPED),
    (0.0043, 0.12, FeedVerdict.MAY),  # a tilted tip is narrower; and it may wedge
    (0.00433, 0.12, FeedVerdict.STOPPED),  # by 0.056 mm
    (0.0, 0.07, FeedVerdict.MAY),  # beyond the limit to wedging
    (0.002, -0.05, FeedVerdict.MAY),  # inside it, but the rim may sit on the edge
    (0.002, 0.05, FeedVerdict.SAFE),
)


def test_what_theory_says() -> None:
    lateral, tilt, expected = zip(*STARTS, strict=True)
    found = predict_feed(PAPER[0], support_at, plenty, lateral, tilt, depth=DEPTH)
    assert found.verdict.tolist() == list(expected)
    assert limits(PAPER[0], support_at, lateral, tilt).verdict.tolist() == list(expected)


def test_the_largest_push_is_that_of_the_statics_at_a_few_depths() -> None:
    parts, errors = PAPER[0], (np.array([0.001, 0.003]), np.array([0.05, -0.04]))
    forces = [
        equilibrium(parts, support_at(tip), *errors, tip - parts.chamfer_height).insertion_force
        for tip in (DEPTH / 2, DEPTH)
    ]
    found = largest_push(parts, support_at, *errors, depth=DEPTH, looks=3)
    assert found == pytest.approx(np.maximum(*forces))


@pytest.mark.slow
def test_the_limit_to_wedging_is_that_of_the_support_at_the_wedging_depth() -> None:
    support = support_at(PAPER[0].wedging_depth + PAPER[0].chamfer_height)
    _, upper = rotation_bounds(PAPER[0], support, 0.001)
    tilt = float(upper) + np.array([-1e-4, 1e-4])
    found = predict_feed(PAPER[0], support_at, plenty, 0.001, tilt, depth=DEPTH)
    assert found.verdict.tolist() == [FeedVerdict.SAFE, FeedVerdict.MAY]
    assert found.may_wedge.tolist() == [False, True]


@pytest.mark.slow
def test_a_push_that_is_too_weak_stops_the_feed() -> None:
    at = PAPER[0], support_at, 0.001, 0.05
    axial = float(predict_feed(*at[:2], plenty, *at[2:], depth=DEPTH).axial)
    assert axial == pytest.approx(float(largest_push(*at, depth=DEPTH)), rel=1e-3)

    def weak(depth: Array) -> Array:
        return np.full_like(depth, 0.99 * axial)

    found = predict_feed(*at[:2], weak, *at[2:], depth=DEPTH)
    assert found.verdict == FeedVerdict.STOPPED


@pytest.mark.slow
def test_two_points_touch_where_the_support_of_that_depth_says_so() -> None:
    lateral, tilt = np.array([0.0, 0.002, 0.0]), np.array([0.05, 0.03, 0.0])
    found = predict_feed(PAPER[0], support_at, plenty, lateral, tilt, depth=DEPTH)
    for k in range(2):
        support = support_at(float(found.onset[k]) + PAPER[0].chamfer_height)
        again = two_point_onset(PAPER[0], support, lateral[k], tilt[k])
        assert found.onset[k] == pytest.approx(float(again), abs=3e-5)
    assert np.isnan(found.onset[2])
