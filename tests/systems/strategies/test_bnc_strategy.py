"""The strategy of the BNC connector, driven without Drake."""

import math
import re
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.connectors.bnc_connector import BncConnector
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import Obstructed
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import DONE, FAILED, RETRACT
from chamfer.systems.strategies.bnc_strategy import (
    BncConnectorSkillParams,
    make_bnc_connector_skill,
)

PARAMS: Final = BncConnectorSkillParams()
CONNECTOR: Final = BncConnector()
PERIOD: Final = 0.05  # s, that of the drives
ANSWERS: Final[Any] = {
    "tare": {"done": "beside"},
    "beside": {"done": "touch"},
    "touch": {"contact": "lie"},
    "lie": {"done": "above"},
    "above": {"done": "tare again"},
    "out": {"done": "tare again"},
    "tare again": {"done": "enter"},
    "enter": {"lost": "to the studs", "hindered": "to the studs", "done": "enter wide"},
    "enter wide": {"lost": "to the studs", "hindered": "to the studs", "done": ["out"] * 3},
    "to the studs": {"contact": "at the studs", "lost": "at the studs"},
    "at the studs": {"done": "feel", "jammed": ["out"] * 3},
    "feel": {"done": "compress", "jammed": "find slots"},
    "find slots": {"lost": "compress", "done": ["out"] * 3},
    "compress": {"done": "turn", "jammed": ["out"] * 3, "timed out": ["out"] * 3},
    "turn": {"done": "click", "jammed": "turn back"},
    "click": {"done": "depth", "jammed": "compress again"},
    "depth": {"done": "pull", "jammed": "compress again"},
    "pull": {"contact": DONE, "lost": "compress again"},
    "compress again": {
        "done": "turn back",
        "jammed": "turn back",
        "timed out": ["turn back"] * 3,
    },
    "turn back": {"done": ["out"] * 3, "jammed": ["out"] * 3},
}
TO_ENTER: Final = ("done", "done", "contact", "done", "done", "done")
TO_COMPRESS: Final = (*TO_ENTER, "lost", "contact", "done", "jammed", "lost")


@pytest.fixture(scope="module")
def strategy(grasp_states: Any, grasp_answers: Any, make_strategy: Any) -> Any:
    skill = make_bnc_connector_skill(PARAMS, CONNECTOR, period=PERIOD, before=grasp_states("tare"))
    return make_strategy(skill, {**grasp_answers, **ANSWERS})


def held(make_drive: Any, *outcomes: str, **changes: Any) -> Any:
    """Drive a plug that is held from the begin through outcomes."""
    params = BncConnectorSkillParams(**changes)
    drive = make_drive(make_bnc_connector_skill(params, CONNECTOR, period=PERIOD))
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
    studs = ["enter", "to the studs", "at the studs", "feel", "compress"]
    assert drive.path == [
        *before,
        *face,
        *studs,
        *["turn", "click", "depth", "pull", "done"],
    ]
    assert (drive.memory.retries, drive.memory.reason, drive.memory.velocity) == ((), "", STILL)


@pytest.mark.parametrize("retries", [1, 2])
def test_retries_are_those_of_the_parameters(retries: int, make_drive: Any) -> None:
    drive = held(make_drive, *TO_COMPRESS, retries=retries)
    for _ in range(retries):
        assert drive.make("jammed") == "out"
        for outcome in ("done", "done", "lost", "contact", "done", "done"):
            drive.make(outcome)
    # Every state and outcome has retries of its own.
    assert [drive.make("done"), drive.make("jammed")] == ["turn", "turn back"]
    for outcome in ("jammed", "done", "done", "lost", "contact", "done", "done"):
        drive.make(outcome)
    assert drive.make("jammed") == RETRACT
    assert drive.memory.reason == "compress: jammed"
    assert drive.end() == FAILED


@pytest.mark.parametrize("turn", ["-rz", "+rz"])
def test_what_the_states_command(turn: Any, make_drive: Any) -> None:
    drive = held(make_drive, turn=turn)
    assert drive.memory.closed
    assert (drive.memory.tares, drive.memory.velocity) == (True, STILL)
    drive.make("done")
    assert drive.memory.damping == (math.inf,) * 6
    drive.make("done")
    assert drive.memory.damping == (math.inf,) * 5 + (0.0,)
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.approach_speed)
    drive.make("contact")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.maintained)
    for outcome in ("done", "done", "done"):
        drive.make(outcome)
    frequencies = PARAMS.search_frequency, PARAMS.search_frequency * 7 / 6
    slow, fast = (2 * math.pi * f * PARAMS.search_amplitude for f in frequencies)
    np.testing.assert_allclose(
        drive.memory.velocity, [0, 0, 0, slow, fast, -PARAMS.search_press], atol=1e-12
    )
    assert drive.memory.damping == STILL
    drive.make("lost")
    assert drive.memory.velocity == (0, 0, 0, 0, 0, -PARAMS.approach_speed)
    for outcome in ("contact", "done", "jammed"):
        drive.make(outcome)
    sweep = 2 * math.pi * 0.05 * math.pi / 2
    np.testing.assert_allclose(drive.memory.velocity, [0, 0, sweep, 0, 0, -PARAMS.maintained])
    drive.make("lost")
    pressed = drive.memory.velocity[5]
    assert pressed < 0
    drive.make("done")
    locks = PARAMS.turn_speed * (1 if turn == "+rz" else -1)
    assert drive.memory.velocity[:5] == (0, 0, locks, 0, 0)
    drive.make("done")
    assert drive.memory.velocity == STILL
    assert [drive.make("done") for _ in range(2)] == ["depth", "pull"]
    assert drive.memory.velocity == (0, 0, 0, 0, 0, PARAMS.pull_speed)
    drive.make("lost")
    drive.make("done")
    assert drive.state == "turn back"
    assert drive.memory.velocity[2] == -locks


def test_a_sweep_looks_a_quarter_turn_to_both_sides(make_drive: Any) -> None:
    drive = held(make_drive, *TO_COMPRESS[:-1])
    turned = []
    while drive.state == "find slots":
        turned.append(drive.way()[2])
        drive.tick()
    # The studs' pattern repeats every half turn: this much is all of it.
    assert max(turned) - min(turned) == pytest.approx(math.pi, rel=0.01)
    assert turned[-1] == pytest.approx(0.0, abs=0.02)


def test_depths_count_from_the_face_of_the_believed_connector(
    find_primitive: Callable[..., Any],
) -> None:
    skill = make_bnc_connector_skill(PARAMS, CONNECTOR)
    rim = (0.0, -(CONNECTOR.bore_radius + CONNECTOR.lead_in))
    at, feel, depth = (
        find_primitive(skill, state, Way) for state in ("at the studs", "feel", "depth")
    )
    assert 2 * PARAMS.drop < at.least < CONNECTOR.setback
    assert CONNECTOR.setback < feel.least < CONNECTOR.setback + PARAMS.drop
    assert (depth.least + depth.most) / 2 == pytest.approx(CONNECTOR.mated_depth)
    assert at.beside == feel.beside == depth.beside == rim
    # What lies on the studs' lips, or is only in the slots, has not clicked.
    click = find_primitive(skill, "click", Way)
    rise = CONNECTOR.turning_depth - CONNECTOR.mated_depth
    assert click.least < rise < CONNECTOR.overlap - CONNECTOR.mated_depth < click.most
    assert click.most < CONNECTOR.spring_travel
    again = find_primitive(skill, "compress again", Seat)
    assert 0 < again.distance < rise  # out of the detents
    compress = find_primitive(skill, "compress", Seat)
    assert CONNECTOR.mated_depth < compress.distance < CONNECTOR.turning_depth
    assert compress.limit == PARAMS.limit_share * CONNECTOR.mating_force


def test_dithers_are_watched_over_whole_cycles(find_primitive: Callable[..., Any]) -> None:
    params = BncConnectorSkillParams(search_frequency=0.8)
    skill = make_bnc_connector_skill(params, CONNECTOR, period=0.005)
    assert find_primitive(skill, "enter", Obstructed).samples == (250, 214)
    assert find_primitive(skill, "enter wide", Obstructed).samples == (325, 279)


WHOLE: Final = {"search_repeats", "retries"}


@pytest.mark.parametrize(
    "name", sorted({*BncConnectorSkillParams.__dataclass_fields__} - {"turn"})
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
