"""Wedging and jamming against linear programs over the friction cones of the contacts.

A load is held where contact forces within their cones balance it; no formula in common.
"""

import math
import re
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg_theory.wedging import jamming_vertices, jams
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]
PAPER = PegHoleGeometry()
OTHER = PegHoleGeometry(
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


@pytest.mark.parametrize("parts", [PAPER, OTHER])
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


@pytest.mark.parametrize(("parts", "ratio"), [(PAPER, 1.0), (OTHER, 1.3), (PAPER, 4.0)])
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
    depth = 1.7 * OTHER.wedging_depth
    corners = jamming_vertices(OTHER, depth)
    expected = [[-1 / 0.3, 4.4], [-1 / 0.3, 1.0], [1 / 0.3, -4.4], [1 / 0.3, -1.0]]
    np.testing.assert_allclose(corners, expected, rtol=1e-12)
    np.testing.assert_array_equal(jams(OTHER, *(0.999 * corners).T, depth), [False] * 4)
    np.testing.assert_array_equal(jams(OTHER, *(1.001 * corners).T, depth), [True] * 4)
    # Counter-clockwise.
    following = np.roll(corners, -1, axis=0)
    area = np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]) / 2
    assert area == pytest.approx(2 / 0.3 * 2 * 1.7)


@pytest.mark.parametrize("depth", [0.0, -0.01, math.nan, math.inf])
def test_jamming_needs_a_depth(depth: float) -> None:
    message = re.escape(f"depth is {depth!r}, allowed: finite numbers > 0")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        jams(PAPER, 0.0, 0.0, depth)
    with pytest.raises(ParameterError, match=f"^{message}$"):
        jamming_vertices(PAPER, depth)
