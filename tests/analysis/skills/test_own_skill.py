"""The experiment that runs a skill out of a file."""

from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import make_scenario, unstructure
from chamfer.analysis.skills.own_skill import OwnSkillScenario, resolve, run
from chamfer.diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    PegScenario,
    Rj45ConnectorScenario,
)
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.models.connectors.obj_file import convex_hull, write_solids
from chamfer.models.validation import ParameterError

TOUCH: Final = """
name: touch
held: true
states:
- name: touch
  run:
  - GuardedMove: {threshold: 5.0}
  on: {contact: done}
  timeout: 5.0
retract:
- MoveDx: {displacement: [0, 0, 0, 0, 0, 0.02]}
"""
FAST: Final[dict[str, Any]] = {"step": 0.002, "duration": 2.0}


def silent(fraction: float, doing: str = "") -> None:
    """Tells nobody."""


@pytest.fixture
def touch(tmp_path: Path) -> str:
    path = tmp_path / "touch.yaml"
    path.write_text(TOUCH)
    return str(path)


def test_a_file_is_run_and_its_text_is_kept(touch: str) -> None:
    scenario = resolve(OwnSkillScenario(skill=touch, **FAST))
    Path(touch).unlink()
    found = run(scenario, 0, silent).metrics
    assert (found["done"].value, found["done"].note) == (1.0, "")
    assert found["success"].value == 0.0  # it is not in
    assert found["success"].note.startswith("said to be done")
    assert 0.2 < found["duration"].value < 1.8
    again = make_scenario(OwnSkillScenario(), given=unstructure(scenario))
    assert resolve(again) == scenario == again


def test_a_part_of_ones_own(tmp_path: Path, touch: str) -> None:
    for name, bottom, top in (("block", 0, 20), ("floor", -3, -2)):
        corners = np.array(list(product((-4, 4), (-4, 4), (bottom, top))), dtype=float)
        write_solids(tmp_path / f"{name}.obj", [convex_hull(name, corners)])
    files = {"plug": str(tmp_path / "block.obj"), "socket": str(tmp_path / "floor.obj")}
    given = {"part": "own", "own": {**files, "mated_depth": 0.002, "mating_force": 5.0}}
    scenario = make_scenario(OwnSkillScenario(), given={**FAST, "skill": touch, **given})
    found = run(resolve(scenario), 0, silent).metrics
    assert (found["done"].value, found["success"].value) == (1.0, 1.0)
    assert found["depth"].value == pytest.approx(0.002, abs=3e-4)


@pytest.mark.parametrize(
    ("part", "kind"),
    [
        ("d-connector", DConnectorScenario),
        ("bnc-connector", BncConnectorScenario),
        ("peg", PegScenario),
        ("rj45-connector", Rj45ConnectorScenario),
    ],
)
def test_without_a_file_it_is_the_part_s_own_strategy(part: Any, kind: Any) -> None:
    sight = SightSettings()
    error = (0.01, 0.0, 0.0, 0.001, 0.0, 0.0)
    scenario = OwnSkillScenario(part=part, sight=sight, initial_error=error)
    own = kind(sight=sight, initial_error=error).make_skill()
    assert scenario.make_skill() == own
    assert resolve(scenario) == scenario


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"part": "own"}, r"^own is None, allowed: the files of a part$"),
        (
            {"part": "usb"},
            r"^part is 'usb', allowed: d-connector, bnc-connector, peg, rj45-connector, own$",
        ),
    ],
)
def test_fields_that_don_t_go_together(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        OwnSkillScenario(**fields)


def test_a_skill_that_can_t_be_run_is_refused_before_it_runs(tmp_path: Path, touch: str) -> None:
    with pytest.raises(UserError, match=r"nowhere\.yaml: No such file or directory$"):
        resolve(OwnSkillScenario(skill=str(tmp_path / "nowhere.yaml")))
    with pytest.raises(UserError, match=r"^skill has several lines, allowed: a path, or the text"):
        resolve(OwnSkillScenario(skill="one\ntwo"))
    with pytest.raises(UserError, match=r"^skill: line 2: "):
        resolve(OwnSkillScenario(skill="name: [\ntwo"))
    Path(touch).write_text(TOUCH.replace("GuardedMove", "Jump"))
    with pytest.raises(UserError, match=r"touch\.yaml: states\[0\]\.run\[0\] is 'Jump', allowed"):
        resolve(OwnSkillScenario(skill=touch))
    fast = TOUCH.replace("{threshold: 5.0}", "\n  - Dither: {frequency: 26}")
    Path(touch).write_text(fast)
    with pytest.raises(UserError, match=r"^skill 'touch': 'touch': the frequency of ldither x is"):
        resolve(OwnSkillScenario(skill=touch))
