"""Shared by the tests of the servo blocks."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

Respond = Callable[[LinearSystem, float, float, NDArray[np.float64]], NDArray[np.float64]]


@pytest.fixture
def respond() -> Respond:
    """Return a function that simulates a block with the input ``start + slope t``."""

    def simulate(
        block: LinearSystem, start: float, slope: float, times: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        builder = DiagramBuilder()
        builder.AddSystem(block)
        end = float(times[-1])
        source = builder.AddSystem(
            TrajectorySource(
                PiecewisePolynomial.FirstOrderHold([0.0, end], [[start, start + slope * end]])
            )
        )
        builder.Connect(source.get_output_port(), block.get_input_port())
        simulator = Simulator(builder.Build())
        ApplySimulatorConfig(
            SimulatorConfig(
                integration_scheme="runge_kutta5", accuracy=1e-11, max_step_size=end / 10
            ),
            simulator,
        )
        context = block.GetMyContextFromRoot(simulator.get_context())
        values = []
        for time in times:
            simulator.AdvanceTo(time)
            values.append(block.get_output_port().Eval(context)[0])
        return np.array(values)

    return simulate
