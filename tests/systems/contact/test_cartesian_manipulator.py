"""The manipulator's block against python-control, and how it keeps time."""

import math

import control
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem, LogVectorOutput

from chamfer.models.arms.cartesian_manipulator import CartesianManipulatorParams
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.cartesian_manipulator import make_cartesian_manipulator

PARAMS = CartesianManipulatorParams(mass=2.0, damping=3.0)


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
    mass, damping = PARAMS.mass, PARAMS.damping
    force = [0.0, 0.0]
    force[axis] = 3.0
    found = run(make_cartesian_manipulator(PARAMS, start=(0.0, 0.0), step=step), force, end)
    times = step * np.arange(len(found))
    _, position = control.step_response(control.tf([1.0], [mass, damping, 0.0]), times)
    _, velocity = control.step_response(control.tf([1.0], [mass, damping]), times)
    np.testing.assert_allclose(found[:, axis], 3.0 * position, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found[:, 2 + axis], 3.0 * velocity, rtol=1e-9, atol=1e-12)
    assert not np.any(found[:, [1 - axis, 3 - axis]])


def test_step_of_the_update_does_not_matter() -> None:
    # Exact for a held force: the same at the instants both have.
    coarse = run(make_cartesian_manipulator(PARAMS, start=(0.2, -0.1), step=0.25), [1.0, -4.0], 1)
    fine = run(make_cartesian_manipulator(PARAMS, start=(0.2, -0.1), step=1 / 64), [1.0, -4.0], 1)
    np.testing.assert_allclose(coarse, fine[::16], rtol=1e-12)


def test_is_one_linear_block_at_rest() -> None:
    block = make_cartesian_manipulator(PARAMS, start=(0.25, -0.1), step=0.001)
    assert isinstance(block, LinearSystem)
    assert block.get_name() == "manipulator"
    assert block.time_period() == 0.001
    assert (block.get_input_port().size(), block.get_output_port().size()) == (2, 4)
    assert not block.HasAnyDirectFeedthrough()
    context = block.CreateDefaultContext()
    assert context.num_continuous_states() == 0
    # Position, then velocity.
    np.testing.assert_array_equal(block.get_output_port().Eval(context), [0.25, -0.1, 0, 0])
    context.SetDiscreteState([1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(block.get_output_port().Eval(context), [1.0, 2.0, 3.0, 4.0])


def test_start_is_a_value_of_the_default_context() -> None:
    block = make_cartesian_manipulator(PARAMS, start=(1, -2), step=0.001)
    moved = block.CreateDefaultContext()
    moved.SetDiscreteState(np.ones(4))
    block.SetDefaultContext(moved)
    np.testing.assert_array_equal(block.get_output_port().Eval(moved), [1.0, -2.0, 0, 0])


def test_stays_where_it_is() -> None:
    block = make_cartesian_manipulator(PARAMS, start=(0.25, -0.1), step=0.001)
    np.testing.assert_array_equal(run(block, [0.0, 0.0], 0.05)[-1], [0.25, -0.1, 0.0, 0.0])


def test_three_axes() -> None:
    params = CartesianManipulatorParams(mass=2.0, damping=0.0)
    block = make_cartesian_manipulator(params, start=(1.0, 2.0, 3.0), step=0.5)
    found = run(block, [16.0, 8.0, 4.0], 2.0)[-1]
    np.testing.assert_allclose(found, [17, 10, 7, 16, 8, 4], rtol=1e-14)


def test_closes_a_loop_without_a_delay() -> None:
    builder = DiagramBuilder()
    block = builder.AddSystem(make_cartesian_manipulator(PARAMS, start=(0.0, 0.0), step=0.25))
    gain = builder.AddSystem(LinearSystem(D=-np.hstack([np.eye(2), np.eye(2)])))
    # A spring and a damper, whose force depends on the encoders at once.
    builder.Connect(block.get_output_port(), gain.get_input_port())
    builder.Connect(gain.get_output_port(), block.get_input_port())
    log = LogVectorOutput(block.get_output_port(), builder, 0.25)
    simulator = Simulator(builder.Build())
    simulator.get_mutable_context().SetDiscreteState(0, [1.0, 0.0, 0.0, 0.0])
    simulator.AdvanceTo(0.75)
    found = log.FindLog(simulator.get_context()).data().T
    state = np.array([1.0, 0.0, 0.0, 0.0])
    for logged in found:
        np.testing.assert_allclose(logged, state, rtol=0, atol=1e-14)
        state = block.A() @ state - block.B() @ (state[:2] + state[2:])


@pytest.mark.parametrize("start", [(0.0,), (0.0,) * 4, (0.0, math.nan), (math.inf, 0.0)], ids=str)
def test_start_has_to_fit(start: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError) as caught:
        make_cartesian_manipulator(PARAMS, start=start, step=0.001)
    assert str(caught.value) == f"start is {start}, allowed: 2 or 3 finite numbers"


@pytest.mark.parametrize("step", [0.0, -0.001, math.nan, math.inf])
def test_step_has_to_be_positive(step: float) -> None:
    # A period of 0 would be a continuous system with the wrong matrices.
    with pytest.raises(ParameterError, match=rf"^step is {step}, allowed: a finite number > 0$"):
        make_cartesian_manipulator(PARAMS, start=(0.0, 0.0), step=step)
