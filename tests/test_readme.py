import contextlib
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.run.console import number, relation
from analysis.run.registry import find

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def scripts() -> list[str]:
    found: list[str] = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(found) == 2
    return found


def printed_by(script: str) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(script, "README.md", "exec"), {})
    return printed.getvalue()


def table() -> list[str]:
    return [line for line in README.splitlines() if line.startswith("| `")]


def test_the_script_is_short_and_ends_in_the_dead_zone() -> None:
    loop, _ = scripts()
    assert len(loop.splitlines()) <= 25
    assert float(printed_by(loop)) == pytest.approx(0.2, abs=0.01)


def test_the_skill_fits_on_a_page_and_ends_well() -> None:
    _, skill = scripts()
    assert len(skill.splitlines()) <= 40
    assert printed_by(skill).split() == ["done"]


def test_every_experiment_is_in_the_table() -> None:
    listed = {re.match(r"\| `([a-z0-9-]+)`", line).group(1) for line in table()}  # type: ignore[union-attr]
    assert listed == {entry.name for entry in find()}


def test_every_file_that_is_named_exists() -> None:
    for name in re.findall(r"\]\(((?!https?:)[^)#]+)\)", README):
        assert (ROOT / name).exists(), name


@pytest.mark.slow
def test_the_table_says_what_reproduce_measures(tmp_path: Path) -> None:
    subprocess.run(
        [sys.executable, "-m", "analysis.cli", "reproduce", "--out", str(tmp_path)],
        check=True,
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
    )
    expected = []
    for entry in find():
        result = json.loads((tmp_path / entry.name / "result.json").read_text(encoding="utf-8"))
        rows = [
            (
                check["metric"],
                f"{relation(check).replace('+-', '±')} {check['unit']}".rstrip(),
                f"{number(check['measured'])} {check['unit']}".rstrip(),
                check["kind"],
                "ok" if check["ok"] else "**failed**",
            )
            for check in result["checks"]
        ] or [("", "", f"{len(result['metrics'])} metrics", "", "")]
        for metric, *cells in rows:
            shown = f"`{metric}`" if metric else ""
            line = " | ".join([f"`{entry.name}`", entry.figure, shown, *cells])
            expected.append(re.sub(r" +\|", " |", f"| {line} |"))
    assert table() == expected, "\n".join(["the table should read", *expected])
