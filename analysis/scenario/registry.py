"""Finds the experiments and the papers' values.

Experiments are found by reading the sources of the rooms of `analysis/` as syntax trees: listing
them runs none of it, and so imports neither Drake nor Matplotlib.
"""

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.scenario.errors import UserError

if TYPE_CHECKING:
    from chamfer.analysis.scenario.experiment import Experiment

_METADATA: Final = ("name", "paper", "figure", "summary")
_MARK: Final = "Experiment"
_KEY: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")  # names become folders and anchors


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Where experiments are: a folder of rooms, folders with modules, and its package.

    Its room ``published`` has the papers' values.
    """

    folder: Path
    package: str


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What is known of an experiment without importing it."""

    name: str
    paper: str
    figure: str
    summary: str
    module: str
    attribute: str


SOURCES: Final = Sources(folder=Path(__file__).parents[1], package="chamfer.analysis")


def find(sources: Sources = SOURCES) -> list[Entry]:
    """Return the experiments, by paper and then by figure, those without one last.

    Raises:
        UserError: If a module can't be read, an experiment's metadata are not plain strings, or
            a name is used twice.
    """
    entries: dict[str, Entry] = {}
    for path in sorted(sources.folder.glob("*/*.py")):
        for entry in _entries(path, f"{sources.package}.{path.parent.name}.{path.stem}"):
            if entry.name in entries:
                first = entries[entry.name]
                raise UserError(
                    f"two experiments are named {entry.name!r}: "
                    f"{first.module}.{first.attribute} and {entry.module}.{entry.attribute}"
                )
            entries[entry.name] = entry
    return sorted(
        entries.values(),
        key=lambda entry: (entry.paper, entry.figure == "", _natural(entry.figure)),
    )


def select(entries: Sequence[Entry], names: Sequence[str]) -> list[Entry]:
    """Return the named experiments in the order of ``names``, each once.

    Raises:
        UserError: If there is no experiment of a name.
    """
    by_name = {entry.name: entry for entry in entries}
    return [by_name[_valid("experiment", name, by_name)] for name in dict.fromkeys(names)]


def select_paper(entries: Sequence[Entry], paper: str) -> list[Entry]:
    """Return the experiments of a paper.

    Raises:
        UserError: If no experiment belongs to that paper.
    """
    _valid("paper", paper, dict.fromkeys(entry.paper for entry in entries))
    return [entry for entry in entries if entry.paper == paper]


def load(entry: Entry) -> "Experiment[Any]":
    """Import the experiment."""
    experiment: Experiment[Any] = getattr(import_module(entry.module), entry.attribute)
    return experiment


def _natural(figure: str) -> list[str | int]:
    """Return a key that sorts Fig. 9 before Fig. 10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", figure)]


def _valid(kind: str, name: str, names: dict[str, Any]) -> str:
    if name in names:
        return name
    from difflib import get_close_matches

    close = get_close_matches(name, names, n=1)
    suggestion = f", did you mean {close[0]!r}?" if close else ","
    valid = ", ".join(names) or "none"
    raise UserError(f"unknown {kind} {name!r}{suggestion} valid names: {valid}")


def _entries(path: Path, module: str) -> Iterator[Entry]:
    where = f"{path.parent.name}/{path.name}"
    try:
        source = path.read_text(encoding="utf-8")
        tree = ast.parse(source if _MARK in source else "")  # parsing them all takes a second
    except SyntaxError as error:
        raise UserError(f"{where}: line {error.lineno}: {error.msg}") from error
    except (OSError, ValueError) as error:
        raise UserError(f"{where}: {error}") from error
    for statement in tree.body:
        if not isinstance(statement, ast.Assign | ast.AnnAssign):
            continue
        if not _makes_experiment(statement.value):
            continue
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        line = f"{where}: line {statement.lineno}"
        if len(targets) != 1 or not isinstance(targets[0], ast.Name):
            raise UserError(f"{line}: an experiment is assigned to one plain name")
        attribute = targets[0].id
        metadata = _metadata(statement.value, f"{line}: {attribute}")
        for key in ("name", "paper"):
            if not _KEY.fullmatch(metadata[key]):
                raise UserError(
                    f"{line}: {attribute}: {key} is {metadata[key]!r}, "
                    "allowed: lower-case letters, digits and single dashes between them"
                )
        yield Entry(**metadata, module=module, attribute=attribute)


def _makes_experiment(value: ast.expr | None) -> bool:
    if not isinstance(value, ast.Call):
        return False
    called = value.func.value if isinstance(value.func, ast.Subscript) else value.func
    return isinstance(called, ast.Name) and called.id == "Experiment"


def _metadata(call: ast.expr | None, where: str) -> dict[str, str]:
    assert isinstance(call, ast.Call)
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    metadata = {}
    for key in _METADATA:
        value = given.get(key)
        if not (isinstance(value, ast.Constant) and isinstance(value.value, str)):
            raise UserError(
                f"{where}: {key} has to be a plain string among the keywords, "
                "listing reads it without running the module"
            )
        metadata[key] = value.value
    return metadata
