"""Skills: state machines whose states run primitives (section 4 and Fig. 4).

Source: Morrow, Nelson and Khosla. A skill is written as a list of states; each names the
primitives that it runs and what follows each of their events. It becomes a chart, to be drawn,
tested without Drake, and run by a state machine block. A state without an answer to an event, or
to the end of its time, fails: a failed skill retracts first, and says why it failed.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

from models.validation import ParameterError
from systems.skills.primitive import (
    EVENTS,
    STILL,
    Event,
    Primitive,
    Sensed,
    Stepped,
    Vector,
    sensed_sizes,
)
from systems.statechart.chart import TIME_TOLERANCE, Chart, ChartError, State, Tick, Transition
from systems.statechart.state_machine import MachineOutput, StateMachine

Outcome = Literal["done", "contact", "lost", "hindered", "jammed", "timed out"]

OUTCOMES: Final[tuple[Outcome, ...]] = (*EVENTS, "timed out")
DONE: Final = "done"
RETRACT: Final = "retract"
FAILED: Final = "failed"
_SIZE: Final = 6


@dataclass(frozen=True)
class Retry:
    """What follows an outcome the first few times, and after that; then the skill fails."""

    target: str
    at_most: int = 3
    then: "Retry | None" = None

    def __post_init__(self) -> None:
        if not self.at_most >= 1:
            raise ParameterError("at_most", self.at_most, "a whole number >= 1")


@dataclass(frozen=True, kw_only=True)
class SkillState:
    """A state of a skill."""

    name: str
    run: Sequence[Primitive]  # their velocities add; the first that has an event ends the state
    on: Mapping[Outcome, str | Retry]  # what follows; DONE ends the skill; all else fails
    timeout: float  # s
    grip: Literal["open", "close"] | None = None  # None: as it is
    marks: bool = False  # where it begins for the first time is the skill's mark
    from_mark: bool = False  # ways count from the mark
    looks: bool = False  # whether the cameras are needed
    tares: bool = False  # whether the force sensor takes its zero meanwhile
    damping: tuple[float, ...] | None = None
    # N m s/rad and N s/m, of accommodation: infinity for stiff, 0 for its own; None: its own

    def __post_init__(self) -> None:
        given = self.damping
        if given is not None and not (len(given) == _SIZE and all(d >= 0 for d in given)):
            raise ParameterError("damping", given, "six numbers >= 0, infinity for stiff")


@dataclass(frozen=True, kw_only=True)
class Skill:
    """States, the first of which it begins with, and what it does when it fails."""

    name: str
    states: Sequence[SkillState]
    retract: Sequence[Primitive]
    retract_timeout: float = 5.0  # s
    held: bool = False  # whether the gripper begins closed


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
    mark: Sensed | None = None  # what was sensed where a state with ``marks`` began first
    reason: str = ""  # why it failed: the state and its outcome

    def tried(self, state: str, outcome: str) -> int:
        """Return how often a state's outcome was answered by trying again."""
        return dict(self.retries).get((state, outcome), 0)


SkillChart = Chart[Sensed, SkillMemory]
_Tick = Tick[Sensed, SkillMemory]
_Action = Callable[[_Tick], SkillMemory]


def make_skill_chart(skill: Skill) -> SkillChart:
    """Return the chart of a skill.

    Its states are those of the skill and ``retract``, ``done`` and ``failed``. The labels of its
    transitions are the outcomes.

    Raises:
        ChartError: If a name is unknown, used twice or taken, or a state can't be reached.
    """
    for state in skill.states:
        if state.name in (DONE, RETRACT, FAILED):
            raise ChartError(f"skill {skill.name!r}: {state.name!r} is a state of every skill")
    retract = SkillState(name=RETRACT, run=skill.retract, on={}, timeout=skill.retract_timeout)
    for state in (*skill.states, retract):
        _check(skill.name, state)
    states = [*map(_chart_state, skill.states), _chart_state(retract)]
    transitions = [t for state in skill.states for t in _transitions(state)]
    ends = [
        State[Sensed, SkillMemory](name=DONE, entry=_stop, outcome="done"),
        State[Sensed, SkillMemory](name=FAILED, entry=_stop, outcome="failed"),
    ]
    over = Transition[Sensed, SkillMemory](
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


def _check(skill: str, state: SkillState) -> None:
    """Raise unless a state has something to run, some time for it, and answers that can be."""
    where = f"skill {skill!r}: {state.name!r}"
    if not state.run:
        raise ChartError(f"{where} runs no primitive")
    if not 0 < state.timeout < math.inf:
        raise ChartError(
            f"skill {skill!r}: the timeout of {state.name!r} is {state.timeout!r}, "
            "allowed: a finite number > 0"
        )
    if state.grip not in (None, "open", "close"):
        raise ChartError(f"{where} has the grip {state.grip!r}, allowed: open, close, None")
    for outcome, answer in state.on.items():
        if outcome not in OUTCOMES:
            valid = ", ".join(OUTCOMES)
            raise ChartError(f"{where} has an answer to {outcome!r}, valid outcomes: {valid}")
        if not {RETRACT, FAILED}.isdisjoint(_targets(answer)):
            raise ChartError(f"{where}: what fails needs no answer, but {outcome!r} has one")


def _targets(answer: str | Retry | None) -> list[str]:
    """Return the states that an answer leads to, the first try's first."""
    if isinstance(answer, Retry):
        return [answer.target, *_targets(answer.then)]
    return [] if answer is None else [answer]


def _chart_state(state: SkillState) -> State[Sensed, SkillMemory]:
    run = tuple(state.run)

    def entry(tick: _Tick) -> SkillMemory:
        memory = tick.memory
        mark = memory.mark or (tick.inputs if state.marks else None)
        begin = mark if state.from_mark and mark is not None else tick.inputs
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


def _require_finite(sensed: Sensed) -> None:
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


def _transitions(state: SkillState) -> list[Transition[Sensed, SkillMemory]]:
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


class SkillMachine(StateMachine[Sensed, SkillMemory]):
    """Runs a skill.

    .. pydrake_system::

        name: SkillMachine
        input_ports:
        - carriage
        - motion
        - wrench
        - xz_detections (optional)
        - yz_detections (optional)
        - cross_section (optional)
        - perturbed
        - spread (optional)
        - holding (optional)
        output_ports:
        - velocity
        - closed
        - looks
        - tares
        - damping
        - retries
        - state

    The inputs are those of :class:`~systems.skills.primitive.Sensed`, shape (6,) each but the
    detections and ``holding``. ``velocity``, shape (6,), is V_cmd, rad/s above m/s; ``damping``,
    shape (6,), that of accommodation, 0 where it is its own; the others have size 1:
    ``closed`` says whether the gripper is told to be closed; ``looks`` triggers the cameras;
    ``tares`` is 1 while the force sensor takes its zero; ``retries`` is how often something was
    tried again; ``state`` the index of the chart's state.

    Args:
        skill: What to run.
        parts: What each camera looks for.
        period: s, between two ticks.

    Raises:
        ChartError: At construction if the skill can't be run.
        ParameterError: At construction if the period is not allowed; in a run, while the skill
            has not ended, if ``carriage``, ``motion``, ``wrench`` or ``perturbed`` is not finite.
    """

    def __init__(self, skill: Skill, *, parts: int, period: float) -> None:
        super().__init__(
            make_skill_chart(skill),
            inputs=Sensed,
            sizes=sensed_sizes(parts),
            outputs={
                "velocity": MachineOutput(size=_SIZE, read=lambda memory: memory.velocity),
                "closed": MachineOutput(size=1, read=lambda memory: (float(memory.closed),)),
                "looks": MachineOutput(size=1, read=lambda memory: (float(memory.looks),)),
                "tares": MachineOutput(size=1, read=lambda memory: (float(memory.tares),)),
                "damping": MachineOutput(size=_SIZE, read=lambda memory: memory.damping),
                "retries": MachineOutput(
                    size=1,
                    read=lambda memory: (float(sum(count for _, count in memory.retries)),),
                ),
            },
            optional=("xz_detections", "yz_detections", "cross_section", "spread", "holding"),
            period=period,
        )
