import contextlib
import io
import re
from pathlib import Path

import pytest

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


def test_the_script_is_short_and_ends_in_the_dead_zone() -> None:
    loop, _ = scripts()
    assert len(loop.splitlines()) <= 25
    assert float(printed_by(loop)) == pytest.approx(0.2, abs=0.01)


def test_the_skill_fits_on_a_page_and_ends_well() -> None:
    _, skill = scripts()
    assert len(skill.splitlines()) <= 40
    assert printed_by(skill).split() == ["done"]


def test_every_file_that_is_named_exists() -> None:
    for name in re.findall(r"\]\(((?!https?:)[^)#]+)\)", README):
        assert (ROOT / name).exists(), name
