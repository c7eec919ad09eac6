"""Exact stepping of linear diagrams.

A linear time-invariant diagram is fused into one system and discretised with the matrix
exponential. At the steps this is exact for inputs that are constant between them, at any step and
stiffness. Block by block it would add a step of delay at every block.
"""

from collections.abc import Iterator

import numpy as np
from pydrake.systems.analysis import DiscreteTimeApproximation
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    InputPortSelection,
    OutputPortIndex,
    System,
)
from pydrake.systems.primitives import (
    Adder,
    Demultiplexer,
    Gain,
    Linearize,
    LinearSystem,
    MatrixGain,
    Multiplexer,
)

from chamfer.models.validation import ParameterError

_LINEAR_BLOCKS = (LinearSystem, Adder, Gain, MatrixGain, Multiplexer, Demultiplexer)


def is_linear(system: System) -> bool:
    """Return whether a system has continuous state only and consists of Drake's linear blocks."""
    states = system.CreateDefaultContext()
    if states.num_abstract_states() or not states.num_continuous_states():
        return False
    return bool(states.num_continuous_states() == states.num_total_states()) and all(
        isinstance(block, _LINEAR_BLOCKS) for block in blocks(system)
    )


def blocks(system: System) -> Iterator[System]:
    """Yield the blocks of a system that have none inside."""
    if isinstance(system, Diagram):
        for inner in system.GetSystems():
            yield from blocks(inner)
    else:
        yield system


def fuse(system: System) -> LinearSystem:
    """Return a linear continuous system as one block.

    All vector inputs are stacked into one input and all outputs into one output, in the order of
    the ports. The default state is kept.

    Raises:
        ParameterError: If the system has discrete or abstract state, or proves not to be linear
            and time-invariant.
    """
    context = system.CreateDefaultContext()
    states = context.num_continuous_states()
    if context.num_abstract_states() or states == 0 or context.num_total_states() != states:
        raise ParameterError("system", system.get_name(), "one with continuous state only")
    initial = context.get_continuous_state_vector().CopyToVector()
    context.SetContinuousState(np.zeros_like(initial))
    inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
    for port in inputs:
        port.FixValue(context, np.zeros(port.size()))
    selections = [port.get_index() for port in inputs] or [InputPortSelection.kNoInput]
    blocks = [
        [
            Linearize(system, context, selection, OutputPortIndex(output))
            for selection in selections
        ]
        for output in range(system.num_output_ports())
    ]
    fused = LinearSystem(
        A=blocks[0][0].A(),
        B=np.hstack([block.B() for block in blocks[0]]),
        C=np.vstack([row[0].C() for row in blocks]),
        D=np.vstack([np.hstack([block.D() for block in row]) for row in blocks]),
    )
    if not _agrees(system, context, fused):
        raise ParameterError("system", system.get_name(), "a linear time-invariant one")
    fused.configure_default_state(initial)
    fused.set_name(system.get_name())
    return fused


def _agrees(system: System, context: Context, fused: LinearSystem) -> bool:
    """Compare the two at an arbitrary time, state and input."""
    state, value = (
        np.sin(1.0 + np.arange(fused.A().shape[0])),
        np.cos(np.arange(fused.B().shape[1])),
    )
    context.SetTime(1.0)
    context.SetContinuousState(state)
    first = 0
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        port.FixValue(context, value[first : first + port.size()])
        first += port.size()
    outputs = np.concatenate(
        [system.get_output_port(i).Eval(context) for i in range(system.num_output_ports())]
    )
    derivatives = system.EvalTimeDerivatives(context).CopyToVector()
    return np.allclose(outputs, fused.C() @ state + fused.D() @ value) and np.allclose(
        derivatives, fused.A() @ state + fused.B() @ value
    )


def count_samples(duration: float, period: float) -> int:
    """Return how many multiples of the period, zero included, are within the duration."""
    count = int(duration / period)
    return count + 1 + int((count + 1) * period <= duration) - int(count * period > duration)


def discretise(system: System, period: float) -> Diagram:
    """Return a diagram with the same ports that takes exact steps of ``period`` s.

    It can take the place of ``system`` in any diagram: ports keep their names and order, the
    state starts from the same value.
    """
    fused = fuse(system)
    sampled = DiscreteTimeApproximation(fused, period)
    initial = fused.CreateDefaultContext().get_continuous_state_vector().CopyToVector()
    sampled.configure_default_state(initial)
    sampled.set_name(f"{system.get_name()}, exact")
    builder = DiagramBuilder()
    builder.AddSystem(sampled)
    inputs = [system.get_input_port(i) for i in range(system.num_input_ports())]
    outputs = [system.get_output_port(i) for i in range(system.num_output_ports())]
    if len(inputs) == 1:
        builder.ExportInput(sampled.get_input_port(), inputs[0].get_name())
    elif inputs:
        stack = builder.AddNamedSystem("inputs", Multiplexer([port.size() for port in inputs]))
        builder.Connect(stack.get_output_port(), sampled.get_input_port())
        for i, port in enumerate(inputs):
            builder.ExportInput(stack.get_input_port(i), port.get_name())
    if len(outputs) == 1:
        builder.ExportOutput(sampled.get_output_port(), outputs[0].get_name())
    else:
        split = builder.AddNamedSystem("outputs", Demultiplexer([port.size() for port in outputs]))
        builder.Connect(sampled.get_output_port(), split.get_input_port())
        for i, port in enumerate(outputs):
            builder.ExportOutput(split.get_output_port(i), port.get_name())
    diagram = builder.Build()
    diagram.set_name(system.get_name())
    return diagram
