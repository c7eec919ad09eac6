"""The strategy of the D connector, driven without Drake."""

import math
import re
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.connectors.d_connector import DConnector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import Obstructed
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, FAILED, RETRACT
from chamfer.systems.primitives.trajectory_primitives import Dither
from chamfer.systems.strategies.d_strategy import DConnectorSkillParams, make_d_connector_skill

PARAMS: Final = DConnectorSkillParams()
CONNECTOR: Final = DConnector()
PERIOD: Final = 0.05  # s, that of the drives
ANSWERS: Final[Any] = {
    "tare": {"done": "beside"},
    "beside": {"done": "touch"},
    "touch": {"contact": "lie"},
    "lie": {"done": "above"},
    "above": {"done": "tare again"},
    "out": {"done": "tare again"},
    "tare again": {"done": "search"},
    "search": {"lost": "settle", "hindered": "settle", "done": "rotary search"},
    "rotary search": {"lost": "settle", "done": ["out"] * 3},
    "settle": {"done": "feel"},
    "feel": {"done": "push", "jammed": ["out"] * 3},
    "push": {"done": "rest", "jammed": ["back off"] + ["out"] * 3},
    "rest": {"done": "verify", "jammed": ["free"]},
    "back off": {"done": "free"},
    "free": {"done": "push"},
    "verify": {"hindered": "pull"},
    "pull": {"contact": DONE},
}
TO_PUSH: Final = ("done", "done", "contact", "done", "done", "done", "lost", "done", "done")


@pytest.fixture(scope="module")
def strategy(grasp_states: Any, grasp_answers: Any, make_strategy: Any) -> Any:
    skill = make_d_connector_skill(PARAMS, CONNECTOR, period=PERIOD, before=grasp_states("tare"))
    return make_strategy(skill, {**grasp_answers, **ANSWERS})


def held(make_drive: Any, *outcomes: str, **changes: Any) -> Any:
    """Drive a plug that is held from the begin through outcomes."""
    params = DConnectorSkillParams(**changes)
    drive = make_drive(make_d_connector_skill(params, CONNECTOR, period=PERIOD))
    for outcome in outcomes:
        drive.make(outcome)
    return drive


def test_every_outcome_is_answered_as_expected_and_every_transition_taken(strategy: Any) -> None:
    drives = [strategy.journey(state, outcome) for state, outcome in strategy.outcomes]
    assert strategy.untaken(drives) == set()


def test_the_straight_way_is_done_without_a_retry(strategy: Any) -> None:
    drive = strategy.drive_to("pull")
    assert drive.make("contact") == DONE
    before = ["reach", "close in", "grasp", "lift", "transport"]
    face = ["tare", "beside", "touch", "lie", "above", "tare again"]
    straight = ["search", "settle", "feel", "push", "rest", "verify", "pull", "done"]
    assert drive.path == [*before, *face, *straight]
    assert (drive.memory.retries, drive.memory.reason, drive.memory.velocity) == ((), "", STILL)


@pytest.mark.parametrize("retries", [1, 2])
def test_retries_are_those_of_the_parameters(retries: int, make_drive: Any) -> None:
    drive = held(make_drive, *TO_PUSH, retries=retries)
    assert drive.make("jammed") == "back off"
    assert [drive.make("done") for _ in range(2)] == ["free", "push"]
    for _ in range(retries):
        assert drive.make("jammed") == "out"
        for outcome in ("done", "done", "lost", "done", "done"):
            drive.make(outcome)
    assert drive.make("jammed") == RETRACT
    assert drive.memory.reason == "push: jammed"
    assert drive.end() == FAILED


def test_the_mark_is_the_face_and_stays(make_drive: Any) -> None:
    drive = held(make_drive, "done", "done")
    drive.carriage[:] = (0.0, 0.01, 0.0, 0.001, 0.004, -0.0052)
    assert drive.make("contact") == "lie"
    assert drive.memory.damping == (math.inf, 0.0, math.inf, math.inf, math.inf, 0.0)
    assert drive.make("done") == "above"
    mark = drive.memory.mark
    assert mark is not None
    np.testing.assert_allclose(mark.carriage, drive.carriage)
    for outcome in ("done", "done", "lost", "done", "jammed", "done", "done"):
        drive.make(outcome)
    assert (drive.state, drive.memory.mark) == ("search", mark)


def test_the_search_is_where_the_plug_came_from(make_drive: Any) -> None:
    drive = held(make_drive, *TO_PUSH[:6])
    frequencies = PARAMS.search_frequency, PARAMS.search_frequency * 7 / 6
    slow, fast = (2 * math.pi * f * PARAMS.search_amplitude for f in frequencies)
    np.testing.assert_allclose(
        drive.memory.velocity, [0, 0, 0, slow, fast, -PARAMS.search_press], atol=1e-12
    )
    # The face was felt beside it.
    assert drive.memory.mark.carriage[4] - drive.carriage[4] == pytest.approx(PARAMS.beside)


def test_what_the_states_command(make_drive: Any) -> None:
    drive = held(make_drive, *TO_PUSH[:7])
    tilts = 2 * math.pi * PARAMS.settle_amplitude
    np.testing.assert_allclose(drive.memory.velocity, [tilts, tilts, 0, 0, 0, -PARAMS.maintained])
    drive.make("done")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.maintained)
    drive.make("done")
    shake = 2 * math.pi * 6.25 * PARAMS.push_dither
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, 0, shake, 0, -Seat().speed])
    drive.make("jammed")
    while drive.state == "back off":
        way = drive.way()
        drive.tick()
    np.testing.assert_allclose(way, [0, 0, 0, 0, 0, PARAMS.back_off], atol=1e-12)
    for outcome in ("done", "done", "done"):
        drive.make(outcome)
    assert drive.state == "verify"
    drive.make("hindered")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, PARAMS.pull_speed)


def test_depths_count_from_the_face_of_the_believed_connector(
    find_primitive: Callable[..., Any],
) -> None:
    skill = make_d_connector_skill(PARAMS, CONNECTOR)
    feel, rest = (find_primitive(skill, state, Way) for state in ("feel", "rest"))
    assert feel.least == pytest.approx(CONNECTOR.pin_depth - PARAMS.entry)
    assert rest.least == pytest.approx(CONNECTOR.mated_depth - PARAMS.short)
    rim = -(CONNECTOR.plug_section.height / 2 + CONNECTOR.lead_in)
    assert feel.beside == rest.beside == (0.0, rim)
    push = find_primitive(skill, "push", Seat)
    assert push.limit == pytest.approx(PARAMS.limit_share * CONNECTOR.mating_force)
    # Where it is hardest it is not seated yet.
    hardest = CONNECTOR.pin_depth + np.linspace(0, 1e-3, 101)
    assert push.distance > hardest[CONNECTOR.pin_force(hardest).argmax()] + 3e-4


def test_dithers_are_watched_over_whole_cycles(find_primitive: Callable[..., Any]) -> None:
    params = DConnectorSkillParams(search_frequency=0.8)
    skill = make_d_connector_skill(params, CONNECTOR, period=0.005)
    for state, cycles in (("search", (250, 214)), ("verify", (286, 286))):
        assert find_primitive(skill, state, Obstructed).samples == cycles
    assert find_primitive(skill, "verify", Obstructed).threshold == PARAMS.verify_threshold
    twist = [
        one
        for state in skill.states
        if state.name == "rotary search"
        for one in state.run
        if isinstance(one, Dither) and one.kind == "rotary"
    ]
    assert [(one.axis, one.amplitude, one.frequency) for one in twist] == [("z", 0.06, 0.12)]


def test_parameters_may_be_zero_where_they_only_help() -> None:
    none: Any = {"twist_amplitude": 0.0, "settle_amplitude": 0.0}
    params = DConnectorSkillParams(push_dither=0.0, **none)
    assert make_d_connector_skill(params, CONNECTOR).states


ZERO: Final = {"twist_amplitude", "settle_amplitude", "push_dither"}
WHOLE: Final = {"search_repeats", "retries"}


@pytest.mark.parametrize("name", DConnectorSkillParams.__dataclass_fields__)
@pytest.mark.parametrize("value", [-1.0, 0.0, math.nan])
def test_errors(name: str, value: float) -> None:
    if name in ZERO and value == 0.0:
        return
    allowed = "a finite number >= 0" if name in ZERO else "a finite number > 0"
    message = f"{name} is {value}, allowed: {'a whole number >= 1' if name in WHOLE else allowed}"
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        DConnectorSkillParams(**{name: value})  # type: ignore[arg-type]


def test_a_push_may_be_as_hard_as_the_mating_force() -> None:
    with pytest.raises(ParameterError, match=r"^limit_share is 0\.9, allowed: a number >= 1:"):
        DConnectorSkillParams(limit_share=0.9)
