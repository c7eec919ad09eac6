"""The strategy of the RJ45 plug, driven without Drake."""

from typing import Any, Final

import pytest

from chamfer.models.connectors.rj45_connector import Rj45Connector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import GuardedMove
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE
from chamfer.systems.strategies.rj45_strategy import (
    Rj45ConnectorSkillParams,
    make_rj45_connector_skill,
)

PARAMS: Final = Rj45ConnectorSkillParams()
RJ45: Final = Rj45Connector()
ANSWERS: Final[Any] = {
    "tare": {"done": "beside"},
    "beside": {"done": "touch"},
    "touch": {"contact": "lie"},
    "lie": {"done": "above"},
    "above": {"done": "tare again"},
    "out": {"done": "tare again"},
    "tare again": {"done": "down"},
    "down": {"contact": "search", "lost": "settle"},
    "search": {"lost": "settle", "done": ["out"] * 3},
    "settle": {"done": "push"},
    "push": {"done": "depth", "jammed": ["out"] * 3, "timed out": ["out"] * 3},
    "depth": {"done": "pull", "jammed": ["out"] * 3},
    "pull": {"contact": "rest", "lost": ["out"] * 3},
    "rest": {"done": DONE},
}


@pytest.fixture(scope="module")
def strategy(grasp_states: Any, grasp_answers: Any, make_strategy: Any) -> Any:
    skill = make_rj45_connector_skill(PARAMS, RJ45, before=grasp_states("tare"))
    return make_strategy(skill, {**grasp_answers, **ANSWERS})


def test_every_outcome_is_answered_as_expected_and_every_transition_taken(strategy: Any) -> None:
    drives = [strategy.journey(state, outcome) for state, outcome in strategy.outcomes]
    assert strategy.untaken(drives) == set()


def test_the_straight_way_ends_with_a_latch_that_holds(strategy: Any) -> None:
    drive = strategy.drive_to("pull")
    assert [drive.make("contact"), drive.make("done")] == ["rest", DONE]
    assert drive.path[-6:] == ["settle", "push", "depth", "pull", "rest", "done"]
    assert (drive.memory.retries, drive.memory.reason, drive.memory.velocity) == ((), "", STILL)


def test_depths_and_forces_fit_the_plug_as_it_is_believed(find_primitive: Any) -> None:
    weak = RJ45.with_mating_force(RJ45.mating_force / 2)
    skill = make_rj45_connector_skill(PARAMS, weak)
    seat: Seat = find_primitive(skill, "push", Seat)
    assert seat.distance == pytest.approx(RJ45.mated_depth - PARAMS.end)
    assert seat.limit == pytest.approx(PARAMS.limit_share * weak.mating_force)
    assert seat.free == pytest.approx(PARAMS.free_share * weak.mating_force)
    depth: Way = find_primitive(skill, "depth", Way)
    # An obstacle half a millimetre short of the stop is not taken for it.
    assert RJ45.mated_depth - 0.0005 < depth.least < RJ45.mated_depth
    pull: GuardedMove = find_primitive(skill, "pull", GuardedMove)
    assert pull.threshold < weak.retention
    assert pull.limit > RJ45.latch_play


@pytest.mark.parametrize(
    "name", ["rest_time", "pull_force", "settle_cycles", "push_growth", "drop", "end"]
)
def test_it_refuses(name: str) -> None:
    with pytest.raises(ParameterError) as refused:
        Rj45ConnectorSkillParams(**{name: -1.0})
    assert refused.value.name == name
