"""A remote centre compliance: its limits, its support in series, and Whitney's formulas for it."""

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.models.arms.position_arm import (
    Compliance,
    ComplianceParams,
    require_within_deflection,
)
from chamfer.models.arms.wrist import WristParams
from chamfer.models.peg.peg_and_hole import PRESETS, PegAndHole
from chamfer.models.peg.support import Support, stacked, strain
from chamfer.models.peg_theory.insertion_statics import bore_contact
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium
from chamfer.models.peg_theory.wedging import wedging_bounds
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

RCC = ComplianceParams(kind="rcc").resolved()
ARM = Support(lateral_stiffness=900.0, angular_stiffness=11.0, centre_distance=0.07)
# Clearance and tilts are small against the friction, as Whitney's are; his tip has no chamfer.
_PEG: dict[str, Any] = {**PRESETS["nist-16mm"], "hole_radius": 0.008 + 8e-6, "friction": 0.4}
PEG = PegAndHole(**_PEG | {"peg_chamfer_share": 0.0})


def test_what_is_open_follows_from_the_kind() -> None:
    arm = ComplianceParams(lateral=9e4).resolved()
    assert isinstance(arm, Compliance)
    assert (arm.lateral, arm.centre_distance, arm.most_lateral, arm.mass) == (9e4, 0.0, None, None)
    assert arm.resolved() == arm
    device = ComplianceParams(kind="rcc", most_angular=0.03).resolved()
    assert (device.most_lateral, device.most_angular) == (2.5e-3, 0.03)
    assert device.support == Support(**Support.PRESETS["rcc"])  # type: ignore[arg-type]
    assert device.lateral < arm.lateral
    wrist = device.wrist(mass=0.5, centre_of_mass=0.02, inertia=8e-4, axial_inertia=4e-4)
    assert (wrist.mass, wrist.inertia) == pytest.approx((0.7, 8e-4 + 0.2 * 4e-4))
    assert wrist.stiffness[2:4] == (device.torsional, device.lateral)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"lateral": 0.0}, "lateral is 0.0, allowed: a finite number > 0"),
        ({"kind": "rcc", "most_axial": -1.0}, "most_axial is -1.0, allowed: a finite number > 0"),
        ({"centre_distance": 30.0}, "centre_distance is 30.0, allowed: a number from -1 to 1 m"),
        ({"most_lateral": 0.002}, "most_lateral is 0.002, allowed: null, or a kind: rcc that"),
        ({"mass": 0.2}, "mass is 0.2, allowed: null, or a kind: rcc that has it"),
    ],
)
def test_refusals(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=re.escape(message)):
        ComplianceParams(**given)


def test_an_error_beyond_the_limits_is_refused_unless_the_arm_gives_way_to_it() -> None:
    require_within_deflection(RCC, 2.4e-3, math.radians(0.9))
    message = "hole.position_error is 0.003, allowed: less: with it the rcc gives way by 0.003, "
    with pytest.raises(ParameterError, match=re.escape(f"{message}compliance.most_lateral is 0.")):
        require_within_deflection(RCC, 3e-3, 0.0)
    with pytest.raises(
        ParameterError, match=r"hole\.angle_error is 0\.03.*most_angular is 0\.017"
    ):
        require_within_deflection(RCC, 1e-3, 0.03)
    with pytest.raises(ParameterError, match=r"hole\.angle_error is 0\.01.*most_lateral"):
        require_within_deflection(replace(RCC, centre_distance=0.3), 1e-3, 0.01)
    require_within_deflection(RCC, 3e-3, 0.03, ARM)
    require_within_deflection(ComplianceParams().resolved(), 1.0, 1.0)


def test_deflection_is_the_largest_share_of_a_limit() -> None:
    moved = np.zeros((4, 6))
    moved[0, 3:5] = 1.5e-3, 2e-3
    moved[1, :2] = 0.6 * math.radians(0.5), -0.8 * math.radians(0.5)
    moved[2, [2, 5]] = math.radians(0.2), -1e-3
    assert RCC.deflection(moved) == pytest.approx([1.0, 0.5, 2.0, 0.0])
    assert not ComplianceParams().resolved().deflection(moved).any()


def at_tip(support: Support) -> Array:
    """Return the compliance of a wrist with such springs in both planes, shape (6, 6)."""
    about, across = support.angular_stiffness, support.lateral_stiffness
    stiffness = (about, about, 1.0, across, across, 1.0)
    return WristParams(stiffness=stiffness, centre=support.centre_distance).compliance


@pytest.mark.parametrize("centre", [0.0, -0.02, 0.07, 0.2])
def test_supports_on_the_side_of_the_peg_add_their_compliances(centre: float) -> None:
    device = replace(RCC.support, centre_distance=centre)
    whole = stacked(device, ARM)
    both = at_tip(device) + at_tip(ARM)
    both[[2, 5], [2, 5]] = 1.0  # not of a plane
    np.testing.assert_allclose(at_tip(whole), both, rtol=0, atol=1e-12 * both.max())
    # What each gives way, seen from the tip, is what the whole does.
    lateral, tilt = np.array([0.001, -0.002]), np.array([0.01, 0.02])
    strains = [(one, *strain(one, whole, lateral, tilt)) for one in (device, ARM)]
    assert sum(turned for _, _, turned in strains) == pytest.approx(tilt)
    tip = sum(across - one.centre_distance * turned for one, across, turned in strains)
    assert tip == pytest.approx(lateral)


def whitney(support: Support, eps0: float, theta0: float, depth: Array) -> tuple[Array, Array]:
    """Return Whitney's insertion forces in one-point, on the mouth, and two-point contact, N."""
    K_x, K_theta = support.lateral_stiffness, support.angular_stiffness
    L_g, mu_r, c = support.centre_distance, PEG.friction_radius, PEG.clearance
    below = L_g - depth
    load = K_x * K_theta * (eps0 - c + depth * theta0)
    one = PEG.friction * load / (K_x * below * (below - mu_r) + K_theta)
    off = 2 * c / depth - theta0
    across = K_x * (eps0 + c - L_g * off)
    two = 2 * ((L_g - mu_r) * across - K_theta * off) / depth - across
    return one, PEG.friction * two


@pytest.mark.parametrize("centre", [0.0, PEG.peg_radius / 2, PEG.peg_radius, 0.04])
@pytest.mark.parametrize(
    ("eps0", "theta0", "contact"),
    [
        (4e-4, 1.5e-3, Contact.MOUTH),
        (1e-4, 1.5e-3, Contact.MOUTH),
        (4e-5, 2e-3, Contact.TWO_POINT),
    ],
)
def test_insertion_force_is_whitneys(
    centre: float, eps0: float, theta0: float, contact: Contact
) -> None:
    """That of the exact statics is within 1 % of its peak."""
    support = replace(RCC.support, centre_distance=centre)
    depth = np.linspace(5e-4, 0.02, 79)
    got = bore_contact(PEG, support, eps0, theta0, depth)
    exact = equilibrium(PEG, support, eps0, theta0, depth)
    there = (got.contact == contact) & (exact.contact == contact)
    assert there.sum() > 5
    force = whitney(support, eps0, theta0, depth)[int(contact == Contact.TWO_POINT)][there]
    assert got.insertion_force[there] == pytest.approx(force, rel=1e-9)
    assert exact.insertion_force[there] == pytest.approx(force, abs=0.01 * force.max())


@pytest.mark.parametrize("centre", [0.0, PEG.wedging_depth, 0.05, 0.3])
def test_wedging_is_whitneys_with_the_lever_of_friction(centre: float) -> None:
    """At the onset the mouth is l_w = 2 mu r above the tip, and friction shifts forces by mu r.

    With both, small angles are within 1 % of theta_w; Whitney's slope S leaves them out, and is
    within 3 % for lateral errors of some clearances alone.
    """
    support = replace(RCC.support, centre_distance=centre)
    K_x, K_theta = support.lateral_stiffness, support.angular_stiffness
    mu_r, limit = PEG.friction_radius, PEG.rotation_limit
    # Of the mouth's edge, and of the tip's corner.
    below = np.array([centre - 2 * mu_r, centre])
    mouth, tip = (lever := K_x * (below - mu_r)) / (lever * below + K_theta)
    for size, tolerance in ((1e-4, math.inf), (3e-5, 0.03)):
        pressed = size - PEG.clearance
        by_hand = [(limit - mouth * pressed) / (1 + mouth * 2 * mu_r), limit + tip * pressed]
        lower, upper = wedging_bounds(PEG, support, [size, -size])
        assert upper == pytest.approx(by_hand, abs=0.01 * limit)
        assert -lower[::-1] == pytest.approx(by_hand, abs=0.01 * limit)
        simple = limit - support.tilt_per_error * np.array([pressed, -pressed])
        assert upper == pytest.approx(simple, abs=tolerance * limit)
