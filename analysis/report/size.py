"""``make size``: lines of code, docstrings and tests by room, so that growth is seen."""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from chamfer.analysis.report.console import table

_PACKAGES: Final = ("models", "systems", "diagrams", "analysis")


def sizes(root: Path) -> dict[str, Counter[str]]:
    """Return the lines of each room: code, docstrings, and its tests (all lines of theirs)."""
    found: dict[str, Counter[str]] = {}
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            text = path.read_text(encoding="utf-8")
            size = found.setdefault(_room(path.relative_to(root)), Counter())
            size["docstrings"] += (docstrings := sum(_docstrings(ast.parse(text))))
            size["code"] += len(text.splitlines()) - docstrings
    for path in sorted((root / "tests").rglob("*.py")):
        room = _room(path.relative_to(root / "tests"))
        found.setdefault(room if room in found else "tests", Counter())["tests"] += len(
            path.read_text(encoding="utf-8").splitlines()
        )
    return found


def _room(path: Path) -> str:
    return "/".join(path.parts[: min(2, len(path.parts) - 1)])


def _docstrings(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(
            node
        ):
            first = node.body[0]
            yield (first.end_lineno or first.lineno) - first.lineno + 1


def main(root: Path) -> None:
    """Print the table."""
    columns = ("code", "docstrings", "tests")
    found = sizes(root)
    rows = [(room, *(f"{size[name]:,}" for name in columns)) for room, size in found.items()]
    whole: Counter[str] = sum(found.values(), Counter())
    rows.append(("all", *(f"{whole[name]:,}" for name in columns)))
    print(*table([("room", *columns), *rows]), sep="\n")
    print(
        f"four packages: {whole['code'] + whole['docstrings']:,} lines, tests: {whole['tests']:,}"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
