"""Groups of states by name: the parts of the strategies that skill files can use."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

from chamfer.systems.primitives.skill import SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.strategies.face_and_search import UNTURNED, Answers, pull_test, settled
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams as Peg
from chamfer.systems.strategies.peg_in_hole import Search
from chamfer.systems.strategies.rj45_strategy import Rj45ConnectorSkillParams as Plug

_DOWN: Final = "approach_speed contact_force clearance maintained "
_FACE: Final = (
    f"{_DOWN} tare_time approach_limit beside out_speed out_acceleration straighten_gain lie_time "
)
_SEARCH: Final = "maintained drop retries "


class StateGroup(NamedTuple):
    """States that skill files use by the name of the group, and the arguments of the group."""

    params: type[Peg] | type[Plug]
    fields: str  # of the parameters, with spaces between: arguments with their defaults
    exits: str  # with spaces between: arguments that are the following states
    make: Callable[..., Sequence[SkillState]]  # of the parameters, the exits and the sizes
    sizes: Mapping[str, str] = {}  # further arguments, with their units


def _felt(of: Peg, then: str) -> Sequence[SkillState]:
    rests, timeout = MoveDx(duration=of.lie_time), 2 * of.lie_time
    return of.feel_face(rests, timeout=timeout, damping=UNTURNED, then=then)


def _search(way: Search, *, fields: str) -> StateGroup:
    def make(of: Peg, found: str) -> Sequence[SkillState]:
        return [replace(of, search=way).along_face(found=found)]

    return StateGroup(Peg, _SEARCH + fields, "found", make)


def _leaning(of: Peg, radius: float, found: str) -> Sequence[SkillState]:
    return of.tilt.states(of, radius, found=found)


def _settled(of: Plug, then: str) -> Sequence[SkillState]:
    return [settled(of.hold, of.settle_amplitude, of.settle_cycles, then)]


def _pulled(of: Plug, held: Any, lost: Any) -> Sequence[SkillState]:
    on: Answers = {"contact": held, "lost": lost}
    return [pull_test(on, speed=of.pull_speed, force=of.pull_force, limit=of.pull_limit)]


# Those that feel the face have a state ``out``, to which the others go back to try again.
STATE_GROUPS: Final[Mapping[str, StateGroup]] = {
    "feel-face": StateGroup(Peg, _FACE, "then", _felt),
    "lay-flat": StateGroup(Peg, _FACE, "then", Peg.laid_flat),
    "touch-face": StateGroup(Peg, f"{_FACE} entered", "search found", Peg.touched),
    "search-by-dithers": _search("dithers", fields="amplitude frequency repeats"),
    "search-by-spiral": _search("spiral", fields="spiral"),
    "search-by-tilt": StateGroup(
        Peg, f"{_DOWN} entered retries tilt", "found", _leaning, {"radius": "m"}
    ),
    "settle": StateGroup(Plug, "maintained settle_amplitude settle_cycles", "then", _settled),
    "push": StateGroup(
        Peg,
        "limit_share free_share push_speed end retries maintained tilted back_off "
        "straighten_amplitude straighten_gain",
        "then",
        lambda of, **given: of.pushed(**given),
        {"force": "N", "depth": "m"},
    ),
    "at-depth": StateGroup(
        Peg,
        "maintained short retries",
        "then",
        lambda of, **given: [of.at_depth(**given)],
        {"depth": "m"},
    ),
    "pull-test": StateGroup(Plug, "pull_speed pull_force pull_limit", "held lost", _pulled),
}
