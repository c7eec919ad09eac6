"""Skills, tick by tick without Drake, and by the block that runs them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import GuardedMove, Hold, Stick
from chamfer.systems.primitives.position_primitives import Centre, Way
from chamfer.systems.primitives.primitive import (
    EVENTS,
    STILL,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, FAILED, RETRACT, Retry, Skill, SkillState
from chamfer.systems.primitives.skill_law import SkillChart, SkillMemory, make_skill_chart
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.statechart.chart import ChartError, Snapshot, TransitionRecord
from chamfer.systems.vision.detections import CROSS_SECTION_SIZE, DETECTION_SIZE

PERIOD: Final = 0.1  # s
NOTHING: Final = Observation(STILL, STILL, STILL)
UP: Final = MoveDx(displacement=(0, 0, 0, 0, 0, 0.2), duration=2 * PERIOD)


@dataclass(frozen=True)
class Fake(Primitive):
    """Moves steadily, keeps what it began from and counts; its event comes at a tick."""

    velocity: Vector = STILL
    event: Event | None = None
    at: int = 0
    label: str = "fake"  # type: ignore[misc]
    events: ClassVar[Mapping[Event, float]] = dict.fromkeys(EVENTS, 0.0)

    def begin(self, sensed: Observation) -> tuple[Observation, int]:
        return sensed, 0

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        assert isinstance(memory, tuple)
        begun, count = memory
        assert time == pytest.approx(count * PERIOD)
        event = self.event if count >= self.at else None
        return Stepped((begun, count + 1), self.velocity, event)


def state(name: str, *run: Primitive, on: Mapping[Any, Any], **fields: Any) -> SkillState:
    return SkillState(name=name, run=run, on=on, **{"timeout": 10.0, **fields})


def skill(*states: SkillState, **fields: Any) -> Skill:
    return Skill(name="test", states=states, **{"retract": [UP], **fields})


class Ticks:
    """A chart, ticked."""

    def __init__(self, chart: SkillChart) -> None:
        self.chart = chart
        self.now: Snapshot[SkillMemory] = chart.start()
        self.count = 0
        self.records: list[TransitionRecord] = []

    def tick(self, sensed: Observation = NOTHING, times: int = 1) -> "Ticks":
        for _ in range(times):
            self.now, record = self.chart.step(self.now, sensed, self.count * PERIOD)
            self.count += 1
            if record is not None:
                self.records.append(record)
        return self

    def until_final(self, sensed: Observation = NOTHING) -> "Ticks":
        for _ in range(1000):
            if self.state in (DONE, FAILED):
                return self
            self.tick(sensed)
        raise AssertionError(f"stays in {self.state}")

    @property
    def state(self) -> str:
        return self.now.state

    @property
    def memory(self) -> SkillMemory:
        return self.now.memory


def ticks(*states: SkillState, **fields: Any) -> Ticks:
    return Ticks(make_skill_chart(skill(*states, **fields)))


def test_the_first_event_decides_and_nothing_moves_in_its_tick() -> None:
    moving = (1.0,) * 6
    found = ticks(
        state(
            "go",
            Fake(moving),
            Fake(moving, "lost", at=2),
            Fake(moving, "done", at=2),
            on={"done": DONE, "lost": "next"},
        ),
        state("next", Fake(moving), on={"done": DONE}),
    )
    found.tick(times=2)
    assert found.memory.velocity == (3.0,) * 6
    found.tick()
    assert (found.state, found.memory.event) == ("go", "lost")
    assert found.memory.velocity == STILL
    found.tick()
    assert (found.state, found.memory.event) == ("next", None)
    assert found.memory.velocity == moving
    # Begun anew, with what was commanded last while something ran.
    assert found.memory.memories == ((NOTHING._replace(perturbed=(3.0,) * 6), 1),)


@pytest.mark.parametrize("answer", [{"timed out": "next"}, {"timed out": Retry("next")}, {}])
def test_a_state_times_out(answer: Any) -> None:
    found = ticks(
        state("go", Fake((1.0,) * 6), on={"done": "next", **answer}, timeout=0.3),
        state("next", Fake(), on={"done": DONE}),
    )
    found.tick(times=3)
    assert found.state == "go"
    found.tick()
    assert found.state == ("next" if answer else RETRACT)
    assert found.memory.reason == ("" if answer else "go: timed out")


@pytest.mark.parametrize(
    ("answer", "path"),
    [
        (Retry("again", 1), ["again"]),
        (Retry("again"), ["again"] * 3),
        (Retry("again", 2, then=Retry("otherwise", 1)), ["again"] * 2 + ["otherwise"]),
        (
            Retry("again", 1, Retry("otherwise", 2, Retry("again", 1))),
            ["again", "otherwise", "otherwise", "again"],
        ),
    ],
)
def test_it_tries_again_as_often_as_it_may_then_it_fails(answer: Retry, path: list[str]) -> None:
    back = Fake(STILL, "done")
    found = ticks(
        state("go", Fake(STILL, "lost"), on={"lost": answer, "done": "otherwise"}),
        state("again", back, on={"done": "go"}),
        state("otherwise", back, on={"done": "go", "lost": "again", "contact": DONE}),
    ).until_final()
    tried = [record.target for record in found.records if record.source == "go"]
    assert tried == [*path, RETRACT]
    assert found.state == FAILED
    assert found.memory.reason == "go: lost"
    assert found.memory.tried("go", "lost") == len(path)


def test_what_is_tilted_takes_the_answer_of_what_has_jammed_where_it_has_none() -> None:
    for answers, then in (
        ({"jammed": DONE}, DONE),
        ({"jammed": DONE, "tilted": "other"}, "other"),
    ):
        go, other = (state(name, Fake(STILL, "tilted"), on=answers) for name in ("go", "other"))
        found = ticks(go, *([other] if "tilted" in answers else [])).tick().tick()
        assert found.state == then


@pytest.mark.parametrize("event", EVENTS)
def test_what_has_no_answer_fails_retracted_and_says_why(event: Event) -> None:
    unlike = {event, "jammed"} if event == "tilted" else {event}
    answers = {other: DONE for other in EVENTS if other not in unlike}
    found = ticks(state("go", Fake((1.0,) * 6, event), on=answers)).tick()
    assert (found.state, found.memory.velocity) == ("go", STILL)
    found.tick()
    assert found.state == RETRACT
    np.testing.assert_allclose(found.memory.velocity, (0, 0, 0, 0, 0, 1.0))
    found.until_final()
    assert (found.state, found.memory.reason) == (FAILED, f"go: {event}")
    labels = [(record.source, record.target, record.label) for record in found.records]
    assert labels == [("go", RETRACT, "otherwise"), (RETRACT, FAILED, "over")]
    assert found.chart.state(FAILED).outcome == "failed"
    assert found.chart.state(DONE).outcome == "done"


def test_a_retract_that_does_not_end_times_out() -> None:
    found = ticks(
        state("go", Fake(STILL, "lost"), on={"done": DONE}),
        retract=[Fake((1.0,) * 6)],
        retract_timeout=0.5,
    )
    found.tick(times=2)
    assert found.state == RETRACT
    found.tick(times=4)
    assert (found.state, found.memory.velocity) == (RETRACT, (1.0,) * 6)
    found.tick()
    assert (found.state, found.memory.velocity) == (FAILED, STILL)


def test_ways_may_count_from_the_first_begin_of_a_state() -> None:
    def place(z: float) -> Observation:
        return NOTHING._replace(carriage=(0.0, 0.0, 0.0, 0.0, 0.0, z))

    def chart(from_mark: bool) -> Ticks:
        return ticks(
            state(
                "touch",
                Fake(STILL, "contact", at=1),
                on={"contact": "go", "lost": DONE},
                marks=True,
            ),
            state(
                "go",
                Fake(STILL, "done", at=1),
                on={"done": Retry("touch"), "lost": DONE},
                from_mark=from_mark,
            ),
        )

    for from_mark, begun in ((True, (0.1, 0.1)), (False, (0.3, 0.7))):
        found = chart(from_mark).tick(place(0.1)).tick(place(0.2)).tick(place(0.3))
        assert found.state == "go"
        assert found.memory.memories == ((place(begun[0]), 1),)
        for z in (0.4, 0.5, 0.6, 0.7):  # back, and there again
            found.tick(place(z))
        assert found.state == "go"
        assert found.memory.memories == ((place(begun[1]), 1),)
        assert found.memory.mark == place(0.1)


@pytest.mark.parametrize("held", [False, True])
def test_the_gripper_is_told_by_states_that_say_so(held: bool) -> None:
    step = Fake(STILL, "done")
    found = ticks(
        state("as it is", step, on={"done": "closing"}),
        state("closing", step, on={"done": "carry"}, grip="close"),
        state("carry", step, on={"done": "opening"}),
        state("opening", step, on={"done": "empty"}, grip="open"),
        state("empty", step, on={"done": DONE}),
        held=held,
    )
    told = {}
    while found.state != DONE:
        found.tick()
        told[found.state] = found.memory.closed
    expected = {"as it is": held, "closing": True, "carry": True, "opening": False, "empty": False}
    assert told == {**expected, DONE: False}


@pytest.mark.parametrize("port", ["carriage", "motion", "wrench", "perturbed"])
@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_what_is_sensed_has_to_be_finite(port: str, value: float) -> None:
    broken = NOTHING._replace(**{port: (0.0, 0.0, 0.0, 0.0, 0.0, value)})  # type: ignore[arg-type]
    found = ticks(state("go", Fake(STILL, "done", at=1), on={"done": DONE})).tick()
    with pytest.raises(
        ParameterError, match=rf"^{port} is \[.*{value}\], allowed: finite numbers$"
    ):
        found.tick(broken)


def test_the_block_shows_what_its_ports_get_and_gives_the_commands() -> None:
    block = SkillMachine(
        skill(
            state(
                "go", Fake((0.5,) * 6, "done", at=2), on={"done": Retry("again", 1)}, grip="close"
            ),
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
        perturbed=STILL,  # as it begins, the skill's own command before
        cross_section=(9.0,) * CROSS_SECTION_SIZE,
        spread=(0.5,) * 6,
    )
    assert seen == (expected, 1)
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
    labels = [record.label for record in block.transitions(context)]
    assert labels == ["done, 1 times at most", "done"]


@pytest.mark.parametrize(
    ("run", "on", "outcome", "expected"),
    [
        (GuardedMove(limit=0.02), {"contact": "a"}, "lost", "contact: 4 N within 20 mm along -z"),
        (Seat(), {"done": "a", "jammed": Retry("a")}, "timed out", "done: a stop after at least"),
        (
            Way(least=5.1e-3),
            {"done": "a", "jammed": Retry("a")},
            "jammed",
            "done: at least 5.1 mm",
        ),
        (Way(direction="+rz", most=0.1), {"done": "a"}, "jammed", "at most 5.73 degrees along"),
        (Stick(), {"lost": "a", "done": "a"}, "done", "lost: more than 1 mm along -z"),
        (Hold(), {"done": "a", "contact": "b"}, "timed out", "done; or contact"),
        (Way(), {"done": "a"}, "done", ""),
    ],
)
def test_what_was_expected_in_place_of_an_outcome(
    run: Primitive, on: Any, outcome: Any, expected: str
) -> None:
    assert expected in state("x", run, on=on).expected(outcome)
    if expected:
        marked = state("x", run, on=on, from_mark=True).expected(outcome)
        assert marked.endswith(", from the mark") == (not isinstance(run, Hold))


def test_a_further_try_changes_the_state_that_is_tried_again() -> None:
    retry = Retry("back", 2, Retry("back", 1), {"speed": 1.5, "gain": 2.0})
    dither = Dither(amplitude=0.0)
    kept = Centre(dither=replace(dither, frequency=2.0), gain=3.0)
    found = ticks(
        state("go", Stick(speed=0.01), kept, Fake(STILL, "lost"), on={"lost": retry}),
        state("back", Fake(STILL, "done"), on={"done": "go", "lost": DONE}),
    )
    speeds, gains = [], []
    while found.state != FAILED:
        found.tick()
        if found.state == "go":
            stick, centre, _ = found.memory.run
            assert isinstance(stick, Stick)
            assert isinstance(centre, Centre)
            speeds.append(stick.speed)
            gains.append(centre.gain)
            assert found.memory.velocity in (STILL, (0.0,) * 5 + (-stick.speed,))
    assert speeds == pytest.approx([0.01, 0.015, 0.0225, 0.0225])
    assert gains == pytest.approx([3.0, 6.0, 12.0, 12.0])
    labels = [record.label for record in found.records if record.target == "back"]
    assert labels[0] == "lost, 2 times at most, speed 1.5x, gain 2x"
    assert labels[2] == "lost again, 1 times at most"


@pytest.mark.parametrize(
    ("run", "factors", "message"),
    [
        (
            Stick(threshold=math.inf),
            {"threshold": 2.0},
            "changes nothing, allowed: speed, threshold",
        ),
        (Seat(free=50.0), {"limit": 0.9}, "in its last try: free is 50.0, allowed: a number > 0"),
        (Stick(), {"speed": 1e200}, "in its last try: "),
    ],
)
def test_a_last_try_has_to_be_possible(run: Any, factors: Any, message: str) -> None:
    again = Retry("a", 3, factors=factors)
    with pytest.raises(ChartError, match=message):
        make_skill_chart(skill(state("a", run, on={"timed out": again})))
