"""The block that runs one primitive: what it shows it, and what it makes of what it says."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.primitive import (
    EVENTS,
    STILL,
    Event,
    Observation,
    PrimitiveRunner,
    Stepped,
)

UP = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Counting:
    """Goes up, says what it was shown, ends after some ticks."""

    ticks: int = 5
    event: Event = "contact"
    velocity: tuple[float, ...] = UP
    shown: list[tuple[Observation, float]] = field(default_factory=list)
    label: str = "count"
    events: ClassVar[Mapping[Event, float]] = dict.fromkeys(EVENTS, 0.0)

    def begin(self, sensed: Observation) -> object:
        self.shown.append((sensed, -1.0))
        return 0

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        assert isinstance(memory, int)
        self.shown.append((sensed, time))
        event = self.event if memory + 1 == self.ticks else None
        return Stepped(memory + 1, self.velocity, event)


def loop(primitive: Any, connected: dict[str, Any], **settings: Any) -> tuple[Any, Any, Any]:
    builder = DiagramBuilder()
    block = builder.AddSystem(PrimitiveRunner(primitive, **settings))
    for name, value in connected.items():
        source = builder.AddSystem(ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    return simulator, block, block.GetMyMutableContextFromRoot(simulator.get_mutable_context())


HERE = {"carriage": np.arange(6.0)}


def test_it_runs_the_primitive_until_its_event_and_then_stands_still() -> None:
    primitive = Counting()
    simulator, block, context = loop(primitive, HERE, period=0.1)
    velocity, event = (block.GetOutputPort(name) for name in ("velocity", "event"))
    simulator.Initialize()
    assert velocity.Eval(context).tolist() == list(STILL)
    for time in (0.05, 0.35):
        simulator.AdvanceTo(time)
        assert velocity.Eval(context).tolist() == list(UP)
        assert event.Eval(context).tolist() == [0.0]
        assert block.event(context) is None
    for time in (0.45, 0.95):
        simulator.AdvanceTo(time)
        assert velocity.Eval(context).tolist() == list(STILL)
        assert event.Eval(context).tolist() == [1.0 + EVENTS.index("contact")]
        assert block.event(context) == "contact"
    assert [time for _, time in primitive.shown] == pytest.approx([-1, 0, 0.1, 0.2, 0.3, 0.4])


def test_what_a_primitive_is_shown() -> None:
    primitive = Counting(ticks=100)
    simulator, _, _ = loop(primitive, HERE)
    simulator.AdvanceTo(0.015)
    (begun, _), (first, _), (second, _) = primitive.shown
    assert begun == first
    assert first == Observation(tuple(range(6)), STILL, STILL)
    assert second == Observation(tuple(range(6)), UP, STILL)  # nothing perturbs the command

    primitive = Counting(ticks=100)
    everything = {
        **HERE,
        "motion": np.full(6, 1.0),
        "wrench": np.full(6, 2.0),
        "xz_detections": np.full(18, 3.0),
        "yz_detections": np.full(18, 4.0),
        "cross_section": np.full(8, 5.0),
    }
    simulator, _, _ = loop(primitive, everything, parts=3)
    simulator.AdvanceTo(0.005)
    expected = {name: tuple(value.tolist()) for name, value in everything.items()}
    assert primitive.shown[0][0] == Observation(**expected)


def test_another_primitive_begins_anew() -> None:
    first, second = Counting(ticks=2), Counting(ticks=2, event="lost", velocity=(0.5,) * 6)
    simulator, block, context = loop(first, HERE, period=0.1)
    simulator.AdvanceTo(0.25)
    assert block.event(context) == "contact"
    block.set_primitive(context, second)
    simulator.AdvanceTo(0.35)
    assert block.event(context) is None
    assert block.GetOutputPort("velocity").Eval(context).tolist() == [0.5] * 6
    simulator.AdvanceTo(0.45)
    assert block.event(context) == "lost"
    assert [time for _, time in second.shown] == pytest.approx([-1, 0, 0.1])


def test_contexts_do_not_share_what_happened() -> None:
    simulator, block, context = loop(Counting(), HERE, period=0.1)
    simulator.AdvanceTo(0.25)
    copy = simulator.get_context().Clone()
    simulator.AdvanceTo(0.95)
    assert block.event(context) == "contact"
    assert block.event(block.GetMyContextFromRoot(copy)) is None
    # The first tick is an offset later where there is one.
    primitive = Counting()
    simulator, _, _ = loop(primitive, HERE, period=0.1, offset=0.07)
    simulator.AdvanceTo(0.06)
    assert not primitive.shown


def test_nan_does_not_leave_the_block() -> None:
    simulator, _, _ = loop(Counting(velocity=(math.nan,) * 6), HERE)
    with pytest.raises(ParameterError, match=r"^velocity of count is .*, allowed: finite numbers"):
        simulator.AdvanceTo(0.02)


def test_the_carriage_has_to_be_connected() -> None:
    simulator, _, _ = loop(Counting(), {})
    with pytest.raises(ParameterError, match=r"^carriage of .*allowed: a connected port$"):
        simulator.AdvanceTo(0.02)


@pytest.mark.parametrize("changes", [{"period": 0.0}, {"offset": -1.0}, {"parts": 0}])
def test_errors(changes: dict[str, Any]) -> None:
    ((name, value),) = changes.items()
    with pytest.raises(ParameterError, match=f"^{name} is {value}, allowed: "):
        PrimitiveRunner(Counting(), **changes)


def test_outputs_do_not_follow_the_inputs_at_once() -> None:
    block = PrimitiveRunner(Counting())
    assert not block.HasAnyDirectFeedthrough()
