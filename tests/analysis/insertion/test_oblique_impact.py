"""An impact: Hunt and Crossley's rebound, Coulomb's friction, and who keeps them."""

import math
from dataclasses import replace

import pytest
from scipy.integrate import solve_ivp

from chamfer.analysis.insertion.contact_convergence import CONVERGENCE
from chamfer.analysis.insertion.oblique_impact import strike
from chamfer.models.peg.bore_contact import ContactMaterial
from chamfer.systems.contact.contact_approximation import Approximation

PEG = CONVERGENCE.insertion


@pytest.mark.parametrize(("dissipation", "speed"), [(20.0, 0.04), (3.0, 1.0), (0.0, 0.5)])
def test_rebound_is_that_of_the_equation_of_motion(dissipation: float, speed: float) -> None:
    e = ContactMaterial(dissipation=dissipation).restitution(speed)
    rate = PEG.contact.stiffness / 2 / PEG.mass

    def motion(time: float, state: list[float]) -> list[float]:
        x, v = state
        return [v, -rate * x * (1 + dissipation * v)]

    span, start = (0.0, 20 / math.sqrt(rate)), [0.0, speed]
    found = solve_ivp(
        motion, span, start, events=lambda time, state: state[0], rtol=1e-10, atol=1e-14
    )
    after = found.y_events[0][:, 1]  # at the start, and where it comes off
    assert -after[after < 0][0] / speed == pytest.approx(e, rel=1e-6)


@pytest.mark.parametrize("approximation", ["lagged", "tamsi"])
def test_a_resolved_impact_is_that_of_theory(approximation: Approximation) -> None:
    rebound, friction = strike(replace(PEG, step=2e-6), 0.04, approximation)
    assert rebound == pytest.approx(PEG.contact.restitution(0.04), rel=0.01)
    assert friction == pytest.approx(1.0, abs=1e-3)


def test_what_a_step_that_holds_the_impact_costs() -> None:
    assert strike(PEG, 0.04, "lagged")[1] > 3  # times Coulomb's friction
    assert strike(replace(PEG, step=1e-4), 0.04, "lagged")[1] < 1.05
    rebound, friction = strike(PEG, 0.04, "similar")
    assert rebound > 3  # it slides at ten times the speed that it strikes with, and takes off
    assert friction == pytest.approx(1.0, abs=1e-3)
    assert strike(PEG, 0.04, "tamsi") == pytest.approx((strike(PEG, 0.04, "lagged")[0], 1.0))
