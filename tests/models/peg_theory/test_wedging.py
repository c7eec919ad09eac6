"""The wedging diagram: the paper's numbers, its sides and its limits."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.wedging import (
    assembles,
    box_margin,
    chamfer_needed,
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
@given(held=holdings, eps0=errors)
def test_aligned_rotation_is_free_and_far_rotation_is_not(held: Held, eps0: float) -> None:
    lower, upper = wedging_bounds(*held, eps0)
    assert lower < upper
    assert not wedges(*held, eps0, (lower + upper) / 2)
    assert wedges(*held, eps0, upper)  # the boundary wedges
    assert wedges(*held, eps0, lower)


@settings(deadline=None, max_examples=20)
@given(held=holdings, eps0=errors, theta0=tilts)
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
