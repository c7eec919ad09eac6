"""Whether a skill can do what it says, before it runs: each mistake is refused in one line."""

import math
from collections.abc import Iterator, Sequence

from chamfer.models.connectors.connector import Connector
from chamfer.systems.primitives.force_primitives import AXIS_NAMES, Load, Obstructed, index_of
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.skill import (
    DONE,
    FAILED,
    OUTCOMES,
    RETRACT,
    Retry,
    Skill,
    SkillState,
)
from chamfer.systems.primitives.trajectory_primitives import Dither
from chamfer.systems.statechart.chart import ChartError

_TICKS = 4  # that a cycle of a dither takes at least
_ROUNDING = 1e-6  # samples


def check_skill(skill: Skill) -> None:
    """Check what can be known without a clock.

    Raises:
        ChartError: If a state runs nothing, has no finite time or one that is too short for what
            it runs, has an answer to an event that can't be, counts from a mark that may not have
            been made, or looks for the hindrance of a dither that it does not run.
    """
    for state in skill.states:
        if state.name in (DONE, RETRACT, FAILED):
            raise ChartError(f"skill {skill.name!r}: {state.name!r} is a state of every skill")
    for state in (*skill.states, retract_of(skill)):
        where = f"skill {skill.name!r}: {state.name!r}"
        _check_fields(skill.name, state, where)
        _check_answers(state, where)
        _check_times(state, where)
        for hindered, axis, _ in _watched(state):
            if not any(AXIS_NAMES[dither.index] == axis for dither in _dithers(state)):
                raise ChartError(f"{where}: {hindered.label} watches {axis}, but no dither is run")
    _check_marks(skill)


def check_timing(skill: Skill, period: float) -> None:
    """Check what depends on the time between two ticks, s.

    Raises:
        ChartError: If a dither is too fast for the ticks, or the windows in which its hindrance is
            looked for are not a cycle of it, or more than there is time for.
    """
    for state in (*skill.states, retract_of(skill)):
        where = f"skill {skill.name!r}: {state.name!r}"
        for dither in _dithers(state):
            fastest = 1 / (_TICKS * period)
            if dither.frequency > fastest:
                raise ChartError(
                    f"{where}: the frequency of {dither.label} is {dither.frequency:g} Hz, "
                    f"allowed: at most {fastest:g} Hz, a quarter of the ticks"
                )
        for hindered, axis, samples in _watched(state):
            for dither in _dithers(state):
                cycle = 1 / (dither.frequency * period)  # samples
                if AXIS_NAMES[dither.index] == axis and abs(samples - cycle) > 0.5 + _ROUNDING:
                    raise ChartError(
                        f"{where}: the windows of {hindered.label} are {samples} samples along "
                        f"{axis}, allowed: a cycle of {dither.label}, {cycle:.4g}"
                    )
            needed = hindered.windows * samples * period
            if needed >= state.timeout:
                raise ChartError(
                    f"{where}: the timeout is {state.timeout:g} s, "
                    f"allowed: more than {needed:g} s, the windows of {hindered.label}"
                )


def check_forces(skill: Skill, damping: Sequence[float], connector: Connector) -> None:
    """Check the forces that end primitives, and those that the connector stands.

    Args:
        skill: Whose states may set a damping of their own.
        damping: Of accommodation, N m s/rad above N s/m, shape (6,).
        connector: What is inserted.

    Raises:
        ChartError: If a force or torque is never reached, or more than the connector stands.
    """
    for state in (*skill.states, retract_of(skill)):
        own = state.damping or STILL
        for primitive in state.run:
            load = getattr(primitive, "load", None)
            if not isinstance(load, Load):
                continue
            index = index_of(load.direction)
            linear = index >= len(STILL) // 2
            reached = (own[index] or damping[index]) * load.speed
            stands = connector.largest_force if linear else connector.largest_torque
            unit = "N" if linear else "N m"
            where = f"skill {skill.name!r}: {state.name!r}: {primitive.label}"
            if reached <= load.force < math.inf:
                raise ChartError(
                    f"{where} ends at {load.force:g} {unit}, "
                    f"allowed: less than {reached:g} {unit}, the damping times its speed"
                )
            # What is pushed stiffly is not told by its speed.
            if stands < (most := min(load.force, reached)) < math.inf:
                raise ChartError(
                    f"{where} pushes with {most:g} {unit}, "
                    f"allowed: at most {stands:g} {unit}, which {connector.name} stands"
                )


def retract_of(skill: Skill) -> SkillState:
    """Return the state in which a skill retracts after a failure."""
    return SkillState(name=RETRACT, run=skill.retract, on={}, timeout=skill.retract_timeout)


def targets(answer: str | Retry | None) -> list[str]:
    """Return the states that an answer leads to, the first try's first."""
    if isinstance(answer, Retry):
        return [answer.target, *targets(answer.then)]
    return [] if answer is None else [answer]


def _check_fields(skill: str, state: SkillState, where: str) -> None:
    if not state.run:
        raise ChartError(f"{where} runs no primitive")
    if not 0 < state.timeout < math.inf:
        raise ChartError(
            f"skill {skill!r}: the timeout of {state.name!r} is {state.timeout!r}, "
            "allowed: a finite number > 0"
        )
    if state.grip not in (None, "open", "close"):
        raise ChartError(f"{where} has the grip {state.grip!r}, allowed: open, close, None")


def _check_answers(state: SkillState, where: str) -> None:
    possible = {event for primitive in state.run for event in primitive.events}
    for outcome, answer in state.on.items():
        if outcome not in OUTCOMES:
            valid = ", ".join(OUTCOMES)
            raise ChartError(f"{where} has an answer to {outcome!r}, valid outcomes: {valid}")
        if outcome not in (*possible, "timed out"):
            valid = ", ".join([*(one for one in OUTCOMES if one in possible), "timed out"])
            raise ChartError(
                f"{where} has an answer to {outcome!r}, which nothing that it runs can be, "
                f"possible outcomes: {valid}"
            )
        if not {RETRACT, FAILED}.isdisjoint(targets(answer)):
            raise ChartError(f"{where}: what fails needs no answer, but {outcome!r} has one")


def _check_times(state: SkillState, where: str) -> None:
    """Raise if an event would come after the timeout.

    What is not done in time, and need not be, only accompanies another primitive.
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


def _watched(state: SkillState) -> Iterator[tuple[Obstructed, str, int]]:
    """Yield each test for hindrance with an axis and the samples of its windows there."""
    for one in state.run:
        if isinstance(one, Obstructed):
            for axis, samples in zip(one.axes, one.samples, strict=True):
                yield one, axis, samples
