"""Wedging against linear programs over the friction cones of the contacts.

A load is held where contact forces within their cones balance it; no formula in common.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from models.wedging import PartsAndSupport

Array = NDArray[np.float64]
PAPER = PartsAndSupport()
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
    parts: PartsAndSupport,
) -> None:
    """Without any load they can press on each other, that is what a wedge is."""
    for ratio, held in ((0.2, True), (0.9, True), (0.999, True), (1.001, False), (2.0, False)):
        depth = ratio * parts.wedging_depth
        mouth_right = (parts.peg_radius, depth, -1.0)
        tip_left = (-parts.peg_radius, 0.0, 1.0)
        found = contact_forces([mouth_right, tip_left], parts.friction, np.zeros(3), squeeze=1.0)
        assert found.status == 0
        assert -found.fun == pytest.approx(1.0 if held else 0.0, abs=1e-9)
