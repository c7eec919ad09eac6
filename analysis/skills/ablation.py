"""Skills without one of their primitives, to measure the value of each.

Source: Morrow, Nelson and Khosla argue for their primitives by the needs of a strategy.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from chamfer.systems.primitives.force_primitives import Level, Obstructed
from chamfer.systems.primitives.position_primitives import Centre, Held
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import Outcome, Retry, Skill, SkillState
from chamfer.systems.primitives.skill_law import targets
from chamfer.systems.primitives.trajectory_primitives import MoveDx

SkillChange = Callable[[Skill], Skill]
_ROTARY: Final = "rotary search"


def whole(skill: Skill) -> Skill:
    """Return the unchanged skill."""
    return skill


def without_tare(skill: Skill) -> Skill:
    """Return a skill that waits in place of the tare, and takes no zero."""
    return replace(skill, states=[replace(state, tares=False) for state in skill.states])


def without_correlation(skill: Skill) -> Skill:
    """Return a skill that does not detect an obstructed dither.

    If nothing else ended the dithers, their end counts as the obstruction.
    """

    def change(state: SkillState) -> SkillState:
        kept = [one for one in state.run if not isinstance(one, Obstructed)]
        if len(kept) == len(state.run):
            return state
        on = _without(state.on, "hindered")
        if "hindered" in state.on:
            on.setdefault("done", state.on["hindered"])
        return replace(state, run=kept, on=on)

    return replace(skill, states=[change(state) for state in skill.states])


def without_level(skill: Skill) -> Skill:
    """Return a skill that rests on the face for the time of levelling, whatever its tilt."""
    return _instead(
        skill, lambda one: MoveDx(duration=one.time) if isinstance(one, Level) else one
    )


def without_centring(skill: Skill) -> Skill:
    """Return a skill whose search drifts with the forces."""
    return _instead(skill, lambda one: None if isinstance(one, Centre) else one)


def without_grip_check(skill: Skill) -> Skill:
    """Return a skill that assumes that the fingers hold the plug."""

    def change(one: Primitive) -> Primitive | None:
        if not isinstance(one, Held):
            return one
        return MoveDx(duration=one.wait + one.time) if "done" in one.events else None

    return _instead(skill, change)


def without_rotary_search(skill: Skill) -> Skill:
    """Return a skill whose search ends with the dithers along x and y."""
    left = next((state for state in skill.states if state.name == _ROTARY), None)
    if left in (None, skill.states[0]) or "done" not in left.on:
        return skill

    def change(state: SkillState) -> SkillState:
        on = {
            outcome: left.on["done"] if answer == _ROTARY else answer
            for outcome, answer in state.on.items()
        }
        return replace(state, on=on)

    kept = [change(state) for state in skill.states if state.name != _ROTARY]
    return _reachable(replace(skill, states=kept))


CHANGES: Final[Mapping[str, SkillChange]] = {
    "whole": whole,
    "without_tare": without_tare,
    "without_correlation": without_correlation,
    "without_level": without_level,
    "without_centring": without_centring,
    "without_rotary_search": without_rotary_search,
    "without_grip_check": without_grip_check,
}


def _instead(skill: Skill, change: Callable[[Primitive], Primitive | None]) -> Skill:
    """Return a skill with other primitives, None for none, without unreachable states."""

    def changed(state: SkillState) -> SkillState:
        run = [new for one in state.run if (new := change(one)) is not None]
        gone = {event for one in state.run for event in one.events}
        gone -= {event for one in run for event in one.events}
        on = {outcome: then for outcome, then in state.on.items() if outcome not in gone}
        return replace(state, run=run, on=on)

    return _reachable(replace(skill, states=[changed(state) for state in skill.states]))


def _without(on: Mapping[Outcome, str | Retry], outcome: Outcome) -> dict[Outcome, str | Retry]:
    """Return entries without the one for an outcome."""
    return {key: answer for key, answer in on.items() if key != outcome}


def _reachable(skill: Skill) -> Skill:
    """Return a skill without the states that no entry leads to any more."""
    by_name = {state.name: state for state in skill.states}
    found, front = set(), [skill.states[0].name]
    while front:
        name = front.pop()
        if name in found or name not in by_name:
            continue
        found.add(name)
        for answer in by_name[name].on.values():
            front += targets(answer)
    return replace(skill, states=[state for state in skill.states if state.name in found])
