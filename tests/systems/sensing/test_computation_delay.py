"""The computation delay: torques that take effect within the period in which they are computed."""

from typing import Any

import numpy as np
import pytest
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput, RandomSource

from chamfer.systems.sensing.computation_delay import ComputationDelay

PERIOD, STEP = 0.005, 0.001


class Ticker(LeafSystem):
    """Puts out 1, 2, 3, ... from its ticks on, as the controller does."""

    def __init__(self) -> None:
        super().__init__()
        count = self.DeclareDiscreteState([0.0])
        self.DeclareStateOutputPort("torque", count)

        def tick(context: Any, state: Any) -> None:
            values = state.get_mutable_discrete_state()
            values.set_value([values.value()[0] + 1])

        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, tick)


class Held(LeafSystem):
    """Holds its input for a step, as the plant does."""

    def __init__(self) -> None:
        super().__init__()
        torque = self.DeclareVectorInputPort("torque", 1)
        self.DeclareStateOutputPort("held", self.DeclareDiscreteState([0.0]))

        def step(context: Any, values: Any) -> None:
            values.set_value(torque.Eval(context))

        self.DeclarePeriodicDiscreteUpdateEvent(STEP, 0.0, step)


def held(delay: float, jitter: float = 0.0, until: float = 0.0505) -> np.ndarray:
    """What the plant holds in each of its steps."""
    builder = DiagramBuilder()
    ticker = builder.AddSystem(Ticker())
    block = builder.AddSystem(
        ComputationDelay(1, delay=delay, jitter=jitter, period=PERIOD, step=STEP)
    )
    plant = builder.AddSystem(Held())
    noise = builder.AddSystem(RandomSource(RandomDistribution.kUniform, 1, PERIOD))
    builder.Connect(ticker.get_output_port(), block.GetInputPort("command"))
    builder.Connect(noise.get_output_port(), block.GetInputPort("jitter"))
    builder.Connect(block.get_output_port(), plant.GetInputPort("torque"))
    logger = LogVectorOutput(plant.get_output_port(), builder, STEP)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(1))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(until)
    found: np.ndarray = logger.FindLog(simulator.get_context()).data()[0, 1:].copy()
    return found


@pytest.mark.parametrize(
    ("delay", "expected"),
    [
        (0.0, [1, 1, 1, 1, 1]),
        (0.002, [0, 0, 1, 1, 1]),
        (0.0025, [0, 0, 0.5, 1, 1]),
        (0.0001, [0.9, 1, 1, 1, 1]),
        (0.005, [0, 0, 0, 0, 0]),
    ],
)
def test_a_torque_waits_for_its_delay(delay: float, expected: list[float]) -> None:
    found = held(delay)
    # 5 steps a period, in the k-th of which the torques k - 1 and k are applied
    for k in range(10):
        np.testing.assert_allclose(found[5 * k : 5 * k + 5] - k, expected, atol=1e-9)


def test_jitter_is_uniform_about_the_delay() -> None:
    # The impulse of each period shows its delay.
    found = held(0.0025, 0.001, until=10.0)
    rows = found[: len(found) // 5 * 5].reshape(-1, 5)
    late = PERIOD - STEP * (rows - np.arange(len(rows))[:, np.newaxis]).sum(axis=1)
    assert late.min() >= 0.0015 - 1e-9
    assert late.max() <= 0.0035 + 1e-9
    assert late.mean() == pytest.approx(0.0025, abs=6e-5)
    assert late.std() == pytest.approx(0.001 / np.sqrt(3), rel=0.05)
