"""Whitney's small-angle forms against exact statics: they agree as the errors become small."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.insertion_statics import bore_contact, two_point_onset
from chamfer.models.peg_theory.planar_statics import equilibrium
from chamfer.models.peg_theory.wedging import two_point_onset as exact_onset

Held = tuple[PegHoleGeometry, Support]

PAPER: Held = (PegHoleGeometry(chamfer_width=0.0), Support())
OTHER: Held = (
    PegHoleGeometry(hole_radius=0.012, peg_radius=0.0117, friction=0.3, chamfer_width=0.0),
    Support(lateral_stiffness=900.0, angular_stiffness=7.0, centre_distance=0.06),
)
CASES = {
    "mouth": ((0.003, 0.022), 0.008),
    "tip": ((0.003, -0.05), 0.004),
    "two points": ((0.003, 0.022), 0.03),
    "two points across": ((-0.003, 0.06), 0.02),
}


@pytest.mark.parametrize("held", [PAPER, OTHER])
@pytest.mark.parametrize("name", CASES)
def test_contact_agrees_as_errors_become_small(held: Held, name: str) -> None:
    """Ten times smaller errors and clearance leave a tenth of the small-angle model's error."""
    (start, depth), (parts, support) = CASES[name], held
    differences = []
    for scale in (1.0, 0.1, 0.01):
        fine = replace(parts, peg_radius=parts.hole_radius - scale * parts.clearance)
        small = (scale * start[0], scale * start[1])
        exact = equilibrium(fine, support, *small, depth)
        got = bore_contact(fine, support, *small, depth)
        assert got.contact == exact.contact
        differences.append(
            max(
                abs(float(got.insertion_force / exact.insertion_force) - 1),
                abs(float(got.tilt / exact.tilt) - 1),
            )
        )
    assert differences[0] < 0.25
    assert differences[1] < 0.15 * differences[0] or differences[1] < 1e-3
    assert differences[2] < 2e-3


@pytest.mark.parametrize("held", [PAPER, OTHER])
def test_onset_agrees_within_the_error_that_is_said(held: Held) -> None:
    starts = np.array([[0.0, 0.03], [0.003, 0.022], [-0.003, 0.05], [0.002, 0.04]])
    simple, exact = (of(*held, *starts.T) for of in (two_point_onset, exact_onset))
    np.testing.assert_allclose(simple, exact, rtol=0.02)
