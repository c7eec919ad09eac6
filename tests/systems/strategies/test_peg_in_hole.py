"""The strategy of the round peg, driven without Drake."""

import math
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE
from chamfer.systems.primitives.trajectory_primitives import Spiral
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams, make_peg_in_hole_skill

PEG: Final = RoundPeg()
ANSWERS: Final[Any] = {
    "tare": {"done": "beside"},
    "beside": {"done": "touch"},
    "touch": {"contact": "lie"},
    "lie": {"done": "above"},
    "above": {"done": "tare again"},
    "out": {"done": "tare again"},
    "tare again": {"done": "down"},
    "down": {"contact": "search", "lost": "insert"},
    "search": {"lost": "insert", "done": ["out"] * 3},
    "insert": {"done": "depth", "jammed": ["out"] * 3, "timed out": ["out"] * 3},
    "depth": {"done": DONE, "jammed": ["out"] * 3},
}
TILTED: Final[Any] = {
    **{name: answers for name, answers in ANSWERS.items() if name not in ("down", "search")},
    "tare again": {"done": "lean"},
    "lean": {"done": "lower"},
    "lower": {"contact": "slide", "lost": ["out"] * 3},
    "slide": {"contact": "across", "lost": ["out"] * 3},
    "across": {"done": "stand"},
    "stand": {"done": "sink"},
    "sink": {"done": "insert", "jammed": ["out"] * 3},
}
TO_SEARCH: Final = ("done", "done", "contact", "done", "done", "done", "contact")


@pytest.mark.parametrize(
    ("search", "answers"), [("dithers", ANSWERS), ("spiral", ANSWERS), ("tilt", TILTED)]
)
def test_every_outcome_is_answered_as_expected_and_every_transition_taken(
    search: Any, answers: Any, grasp_states: Any, grasp_answers: Any, make_strategy: Any
) -> None:
    params = PegInHoleSkillParams(search=search)
    skill = make_peg_in_hole_skill(params, PEG, before=grasp_states("tare"))
    strategy = make_strategy(skill, {**grasp_answers, **answers})
    drives = [strategy.journey(state, outcome) for state, outcome in strategy.outcomes]
    assert strategy.untaken(drives) == set()


def test_it_is_aligned_beside_the_hole_and_stays_turned_until_it_is_in(make_drive: Any) -> None:
    drive = make_drive(make_peg_in_hole_skill(PegInHoleSkillParams(), PEG))
    stiff = {}
    for outcome in (*TO_SEARCH, "lost"):
        stiff[drive.state] = [d == math.inf for d in drive.memory.damping or STILL]
        drive.make(outcome)
    assert not any(stiff["lie"])
    for state in ("above", "tare again", "down", "search"):
        assert stiff[state][:3] == [True] * 3
    assert not stiff["search"][5]
    assert drive.state == "insert"
    assert not any(d == math.inf for d in drive.memory.damping or STILL)


@pytest.mark.parametrize("search", ["dithers", "spiral"])
def test_it_searches_about_the_middle(search: Any, make_drive: Any) -> None:
    params = PegInHoleSkillParams(search=search)
    drive = make_drive(make_peg_in_hole_skill(params, PEG))
    for outcome in TO_SEARCH:
        drive.make(outcome)
    way = np.zeros(6)
    furthest = 0.0
    while drive.state == "search":
        way = drive.way()
        furthest = max(furthest, math.hypot(*way[3:5]))
        drive.tick()
    assert drive.state == "out"
    reach = math.sqrt(2) * params.amplitude if search == "dithers" else params.spiral.radius
    assert furthest == pytest.approx(reach, rel=0.1)


def test_depths_and_limit_are_those_of_the_peg_as_it_is_believed(find_primitive: Any) -> None:
    params = PegInHoleSkillParams()
    skill = make_peg_in_hole_skill(params, RoundPeg(depth=0.012, seating_force=8.0))
    seat: Seat = find_primitive(skill, "insert", Seat)
    assert (seat.distance, seat.limit) == pytest.approx((0.012 - params.end, 10.0))
    assert seat.free == pytest.approx(params.free_share * 8.0)
    assert find_primitive(skill, "depth", Way).least == pytest.approx(0.012 - params.short)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("search", "random"),
        ("repeats", 0),
        ("amplitude", -0.001),
        ("lie_time", 0.0),
        ("short", math.nan),
        ("retries", 0),
        ("beside", 0.0),
    ],
)
def test_it_refuses(name: str, value: Any) -> None:
    with pytest.raises(ParameterError) as refused:
        PegInHoleSkillParams(**{name: value})
    assert refused.value.name == name


def test_both_searches_cover_the_same_disc() -> None:
    params = PegInHoleSkillParams()
    assert isinstance(params.spiral, Spiral)
    assert params.spiral.radius < math.sqrt(2) * params.amplitude
    assert params.spiral.radius > params.amplitude
