"""Desired trajectories as blocks, against the functions of time that they are."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

from chamfer.systems.servo.desired_trajectory import Sinusoid, Step, make_desired_trajectory


def values(trajectory: Step | Sinusoid, times: np.ndarray) -> np.ndarray:
    block = make_desired_trajectory(trajectory)
    simulator = Simulator(block)
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="runge_kutta5", accuracy=1e-11, max_step_size=0.1),
        simulator,
    )
    output = []
    for time in times:
        simulator.AdvanceTo(time)
        output.append(block.get_output_port().Eval(simulator.get_context())[0])
    return np.array(output)


@pytest.mark.parametrize("amplitude", [1.0, -0.25, 0.0])
def test_step_is_constant_from_the_start(amplitude: float) -> None:
    assert values(Step(amplitude=amplitude), np.linspace(0, 3, 7)).tolist() == [amplitude] * 7


@pytest.mark.parametrize(("amplitude", "frequency"), [(1.0, 1.0), (-0.2, 7.0), (3.0, 0.1)])
def test_sinusoid_is_a_sine(amplitude: float, frequency: float) -> None:
    times = np.linspace(0.0, 4.0, 33)
    np.testing.assert_allclose(
        values(Sinusoid(amplitude=amplitude, frequency=frequency), times),
        amplitude * np.sin(frequency * times),
        atol=1e-8 * abs(amplitude),
    )


@pytest.mark.parametrize("trajectory", [Step(), Sinusoid()], ids=["step", "sinusoid"])
def test_is_an_undriven_linear_block(trajectory: Step | Sinusoid) -> None:
    block = make_desired_trajectory(trajectory)
    assert block.get_name() == "desired trajectory"
    assert block.num_input_ports() == 0
    assert block.get_output_port().size() == 1
    assert np.all(np.linalg.eigvals(block.A()).real == 0.0)


def test_fresh_contexts_start_again() -> None:
    block = make_desired_trajectory(Sinusoid(amplitude=2.0, frequency=3.0))
    used = Simulator(block)
    used.AdvanceTo(1.0)
    fresh = block.CreateDefaultContext()
    assert block.get_output_port().Eval(fresh)[0] == 0.0
    assert block.get_output_port().Eval(used.get_context())[0] == pytest.approx(
        2 * math.sin(3.0), abs=1e-3
    )


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("kind", [Step, Sinusoid])
def test_amplitude_has_to_be_finite(kind: type[Step] | type[Sinusoid], value: float) -> None:
    with pytest.raises(ValueError, match=rf"^amplitude is {value}, allowed: a finite number$"):
        kind(amplitude=value)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_frequency_has_to_be_positive(value: float) -> None:
    with pytest.raises(ValueError, match=rf"^frequency is {value}, allowed: a finite number > 0$"):
        Sinusoid(frequency=value)
