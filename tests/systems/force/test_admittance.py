"""The least damping is where the poles of the loop say so, and where a simulation does."""

import cmath
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError
from chamfer.systems.force.accommodation_law import AccommodationLaw
from chamfer.systems.force.admittance_law import AdmittanceLaw, AdmittanceParams, AdmittanceState

Array = NDArray[np.float64]
REST = np.zeros(6)


def axis(**changes: float) -> AdmittanceParams:
    """Return an admittance whose axes are all the same, however badly damped."""
    period = changes.pop("period")
    fields: dict[str, Any] = {name: (value,) * 6 for name, value in changes.items()}
    return AdmittanceParams(period=period, allow_unstable=True, **fields)


def poles(params: AdmittanceParams) -> NDArray[np.complex128]:
    """Poles of the law against springs, with a sample of delay, but for those of the delay at 0.

    The motion of every axis, from the columns of what a tick makes of v, x and the force before.
    """
    law, stiffness = AdmittanceLaw(params), np.array(params.stiffness)

    def tick(z: Array) -> Array:
        v, x, felt = np.split(z, 3)
        seen = law.observe({"command": REST, "wrench": felt})
        after = law.update(AdmittanceState(v, REST, x), seen, 0.0)
        return np.concatenate([after.velocity, after.displacement, -stiffness * x])

    found = np.linalg.eigvals(np.transpose([tick(one) for one in np.eye(18)]))
    return found[np.argsort(-np.abs(found))][:12].astype(np.complex128)


LOOPS = {
    "period": st.floats(1e-3, 0.02),
    "stiffness": st.floats(1e2, 1e5),
    "inertia": st.floats(0.05, 20.0),
    "spring": st.floats(0.0, 1e4),
}


@given(**LOOPS)
def test_from_the_least_damping_on_all_poles_are_real(**loop: float) -> None:
    least = axis(damping=1.0, **loop).least_damping[3]
    over, under = (poles(axis(damping=factor * least, **loop)) for factor in (1.01, 0.99))
    assert np.abs(over.imag).max() < 1e-7
    assert over.real.min() > -1e-9
    assert over.real.max() < 1
    assert np.abs(under.imag).max() > 1e-4


@given(**LOOPS)
def test_the_mass_is_nothing_to_where_it_is_stable(**loop: float) -> None:
    bound = (loop["stiffness"] - loop["spring"]) * loop["period"]
    if bound < 0.01:
        return
    stable, unstable = (np.abs(poles(axis(damping=f * bound, **loop))).max() for f in (1.01, 0.99))
    assert stable < 1 < unstable


def contact_force(damping: float, ticks: int) -> Array:
    """Force, N, that a tool of 2 kg presses with on 10 N/mm, commanded 10 mm/s into it."""
    params = axis(damping=damping, stiffness=1e4, inertia=2.0, period=0.005)
    law = AdmittanceLaw(params)
    state, x, felt, forces = law.start(), np.zeros(6), np.zeros(6), []
    for k in range(ticks):
        seen = law.observe({"command": np.full(6, 0.01), "wrench": felt})
        felt = -1e4 * x
        state, command = law.step(state, seen, k * 0.005)
        x = x + 0.005 * command.velocity
        forces.append(1e4 * x[3])
    return np.array(forces)


def test_at_the_least_damping_the_force_grows_to_what_stalls_and_never_beyond() -> None:
    least = axis(damping=1.0, stiffness=1e4, inertia=2.0, period=0.005).least_damping[3]
    assert least == pytest.approx(2 * 50 + 2 * math.sqrt(50**2 + 2 * 1e4))
    force = contact_force(least, 200)
    assert np.diff(force).min() > -1e-9
    assert force[-1] == pytest.approx(0.01 * least)
    assert contact_force(0.7 * least, 200).max() > 1.01 * 0.01 * 0.7 * least


@pytest.mark.parametrize("damping", [4.0, 40.0])
def test_in_the_open_it_is_the_mass_on_spring_and_damper(damping: float) -> None:
    params = axis(damping=damping, stiffness=0.0, inertia=2.0, spring=50.0, period=1e-4)
    law, push = AdmittanceLaw(params), np.full(6, 3.0)
    state = law.start()
    p, q = (
        (-damping + sign * cmath.sqrt(damping**2 - 4 * 2.0 * 50.0)) / (2 * 2.0) for sign in (1, -1)
    )
    for k in range(1, 10001):
        state = law.update(state, law.observe({"command": REST, "wrench": push}), 0.0)
        if k % 1000 == 0:
            t = k * 1e-4
            way = 3.0 / 50.0 * (1 + (q * cmath.exp(p * t) - p * cmath.exp(q * t)) / (p - q)).real
            np.testing.assert_allclose(state.displacement, way, rtol=0, atol=3e-5)


def test_without_mass_and_spring_it_is_accommodation() -> None:
    params = AdmittanceParams(damping=(4.0,) * 3 + (1e3,) * 3, centre=(0.005, 0.0, 0.01))
    admits, gives = AdmittanceLaw(params), AccommodationLaw(params)
    drawn, state, other = np.random.default_rng(1), admits.start(), gives.start()
    for k in range(50):
        values = {"command": drawn.normal(size=6), "wrench": drawn.normal(size=6)}
        values["damping"] = drawn.choice([0.0, 4e3, math.inf], 6)
        state, admitted = admits.step(state, admits.observe(values), k * params.period)
        other, given_way = gives.step(other, gives.observe(values), k * params.period)
        for name in gives.outputs:
            np.testing.assert_array_equal(getattr(admitted, name), getattr(given_way, name))


MASSIVE: dict[str, Any] = {
    "damping": (4.0,) * 3 + (2e3,) * 3,
    "inertia": (0.01,) * 3 + (4.0,) * 3,
    "spring": (1.0,) * 3 + (200.0,) * 3,
}


def test_a_centre_is_allowed_where_all_poles_are_real() -> None:
    seen = set()
    for height in np.linspace(0.02, 0.06, 17).tolist():
        centre = (0.0, 0.01, height)
        real = np.abs(poles(AdmittanceParams(**MASSIVE, centre=centre, allow_unstable=True)).imag)
        seen.add(fits := bool(real.max() < 1e-6))
        if fits:
            AdmittanceParams(**MASSIVE, centre=centre)
        else:
            with pytest.raises(ParameterError, match=r"^centre is .* all poles are real and not"):
                AdmittanceParams(**MASSIVE, centre=centre)
    assert seen == {True, False}


def test_too_little_damping_is_refused() -> None:
    bound = r"2 k T \+ 2 sqrt\(k\^2 T\^2 \+ M \(k \+ K\) \+ k K T\^2\) = 889.9"
    with pytest.raises(ParameterError, match=f"^damping of z is 800.0, allowed: at least {bound}"):
        AdmittanceParams(inertia=(0.0,) * 5 + (1.0,))
