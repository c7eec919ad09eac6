"""The strategy of the BNC connector, driven without Drake."""

import math
import re
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pytest

from models.validation import ParameterError
from systems.skills.bnc_connector import BncConnectorSkillParams, make_bnc_connector_skill
from systems.skills.force_primitives import GuardedMove, Hindered, Push
from systems.skills.primitive import STILL
from systems.skills.skill import DONE, FAILED, RETRACT

PARAMS: Final = BncConnectorSkillParams()
PERIOD: Final = 0.05  # s, that of the drives
ANSWERS: Final[Any] = {
    "approach": {"contact": "enter"},
    "enter": {"lost": "to the studs", "hindered": "to the studs"},
    "to the studs": {"contact": "find slots", "lost": "compress"},
    "find slots": {"lost": "compress", "hindered": "compress"},
    "compress": {"done": "turn", "jammed": ["find slots"] * 3},
    "turn": {"done": "release", "jammed": ["find slots"] * 3},
    "release": {"done": "verify"},
    "verify": {"hindered": "pull", "done": ["find slots"] * 3},
    "pull": {"contact": DONE, "lost": ["approach"] * 3},
}
TO_COMPRESS: Final = ("contact", "lost", "contact", "lost")


@pytest.fixture(scope="module")
def strategy(grasp_states: Any, grasp_answers: Any, make_strategy: Any) -> Any:
    skill = make_bnc_connector_skill(PARAMS, period=PERIOD, before=grasp_states("approach"))
    return make_strategy(skill, {**grasp_answers, **ANSWERS})


def test_every_outcome_is_answered_as_expected_and_every_transition_taken(strategy: Any) -> None:
    drives = [strategy.journey(state, outcome) for state, outcome in strategy.outcomes]
    assert len(drives) == 41
    assert strategy.untaken(drives) == set()


def test_the_straight_way_is_done_without_a_retry(strategy: Any) -> None:
    drive = strategy.drive_to("pull")
    assert drive.make("contact") == DONE
    assert drive.path[:6] == ["reach", "close in", "grasp", "lift", "transport", "approach"]
    front = ["enter", "to the studs", "compress", "turn", "release", "verify", "pull", "done"]
    assert drive.path[6:] == front
    assert (drive.memory.retries, drive.memory.reason, drive.memory.velocity) == ((), "", STILL)


@pytest.mark.parametrize("retries", [1, 2])
def test_retries_are_those_of_the_parameters(retries: int, make_drive: Any) -> None:
    drive = make_drive(make_bnc_connector_skill(BncConnectorSkillParams(retries=retries)))
    for outcome in TO_COMPRESS:
        drive.make(outcome)
    for _ in range(retries):
        assert [drive.make("jammed"), drive.make("lost")] == ["find slots", "compress"]
    # Every state and outcome has retries of its own.
    assert [drive.make("done"), drive.make("jammed")] == ["turn", "find slots"]
    assert drive.make("lost") == "compress"
    assert drive.make("jammed") == RETRACT
    assert drive.memory.reason == "compress: jammed"
    assert drive.end() == FAILED


def test_a_plug_held_from_the_begin_is_approached_at_once(make_drive: Any) -> None:
    drive = make_drive(make_bnc_connector_skill(PARAMS, period=PERIOD))
    assert drive.path == ["approach"]
    assert drive.memory.closed
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -0.01)


@pytest.mark.parametrize("turn", ["-rz", "+rz"])
def test_what_the_states_command(turn: Any, make_drive: Any) -> None:
    params = BncConnectorSkillParams(turn=turn)
    drive = make_drive(make_bnc_connector_skill(params, period=PERIOD))
    drive.make("contact")
    slow, fast = (2 * math.pi * f * PARAMS.search_amplitude for f in (0.6, 0.6 * 9 / 8))
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, 0, slow, fast, -PARAMS.maintained])
    drive.make("lost")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.approach_speed)
    drive.make("contact")
    sweep = 2 * math.pi * 0.05 * math.pi / 2
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, sweep, 0, 0, -PARAMS.maintained])
    drive.make("lost")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.compress_speed)
    drive.make("done")
    turned = PARAMS.turn_speed * (1 if turn == "+rz" else -1)
    assert drive.memory.velocity == (0, 0, turned, 0, 0, -PARAMS.compress_speed)
    drive.make("done")
    assert drive.memory.velocity == STILL
    drive.make("done")
    wiggle = 2 * math.pi * 0.5 * PARAMS.verify_amplitude
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, wiggle, 0, 0, 0])
    drive.make("hindered")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, PARAMS.pull_speed)


def test_a_sweep_looks_a_quarter_turn_to_both_sides(make_drive: Any) -> None:
    drive = make_drive(make_bnc_connector_skill(PARAMS, period=PERIOD))
    for outcome in TO_COMPRESS[:-1]:
        drive.make(outcome)
    turned = []
    while drive.state == "find slots":
        turned.append(drive.way()[2])
        drive.tick()
    # The studs' pattern repeats every half turn: this much is all of it.
    assert max(turned) - min(turned) == pytest.approx(math.pi, rel=0.01)
    assert turned[-1] == pytest.approx(0.0, abs=0.02)
    assert drive.memory.reason == "find slots: done"


def test_a_compression_counts_its_way_from_the_approach_on(make_drive: Any) -> None:
    drive = make_drive(make_bnc_connector_skill(PARAMS, period=PERIOD))
    for outcome in TO_COMPRESS:
        drive.make(outcome)
    assert drive.carriage[5] == pytest.approx(-2.02 * PARAMS.drop)
    drive.carriage[5] = -0.005 - 1.001 * PARAMS.compress_depth
    while drive.memory.event is None:
        drive.tick(wrench=(0, 0, 0, 0, 0, 1.01 * PARAMS.compress_force))
    assert drive.memory.event == "done"


def test_dithers_are_watched_over_whole_cycles(find_primitive: Callable[..., Any]) -> None:
    skill = make_bnc_connector_skill(BncConnectorSkillParams(search_frequency=0.8), period=0.005)
    assert find_primitive(skill, "enter", Hindered).samples == (250, 222)
    verify = find_primitive(skill, "verify", Hindered)
    assert (verify.axes, verify.samples) == (("rz",), (400,))
    assert verify.threshold == PARAMS.verify_threshold
    assert find_primitive(skill, "to the studs", GuardedMove).limit == PARAMS.stud_limit
    pull = find_primitive(skill, "pull", GuardedMove)
    assert (pull.direction, pull.threshold, pull.limit) == ("+z", 10.0, PARAMS.pull_limit)
    turn = find_primitive(skill, "turn", Push)
    assert (turn.force, turn.distance) == (PARAMS.turn_torque, PARAMS.turn_distance)


WHOLE: Final = {"search_repeats", "retries"}


@pytest.mark.parametrize(
    "name", sorted({*BncConnectorSkillParams.__dataclass_fields__} - {"turn", "centring"})
)
@pytest.mark.parametrize("value", [-1.0, 0.0, math.nan])
def test_errors(name: str, value: float) -> None:
    allowed = "a whole number >= 1" if name in WHOLE else "a finite number > 0"
    message = f"{name} is {value}, allowed: {allowed}"
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        BncConnectorSkillParams(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("centring", -1.0, "a finite number >= 0"),
        ("retries", 1.5, "a whole number >= 1"),
        ("search_repeats", 2.5, "a whole number >= 1"),
    ],
)
def test_what_any_insertion_refuses(name: str, value: float, allowed: str) -> None:
    message = f"{name} is {value}, allowed: {allowed}"
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        BncConnectorSkillParams(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("turn", ["left", "-x"])
def test_a_turn_is_about_z(turn: Any) -> None:
    with pytest.raises(ParameterError, match=f"^turn is '{turn}', allowed: -rz, \\+rz$"):
        BncConnectorSkillParams(turn=turn)
