"""Diagrams and charts of the kind that the project draws."""

from collections.abc import Callable, Sequence
from typing import Any

import pytest
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Adder, Gain, LogVectorOutput, Multiplexer

from chamfer.systems.statechart.chart import ANY, Chart, State, Transition

AnyChart = Chart[None, None]


class Block(LeafSystem):
    """A block of which only the ports matter."""

    def __init__(self, inputs: Sequence[str], output: str) -> None:
        super().__init__()
        for name in inputs:
            self.DeclareVectorInputPort(name, 1)
        self.DeclareVectorOutputPort(output, 1, self._calc, {self.nothing_ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, 0.0)


def make_plant(*, stiffness: bool) -> Diagram:
    builder = DiagramBuilder()
    balance = builder.AddNamedSystem("force balance", Adder(2, 1))
    motion = builder.AddNamedSystem("impedance control A(s)", Block(["u0"], "y0"))
    environment = builder.AddNamedSystem("environment B(s)", Block(["u0"], "y0"))
    minus = builder.AddNamedSystem("minus", Gain(-1.0, 1))
    builder.Connect(balance.get_output_port(), motion.get_input_port())
    builder.Connect(motion.get_output_port(), environment.get_input_port())
    builder.Connect(environment.get_output_port(), minus.get_input_port())
    builder.Connect(minus.get_output_port(), balance.get_input_port(1))
    entry = balance.get_input_port(0)
    if stiffness:
        gain = builder.AddNamedSystem("stiffness K_p", Gain(700.0, 1))
        builder.Connect(gain.get_output_port(), entry)
        entry = gain.get_input_port()
    builder.ExportInput(entry, "command")
    builder.ExportOutput(motion.get_output_port(), "actual_trajectory")
    return builder.Build()


def make_loop(controller: str, *, stiffness: bool) -> Diagram:
    builder = DiagramBuilder()
    desired = builder.AddNamedSystem("desired trajectory", Block([], "desired_trajectory"))
    vision = builder.AddNamedSystem(
        "computer vision", Block(["desired_trajectory", "actual_trajectory"], "error")
    )
    control = builder.AddNamedSystem(controller, Block(["error"], "force"))
    plant = builder.AddNamedSystem("plant", make_plant(stiffness=stiffness))
    builder.Connect(desired.get_output_port(), vision.GetInputPort("desired_trajectory"))
    builder.Connect(plant.get_output_port(), vision.GetInputPort("actual_trajectory"))
    builder.Connect(vision.get_output_port(), control.get_input_port())
    builder.Connect(control.get_output_port(), plant.get_input_port())
    mux = builder.AddSystem(Multiplexer(2))
    builder.Connect(control.get_output_port(), mux.get_input_port(0))
    builder.Connect(plant.get_output_port(), mux.get_input_port(1))
    LogVectorOutput(mux.get_output_port(), builder)
    builder.ExportOutput(plant.get_output_port(), "actual trajectory")
    return builder.Build()


@pytest.fixture(scope="package")
def loops() -> Diagram:
    """Two unconnected loops, the first without a stiffness, the second with one."""
    builder = DiagramBuilder()
    builder.AddNamedSystem("PID loop", make_loop("PID", stiffness=False))
    builder.AddNamedSystem("FSM loop", make_loop("state machine", stiffness=True))
    diagram = builder.Build()
    diagram.set_name("FSM against PID")
    return diagram


def transition(source: str, target: str, label: str) -> Transition[None, None]:
    return Transition(source=source, target=target, label=label, guard=lambda _: True)


@pytest.fixture
def compensator() -> AnyChart:
    """A chart in which every transition comes from any state."""
    return Chart(
        "compensator",
        states=[
            State(name="next_desired_position"),
            State(name="aligned"),
            State(name="modify_compensation"),
            State(name="hold"),
            State(name="trajectory_ended", outcome="done"),
        ],
        transitions=[
            transition(ANY, "trajectory_ended", "trajectory ended"),
            transition(ANY, "hold", "no valid measurement"),
            transition(ANY, "modify_compensation", "error outside the dead zone"),
            transition(ANY, "aligned", "error inside the dead zone"),
        ],
        memory=None,
    )


@pytest.fixture
def axis() -> AnyChart:
    """A chart with a pair of opposite transitions, a loop, a timeout and both outcomes."""
    return Chart(
        "axis",
        states=[
            State(name="idle"),
            State(name="moving", timeout=5.0, on_timeout="fault"),
            State(name="settling"),
            State(name="arrived", outcome="done"),
            State(name="fault", outcome="failed"),
        ],
        transitions=[
            transition("idle", "moving", "command"),
            transition("moving", "settling", "near the goal"),
            transition("moving", "moving", "new goal"),
            transition("settling", "moving", "overshoot"),
            transition("settling", "arrived", "settled"),
        ],
        memory=None,
    )


@pytest.fixture
def build() -> Callable[[Callable[[DiagramBuilder], Any]], Diagram]:
    """Build a diagram from what a function adds to a builder."""

    def make(add: Callable[[DiagramBuilder], Any]) -> Diagram:
        builder = DiagramBuilder()
        add(builder)
        diagram = builder.Build()
        diagram.set_name("root")
        return diagram

    return make
