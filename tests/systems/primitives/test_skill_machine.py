"""The block that runs a skill, and the skills that it refuses."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.primitive import (
    EVENTS,
    STILL,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.primitives.skill import (
    DONE,
    Retry,
    Skill,
    SkillState,
)
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.vision.cross_section import CROSS_SECTION_SIZE
from chamfer.systems.vision.part_detector import DETECTION_SIZE

PERIOD: Final = 0.1  # s


@dataclass(frozen=True)
class Fake:
    """Moves steadily; its event comes at a tick."""

    velocity: Vector = STILL
    event: Event | None = None
    at: int = 0
    label: str = "fake"
    events: ClassVar[Mapping[Event, float]] = dict.fromkeys(EVENTS, 0.0)

    def begin(self, sensed: Observation) -> int:
        return 0

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        assert isinstance(memory, int)
        return Stepped(memory + 1, self.velocity, self.event if memory >= self.at else None)


def state(name: str, *run: Primitive, on: Mapping[Any, Any], **fields: Any) -> SkillState:
    return SkillState(name=name, run=run, on=on, **{"timeout": 10.0, **fields})


def skill(*states: SkillState, **fields: Any) -> Skill:
    return Skill(name="test", states=states, **{"retract": [MoveDx()], **fields})


GO: Final = state("go", Fake(), on={"done": DONE})


@pytest.mark.parametrize("at_most", [0, -1])
def test_retries_have_to_be_some(at_most: int) -> None:
    with pytest.raises(ParameterError, match=r"^at_most is -?\d, allowed: a whole number >= 1$"):
        Retry("go", at_most)


# The block


@dataclass(frozen=True)
class Remembering:
    """Keeps what it is shown."""

    label: str = "remembering"
    events: ClassVar[Mapping[Event, float]] = dict.fromkeys(EVENTS, 0.0)

    def begin(self, sensed: Observation) -> tuple[Observation, ...]:
        return ()

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        assert isinstance(memory, tuple)
        seen = (*memory, sensed)
        return Stepped(seen, (0.5,) * 6, "done" if len(seen) == 3 else None)


def test_the_block_shows_what_its_ports_get_and_gives_the_commands() -> None:
    block = SkillMachine(
        skill(
            state("go", Remembering(), on={"done": Retry("again", 1)}, grip="close"),
            state(
                "again",
                Fake((2.0,) * 6, "done", at=1),
                on={"done": DONE},
                grip="open",
                looks=True,
                tares=True,
                damping=(0.0, 0.0, 5.0, math.inf, 0.0, 0.0),
            ),
        ),
        parts=2,
        period=PERIOD,
    )
    sizes = {port: block.GetInputPort(port).size() for port in Observation._fields}
    assert sizes == {
        **dict.fromkeys(("carriage", "motion", "wrench", "perturbed", "spread"), 6),
        "holding": 1,
        "xz_detections": 2 * DETECTION_SIZE,
        "yz_detections": 2 * DETECTION_SIZE,
        "cross_section": CROSS_SECTION_SIZE,
    }
    builder = DiagramBuilder()
    builder.AddSystem(block)
    logs = {}
    for name in ("velocity", "closed", "looks", "tares", "damping", "retries", "state"):
        logs[name] = LogVectorOutput(block.GetOutputPort(name), builder, PERIOD)
    simulator = Simulator(builder.Build())
    context = block.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    for i, name in enumerate(("carriage", "motion", "wrench", "perturbed")):
        block.GetInputPort(name).FixValue(context, np.full(6, float(i)))
    block.GetInputPort("spread").FixValue(context, np.full(6, 0.5))
    block.GetInputPort("cross_section").FixValue(context, np.full(CROSS_SECTION_SIZE, 9.0))
    assert block.GetOutputPort("velocity").Eval(context).tolist() == [0.0] * 6
    assert block.GetOutputPort("closed").Eval(context).tolist() == [0.0]
    simulator.AdvanceTo(0.05)
    (seen,) = block.snapshot(context).memory.memories
    expected = Observation(
        carriage=(0.0,) * 6,
        motion=(1.0,) * 6,
        wrench=(2.0,) * 6,
        perturbed=(3.0,) * 6,
        cross_section=(9.0,) * CROSS_SECTION_SIZE,
        spread=(0.5,) * 6,
    )
    assert seen == (expected,)
    simulator.AdvanceTo(0.65)
    found = {
        name: log.FindLog(simulator.get_context()).data()[0].tolist() for name, log in logs.items()
    }
    # Published before a tick's update: a value is seen one entry later.
    assert found["velocity"] == [0.0, 0.5, 0.5, 0.0, 2.0, 0.0, 0.0]
    assert found["closed"] == [0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    assert found["looks"] == [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]
    assert found["retries"] == [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    assert found["tares"] == found["looks"]
    logged = logs["damping"].FindLog(simulator.get_context()).data()
    assert logged[3].tolist() == [0.0, 0.0, 0.0, 0.0, math.inf, math.inf, 0.0]
    names = [block.chart.state_names[int(i)] for i in found["state"]]
    assert names == ["go", "go", "go", "go", "again", "again", DONE]
    assert [record.label for record in block.transitions(context)] == [
        "done, 1 times at most",
        "done",
    ]


def test_a_skill_may_begin_with_the_part_in_hand() -> None:
    block = SkillMachine(skill(GO, held=True), parts=1, period=PERIOD)
    context = block.CreateDefaultContext()
    assert block.GetOutputPort("closed").Eval(context).tolist() == [1.0]
    assert not block.HasAnyDirectFeedthrough()


@pytest.mark.parametrize("damping", [(1.0,) * 5, (1.0,) * 5 + (-1.0,), (math.nan,) * 6])
def test_a_damping_has_six_numbers(damping: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match=r"^damping is .*, allowed: six numbers >= 0, infin"):
        state("go", Fake(), on={}, damping=damping)
