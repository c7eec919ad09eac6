"""The chart of a skill: to be drawn, tested without Drake, and run by a block."""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.primitive import STILL, Event, Observation, Stepped, Vector
from chamfer.systems.primitives.skill import (
    DONE,
    FAILED,
    RETRACT,
    Outcome,
    Retry,
    Skill,
    SkillState,
)
from chamfer.systems.primitives.skill_check import check_skill, retract_of
from chamfer.systems.statechart.chart import TIME_TOLERANCE, Chart, State, Tick, Transition

_SIZE: Final = 6


class SkillMemory(NamedTuple):
    """What a skill remembers."""

    velocity: Vector = STILL  # V_cmd, rad/s above m/s
    event: Event | None = None
    memories: tuple[object, ...] = ()  # of the primitives that run
    closed: bool = False  # the gripper
    looks: bool = False  # the cameras
    tares: bool = False  # the force sensor
    damping: Vector = STILL  # of accommodation, 0: its own
    retries: tuple[tuple[tuple[str, str], int], ...] = ()  # by state and outcome
    mark: Observation | None = None  # what was sensed where a state with ``marks`` began first
    reason: str = ""  # why it failed: the state and its outcome

    def tried(self, state: str, outcome: str) -> int:
        """Return how often a state's outcome was answered by trying again."""
        return dict(self.retries).get((state, outcome), 0)


SkillChart = Chart[Observation, SkillMemory]
_Tick = Tick[Observation, SkillMemory]
_Action = Callable[[_Tick], SkillMemory]


def make_skill_chart(skill: Skill) -> SkillChart:
    """Return the chart of a skill.

    Its states are those of the skill and ``retract``, ``done`` and ``failed``. The labels of its
    transitions are the outcomes.

    Raises:
        ChartError: If a name is unknown, used twice or taken, a state can't be reached, or
            :func:`~chamfer.systems.primitives.skill_check.check_skill` refuses the skill.
    """
    check_skill(skill)
    retract = retract_of(skill)
    states = [*map(_chart_state, skill.states), _chart_state(retract)]
    transitions = [t for state in skill.states for t in _transitions(state)]
    ends = [
        State[Observation, SkillMemory](name=DONE, entry=_stop, outcome="done"),
        State[Observation, SkillMemory](name=FAILED, entry=_stop, outcome="failed"),
    ]
    over = Transition[Observation, SkillMemory](
        source=RETRACT,
        target=FAILED,
        label="over",
        guard=lambda tick: tick.memory.event is not None or _late(retract, tick),
    )
    return Chart(
        skill.name,
        states=[*states, *ends],
        transitions=[*transitions, over],
        memory=SkillMemory(closed=skill.held),
    )


def _chart_state(state: SkillState) -> State[Observation, SkillMemory]:
    run = tuple(state.run)

    def entry(tick: _Tick) -> SkillMemory:
        memory = tick.memory
        mark = memory.mark or (tick.inputs if state.marks else None)
        begin = tick.inputs
        if state.from_mark:
            assert mark is not None  # as the skill was checked
            begin = mark
        return memory._replace(
            mark=mark,
            event=None,
            memories=tuple(primitive.begin(begin) for primitive in run),
            closed=memory.closed if state.grip is None else state.grip == "close",
            looks=state.looks,
            tares=state.tares,
            damping=state.damping or STILL,
        )

    def during(tick: _Tick) -> SkillMemory:
        _require_finite(tick.inputs)
        time = tick.time_in_state
        stepped = [
            primitive.step(tick.inputs, memory, time)
            for primitive, memory in zip(run, tick.memory.memories, strict=True)
        ]
        event = next((one.event for one in stepped if one.event is not None), None)
        return tick.memory._replace(
            # What has ended commands nothing more, also in the tick before it is left.
            velocity=STILL if event is not None else _sum(stepped),
            event=event,
            memories=tuple(one.memory for one in stepped),
        )

    labels = [primitive.label for primitive in run]
    if state.grip is not None:
        labels.insert(0, f"grip {state.grip}")
    return State(name=state.name, entry=entry, during=during, note=", ".join(labels))


def _require_finite(sensed: Observation) -> None:
    """Raise if a force or a place is not known: no guard would ever see it."""
    for name in ("carriage", "motion", "wrench", "perturbed"):
        values: Vector = getattr(sensed, name)
        if not all(map(math.isfinite, values)):
            raise ParameterError(name, list(values), "finite numbers")


def _sum(stepped: Sequence[Stepped]) -> Vector:
    return tuple(sum(one.velocity[i] for one in stepped) for i in range(_SIZE))


def _stop(tick: _Tick) -> SkillMemory:
    still = tick.memory._replace(velocity=STILL, event=None, memories=(), damping=STILL)
    return still._replace(looks=False, tares=False)


def _late(state: SkillState, tick: _Tick) -> bool:
    return tick.time_in_state >= state.timeout - TIME_TOLERANCE


def _transitions(state: SkillState) -> list[Transition[Observation, SkillMemory]]:
    found = []
    for outcome, answer in state.on.items():
        guard = _guard(state, outcome)
        if isinstance(answer, str):
            found.append(Transition(source=state.name, target=answer, label=outcome, guard=guard))
            continue
        first, label = 0, str(outcome)
        retry: Retry | None = answer
        while retry is not None:
            last = first + retry.at_most
            found.append(
                Transition(
                    source=state.name,
                    target=retry.target,
                    label=f"{label}, {retry.at_most} times at most",
                    guard=_while_tried(guard, (state.name, outcome), first, last),
                    action=_count((state.name, outcome)),
                )
            )
            first, retry, label = last, retry.then, f"{outcome} again"

    def ended(tick: _Tick) -> bool:
        return tick.memory.event is not None or _late(state, tick)

    def why(tick: _Tick) -> SkillMemory:
        outcome = tick.memory.event or "timed out"
        return tick.memory._replace(reason=f"{state.name}: {outcome}")

    found.append(
        Transition(source=state.name, target=RETRACT, label="otherwise", guard=ended, action=why)
    )
    return found


def _guard(state: SkillState, outcome: Outcome) -> Callable[[_Tick], bool]:
    if outcome == "timed out":
        return lambda tick: tick.memory.event is None and _late(state, tick)
    return lambda tick: tick.memory.event == outcome


def _while_tried(
    guard: Callable[[_Tick], bool], edge: tuple[str, str], first: int, last: int
) -> Callable[[_Tick], bool]:
    return lambda tick: guard(tick) and first <= tick.memory.tried(*edge) < last


def _count(edge: tuple[str, str]) -> _Action:
    def action(tick: _Tick) -> SkillMemory:
        memory = tick.memory
        counts = {**dict(memory.retries), edge: memory.tried(*edge) + 1}
        return memory._replace(retries=tuple(counts.items()))

    return action
