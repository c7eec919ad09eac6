"""The closed loop's closed forms are those of the difference equations in the module's docstring:
without delay f' = (1 - kappa) f, with one sample of delay z^2 - z + kappa = 0."""

import cmath
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Integrator,
    LogVectorOutput,
    ZeroOrderHold,
)
from scipy.optimize import brentq

from chamfer.models.validation import ParameterError
from chamfer.systems.contact.spring_constraint import SpringConstraint, SpringConstraintParams
from chamfer.systems.force.accommodation import AccommodationController
from chamfer.systems.force.accommodation_law import AccommodationParams

Array = NDArray[np.float64]

PERIOD = 1 / 64  # s, binary, so that the ticks' times are exact
DAMPING = 800.0  # N s/m
SPEED = 0.01  # m/s


def params(kappa: float = 0.25, **changes: Any) -> AccommodationParams:
    fields: dict[str, Any] = {
        "damping": (2.0, 2.0, 2.0, DAMPING, DAMPING, DAMPING),
        "stiffness": (1.0, 1.0, 1.0) + 3 * (kappa * DAMPING / PERIOD,),
        "period": PERIOD,
    }
    return AccommodationParams(**{**fields, **changes})


SIX = st.tuples(*[st.floats(-50, 50)] * 6)


def test_a_damping_that_is_set_takes_the_place_of_the_controllers_own() -> None:
    block = AccommodationController(params())
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("command").FixValue(context, np.full(6, 0.1))
    block.GetInputPort("wrench").FixValue(context, np.full(6, 8.0))
    found = []
    for damping in ([0, 0, 4.0, math.inf, 0, 1600.0], np.zeros(6)):
        block.GetInputPort("damping").FixValue(context, damping)
        simulator.AdvanceTo(context.get_time() + PERIOD)
        found.append(block.GetOutputPort("velocity").Eval(context).copy())
    np.testing.assert_allclose(found[0], [4.1, 4.1, 2.1, 0.1, 0.11, 0.105])
    np.testing.assert_allclose(found[1], [4.1, 4.1, 4.1, 0.11, 0.11, 0.11])
    block.GetInputPort("damping").FixValue(context, [0, 0, 0, 0, 0, 790.0])
    with pytest.raises(ParameterError, match=r"^damping of z is 790"):
        simulator.AdvanceTo(context.get_time() + PERIOD)


def contact_force(kappa: float, ticks: int, *, delayed: bool) -> Array:
    """Force of a tool on a spring along x at the ticks, N, shape (ticks + 1,); pressed > 0."""
    settings = params(kappa, allow_unstable=True)
    builder = DiagramBuilder()
    command = builder.AddSystem(ConstantVectorSource([0, 0, 0, SPEED, 0, 0]))
    block = builder.AddSystem(AccommodationController(settings))
    carriage = builder.AddSystem(Integrator(6))
    spring = builder.AddSystem(
        SpringConstraint(SpringConstraintParams(index=3, stiffness=settings.stiffness[3]))
    )
    builder.Connect(command.get_output_port(), block.GetInputPort("command"))
    builder.Connect(block.GetOutputPort("velocity"), carriage.get_input_port())
    builder.Connect(carriage.get_output_port(), spring.get_input_port())
    wrench = spring.get_output_port()
    if delayed:
        hold = builder.AddSystem(ZeroOrderHold(PERIOD, 6))
        builder.Connect(wrench, hold.get_input_port())
        wrench = hold.get_output_port()
    builder.Connect(wrench, block.GetInputPort("wrench"))
    log = LogVectorOutput(spring.get_output_port(), builder, publish_period=PERIOD)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(ticks * PERIOD)
    found: Array = -log.FindLog(simulator.get_context()).data()[3]
    return found


@pytest.mark.parametrize("kappa", [0.1, 0.5, 1.0, 1.5, 2.2])
def test_without_delay_the_force_follows_the_closed_form(kappa: float) -> None:
    k = np.arange(31)
    expected = DAMPING * SPEED * (1 - (1 - kappa) ** k)
    found = contact_force(kappa, 30, delayed=False)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def delayed_form(kappa: float, ticks: int) -> Array:
    """f of z^2 - z + kappa = 0 from 0 and kappa D v: nothing is felt at the first tick."""
    stall = DAMPING * SPEED
    k = np.arange(ticks + 1)
    if kappa == 0.25:  # a double root, 1/2; e_0 = -1, e_1 = kappa - 1
        return stall * (1 - (1 + 0.5 * k) * 0.5**k)
    root = cmath.sqrt(1 - 4 * kappa)
    p, q = (1 + root) / 2, (1 - root) / 2
    a = ((kappa - 1) + q) / (p - q)  # e_k = a p^k + b q^k
    b = -1 - a
    return stall * np.real(1 + a * p**k + b * q**k)


@pytest.mark.parametrize("kappa", [0.1, 0.25, 0.5, 0.95, 1.1])
def test_with_a_sample_of_delay_the_force_follows_the_closed_form(kappa: float) -> None:
    found = contact_force(kappa, 30, delayed=True)
    np.testing.assert_allclose(found, delayed_form(kappa, 30), rtol=1e-9, atol=1e-9)


FREE = (0.0,) * 6  # stiffness that no centre is too far for
CENTRES = st.tuples(*[st.floats(-0.2, 0.2)] * 3)


def velocity_at(point: Any, v: Array) -> Array:
    """Linear velocity of a point of the tool that moves with v at the reference point."""
    found: Array = v[3:] + np.cross(v[:3], point)
    return found


@given(centre=CENTRES, wrench=SIX, damping=st.tuples(*[st.floats(1, 1e4)] * 6))
def test_at_a_remote_centre_the_damping_is_diagonal(
    centre: tuple[float, ...], wrench: tuple[float, ...], damping: tuple[float, ...]
) -> None:
    remote = params(damping=damping, stiffness=FREE, centre=centre)
    v = remote.mobility @ wrench
    torque, force = np.array(wrench[:3]), np.array(wrench[3:])
    at_centre = torque - np.cross(centre, force)  # the same wrench, about the centre
    np.testing.assert_allclose(v[:3], at_centre / damping[:3], atol=1e-9)
    np.testing.assert_allclose(velocity_at(centre, v), force / damping[3:], atol=1e-9)


def far(height: float, **changes: Any) -> AccommodationParams:
    """Of an axis along x with k T / D = 0.1, and about y of 0.05."""
    stiffness = (0.05 * 2 / PERIOD,) * 3 + (0.1 * DAMPING / PERIOD,) * 3
    return params(stiffness=stiffness, centre=(0.0, 0.0, height), **changes)


def largest_eigenvalue(height: float) -> float:
    """Of T D^-1 K about y and along x, by trace and determinant."""
    k_r, k_x = 0.05 * 2 / PERIOD, 0.1 * DAMPING / PERIOD
    # The mobility about y, across, and along x.
    m_r, m_c, m_x = 1 / 2, -height / 2, 1 / DAMPING + height**2 / 2
    trace = PERIOD * (m_r * k_r + m_x * k_x)
    det = PERIOD**2 * (m_r * m_x - m_c**2) * k_r * k_x
    return trace / 2 + math.sqrt(trace**2 / 4 - det)


def test_a_centre_too_far_is_refused_by_the_largest_eigenvalue() -> None:
    bound = brentq(lambda height: largest_eigenvalue(height) - 0.25, 0.0, 0.1)
    far(bound * 0.999)
    far(-bound * 0.999)
    height = bound * 1.2
    with pytest.raises(ParameterError) as refused:
        far(height)
    assert str(refused.value) == (
        f"centre is (0.0, 0.0, {height}), allowed: one with which the largest eigenvalue of "
        f"T D^-1 K, here {largest_eigenvalue(height):.3g}, is at most 0.25"
    )
    far(height, allow_unstable=True)
