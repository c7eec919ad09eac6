"""A skill of one's own: its file, and the experiment that runs it."""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import quiet
from chamfer.analysis.scenario.scenario_io import make_scenario, unstructure
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.analysis.skills.connector_campaign import D_CONNECTOR as D_CAMPAIGN
from chamfer.analysis.skills.connector_campaign import resolve_campaign
from chamfer.analysis.skills.own_skill import (
    OWN_SKILL,
    OwnSkillScenario,
    figures,
    resolve_own_skill,
    run,
    show_replay,
)
from chamfer.analysis.skills.skill_file import read_skill, skill_of, skill_text
from chamfer.diagrams.skills.connector_scenario import (
    BNC_CONNECTOR,
    D_CONNECTOR,
    RJ45_CONNECTOR,
    ROUND_PEG,
    resolve,
)
from chamfer.models.connectors.mesh_connector import convex_hull, write_solids
from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import GuardedMove
from chamfer.systems.primitives.skill import PRIMITIVES, Retry, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.sensing.force_sensor import WrenchSensorParams

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


@pytest.mark.parametrize("scenario", [D_CONNECTOR, BNC_CONNECTOR, ROUND_PEG, RJ45_CONNECTOR])
def test_all_strategies_are_written_and_read_back(tmp_path: Path, scenario: Any) -> None:
    skill = resolve(scenario).make_skill()
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("states: []", "states is [], allowed: a list of states"),
        (
            STATE % ("{Seat: {sped: 3}}", "{}", 1),
            "state 'a': run[0].Seat.sped: no such field, valid fields: direction, ",
        ),
        (STATE % ("{Pusch: {}}", "{}", 1), "state 'a': run[0] is 'Pusch', allowed: "),
        (STATE % ("Seat", "{}", 1), "state 'a': run[0] is 'Seat', allowed: one of "),
        (STATE % ("{Seat: {}, Stick: {}}", "{}", 1), "state 'a': run[0] is {'Seat': {}, "),
        (
            STATE % ("{GuardedMove: {speed: -3}}", "{}", 1),
            "state 'a': run[0].GuardedMove.speed is -3.0, allowed: a finite number > 0",
        ),
        (
            STATE % ("{MoveDx: }", "{done: 5}", 1),
            "state 'a': on.done is 5, allowed: a text or a mapping of at_most, factors, targe",
        ),
        (
            STATE % ("{MoveDx: }", "{finished: done}", 1),
            "state 'a': on.finished is 'finished', allowed: done, contact, ",
        ),
        (
            STATE % ("{MoveDx: }", "{done: {target: done, at_most: 0}}", 3),
            "state 'a': on.done.at_most is 0, allowed: a whole number >= 1",
        ),
        (
            STATE % ("{MoveDx: }", "{done: done}", ".nan") + "\nretract: [{MoveDx: }]",
            "skill 'x': 'a': the timeout is nan, allowed: a finite number > 0",
        ),
        (
            STATE % ("{MoveDx: }", "{lost: done}", 3) + "\nretract: [{MoveDx: }]",
            "skill 'x': 'a' has an entry for 'lost', which none of its primitives can have",
        ),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "skill.yaml"
    path.write_text(f"name: x\n{text}" + ("" if "retract" in text else "\nretract: []"))
    with pytest.raises(UserError) as refused:
        read_skill(path)
    told = str(refused.value)
    assert "\n" not in told
    assert told.startswith(f"{path}: {message}")


FAST: Final[dict[str, Any]] = {"step": 0.002, "duration": 2.0}


@pytest.fixture
def touch(tmp_path: Path) -> str:
    path = tmp_path / "touch.yaml"
    path.write_text(TEXT)
    return str(path)


def test_a_file_is_run_and_its_text_is_kept(touch: str) -> None:
    scenario = resolve_own_skill(OwnSkillScenario(skill=touch, **FAST))
    Path(touch).unlink()
    found = run(scenario, 0, quiet).metrics
    assert (found["done"].value, found["done"].note) == (1.0, "")
    assert found["success"].value == 0.0  # it is not in
    assert found["success"].note.startswith("touch: done but not mated at ")
    assert 0.2 < found["duration"].value < 1.8
    again = make_scenario(OwnSkillScenario(), given=unstructure(scenario))
    assert resolve_own_skill(again) == scenario


@pytest.fixture
def block(tmp_path: Path) -> str:
    """The path of a part: a block, and a floor that it is to touch."""
    for name, bottom, top in (("block", 0, 20), ("floor", -3, -2)):
        corners = np.array(list(product((-4, 4), (-4, 4), (bottom, top))), dtype=float)
        write_solids(tmp_path / f"{name}.obj", [convex_hull(name, corners)])
    files = "plug: block.obj\nsocket: floor.obj\n"
    path = tmp_path / "block.yaml"
    path.write_text(f"{files}mated_depth: 0.002\nseating_force: 5\n")
    return str(path)


def test_a_part_of_ones_own(block: str, touch: str) -> None:
    scenario = make_scenario(OwnSkillScenario(), given={**FAST, "skill": touch, "part": block})
    resolved = resolve_own_skill(scenario)
    found = run(resolved, 0, quiet).metrics
    assert (found["done"].value, found["success"].value) == (1.0, 1.0)
    assert found["depth"].value == pytest.approx(0.002, abs=3e-4)
    Path(block).unlink()  # all that it says is kept
    again = make_scenario(OwnSkillScenario(), given=unstructure(resolved))
    assert resolve_own_skill(again) == resolved
    plug = Path(block).with_suffix(".obj")
    plug.write_text(plug.read_text().replace("-4", "-5"))
    with pytest.raises(
        UserError, match=r"^connector\.digest is '.*', allowed: null, or the digest of "
    ):
        resolve_own_skill(again)


PARTS: Final = Path(__file__).parents[3] / "docs" / "parts"


def part_of(*settings: str) -> Any:
    """What the settings make of a part."""
    return resolve_own_skill(make_scenario(OWN_SKILL, settings=settings)).insertion.connector


def test_fields_of_the_part_are_set() -> None:
    bnc = part_of("part=bnc-connector", "connector.friction=0.4", "connector.spring_force=20")
    usual = BNC_CONNECTOR.connector
    rubbing = replace(usual.material, friction=0.4)
    assert bnc == replace(usual, material=rubbing, spring_force=20.0)
    assert make_scenario(D_CONNECTOR, settings=["connector.friction=0.4"]).connector == replace(
        D_CONNECTOR.connector, material=rubbing
    )
    unknown = r"^connector\.spring_force: no such field, valid fields: contacts, friction, larg.*"
    with pytest.raises(UserError, match=unknown):
        part_of("connector.spring_force=20")
    usb = part_of(
        f"part={PARTS}/usb-a.yaml", f"skill={PARTS}/usb-a-skill.yaml", "connector.springs.grip=1e4"
    )
    assert usb.springs == {"grip": 1e4, "contact": 12000}
    with pytest.raises(UserError, match=r"^connector\.plug has to be given, it has no default$"):
        part_of("part=own")
    with pytest.raises(UserError, match=r"^connector\.material\.friction is -1\.0, allowed: "):
        part_of("connector.friction=-1")
    for material in ("connector.material=5", "connector.material.friction=0.3"):
        with pytest.raises(UserError, match=r"^connector\.friction and .*material.* are both set"):
            part_of("connector.friction=0.4", material)
    with pytest.raises(ParameterError, match=r"^obstacle is 5\.0, allowed: less than the mated d"):
        part_of("obstacle=5")  # nothing would meet it


def test_a_part_goes_through_a_campaign_and_an_ablation(block: str, touch: str) -> None:
    given = {**FAST, "skill": touch, "part": block, "trials": 2, "spread": {"obstacles": 0.0}}
    scenario = resolve_own_skill(make_scenario(OWN_SKILL, given={**given, "duration": 1.5}))
    outcome = run(scenario, 0, quiet)
    assert len(set(outcome.traces["mating_force"].tolist())) == 2
    assert outcome.metrics["success_rate"].value == 100.0
    assert set(figures(scenario, outcome)) == {"success"}
    show_replay(scenario, outcome, Meshcat(MeshcatParams(host="localhost")))


def test_a_skill_is_compared_with_what_it_can_lack() -> None:
    given = {**FAST, "duration": 0.1, "trials": 2, "compared": ["without_tare"]}
    scenario = resolve_own_skill(make_scenario(OWN_SKILL, given=given))
    outcome = run(scenario, 0, quiet)
    assert outcome.traces["skill"].tolist() == ["whole"] * 2 + ["without_tare"] * 2
    assert "without_tare.success_rate" in outcome.metrics
    assert set(figures(scenario, outcome)) == {"ablation"}
    for names in (["without_spring"], ["whole"], ["without_tare", "without_tare"]):
        with pytest.raises(
            ParameterError, match=rf"^compared is '{names[-1]}', allowed: primitives that this"
        ):
            resolve_own_skill(replace(OWN_SKILL, trials=2, compared=tuple(names)))


def test_a_campaign_is_that_of_the_part() -> None:
    changes = {"trials": 3, "sensing": "realistic", "sensor": WrenchSensorParams(), "step": 0.002}
    scenario = resolve_own_skill(replace(OWN_SKILL, **changes)).insertion
    usual = resolve_campaign(replace(D_CAMPAIGN, sight=None, trials=3, duration=120.0))
    assert scenario == usual


def test_a_skill_that_can_t_be_run_is_refused_before_it_runs(tmp_path: Path, touch: str) -> None:
    with pytest.raises(UserError, match=r"nowhere\.yaml: No such file or directory$"):
        resolve_own_skill(OwnSkillScenario(skill=str(tmp_path / "nowhere.yaml")))
    with pytest.raises(UserError, match=r"^skill has several lines, allowed: a path, or the text"):
        resolve_own_skill(OwnSkillScenario(skill="one\ntwo"))
    with pytest.raises(UserError, match=r"^skill: line 2: "):
        resolve_own_skill(OwnSkillScenario(skill="name: [\ntwo"))
    Path(touch).write_text(TEXT.replace("GuardedMove", "Jump"))
    with pytest.raises(
        UserError, match=r"touch\.yaml: state 'touch': run\[0\] is 'Jump', allowed"
    ):
        resolve_own_skill(OwnSkillScenario(skill=touch))
    fast = TEXT.replace("{direction: -z, threshold: 5}", "\n  - Dither: {frequency: 26}")
    Path(touch).write_text(fast)
    with pytest.raises(UserError, match=r"^skill 'touch': 'touch': the frequency of ldither x is"):
        resolve_own_skill(OwnSkillScenario(skill=touch))


def test_a_part_without_a_strategy_needs_a_skill(tmp_path: Path) -> None:
    corners = np.array(list(product((-4, 4), (-4, 4), (0, 20))), dtype=float)
    write_solids(tmp_path / "block.obj", [convex_hull("block", corners)])
    path = str(tmp_path / "block.obj")
    own = {"plug": path, "socket": path, "mated_depth": 0.002, "seating_force": 10.0}
    with pytest.raises(ParameterError, match=r"^skill is None, allowed: a skill, block has no st"):
        resolve_own_skill(OwnSkillScenario(part="own", connector=own))
