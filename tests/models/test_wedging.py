"""The wedging diagram: the paper's numbers, its sides and its limits."""

import dataclasses
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.peg_and_hole import HolePart, Peg
from models.validation import ParameterError
from models.wedging import (
    PartsAndSupport,
    box_margin,
    chamfer_needed,
    least_margin,
    quadratic_roots,
    rotation_bounds,
    rotation_margin,
    wedges,
)

PAPER = PartsAndSupport()
# Every number differs from the paper's, so that no two can be mixed up unseen.
OTHER = PartsAndSupport(
    hole_radius=0.012,
    peg_radius=0.0117,
    friction=0.3,
    lateral_stiffness=900.0,
    rotational_stiffness=7.0,
    centre_distance=0.06,
    chamfer_width=0.003,
    chamfer_angle=0.9,
)

supports = st.builds(
    lambda clearance, friction, K_x, K_theta, L_g: PartsAndSupport(
        peg_radius=PAPER.hole_radius - clearance,
        friction=friction,
        lateral_stiffness=K_x,
        rotational_stiffness=K_theta,
        centre_distance=L_g,
    ),
    st.floats(1e-5, 5e-4),
    st.floats(0.05, 1.0),
    st.floats(50.0, 5e3),
    st.floats(2.0, 100.0),
    st.floats(0.0, 0.5),
)
errors = st.floats(-0.02, 0.02)
tilts = st.floats(-0.2, 0.2)


def test_published_numbers() -> None:
    assert PAPER.clearance_ratio == pytest.approx(0.0255107, abs=5e-8)
    assert PAPER.rotation_limit == pytest.approx(0.05817, abs=5e-6)
    assert PAPER.lateral_limit == pytest.approx(0.019814, abs=5e-7)
    assert (PAPER.lateral_stiffness, PAPER.rotational_stiffness) == (400.0, 5.0)
    # Section 4 writes the limit as (c 2R) / (mu 2r), which is not c / mu.
    c, R, r, mu = PAPER.clearance_ratio, 0.010035, 0.009779, 0.45
    assert PAPER.rotation_limit == pytest.approx(c * 2 * R / (mu * 2 * r), rel=1e-12)
    assert PAPER.rotation_limit != pytest.approx(c / mu, rel=0.02)


def test_lengths_of_the_parts() -> None:
    assert OTHER.clearance == pytest.approx(3e-4)
    assert OTHER.friction_radius == pytest.approx(0.3 * 0.0117)
    assert OTHER.wedging_depth == pytest.approx(2 * 0.3 * 0.0117)
    assert OTHER.chamfer_limit == pytest.approx(0.0033)
    assert OTHER.lateral_limit == pytest.approx(0.0237)
    # A peg that leans by that much just spans the mouth.
    assert 2 * 0.0117 / math.cos(OTHER.mouth_tilt_limit) == pytest.approx(2 * 0.012)
    # Two points touch at theta_w where lambda is one.
    assert OTHER.wedging_depth * OTHER.rotation_limit == pytest.approx(2 * OTHER.clearance)


def test_chamfers_for_the_published_errors() -> None:
    needed = chamfer_needed(PAPER, [0.0025, -0.0032, 0.0001, 0.019814])
    np.testing.assert_allclose(needed, [0.002244, 0.002944, 0.0, 0.019558], atol=1e-12)


# The worst published pair, its errors of one sign.


def test_margins_to_the_box_are_those_of_section_5() -> None:
    lateral, rotation = box_margin(PAPER, [0.0032, -0.0032], [-0.040, 0.040])
    np.testing.assert_allclose(100 * lateral, 83.85, atol=0.005)
    np.testing.assert_allclose(100 * rotation, 31.24, atol=0.005)


def test_margin_to_the_parallelogram_at_the_worst_compliance_centre() -> None:
    worst = replace(PAPER, centre_distance=PAPER.worst_centre_distance)
    margin = rotation_margin(worst, 0.0032, 0.040, "simple")
    used = (1 - margin) * worst.rotation_limit
    assert used == pytest.approx(0.0532, abs=5e-5)
    assert 100 * margin == pytest.approx(8.6, abs=0.05)
    assert 100 * rotation_margin(worst, 0.0032, 0.040) == pytest.approx(6.34, abs=0.01)


def test_errors_of_opposite_signs_compensate() -> None:
    same, opposite = (rotation_margin(PAPER, 0.0032, theta) for theta in (0.03, -0.03))
    assert opposite > same + 0.3


# The sides of the diagram.


def test_no_slope_at_a_remote_centre_and_the_largest_in_between() -> None:
    assert replace(PAPER, centre_distance=0.0).tilt_per_error == 0.0
    assert replace(PAPER, centre_distance=1e6).tilt_per_error == pytest.approx(0.0, abs=2e-6)
    at = PAPER.worst_centre_distance
    assert at == pytest.approx(math.sqrt(5 / 400))
    largest = replace(PAPER, centre_distance=at).tilt_per_error
    assert largest == pytest.approx(1 / (2 * math.sqrt(5 / 400)))
    for distance in np.linspace(0.0, 1.0, 101).tolist():
        assert replace(PAPER, centre_distance=distance).tilt_per_error <= largest * (1 + 1e-12)


def test_a_remote_centre_leaves_a_box() -> None:
    lower, upper = rotation_bounds(replace(PAPER, centre_distance=0.0), [-0.01, 0.01], "simple")
    np.testing.assert_allclose(upper, PAPER.rotation_limit)
    np.testing.assert_allclose(lower, -PAPER.rotation_limit)


def test_simple_sides_begin_at_the_clearance() -> None:
    S = OTHER.centre_distance / (OTHER.centre_distance**2 + 7.0 / 900.0)
    lower, upper = rotation_bounds(OTHER, [-0.0003, 0.0, 0.0003, 0.0013, -0.0013], "simple")
    limit = OTHER.rotation_limit
    expected = limit + S * np.array([0.0, 0.0, 0.0, -0.001, 0.001])
    np.testing.assert_allclose(upper, expected, rtol=1e-12)
    np.testing.assert_allclose(lower, expected - 2 * limit, rtol=1e-12)


@pytest.mark.parametrize("parts", [PAPER, OTHER])
def test_exact_sides_where_the_wedging_depth_decides(parts: PartsAndSupport) -> None:
    """The straight lines of the small-angle model, with friction and depth in the arms."""
    K_x, K_theta, L_g = parts.lateral_stiffness, parts.rotational_stiffness, parts.centre_distance
    gap, shift = parts.clearance, parts.friction * parts.peg_radius
    l_w, C_w = 2 * shift, L_g - 3 * shift
    S_w = C_w * K_x / (C_w * K_x * (L_g - l_w) + K_theta)
    S_t = (L_g - shift) * K_x / ((L_g - shift) * K_x * L_g + K_theta)
    eps0 = np.linspace(gap, 0.01, 7)
    lower, upper = rotation_bounds(parts, eps0)
    on_mouth = (gap / shift - S_w * (eps0 - gap)) / (1 + S_w * l_w)
    np.testing.assert_allclose(upper, on_mouth, rtol=1e-9)
    np.testing.assert_allclose(lower, -gap / shift - S_t * (eps0 - gap), rtol=1e-9)


def test_the_simple_sides_are_a_few_percent_too_wide_near_the_axis() -> None:
    eps0 = np.linspace(0.0, 1e-3, 401)
    simple, exact = (rotation_bounds(PAPER, eps0, form)[1] for form in ("simple", "exact"))
    excess = (simple - exact) / PAPER.rotation_limit
    assert 0.03 < excess.max() < 0.04
    assert eps0[excess.argmax()] == pytest.approx(PAPER.clearance, abs=1e-5)


@pytest.mark.parametrize("form", ["exact", "simple"])
@given(parts=supports)
def test_sides_have_no_jumps(form: Any, parts: PartsAndSupport) -> None:
    for kink in (-parts.clearance, 0.0, parts.clearance):
        around = kink + np.array([-1e-12, 0.0, 1e-12])
        for side in rotation_bounds(parts, around, form):
            assert np.ptp(side) < 1e-4 * parts.rotation_limit


@pytest.mark.parametrize("form", ["exact", "simple"])
@given(parts=supports, eps0=errors, theta0=tilts)
def test_mirroring(form: Any, parts: PartsAndSupport, eps0: float, theta0: float) -> None:
    there, mirrored = (
        rotation_margin(parts, sign * eps0, sign * theta0, form) for sign in (1, -1)
    )
    assert there == mirrored


@given(parts=supports, eps0=errors)
def test_aligned_rotation_is_free_and_far_rotation_is_not(
    parts: PartsAndSupport, eps0: float
) -> None:
    lower, upper = rotation_bounds(parts, eps0)
    assert lower < upper
    middle = (lower + upper) / 2
    assert not wedges(parts, eps0, middle)
    assert wedges(parts, eps0, upper)  # the boundary wedges
    assert wedges(parts, eps0, lower)
    # A peg whose tip is on the wall from the start leans as it did before.
    limit = parts.rotation_limit
    got = wedges(parts, -parts.clearance, np.array([0.9999, 1.0001]) * limit)
    np.testing.assert_array_equal(got, [False, True])


@given(parts=supports, eps0=errors, theta0=tilts)
def test_the_margin_says_on_which_side(parts: PartsAndSupport, eps0: float, theta0: float) -> None:
    lower, upper = rotation_bounds(parts, eps0)
    margin = rotation_margin(parts, eps0, theta0) * parts.rotation_limit
    assert margin == pytest.approx(min(upper - theta0, theta0 - lower), rel=1e-9, abs=1e-15)
    assert wedges(parts, eps0, theta0) == (not lower < theta0 < upper)


def test_inputs_are_broadcast() -> None:
    grid = wedges(PAPER, np.linspace(-0.01, 0.01, 5)[:, None], np.linspace(-0.1, 0.1, 7))
    assert grid.shape == (5, 7)
    for i, eps0 in enumerate(np.linspace(-0.01, 0.01, 5)):
        for j, theta0 in enumerate(np.linspace(-0.1, 0.1, 7)):
            assert grid[i, j] == wedges(PAPER, eps0, theta0)


def test_roots_of_quadratics() -> None:
    first, second = quadratic_roots(
        [1.0, 2.0, 0.0, 1.0], [-3.0, 8.0, 2.0, 0.0], [2.0, 6.0, -5.0, 1.0]
    )
    got = [sorted(pair) for pair in np.column_stack([first, second])[:2].tolist()]
    np.testing.assert_allclose(got, [[1.0, 2.0], [-3.0, -1.0]])
    assert 2.5 in (first[2], second[2])
    assert np.isnan(first[3])
    assert np.isnan(second[3])


POSITIVE, NOT_NEGATIVE = "a finite number > 0", "a finite number >= 0"
THINNER = "less than the hole's radius, 0.010035"


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        *(
            (name, value, POSITIVE)
            for value in (0.0, -1.0, math.nan, math.inf)
            for name in (
                "hole_radius",
                "peg_radius",
                "friction",
                "lateral_stiffness",
                "rotational_stiffness",
            )
        ),
        *(
            (name, value, NOT_NEGATIVE)
            for value in (-1e-9, math.nan, math.inf)
            for name in (
                "centre_distance",
                "chamfer_width",
            )
        ),
        ("peg_radius", 0.010035, THINNER),
        ("peg_radius", 0.02, THINNER),
        ("chamfer_angle", 0.0, "between 0 and pi/2"),
        ("chamfer_angle", math.pi / 2, "between 0 and pi/2"),
        ("chamfer_angle", math.nan, "between 0 and pi/2"),
        (
            "rotational_stiffness",
            0.017,
            "> 0.0174284 = K_x (3 mu r / 2)^2, softer supports turn over in contact",
        ),
    ],
)
def test_errors(name: str, value: float, allowed: str) -> None:
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        replace(PAPER, **{name: value})


def test_parameters_are_frozen_and_by_keyword() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PAPER.friction = 0.5  # type: ignore[misc]
    with pytest.raises(TypeError):
        PartsAndSupport(0.01)  # type: ignore[misc]
    replace(PAPER, centre_distance=0.0, chamfer_width=0.0)


@pytest.mark.parametrize("form", ["simple", "exact"])
def test_no_compliance_centre_leaves_less_than_the_least_margin(form: Any) -> None:
    lateral, rotation = 0.0032, 0.040
    least, at = least_margin(PAPER, lateral, rotation, form)
    for distance in np.linspace(0.0, 1.0, 501).tolist():
        there = replace(PAPER, centre_distance=distance)
        assert rotation_margin(there, lateral, rotation, form) >= least - 1e-12
    there = replace(PAPER, centre_distance=at)
    assert rotation_margin(there, lateral, rotation, form) == pytest.approx(least)
    if form == "simple":
        assert at == pytest.approx(math.sqrt(5 / 400), rel=1e-3)


def test_the_assumed_chamfers_are_those_of_the_parts_that_the_cameras_see() -> None:
    assert PAPER.chamfer_width == pytest.approx(Peg().chamfer + HolePart().chamfer)
    assert (PAPER.peg_radius, PAPER.hole_radius) == (Peg().radius, HolePart().radius)
