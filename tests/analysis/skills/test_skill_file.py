"""Skills in YAML."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.analysis.skills.skill_file import read_skill, skill_of, skill_text
from chamfer.diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    PegScenario,
    Rj45ConnectorScenario,
)
from chamfer.systems.primitives.force_primitives import GuardedMove
from chamfer.systems.primitives.skill import PRIMITIVES
from chamfer.systems.primitives.skill import Retry, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx

STATE = "states: [{name: a, run: [%s], on: %s, timeout: %s}]"
TEXT = """
name: touch
held: true
states:
- name: touch
  run:
  - GuardedMove: {direction: -z, threshold: 5}
  on: {contact: done, lost: {target: touch, at_most: 2}}
  timeout: 5
retract:
- MoveDx: {displacement: [0, 0, 0, 0, 0, 0.02]}
"""


def test_a_file_says_what_python_says(tmp_path: Path) -> None:
    (tmp_path / "touch.yaml").write_text(TEXT)
    state = SkillState(
        name="touch",
        run=[GuardedMove(direction="-z", threshold=5.0)],
        on={"contact": "done", "lost": Retry("touch", 2)},
        timeout=5.0,
    )
    up = MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, 0.02))
    expected = Skill(name="touch", states=[state], retract=[up], held=True)
    found = read_skill(tmp_path / "touch.yaml")
    assert found == expected
    assert isinstance(found.states[0].timeout, float)


@pytest.mark.parametrize(
    "kind", [DConnectorScenario, BncConnectorScenario, PegScenario, Rj45ConnectorScenario]
)
@pytest.mark.parametrize("fields", [{}, {"sight": None}])
def test_all_strategies_are_written_and_read_back(
    tmp_path: Path, kind: Any, fields: dict[str, Any]
) -> None:
    skill = kind(**fields).make_skill()
    (tmp_path / "skill.yaml").write_text(skill_text(skill))
    assert read_skill(tmp_path / "skill.yaml") == skill


@dataclass(frozen=True, kw_only=True)
class Mine(MoveDx):
    """A primitive of one's own."""

    strength: float = 1.0


def test_ones_own_primitives_get_names() -> None:
    state = SkillState(name="a", run=[Mine(strength=2.0)], on={"done": "done"}, timeout=5.0)
    skill = Skill(name="x", states=[state], retract=[MoveDx()])
    with pytest.raises(UserError, match=r"^Mine has no name in a file, valid names: Centre, "):
        skill_text(skill)
    names = {**PRIMITIVES, "mine": Mine}
    assert "  - mine:\n      strength: 2.0\n" in skill_text(skill, names)
    assert skill_of(parse_value(skill_text(skill, names)), names) == skill


def test_a_file_that_is_not_there_or_no_skill(tmp_path: Path) -> None:
    path = tmp_path / "skill.yaml"
    with pytest.raises(UserError, match=r"skill\.yaml: No such file"):
        read_skill(path)
    path.write_text("[1]")
    with pytest.raises(UserError, match=r"skill\.yaml is a list, allowed: a mapping of skill f"):
        read_skill(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("retract: []", "states has to be given, it has no default"),
        ("states: 5", "states is 5, allowed: a list"),
        ("states: []", "skill 'x': 'retract' runs no primitive"),
        ("colour: red", "colour: no such field, valid fields: held, name, retract, "),
        (
            STATE % ("{Seat: {sped: 3}}", "{}", 1),
            "states[0].run[0].Seat.sped: no such field, valid fields: direction, ",
        ),
        (STATE % ("{Pusch: {}}", "{}", 1), "states[0].run[0] is 'Pusch', allowed: "),
        (STATE % ("Seat", "{}", 1), "states[0].run[0] is 'Seat', allowed: one of "),
        (STATE % ("{Seat: {}, Stick: {}}", "{}", 1), "states[0].run[0] is {'Seat': {}, "),
        (
            STATE % ("{GuardedMove: {speed: -3}}", "{}", 1),
            "states[0].run[0].GuardedMove.speed is -3.0, allowed: a finite number > 0",
        ),
        (
            STATE % ("{MoveDx: }", "{done: 5}", 1),
            "states[0].on.done is 5, allowed: a text or a mapping of at_most, target, then",
        ),
        (
            STATE % ("{MoveDx: }", "{finished: done}", 1),
            "states[0].on.finished is 'finished', allowed: done, contact, ",
        ),
        (
            STATE % ("{MoveDx: }", "{done: {target: done, at_most: 0}}", 3),
            "states[0].on.done.at_most is 0, allowed: a whole number >= 1",
        ),
        (
            STATE % ("{MoveDx: }", "{done: done}", ".nan") + "\nretract: [{MoveDx: }]",
            "skill 'x': the timeout of 'a' is nan, allowed: a finite number > 0",
        ),
        (
            STATE % ("{MoveDx: }", "{lost: done}", 3) + "\nretract: [{MoveDx: }]",
            "skill 'x': 'a' has an answer to 'lost', which nothing that it runs can be",
        ),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    lines = [
        line
        for line in ("states: []", "retract: []")
        if line.partition(":")[0] not in text or text == "colour: red"
    ]
    if text == "retract: []":
        lines = []
    path = tmp_path / "skill.yaml"
    path.write_text("\n".join(["name: x", text, *lines]))
    with pytest.raises(UserError) as refused:
        read_skill(path)
    told = str(refused.value)
    assert "\n" not in told
    assert told.startswith(f"{path}: {message}")
