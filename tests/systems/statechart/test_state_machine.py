"""The state machine block: when it ticks, what it reads, and what its context holds."""

import math
from collections.abc import Callable
from typing import NamedTuple

import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.law import Signal
from chamfer.systems.statechart.chart import Chart, State, Tick, Transition, TransitionRecord
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput
from chamfer.systems.statechart.state_machine import StateMachine

Vector = tuple[float, ...]


class Inputs(NamedTuple):
    signal: Vector
    request: Vector | None


class Memory(NamedTuple):
    ticks: tuple[float, ...]  # s
    last: Inputs | None
    command: float


Block = StateMachine[Inputs, Memory]
INITIAL = Memory((), None, -7.0)


def remember(tick: Tick[Inputs, Memory]) -> Memory:
    return Memory((*tick.memory.ticks, tick.time), tick.inputs, 10 * tick.inputs.signal[0])


def way(
    source: str, target: str, label: str, holds: Callable[[float], bool]
) -> Transition[Inputs, Memory]:
    return Transition(
        source=source,
        target=target,
        label=label,
        guard=lambda tick: holds(tick.inputs.signal[0]),
    )


def make_block(*, period: float = 0.25, size: int = 1) -> Block:
    """Return a block: ``high`` above a signal of 1, else ``low``; commands ten times it."""
    chart = Chart(
        "level",
        states=[State(name="low", during=remember), State(name="high", during=remember)],
        transitions=[
            way("low", "high", "above 1", lambda signal: signal > 1),
            way("low", "high", "above 2", lambda signal: signal > 2),
            way("high", "low", "not above 1", lambda signal: signal <= 1),
        ],
        memory=INITIAL,
    )
    return StateMachine(
        ChartLaw(
            chart,
            observation=Inputs,
            inputs={"signal": Signal(size), "request": Signal(2, optional=True)},
            outputs={"command": MachineOutput(size=1, read=lambda memory: (memory.command,))},
            period=period,
        )
    )


def advance(simulator: Simulator, time: float) -> None:
    """Advance to a time and run the events of that instant."""
    simulator.AdvanceTo(time)
    simulator.AdvancePendingEvents()


def fed(block: Block, value: float) -> Simulator:
    simulator = Simulator(block)
    block.GetInputPort("signal").FixValue(simulator.get_mutable_context(), [value])
    return simulator


def test_ticks_at_its_period() -> None:
    block = make_block(period=1 / 80)
    simulator = fed(block, 0.0)
    simulator.AdvanceTo(0.999)
    ticks = block.snapshot(simulator.get_context()).memory.ticks
    assert ticks == pytest.approx([k / 80 for k in range(80)], rel=1e-14)


@pytest.mark.parametrize("steps", [1, 4], ids=["same period", "four plant steps a tick"])
def test_plant_of_the_same_instant_sees_the_new_output(steps: int) -> None:
    period, decay, gain, count = 1 / 80, 0.9, 0.35, 60

    class Error(NamedTuple):
        signal: Vector

    def act(tick: Tick[Error, float]) -> float:
        return tick.memory + (0.1 if tick.inputs.signal[0] < 1.0 else -0.07)

    builder = DiagramBuilder()
    machine = builder.AddSystem(
        StateMachine(
            ChartLaw(
                Chart("relay", states=[State(name="on", during=act)], transitions=[], memory=0.0),
                observation=Error,
                inputs={"signal": Signal()},
                outputs={"command": MachineOutput(size=1, read=lambda memory: (memory,))},
                period=period,
            )
        )
    )
    plant = builder.AddSystem(
        LinearSystem(A=[[decay]], B=[[gain]], C=[[1.0]], D=[[0.0]], time_period=period / steps)
    )
    builder.Connect(plant.get_output_port(), machine.GetInputPort("signal"))
    builder.Connect(machine.GetOutputPort("command"), plant.get_input_port())
    simulator = Simulator(builder.Build())
    context = plant.GetMyContextFromRoot(simulator.get_context())

    output, command = 0.0, 0.0
    for k in range(count):
        command += 0.1 if output < 1.0 else -0.07
        for step in range(steps):
            output = decay * output + gain * command
            advance(simulator, (k + step / steps) * period)
            assert plant.get_output_port().Eval(context)[0] == pytest.approx(output, rel=1e-12)


def test_clone_continues_on_its_own() -> None:
    block = make_block()
    original = fed(block, 0.5)
    advance(original, 0.6)
    clone = Simulator(block, original.get_context().Clone())
    block.GetInputPort("signal").FixValue(clone.get_mutable_context(), [3.0])
    advance(clone, 1.0)
    advance(original, 1.0)

    alone = fed(make_block(), 0.5)
    advance(alone, 1.0)
    assert block.snapshot(original.get_context()) == block.snapshot(alone.get_context())
    assert block.transitions(original.get_context()) == ()
    continued = block.snapshot(clone.get_context())
    assert (continued.state, continued.entered_at) == ("high", 0.75)
    assert continued.memory.ticks == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert [record.time for record in block.transitions(clone.get_context())] == [0.75]


def test_log_holds_time_states_guards_and_inputs_oldest_first() -> None:
    block = make_block()
    simulator = fed(block, 0.5)
    port = block.GetInputPort("signal")
    for time, value in ((0.0, 0.5), (0.25, 2.5), (0.5, 2.5), (0.75, 0.0), (1.0, 1.5)):
        simulator.AdvanceTo(time)
        port.FixValue(simulator.get_mutable_context(), [value])
        simulator.AdvancePendingEvents()
        assert block.GetOutputPort("state").Eval(simulator.get_context())[0] == (value > 1)
    assert block.transitions(simulator.get_context()) == (
        TransitionRecord(0.25, "low", "high", "above 1", Inputs((2.5,), None), ("above 2",)),
        TransitionRecord(0.75, "high", "low", "not above 1", Inputs((0.0,), None), ()),
        TransitionRecord(1.0, "low", "high", "above 1", Inputs((1.5,), None), ()),
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"period": 0.0}, r"period is 0\.0, allowed: a finite number > 0"),
        ({"period": math.inf}, "period is inf, allowed: a finite number > 0"),
        ({"inputs": {"signal": Signal()}}, "inputs is .*, allowed: one for each of signal, req"),
        ({"inputs": {"signal": Signal(-1), "request": Signal()}}, "size of signal is -1, allowed"),
        (
            {"inputs": {"signal": Signal(2, ("m",)), "request": Signal()}},
            "units of signal is .*or 2",
        ),
        (
            {"outputs": {"pair": MachineOutput(size=0, read=lambda memory: ())}},
            "size of pair is 0, allowed: a whole number",
        ),
        (
            {"outputs": {"state": MachineOutput(size=1, read=lambda memory: (0.0,))}},
            r"outputs is \['state'\], allowed: names other than state",
        ),
    ],
)
def test_rejects(changes: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {
        "inputs": {"signal": Signal(), "request": Signal()},
        "outputs": {},
        "period": 1.0,
        **changes,
    }
    with pytest.raises(ParameterError, match=f"^{message}"):
        ChartLaw(
            Chart("c", states=[State(name="a")], transitions=[], memory=None),
            observation=Inputs,
            **arguments,  # type: ignore[arg-type]
        )
