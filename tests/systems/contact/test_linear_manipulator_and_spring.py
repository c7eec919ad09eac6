"""The Cartesian manipulator and the spring that constrains a tool."""

import math
from typing import Any

import control
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import LinearSystem

from chamfer.models.arms.cartesian_manipulator import CartesianManipulatorParams
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator
from chamfer.systems.contact.spring_constraint import SpringConstraint, SpringConstraintParams

MANIPULATOR = CartesianManipulatorParams(mass=2.0, damping=3.0)


def run(block: LinearSystem, force: list[float], end: float) -> np.ndarray:
    """Return the outputs at multiples of the period, before the update of that instant."""
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.get_input_port().FixValue(context, force)
    found, step = [], block.time_period()
    for k in range(round(end / step) + 1):
        if k > 0:
            simulator.AdvanceTo(k * step)
        found.append(block.get_output_port().Eval(context).copy())
    return np.array(found)


@pytest.mark.parametrize("axis", [0, 1])
def test_step_response(axis: int) -> None:
    step, end = 0.001, 2.0
    mass, damping = MANIPULATOR.mass, MANIPULATOR.damping
    force, start = [0.0, 0.0], (0.25, -0.1)
    force[axis] = 3.0
    block = make_cartesian_manipulator(MANIPULATOR, start=start, step=step)
    assert not block.HasAnyDirectFeedthrough()
    found = run(block, force, end) - [*start, 0.0, 0.0]
    times = step * np.arange(len(found))
    _, position = control.step_response(control.tf([1.0], [mass, damping, 0.0]), times)
    _, velocity = control.step_response(control.tf([1.0], [mass, damping]), times)
    np.testing.assert_allclose(found[:, axis], 3.0 * position, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found[:, 2 + axis], 3.0 * velocity, rtol=1e-9, atol=1e-12)
    assert not np.any(found[:, [1 - axis, 3 - axis]])


def wrench(displacement: dict[int, float], **params: Any) -> list[float]:
    block = SpringConstraint(SpringConstraintParams(**params))
    context = block.CreateDefaultContext()
    value = np.zeros(6)
    for index, x in displacement.items():
        value[index] = x
    block.GetInputPort("displacement").FixValue(context, value)
    found: list[float] = block.GetOutputPort("wrench").Eval(context).tolist()
    return found


@pytest.mark.parametrize(
    ("sides", "x", "force"),
    [
        ("both", 0.002, -2.0),
        ("both", -0.002, 2.0),
        ("one", 0.002, -2.0),
        ("one", -0.002, 0.0),
        ("none", 0.002, 0.0),
        ("none", -0.002, 0.0),
    ],
)
@pytest.mark.parametrize("index", [0, 3, 5])
def test_it_pushes_back_along_its_axis_on_its_sides(
    index: int, sides: str, x: float, force: float
) -> None:
    found = wrench({index: x, (index + 1) % 6: 0.5}, index=index, sides=sides, stiffness=1000.0)
    expected = np.zeros(6)
    expected[index] = force
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize(("x", "force"), [(0.0005, 0.0), (0.001, 0.0), (0.003, -2.0), (-1.0, 0.0)])
def test_a_stop_begins_where_it_is(x: float, force: float) -> None:
    found = wrench({3: x}, index=3, sides="one", stiffness=1000.0, stop_at=0.001)
    assert found[3] == pytest.approx(force, abs=1e-12)


@pytest.mark.parametrize("sides", ["none", "both", "one"])
def test_a_displacement_that_is_not_finite_is_named(sides: str) -> None:
    with pytest.raises(ParameterError, match="displacement is nan, allowed: a finite number"):
        wrench({3: math.nan}, index=3, sides=sides)
