"""The README and the docs are true: their scripts run, and what they name exists."""

import contextlib
import io
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import pytest

from analysis.run.scenario_yaml import parse_value
from analysis.skills.skill_file import skill_of
from diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    PegScenario,
    Rj45ConnectorScenario,
)
from systems.skills.peg_in_hole import PegInHoleSkillParams, Search

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def script(page: str) -> str:
    text = (ROOT / page).read_text(encoding="utf-8")
    (found,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    return str(found)


def printed_by(program: str) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(program, "page", "exec"), {})
    return printed.getvalue()


def test_the_readme_fits_on_a_page() -> None:
    assert len(PAGES[0].read_text(encoding="utf-8").splitlines()) <= 150


def test_the_loop_is_short_and_ends_in_the_dead_zone() -> None:
    loop = script("README.md")
    assert len(loop.splitlines()) <= 25
    assert float(printed_by(loop)) == pytest.approx(0.2, abs=0.01)


def test_the_skill_fits_on_a_page_and_ends_well() -> None:
    skill = script("docs/skills.md")
    assert len(skill.splitlines()) <= 40
    assert printed_by(skill).split() == ["done"]


def test_a_part_of_ones_own_goes_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("coacd")
    monkeypatch.chdir(tmp_path)
    assert printed_by(script("docs/own-part.md")).split() == ["done", "5.0", "mm"]


@pytest.mark.slow
def test_a_cell_gets_an_answer() -> None:
    lines = [line.split() for line in printed_by(script("docs/design.md")).splitlines()]
    assert [line[0] for line in lines] == ["0.45", "0.2"]
    assert {line[1] for line in lines} <= {"certain", "likely", "no"}


@pytest.mark.slow
def test_loops_in_python_control_have_the_margins_that_the_page_prints() -> None:
    page = (ROOT / "docs/control-tools.md").read_text(encoding="utf-8")
    with warnings.catch_warnings(action="ignore"):
        printed = printed_by(script("docs/control-tools.md"))
    assert all(f"    {line}\n" in page for line in printed.splitlines())


def test_an_arm_of_ones_own_is_designed_for() -> None:
    posture, load, frequencies, zones = printed_by(script("docs/own-arm.md")).splitlines()
    assert len(re.findall(r"[-.\d]+", posture)) == 7
    assert 0.1 < float(load) < 0.5
    assert len(re.findall(r"[.\d]+", frequencies)) == 6
    assert 0.2 < float(zones.split()[0]) < 1.0


def test_the_skill_in_yaml_is_the_one_in_python() -> None:
    page = (ROOT / "docs/skills.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```yaml\n(.*?)```", page, flags=re.DOTALL)
    names: dict[str, object] = {}
    program = script("docs/skills.md").partition("result = ")[0]
    exec(compile(program, "page", "exec"), names)
    assert skill_of(parse_value(text)) == names["skill"]


def test_the_campaign_runs_in_processes(tmp_path: Path) -> None:
    (tmp_path / "campaign.py").write_text(script("docs/campaigns.md"))
    found = subprocess.run(
        [sys.executable, tmp_path / "campaign.py"],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    *told, (error, failed) = map(str.split, found.stdout.splitlines())
    assert told[0][1:] == ["of", "10"] or told[0][1:3] == ["of", "10,"]
    assert float(error) == pytest.approx(sum(1 / n for n in range(1, 11)) / 10)
    assert failed == "0"


@pytest.mark.parametrize(
    ("connector", "scenarios"),
    [
        ("D connector", [DConnectorScenario()]),
        ("BNC connector", [BncConnectorScenario()]),
        (
            "Peg in a hole",
            [PegScenario(skill=PegInHoleSkillParams(search=one)) for one in get_args(Search)],
        ),
        ("RJ45 connector", [Rj45ConnectorScenario()]),
    ],
)
def test_the_strategies_page_names_every_state_once(
    connector: str, scenarios: Sequence[Any]
) -> None:
    page = (ROOT / "docs/strategies.md").read_text(encoding="utf-8")
    sections = {part.partition("\n")[0]: part for part in page.split("\n### ")}
    rows = [
        line.split("|")[1]
        for name in ("Grasp and transport, of both", connector)
        for line in sections[name].splitlines()
        if line.startswith("| `")
    ]
    named = [state for row in rows for state in re.findall("`([^`]+)`", row)]
    states = {state.name for one in scenarios for state in one.make_skill().states}
    assert sorted(named) == sorted(states)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_that_is_named_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"\]\(((?!https?:)[^)#]+)\)", text):
        assert (page.parent / name).exists(), name
    for name in re.findall(r"`((?:analysis|diagrams|systems|models)/[a-z_/]+(?:\.py)?)`", text):
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_module_that_is_named_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:analysis|diagrams|systems|models)(?:\.[a-z_]+)+)", text):
        path = ROOT.joinpath(*name.split("."))
        parent = path.parent  # the last part may be a name of the module's
        assert any(one.with_suffix(".py").exists() or one.is_dir() for one in (path, parent)), name
