"""The strategy of the D connector, driven without Drake."""

import math
import re
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pytest

from models.validation import ParameterError
from systems.skills.d_connector import DConnectorSkillParams, make_d_connector_skill
from systems.skills.force_primitives import Hindered, Hold, Push, ShiftToContact
from systems.skills.primitive import STILL
from systems.skills.skill import DONE, FAILED, RETRACT
from systems.skills.trajectory_primitives import Dither

PARAMS: Final = DConnectorSkillParams()
PERIOD: Final = 0.05  # s, that of the drives
ANSWERS: Final[Any] = {
    "approach": {"contact": "level"},
    "level": {"done": "search", "lost": ["shift"] * 6, "timed out": ["shift"] * 6},
    "shift": {"done": "approach"},
    "search": {"lost": "settle", "hindered": "settle", "done": "rotary search"},
    "rotary search": {"lost": "settle", "done": ["shift"] * 3},
    "settle": {"done": "push"},
    "push": {"done": "verify", "jammed": ["back off"] * 3 + ["shift"] * 3},
    "back off": {"done": "free"},
    "free": {"done": "push"},
    "verify": {"hindered": DONE},
}


@pytest.fixture(scope="module")
def strategy(grasp_states: Any, grasp_answers: Any, make_strategy: Any) -> Any:
    skill = make_d_connector_skill(PARAMS, period=PERIOD, before=grasp_states("approach"))
    return make_strategy(skill, {**grasp_answers, **ANSWERS})


def test_every_outcome_is_answered_as_expected_and_every_transition_taken(strategy: Any) -> None:
    drives = [strategy.journey(state, outcome) for state, outcome in strategy.outcomes]
    assert len(drives) == 40
    assert strategy.untaken(drives) == set()


def test_the_straight_way_is_done_without_a_retry(strategy: Any) -> None:
    drive = strategy.drive_to("verify")
    assert drive.make("hindered") == DONE
    straight = ["approach", "level", "search", "settle", "push", "verify", "done"]
    assert drive.path == ["reach", "close in", "grasp", "lift", "transport", *straight]
    assert (drive.memory.retries, drive.memory.reason, drive.memory.velocity) == ((), "", STILL)


@pytest.mark.parametrize("retries", [1, 2])
def test_retries_are_those_of_the_parameters(retries: int, make_drive: Any) -> None:
    params = DConnectorSkillParams(retries=retries)
    drive = make_drive(make_d_connector_skill(params, period=PERIOD))
    for outcome in ("contact", "done", "lost", "done"):
        drive.make(outcome)
    for _ in range(retries):
        assert drive.make("jammed") == "back off"
        assert [drive.make("done") for _ in range(2)] == ["free", "push"]
    for _ in range(retries):
        assert drive.make("jammed") == "shift"
        for outcome in ("done", "contact", "done", "lost", "done"):
            drive.make(outcome)
    assert drive.make("jammed") == RETRACT
    assert drive.memory.reason == "push: jammed"
    assert drive.end() == FAILED


def test_a_plug_held_from_the_begin_is_approached_at_once(make_drive: Any) -> None:
    drive = make_drive(make_d_connector_skill(PARAMS, period=PERIOD))
    assert drive.path == ["approach"]
    assert drive.memory.closed
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -0.01)


def test_it_shifts_to_where_it_was_touched(make_drive: Any) -> None:
    drive = make_drive(make_d_connector_skill(PARAMS, period=PERIOD))
    drive.make("contact")
    assert drive.make("lost") == "shift"
    # It turns back to how it was at the approach, 0.06 rad ago.
    assert drive.memory.velocity[0] == pytest.approx(-PARAMS.hold_gain * 0.06)


def test_a_push_counts_its_way_from_the_approach_on(make_drive: Any) -> None:
    drive = make_drive(make_d_connector_skill(PARAMS, period=PERIOD))
    for outcome in ("contact", "done", "lost", "done"):
        drive.make(outcome)
    drive.carriage[5] = -0.005 - 1.001 * PARAMS.push_depth
    while drive.memory.event is None:
        drive.tick(wrench=(0, 0, 0, 0, 0, 1.01 * PARAMS.push_force))
    assert drive.memory.event == "done"


def test_what_the_states_command(make_drive: Any) -> None:
    drive = make_drive(make_d_connector_skill(PARAMS, period=PERIOD))
    drive.make("contact")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.maintained)
    drive.make("done")
    slow, fast = (2 * math.pi * f * PARAMS.search_amplitude for f in (0.6, 0.6 * 9 / 8))
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, 0, slow, fast, -PARAMS.maintained])
    drive.make("lost")
    tilts = 2 * math.pi * PARAMS.settle_amplitude
    np.testing.assert_allclose(drive.memory.velocity, [tilts, tilts, 0, 0, 0, -PARAMS.maintained])
    drive.make("done")
    shake = 2 * math.pi * 4.0 * PARAMS.push_dither
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, 0, shake, 0, -PARAMS.push_speed])
    drive.make("jammed")
    while drive.state == "back off":
        way = drive.way()
        drive.tick()
    np.testing.assert_allclose(way, [0, 0, 0, 0, 0, PARAMS.back_off], atol=1e-12)


def test_dithers_are_watched_over_whole_cycles(find_primitive: Callable[..., Any]) -> None:
    skill = make_d_connector_skill(DConnectorSkillParams(search_frequency=0.8), period=0.005)
    for state, cycles in (("search", (250, 222)), ("verify", (400, 400))):
        assert find_primitive(skill, state, Hindered).samples == cycles
    assert find_primitive(skill, "verify", Hindered).threshold == PARAMS.verify_threshold
    twist = [
        one
        for state in skill.states
        if state.name == "rotary search"
        for one in state.run
        if isinstance(one, Dither) and one.kind == "rotary"
    ]
    assert [(one.axis, one.amplitude, one.frequency) for one in twist] == [("z", 0.06, 0.7)]
    assert find_primitive(skill, "rotary search", Hold).axes == ("rx", "ry")
    assert find_primitive(skill, "shift", ShiftToContact).way == PARAMS.shift
    assert find_primitive(skill, "push", Push).force == PARAMS.push_force


def test_parameters_may_be_zero_where_they_only_help() -> None:
    none: Any = {"centring": 0.0, "twist_amplitude": 0.0, "settle_amplitude": 0.0}
    assert make_d_connector_skill(DConnectorSkillParams(push_dither=0.0, **none)).states


ZERO: Final = {"centring", "twist_amplitude", "settle_amplitude", "push_dither"}
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
