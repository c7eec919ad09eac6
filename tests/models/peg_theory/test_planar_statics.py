"""Exact statics of an insertion against a balance of forces and moments found by itself."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog, root

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg.support import Support, in_series
from chamfer.models.peg_theory.fed_insertion import Verdict, limits, predict_feed
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
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]
Held = tuple[PegHoleGeometry, Support]

PAPER: Held = (PegHoleGeometry(), Support())
OTHER: Held = (
    PegHoleGeometry(
        hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.003, chamfer_angle=0.9
    ),
    Support(lateral_stiffness=900.0, angular_stiffness=7.0, centre_distance=0.06),
)
# The reference's single peg on a spring, its chamfer on the hole alone.
SPRUNG: Held = (
    PegHoleGeometry(hole_radius=0.0052, peg_radius=0.005, friction=0.3, chamfer_width=0.001),
    Support(lateral_stiffness=521.7, angular_stiffness=1.5, centre_distance=0.04),
)
MOUTH_RIGHT, MOUTH_LEFT, TIP_RIGHT, TIP_LEFT = range(4)


def balanced(
    held: Held, start: tuple[float, float], depth: float, pressed: list[int]
) -> tuple[float, float, float]:
    """Return the push, the force across and the tilt at which the peg is in balance.

    Six equations for what is not known, solved at once: gaps, forces and the moment about the
    tip, in which the push has its lever. The module eliminates all but the tilt, and balances
    the moment about the centre.
    """
    parts, support = held
    R, r, mu = parts.hole_radius, parts.peg_radius, parts.friction
    h, L_g = parts.peg_chamfer.height, support.centre_distance
    rest = start[0] + L_g * math.sin(start[1])

    def residual(values: Array) -> list[float]:
        x, tilt = values[:2] * 1e-3
        push, normals = values[2], values[3:]
        tip = np.array([x, -depth - h])
        along = np.array([math.sin(tilt), math.cos(tilt)])
        across = np.array([math.cos(tilt), -math.sin(tilt)])
        centre = tip + L_g * along
        spring = np.array([support.lateral_stiffness * (rest - centre[0]), -push])
        forces = [(centre, spring)]
        gaps = []
        for place, normal_force in zip(pressed, normals, strict=True):
            side = 1.0 if place in (MOUTH_RIGHT, TIP_RIGHT) else -1.0
            if place in (MOUTH_RIGHT, MOUTH_LEFT):
                at = np.array([side * R, 0.0])
                gaps.append(side * float((at - tip) @ across) - r)
                forces.append((at, normal_force * (-side * across + mu * along)))
            else:
                at = tip + h * along + side * r * across
                gaps.append(R - side * at[0])
                forces.append((at, normal_force * np.array([-side, mu])))
        total = np.sum([force for _, force in forces], axis=0)
        clockwise = support.angular_stiffness * (start[1] - tilt)
        for at, force in forces:
            arm = at - tip
            clockwise += arm[1] * force[0] - arm[0] * force[1]
        return [*total, clockwise / r, *(1e3 * gap for gap in gaps)]

    guess = np.array([0.0, start[1] * 1e3, 1.0, *([1.0] * len(pressed))])
    found = root(residual, guess, tol=1e-13)
    assert np.abs(residual(found.x)).max() < 1e-9, found.message
    x, tilt = found.x[:2] * 1e-3
    moved = rest - x - L_g * math.sin(tilt)
    return float(found.x[2]), -support.lateral_stiffness * moved, float(tilt)


CASES = {
    "mouth": ((0.003, 0.022), 0.008, [MOUTH_RIGHT], Contact.MOUTH),
    "mouth, mirrored": ((-0.003, -0.022), 0.008, [MOUTH_LEFT], Contact.MOUTH),
    "tip": ((0.003, -0.05), 0.004, [TIP_RIGHT], Contact.TIP),
    "tip, mirrored": ((-0.003, 0.05), 0.004, [TIP_LEFT], Contact.TIP),
    "two points": ((0.003, 0.022), 0.03, [MOUTH_RIGHT, TIP_LEFT], Contact.TWO_POINT),
    "two, mirrored": ((-0.003, -0.022), 0.03, [MOUTH_LEFT, TIP_RIGHT], Contact.TWO_POINT),
    "two across": ((-0.003, 0.06), 0.02, [MOUTH_RIGHT, TIP_LEFT], Contact.TWO_POINT),
}


@pytest.mark.parametrize("held", [PAPER, OTHER])
@pytest.mark.parametrize("name", CASES)
def test_every_state_is_the_balance_found_by_itself(held: Held, name: str) -> None:
    start, depth, pressed, contact = CASES[name]
    push, across, tilt = balanced(held, start, depth, pressed)
    got = equilibrium(*held, *start, depth)
    assert got.contact == contact
    assert got.insertion_force == pytest.approx(push, rel=1e-6)
    assert got.lateral_force == pytest.approx(across, rel=1e-6)
    assert got.tilt == pytest.approx(tilt, rel=1e-6)


def peak(start: tuple[float, float], *, held: Held = SPRUNG) -> float:
    depth = np.linspace(0.0, 0.019, 1901)
    return float(equilibrium(*held, *start, depth).insertion_force.max())


@pytest.mark.parametrize(
    ("lateral", "degrees", "force"), [(0.0, 3.0, 2.6), (0.0, 5.0, 8.3), (0.001, 5.0, 10.6)]
)
def test_peaks_of_the_reference(lateral: float, degrees: float, force: float) -> None:
    assert peak((lateral, math.radians(degrees))) == pytest.approx(force, abs=0.1)


def test_states_follow_each_other_and_the_force_has_no_jump() -> None:
    depth = np.linspace(-0.004, 0.019, 4601)
    got = equilibrium(*SPRUNG, 0.001, math.radians(5.0), depth)
    changes = np.flatnonzero(np.diff(got.contact)) + 1
    order = [Contact(got.contact[k]) for k in (0, *changes)]
    assert order == [Contact.NONE, Contact.CHAMFER, Contact.MOUTH, Contact.TWO_POINT]
    into_bore = changes[1]
    jumps = np.abs(np.diff(got.insertion_force))
    assert np.delete(jumps, into_bore - 1).max() < 0.15  # steepest behind the onset
    # At the chamfer's end the push falls, as the force turns from 45 degrees to across.
    assert got.insertion_force[into_bore - 1] > 3 * got.insertion_force[into_bore]


def test_on_the_chamfer() -> None:
    """Force along and across from one contact at 45 degrees, by hand."""
    parts, support = SPRUNG
    got = equilibrium(parts, support, 0.001, 0.0, -0.0004)
    mu = parts.friction
    assert got.contact == Contact.CHAMFER
    ratio = float(got.insertion_force / -got.lateral_force)
    assert ratio == pytest.approx((1 + mu) / (1 - mu), rel=0.02)
    upright = equilibrium(parts, replace(support, angular_stiffness=1e6), 0.001, 0.0, -0.0004)
    assert upright.tip == pytest.approx(0.0006, abs=1e-7)
    assert upright.lateral_force == pytest.approx(-521.7 * 0.0004, rel=1e-3)


def test_a_peg_along_the_wall_is_upright() -> None:
    parts, support = PAPER
    got = equilibrium(parts, support, 0.003, -0.0117, 0.005)
    assert got.contact == Contact.ALONG_WALL
    assert (float(got.tilt), float(got.tip)) == pytest.approx((0.0, parts.clearance))
    moved = 0.003 - 0.1 * math.sin(0.0117) - parts.clearance
    assert got.lateral_force == pytest.approx(-400 * moved)
    assert got.insertion_force == pytest.approx(parts.friction * 400 * moved)


def test_depth_is_finite() -> None:
    message = re.escape("depth is nan, allowed: finite numbers")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        equilibrium(*PAPER, 0.0, 0.0, math.nan)


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


FED_PARTS = PegHoleGeometry()
ARM = Support(lateral_stiffness=400.0, angular_stiffness=5.0, centre_distance=0.0)
DEPTH = 0.04


def support_at(depth: float) -> Support:
    return in_series(ARM, ARM, depth)


def plenty(depth: Array) -> Array:
    return np.full_like(depth, 100.0)


STARTS = (
    (0.002, 0.03, Verdict.SAFE),
    (0.0042, 0.0, Verdict.SAFE),  # the chamfers reach 4.256 mm
    (0.0043, 0.0, Verdict.STOPPED),
    (-0.0043, 0.0, Verdict.STOPPED),
    (0.0043, 0.12, Verdict.MAY),  # a tilted tip is narrower; and it may wedge
    (0.00433, 0.12, Verdict.STOPPED),  # by 0.056 mm
    (0.0, 0.07, Verdict.MAY),  # beyond the limit to wedging
    (0.002, -0.05, Verdict.MAY),  # inside it, but the rim may sit on the edge
    (0.002, 0.05, Verdict.SAFE),
    (0.006, 0.05, Verdict.STOPPED),  # beside the mouth
)


def test_what_theory_says() -> None:
    lateral, tilt, expected = zip(*STARTS, strict=True)
    found = predict_feed(FED_PARTS, support_at, plenty, lateral, tilt, depth=DEPTH)
    assert found.verdict.tolist() == list(expected)
    assert np.isinf(found.axial[-1])
    assert np.isnan(found.onset[-1])
    assert not found.may_wedge[-1]
    assert limits(FED_PARTS, support_at, lateral, tilt).verdict.tolist() == list(expected)


@pytest.mark.slow
def test_the_force_is_the_largest_of_the_statics_on_the_way() -> None:
    tips = np.linspace(0.001, DEPTH, 40)
    forces = [
        float(
            equilibrium(
                FED_PARTS,
                support_at(tip),
                0.001,
                0.05,
                tip - FED_PARTS.chamfer_height,
            ).insertion_force
        )
        for tip in tips.tolist()
    ]
    found = predict_feed(FED_PARTS, support_at, plenty, 0.001, 0.05, depth=DEPTH)
    assert found.axial == pytest.approx(max(forces))

    def weak(depth: Array) -> Array:
        return np.full_like(depth, 0.99 * max(forces))

    assert predict_feed(FED_PARTS, support_at, weak, 0.001, 0.05, depth=DEPTH).verdict == (
        Verdict.STOPPED
    )


@pytest.mark.slow
def test_two_points_touch_where_the_support_of_that_depth_says_so() -> None:
    lateral, tilt = np.array([0.0, 0.002, 0.0]), np.array([0.05, 0.03, 0.0])
    found = predict_feed(FED_PARTS, support_at, plenty, lateral, tilt, depth=DEPTH)
    for k in range(2):
        support = support_at(float(found.onset[k]) + FED_PARTS.chamfer_height)
        again = two_point_onset(FED_PARTS, support, lateral[k], tilt[k])
        assert found.onset[k] == pytest.approx(float(again), abs=3e-5)
    assert np.isnan(found.onset[2])
