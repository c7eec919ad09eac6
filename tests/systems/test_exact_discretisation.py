import numpy as np
import pytest
from pydrake.common import RandomDistribution
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Demultiplexer,
    Gain,
    Integrator,
    LinearSystem,
    LogVectorOutput,
    Multiplexer,
    RandomSource,
    Saturation,
    ZeroOrderHold,
)
from scipy.linalg import expm

from chamfer.models.validation import ParameterError
from chamfer.systems.exact_discretisation import count_samples, discretise, fuse, is_linear


def two_by_two() -> LinearSystem:
    generator = np.random.default_rng(3)
    a = generator.normal(size=(3, 3)) - 3 * np.eye(3)
    return LinearSystem(
        A=a,
        B=generator.normal(size=(3, 2)),
        C=generator.normal(size=(2, 3)),
        D=generator.normal(size=(2, 2)),
    )


def split_ports(system: LinearSystem) -> Diagram:
    """The system behind two inputs and two outputs of size one."""
    builder = DiagramBuilder()
    inner = builder.AddSystem(system)
    stack, split = builder.AddSystem(Multiplexer(2)), builder.AddSystem(Demultiplexer(2))
    builder.Connect(stack.get_output_port(), inner.get_input_port())
    builder.Connect(inner.get_output_port(), split.get_input_port())
    for i, name in enumerate(("first", "second")):
        builder.ExportInput(stack.get_input_port(i), f"{name}_in")
        builder.ExportOutput(split.get_output_port(i), f"{name}_out")
    diagram = builder.Build()
    diagram.set_name("two by two")
    return diagram


def test_fuse_recovers_every_matrix() -> None:
    expected = two_by_two()
    fused = fuse(split_ports(two_by_two()))
    for name in "ABCD":
        np.testing.assert_allclose(getattr(fused, name)(), getattr(expected, name)(), atol=1e-12)


def test_discretise_keeps_the_ports_names_and_order() -> None:
    sampled = discretise(split_ports(two_by_two()), 0.1)
    assert [sampled.get_input_port(i).get_name() for i in range(2)] == ["first_in", "second_in"]
    assert [sampled.get_output_port(i).get_name() for i in range(2)] == ["first_out", "second_out"]
    assert sampled.get_name() == "two by two"


@pytest.mark.parametrize("step", [1e-3, 0.1, 2.0])
def test_steps_are_exact_for_constant_inputs_whatever_their_size(step: float) -> None:
    system = two_by_two()
    value = np.array([0.7, -1.3])
    builder = DiagramBuilder()
    sampled = builder.AddSystem(discretise(two_by_two(), step))
    source = builder.AddSystem(ConstantVectorSource(value))
    builder.Connect(source.get_output_port(), sampled.get_input_port(0))
    log = LogVectorOutput(sampled.get_output_port(0), builder, publish_period=step)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(5 * step)
    found = log.FindLog(simulator.get_context()).data()
    big = np.zeros((5, 5))
    big[:3, :3], big[:3, 3:] = system.A(), system.B()
    for i in range(6):
        state = (expm(big * i * step) @ np.concatenate([np.zeros(3), value]))[:3]
        np.testing.assert_allclose(
            found[:, i], system.C() @ state + system.D() @ value, rtol=1e-10, atol=1e-12
        )


def test_a_system_that_is_not_linear_is_refused() -> None:
    builder = DiagramBuilder()
    way, limit = builder.AddSystem(Integrator(1)), builder.AddSystem(Saturation([-0.5], [0.5]))
    builder.Connect(way.get_output_port(), limit.get_input_port())
    builder.ExportInput(way.get_input_port(), "in")
    builder.ExportOutput(limit.get_output_port(), "out")
    with pytest.raises(ParameterError, match="allowed: a linear time-invariant one"):
        fuse(builder.Build())


def random_walk() -> Diagram:
    """Continuous state beside the abstract state of a random source."""
    builder = DiagramBuilder()
    source = builder.AddSystem(RandomSource(RandomDistribution.kGaussian, 1, 0.125))
    walk = builder.AddSystem(Integrator(1))
    builder.Connect(source.get_output_port(), walk.get_input_port())
    builder.ExportOutput(source.get_output_port(), "step")
    builder.ExportOutput(walk.get_output_port(), "walk")
    return builder.Build()


def test_what_is_linear_and_continuous_is_told_from_what_is_not() -> None:
    assert is_linear(two_by_two())
    assert is_linear(split_ports(two_by_two()))
    assert not is_linear(Gain(2.0, 1))  # no state
    assert not is_linear(ZeroOrderHold(0.1, 1))
    assert not is_linear(random_walk())  # Drake aborts where its states are counted
    for system in (random_walk(), ZeroOrderHold(0.1, 1)):
        with pytest.raises(ParameterError, match="allowed: one with continuous state only"):
            fuse(system)


@pytest.mark.parametrize(
    ("duration", "period", "count"),
    [(2.5, 1 / 80, 201), (0.3, 0.1, 3), (0.7, 0.1, 7), (0.8, 0.1, 9), (0.05, 0.1, 1)],
)
def test_samples_up_to_a_duration_are_counted_in_floating_point(
    duration: float, period: float, count: int
) -> None:
    # 3 * 0.1 and 7 * 0.1 are beyond 0.3 and 0.7.
    assert count_samples(duration, period) == count
