"""Statics of an insertion: the exact ones and Whitney's, against balances and each other."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import root

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.insertion_statics import (
    bore_contact,
    chamfer_depth,
    cross_chamfer,
    enters,
    two_point_onset,
)
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium
from chamfer.models.peg_theory.wedging import two_point_onset as exact_onset
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
def test_onset_of_a_peg_whose_tip_is_on_the_wall_from_the_start(held: Held) -> None:
    clearance = held[0].clearance
    for step in (-1e-18, 0.0, 1e-18):
        onset = two_point_onset(*held, clearance + step, -0.03)
        assert onset == pytest.approx(2 * clearance / 0.03, rel=1e-6)


def test_never_two_points_without_tilt() -> None:
    assert math.isnan(two_point_onset(PegHoleGeometry(), Support(centre_distance=0.0), 0.0, 0.0))
    assert math.isnan(two_point_onset(*PAPER, 0.003, -0.0117))  # along the wall


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
def test_depths_are_finite_and_in_the_bore(depth: float) -> None:
    message = re.escape(f"depth is {depth!r}, allowed: finite numbers")
    with pytest.raises(ParameterError, match=f"^{message} >= 0$"):
        bore_contact(*PAPER, 0.0, 0.0, depth)
    if not math.isfinite(depth):
        with pytest.raises(ParameterError, match=f"^{message}$"):
            equilibrium(*PAPER, 0.0, 0.0, depth)


@pytest.mark.parametrize("held", [PAPER, OTHER])
def test_onset_agrees_within_the_error_that_is_said(held: Held) -> None:
    bare = replace(held[0], chamfer_width=0.0), held[1]
    starts = np.array([[0.0, 0.03], [0.003, 0.022], [-0.003, 0.05], [0.002, 0.04]])
    simple, exact = (of(*bare, *starts.T) for of in (two_point_onset, exact_onset))
    np.testing.assert_allclose(simple, exact, rtol=0.02)


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
    tip, in which the push has its lever. The exact statics eliminate all but the tilt, and balance
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
