"""The README and the docs are true: their scripts run, and what they name exists."""

import contextlib
import io
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest

from chamfer.diagrams.skills.connector_scenario import (
    BNC_CONNECTOR,
    D_CONNECTOR,
    RJ45_CONNECTOR,
    ROUND_PEG,
    resolve,
)
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams, Search

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]


def scripts(page: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return [str(found) for found in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)]


def run_script(program: str) -> tuple[str, dict[str, Any]]:
    """Return what it prints, and the names that it leaves."""
    printed, names = io.StringIO(), dict[str, Any]()
    with contextlib.redirect_stdout(printed):
        exec(compile(program, "page", "exec"), names)
    return printed.getvalue(), names


def test_the_readme_fits_on_a_page() -> None:
    assert len(PAGES[0].read_text(encoding="utf-8").splitlines()) <= 150


def test_the_loops_of_the_readme_are_short_and_end_where_they_should() -> None:
    loop, law = scripts("README.md")
    assert len(loop.splitlines()) <= 25
    assert len(list(filter(None, law.splitlines()))) <= 12
    printed, names = run_script(loop + law)
    assert float(printed) == pytest.approx(0.2, abs=0.01)
    simulator = names["simulator"]
    (reached,) = simulator.get_system().get_output_port().Eval(simulator.get_context())
    assert reached == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize(
    ("connector", "scenarios"),
    [
        ("D connector", [D_CONNECTOR]),
        ("BNC connector", [BNC_CONNECTOR]),
        (
            "Peg in a hole",
            [
                replace(ROUND_PEG, skill=PegInHoleSkillParams(search=one))
                for one in get_args(Search)
            ],
        ),
        ("RJ45 connector", [RJ45_CONNECTOR]),
    ],
)
def test_the_strategies_page_names_every_state_once(
    connector: str, scenarios: Sequence[Any]
) -> None:
    page = (ROOT / "docs/strategies.md").read_text(encoding="utf-8")
    sections = {part.partition("\n")[0]: part for part in page.split("\n### ")}
    rows = [
        line.split("|")[1]
        for name in ("Grasp and transport", connector)
        for line in sections[name].splitlines()
        if line.startswith("| `")
    ]
    named = [state for row in rows for state in re.findall("`([^`]+)`", row)]
    states = {
        state.name
        for one in scenarios
        for senses in (True, False)  # without, the plug is weighed
        for state in resolve(replace(one, gripper=replace(one.gripper, senses=senses)))
        .make_skill()
        .states
    }
    assert sorted(named) == sorted(states)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_file_that_is_named_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"\]\(((?!https?:|reference/generated/)[^)#]+)\)", text):  # built
        assert (page.parent / name).exists(), name
    for name in re.findall(r"`((?:analysis|diagrams|systems|models)/[a-z_/]+(?:\.py)?)`", text):
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_module_that_is_named_exists(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(
        r"`chamfer\.((?:analysis|diagrams|systems|models)(?:\.[a-z_]+)+)", text
    ):
        path = ROOT.joinpath(*name.split("."))
        parent = path.parent  # the last part may be a name of the module's
        assert any(one.with_suffix(".py").exists() or one.is_dir() for one in (path, parent)), name
