"""A skill as a law: it is checked, made a chart, and run once a period.

A wrong skill is refused in one line before it runs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Final, NamedTuple

from chamfer.models.validation import ParameterError
from chamfer.systems.force.accommodation_law import DAMPING, VELOCITY
from chamfer.systems.primitives.force_primitives import (
    AXIS_NAMES,
    Obstructed,
    PrimitiveLoad,
    index_of,
)
from chamfer.systems.primitives.primitive import (
    STILL,
    Event,
    Observation,
    Primitive,
    Vector,
    sensed_signals,
)
from chamfer.systems.primitives.skill import (
    DONE,
    FAILED,
    OUTCOMES,
    RETRACT,
    Outcome,
    Retry,
    Skill,
    SkillState,
    scaled,
)
from chamfer.systems.primitives.trajectory_primitives import Dither
from chamfer.systems.statechart.chart import (
    TIME_TOLERANCE,
    Chart,
    ChartError,
    State,
    Tick,
    Transition,
)
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput, number

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.connector import Connector

_TICKS = 4  # that a cycle of a dither takes at least
_ROUNDING = 1e-6  # ticks
_SIZE: Final = 6
_MANY: Final = 10**9  # tries


def _states_of(skill: Skill) -> Iterator[tuple[SkillState, str]]:
    """Yield all states that run something, each with its name for messages."""
    for state in (*skill.states, _retract_of(skill)):
        where = f"skill {skill.name!r}: {state.name!r}"
        yield state, where
        if any(one.factors for one in _retries(state)):
            yield _last_try(state, where), f"{where}, in its last try"


def _retries(state: SkillState) -> Iterator[Retry]:
    return (one for it in state.on.values() if isinstance(it, Retry) for one in it.chain)


def _last_try(state: SkillState, where: str) -> SkillState:
    """Return a state as in its last try; a retry that changes nothing is refused."""
    try:
        for name, by in (pair for one in _retries(state) for pair in one.factors.items()):
            if all(scaled(one, name, by) == one for one in state.run):
                items = [item for one in state.run for item in vars(one).items()]
                numbers = sorted({name for name, size in items if isinstance(size, float)})
                raise ChartError(
                    f"{where} is tried again with {name} {by:g}x, which changes nothing, "
                    f"allowed: {', '.join(numbers)}"
                )
        return replace(state, run=state.run_again(lambda _: _MANY))
    except OverflowError as error:
        allowed = "allowed: fewer tries or smaller factors"
        raise ChartError(f"{where}, in its last try: a number is too large, {allowed}") from error
    except ParameterError as error:
        raise ChartError(f"{where}, in its last try: {error}") from error


def _check_skill(skill: Skill) -> None:
    """Check everything that needs no clock."""
    for state in skill.states:
        if state.name in (DONE, RETRACT, FAILED):
            raise ChartError(f"skill {skill.name!r}: {state.name!r} is a state of every skill")
    for state, where in _states_of(skill):
        if not state.run:
            raise ChartError(f"{where} runs no primitive")
        if not 0 < state.timeout < math.inf:
            allowed = "allowed: a finite number > 0"
            raise ChartError(f"{where}: the timeout is {state.timeout!r}, {allowed}")
        if state.grip not in (None, "open", "close"):
            raise ChartError(f"{where} has the grip {state.grip!r}, allowed: open, close, None")
        _check_answers(state, where)
        _check_times(state, where)
        for watch, axis, _ in _watched(state):
            if not any(AXIS_NAMES[dither.index] == axis for dither in _dithers(state)):
                raise ChartError(f"{where}: {watch.label} watches {axis}, but runs no dither")
    _check_marks(skill)


def check_timing(skill: Skill, period: float) -> None:
    """Check dithers, and the windows that watch them, against the time between two ticks, s.

    Raises:
        ChartError: If a dither is too fast, or a window is not a cycle of it.
    """
    for state, where in _states_of(skill):
        for dither in _dithers(state):
            fastest = 1 / (_TICKS * period)
            if dither.frequency > fastest:
                raise ChartError(
                    f"{where}: the frequency of {dither.label} is {dither.frequency:g} Hz, "
                    f"allowed: at most {fastest:g} Hz, a quarter of the ticks"
                )
        for watch, axis, cycle in _watched(state):
            for dither in _dithers(state):
                off = abs(cycle - 1 / dither.frequency)
                if AXIS_NAMES[dither.index] == axis and off > (0.5 + _ROUNDING) * period:
                    raise ChartError(
                        f"{where}: the windows of {watch.label} are {cycle:.4g} s along {axis}, "
                        f"allowed: a cycle of {dither.label}, {1 / dither.frequency:.4g} s"
                    )
            needed = watch.windows * cycle
            if needed >= state.timeout:
                raise ChartError(
                    f"{where}: the timeout is {state.timeout:g} s, "
                    f"allowed: more than {needed:g} s, the windows of {watch.label}"
                )


def check_forces(skill: Skill, damping: Sequence[float], connector: "Connector") -> None:
    """Check the forces that end primitives, and those that the connector withstands.

    A state may set its own ``damping``, N m s/rad above N s/m, in place of accommodation's.

    Raises:
        ChartError: If a force or torque is never reached, or more than the connector withstands.
    """
    for state, where in _states_of(skill):
        own = state.damping or STILL
        for primitive in state.run:
            load = getattr(primitive, "load", None)
            if not isinstance(load, PrimitiveLoad):
                continue
            index = index_of(load.direction)
            linear = index >= len(STILL) // 2
            reached = (own[index] or damping[index]) * load.speed
            stands = connector.largest_force if linear else connector.largest_torque
            unit = "N" if linear else "N m"
            if reached <= load.force < math.inf:
                raise ChartError(
                    f"{where}: {primitive.label} ends at {load.force:g} {unit}, "
                    f"allowed: less than {reached:g} {unit}, the damping times its speed"
                )
            # What is pushed stiffly is not told by its speed.
            if stands < (most := min(load.force, reached)) < math.inf:
                raise ChartError(
                    f"{where}: {primitive.label} pushes with {most:g} {unit}, "
                    f"allowed: at most {stands:g} {unit}, which {connector.name} withstands"
                )


def _retract_of(skill: Skill) -> SkillState:
    return SkillState(name=RETRACT, run=skill.retract, on={}, timeout=skill.retract_timeout)


def targets(answer: str | Retry | None) -> list[str]:
    """Return the states that an entry leads to, the first try's first."""
    if isinstance(answer, Retry):
        return [answer.target, *targets(answer.then)]
    return [] if answer is None else [answer]


def _check_answers(state: SkillState, where: str) -> None:
    possible = {event for primitive in state.run for event in primitive.events}
    for outcome, answer in state.on.items():
        if outcome not in OUTCOMES:
            valid = ", ".join(OUTCOMES)
            raise ChartError(f"{where} has an entry for {outcome!r}, valid outcomes: {valid}")
        if outcome not in (*possible, "timed out"):
            valid = ", ".join([*(one for one in OUTCOMES if one in possible), "timed out"])
            raise ChartError(
                f"{where} has an entry for {outcome!r}, which none of its primitives can have, "
                f"possible outcomes: {valid}"
            )
        if not {RETRACT, FAILED}.isdisjoint(targets(answer)):
            raise ChartError(f"{where}: a failure needs no entry, but {outcome!r} has one")


def _check_times(state: SkillState, where: str) -> None:
    """Raise if an event would come after the timeout.

    A primitive that need not end in time only accompanies another one.
    """
    needs_done = "done" in state.on or state.name == RETRACT
    done = [one.events["done"] for one in state.run if "done" in one.events]
    for primitive in state.run:
        for event, earliest in primitive.events.items():
            if event == "done" and not (needs_done and earliest == min(done)):
                continue
            if earliest >= state.timeout:
                raise ChartError(
                    f"{where}: the timeout is {state.timeout:g} s, allowed: more than "
                    f"{earliest:g} s, before which {primitive.label} is never {event}"
                )


def _check_marks(skill: Skill) -> None:
    """Raise if a state that counts from the mark can be reached without any."""
    states = {state.name: state for state in skill.states}
    front = [state.name for state in skill.states[:1]]
    seen = set(front)
    while front:
        state = states.get(front.pop())
        if state is None or state.marks:
            continue
        if state.from_mark:
            raise ChartError(
                f"skill {skill.name!r}: {state.name!r} counts from a mark, "
                "but can be reached without one"
            )
        following = {one for answer in state.on.values() for one in targets(answer)} - seen
        seen |= following
        front.extend(following)


def _dithers(state: SkillState) -> Iterator[Dither]:
    return (one for one in state.run if isinstance(one, Dither))


def _watched(state: SkillState) -> Iterator[tuple[Obstructed, str, float]]:
    """Yield each test for obstruction with an axis and how long its windows are there, s."""
    for one in state.run:
        if isinstance(one, Obstructed):
            for axis, cycle in zip(one.axes, one.cycle, strict=True):
                yield one, axis, cycle


class SkillMemory(NamedTuple):
    """The memory of a skill from tick to tick."""

    velocity: Vector = STILL  # V_cmd, rad/s above m/s
    ran: Vector = STILL  # V_cmd while the primitives still ran, without an event
    event: Event | None = None
    run: tuple[Primitive, ...] = ()  # the primitives that run
    memories: tuple[object, ...] = ()  # theirs
    closed: bool = False  # the gripper
    looks: bool = False  # the cameras
    tares: bool = False  # the force sensor
    damping: Vector = STILL  # of accommodation, 0: its own
    retries: tuple[tuple[tuple[str, str], int], ...] = ()  # by state and outcome
    mark: Observation | None = None  # observation at the first begin of a state with ``marks``
    marked: tuple[str, ...] = ()  # the states with ``marks`` that have begun
    reason: str = ""  # why it failed: the state and its outcome
    expected: str = ""  # of that state, in words, in place of that outcome

    def tried(self, state: str, outcome: str) -> int:
        """Return how often a retry followed a state's outcome."""
        return dict(self.retries).get((state, outcome), 0)


SkillChart = Chart[Observation, SkillMemory]
_Tick = Tick[Observation, SkillMemory]


def make_skill_chart(skill: Skill) -> SkillChart:
    """Return the chart of a skill.

    Its states are those of the skill and ``retract``, ``done`` and ``failed``. The labels of its
    transitions are the outcomes.

    Raises:
        ChartError: If a name is unknown, used twice or taken; if a state can't be reached, runs
            nothing, or has no finite time or a time that is too short for its primitives; if it
            has an entry for an impossible event, counts from a mark that may not exist, or tests
            for the obstruction of a dither that it does not run.
    """
    _check_skill(skill)
    retract = _retract_of(skill)
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
        abort_action=_aborted,
    )


def _chart_state(state: SkillState) -> State[Observation, SkillMemory]:
    def entry(tick: _Tick) -> SkillMemory:
        memory = tick.memory
        marks = state.marks and state.name not in memory.marked
        mark = tick.inputs if marks else memory.mark
        begin = mark if state.from_mark and mark is not None else tick.inputs
        begin = begin._replace(perturbed=memory.ran)  # however many ticks ago that was
        run = state.run_again(partial(memory.tried, state.name))
        return memory._replace(
            mark=mark,
            marked=(*memory.marked, state.name) if marks else memory.marked,
            event=None,
            run=run,
            memories=tuple(primitive.begin(begin) for primitive in run),
            closed=memory.closed if state.grip is None else state.grip == "close",
            looks=state.looks,
            tares=state.tares,
            damping=state.damping or STILL,
        )

    def during(tick: _Tick) -> SkillMemory:
        for name in ("carriage", "motion", "wrench", "perturbed"):
            values = getattr(tick.inputs, name)
            if not all(map(math.isfinite, values)):  # no guard would ever see it
                raise ParameterError(name, list(values), "finite numbers")
        time = tick.time_in_state
        stepped = [
            primitive.step(tick.inputs, memory, time)
            for primitive, memory in zip(tick.memory.run, tick.memory.memories, strict=True)
        ]
        event = next((one.event for one in stepped if one.event is not None), None)
        total = tuple(sum(one.velocity[i] for one in stepped) for i in range(_SIZE))
        return tick.memory._replace(
            # What has ended commands nothing more, also in the tick before it is left.
            velocity=STILL if event is not None else total,
            ran=tick.memory.ran if event is not None else total,
            event=event,
            memories=tuple(one.memory for one in stepped),
        )

    labels = [primitive.label for primitive in state.run]
    if state.grip is not None:
        labels.insert(0, f"grip {state.grip}")
    return State(name=state.name, entry=entry, during=during, note=", ".join(labels))


def _stop(tick: _Tick) -> SkillMemory:
    return tick.memory._replace(
        velocity=STILL, event=None, run=(), memories=(), damping=STILL, looks=False, tares=False
    )


def _aborted(state: str, tick: _Tick) -> SkillMemory:
    return tick.memory._replace(reason=tick.memory.reason or f"{state}: abort")


def _late(state: SkillState, tick: _Tick) -> bool:
    return tick.time_in_state >= state.timeout - TIME_TOLERANCE


def _transitions(state: SkillState) -> list[Transition[Observation, SkillMemory]]:
    found = []
    for outcome, answer in state.on.items():
        if isinstance(answer, str):
            guard = _guard(state, outcome)
            found.append(Transition(source=state.name, target=answer, label=outcome, guard=guard))
            continue
        first, label = 0, str(outcome)
        retry: Retry | None = answer
        while retry is not None:
            tries = range(first, first + retry.at_most)
            changes = "".join(f", {name} {by:g}x" for name, by in retry.factors.items())
            found.append(
                Transition(
                    source=state.name,
                    target=retry.target,
                    label=f"{label}, {retry.at_most} times at most{changes}",
                    guard=_guard(state, outcome, tries),
                    action=partial(_counted, (state.name, outcome)),
                )
            )
            first, retry, label = tries.stop, retry.then, f"{outcome} again"

    def ended(tick: _Tick) -> bool:
        return tick.memory.event is not None or _late(state, tick)

    def why(tick: _Tick) -> SkillMemory:
        outcome = tick.memory.event or "timed out"
        reason = f"{state.name}: {outcome}"
        expected = replace(state, run=tick.memory.run).expected(outcome)
        return tick.memory._replace(reason=reason, expected=expected)

    found.append(
        Transition(source=state.name, target=RETRACT, label="otherwise", guard=ended, action=why)
    )
    return found


def _guard(
    state: SkillState, outcome: Outcome, tries: range | None = None
) -> Callable[[_Tick], bool]:
    """Return the guard of an outcome, for its first time or its retries."""

    def guard(tick: _Tick) -> bool:
        event = tick.memory.event
        if event == "tilted" and "tilted" not in state.on:
            event = "jammed"
        ends = event is None and _late(state, tick) if outcome == "timed out" else event == outcome
        return ends and (tries is None or tick.memory.tried(state.name, outcome) in tries)

    return guard


def _counted(edge: tuple[str, str], tick: _Tick) -> SkillMemory:
    memory = tick.memory
    counts = {**dict(memory.retries), edge: memory.tried(*edge) + 1}
    return memory._replace(retries=tuple(counts.items()))


class SkillLaw(ChartLaw[Observation, SkillMemory]):
    """Runs a skill.

    ``parts`` is the number of parts that each camera looks for; the period, s, is between two
    steps. A step may be missing or come late, because every wait of a skill counts time.

    Raises:
        ChartError: If the skill can't be run.
        ParameterError: If the period is not allowed; in a step, while the skill has not ended, if
            ``carriage``, ``motion``, ``wrench`` or ``perturbed`` is not finite.
    """

    def __init__(self, skill: Skill, *, parts: int, period: float) -> None:
        check_timing(skill, period)
        super().__init__(
            make_skill_chart(skill),
            observation=Observation,
            inputs=sensed_signals(parts),
            outputs={
                "velocity": MachineOutput(size=_SIZE, unit=VELOCITY, read=attrgetter("velocity")),
                **{name: number(name) for name in ("closed", "looks", "tares")},
                "damping": MachineOutput(size=_SIZE, unit=DAMPING, read=attrgetter("damping")),
                "retries": MachineOutput(
                    read=lambda one: (float(sum(dict(one.retries).values())),)
                ),
            },
            period=period,
        )
