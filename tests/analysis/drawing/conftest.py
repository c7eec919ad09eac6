"""Diagrams and charts of the kind that the project draws."""

import pytest
from pydrake.systems.framework import Diagram

from chamfer.diagrams.servo.servo_loops import make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import STEP, resolve
from chamfer.systems.statechart.chart import ANY, Chart, State, Transition

AnyChart = Chart[None, None]


@pytest.fixture(scope="package")
def loops() -> Diagram:
    """Two unconnected loops, the first without a stiffness, the second with one."""
    return make_servo_diagram(resolve(STEP))


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
