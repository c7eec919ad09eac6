"""Contact in the bore against statics in the plane, with the peg's real shape.

No small angles, and no formula in common.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import root

from models.insertion import MOUTH_LEFT, MOUTH_RIGHT, TIP_LEFT, TIP_RIGHT, bore_contact
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


def normals_of_a_peg(
    parts: PartsAndSupport, start: tuple[float, float], depth: float, pressed: list[int]
) -> tuple[Array, float, float]:
    """Return normal forces, tilt and the upward sum of contact forces at equilibrium."""
    R, r, mu = parts.hole_radius, parts.peg_radius, parts.friction
    L_g, rest = parts.centre_distance, start[0] + parts.centre_distance * math.sin(start[1])

    def contacts(x: float, tilt: float) -> list[tuple[float, Array, Array, Array]]:
        """Gap, place, normal, and direction of friction on the peg for each contact."""
        tip = np.array([x, -depth])
        along = np.array([math.sin(tilt), math.cos(tilt)])
        across = np.array([math.cos(tilt), -math.sin(tilt)])
        found = []
        for place in pressed:
            side = 1.0 if place in (MOUTH_RIGHT, TIP_RIGHT) else -1.0
            if place in (MOUTH_RIGHT, MOUTH_LEFT):
                edge = np.array([side * R, 0.0])
                gap = r - side * float((edge - tip) @ across)
                found.append((gap, edge, -side * across, along))
            else:
                corner = tip + side * r * across
                up = np.array([0.0, 1.0])
                found.append((R - side * corner[0], corner, np.array([-side, 0.0]), up))
        return found

    def forces(values: Array) -> tuple[Array, float, list[float]]:
        x, tilt = values[:2] * 1e-3
        centre = np.array([x, -depth]) + L_g * np.array([math.sin(tilt), math.cos(tilt)])
        total, moment, gaps = np.zeros(2), 0.0, []
        for normal_force, (gap, place, normal, up) in zip(
            values[2:], contacts(x, tilt), strict=True
        ):
            force = normal_force * (normal + mu * up)
            arm = place - centre
            total = total + force
            moment += arm[1] * force[0] - arm[0] * force[1]  # clockwise, as the tilt
            gaps.append(gap)
        return total, moment, gaps

    def residual(values: Array) -> list[float]:
        x, tilt = values[:2] * 1e-3
        total, moment, gaps = forces(values)
        centre_x = x + L_g * math.sin(tilt)
        spring = parts.lateral_stiffness * (rest - centre_x)
        torsion = parts.rotational_stiffness * (start[1] - tilt)
        return [spring + total[0], (torsion + moment) / r, *(1e3 * gap for gap in gaps)]

    guess = np.array([0.0, start[1] * 1e3, *([0.5] * len(pressed))])
    found = root(residual, guess, tol=1e-12)
    assert found.success, found.message
    return found.x[2:], float(found.x[1] * 1e-3), float(forces(found.x)[0][1])


CASES = {
    "mouth": ((0.003, 0.022), 0.008, [MOUTH_RIGHT]),
    "mouth, mirrored": ((-0.003, -0.022), 0.008, [MOUTH_LEFT]),
    "tip": ((0.003, -0.05), 0.004, [TIP_RIGHT]),
    "tip, mirrored": ((-0.003, 0.05), 0.004, [TIP_LEFT]),
    "two points": ((0.003, 0.022), 0.03, [MOUTH_RIGHT, TIP_LEFT]),
    "two points, mirrored": ((-0.003, -0.022), 0.03, [MOUTH_LEFT, TIP_RIGHT]),
    "two points across": ((-0.003, 0.06), 0.02, [MOUTH_RIGHT, TIP_LEFT]),
}


@pytest.mark.parametrize("parts", [PAPER, OTHER])
@pytest.mark.parametrize("name", CASES)
def test_contact_agrees_with_statics_as_errors_become_small(
    parts: PartsAndSupport, name: str
) -> None:
    """Ten times smaller errors and clearance leave a tenth of the small-angle model's error."""
    start, depth, pressed = CASES[name]
    differences = []
    for scale in (1.0, 0.1, 0.01):
        fine = replace(parts, peg_radius=parts.hole_radius - scale * parts.clearance)
        small = (scale * start[0], scale * start[1])
        normals, tilt, upward = normals_of_a_peg(fine, small, depth, pressed)
        got = bore_contact(fine, *small, depth)
        assert np.flatnonzero(got.normal_forces).tolist() == pressed
        differences.append(
            max(
                float(np.abs(got.normal_forces[pressed] / normals - 1).max()),
                abs(float(got.tilt) / tilt - 1),
                abs(float(got.insertion_force) / upward - 1),
            )
        )
    assert differences[0] < 0.2
    assert differences[1] < 0.15 * differences[0] or differences[1] < 1e-3
    assert differences[2] < 2e-3
