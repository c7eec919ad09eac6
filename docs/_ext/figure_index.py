"""Which experiment, block or module is what a paper's figure, equation or section describes.

Read from where it is said anyway: the experiments' metadata and the docstrings of modules, classes
and functions. Where a docstring names no paper, the style of the number tells the thesis'
("Fig. 2-4", "eq. (5-6)"), and otherwise the room does.
"""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Final

from docs._ext.blocks import ROOT

from chamfer.analysis.catalogue import CATALOGUE

_PAPERS: Final = {
    "fsm-visual-servoing": re.compile(r"\bRuybal\b"),
    "sensorimotor-primitives": re.compile(r"\bMorrow\b"),
    "hybrid-force-position": re.compile(r"\bthesis\b"),
}
_SKILLS: Final = ("connectors", "skills", "primitives", "strategies")
_ROOMS: Final = {  # of those whose docstrings name no paper
    **dict.fromkeys(
        ("servo", "cameras", "vision", "cell", "insertion", "peg", "peg_theory", "plants"),
        "fsm-visual-servoing",
    ),
    **dict.fromkeys(
        ("connectors", "skills", "primitives", "strategies"), "sensorimotor-primitives"
    ),
}
_THESIS: Final = "hybrid-force-position"
_LARGEST: Final = {  # numbers that a paper has; beyond them is another source's
    "fsm-visual-servoing": {"fig": 14, "eq": 2, "section": 6},
    "sensorimotor-primitives": {"fig": 6, "eq": 1, "section": 5},
    _THESIS: {"fig": 6, "eq": 6, "section": 6, "chapter": 6},  # the chapter
}
_KINDS: Final = {"fig": "Fig.", "eq": "eq.", "section": "section", "chapter": "chapter"}
_NUMBER: Final = r"\(?\d+(?:[-.]\d+)*\)?"
_MENTION: Final = re.compile(
    rf"\b(fig|eq|section|chapter)s?\.?\s+({_NUMBER}(?:(?:,\s+|\s+and\s+|\s+to\s+|,\s+and\s+)"
    rf"{_NUMBER})*)",
    re.IGNORECASE,
)


@dataclass(frozen=True, kw_only=True)
class Mention:
    """A place that is said to be what a figure, an equation or a section describes."""

    paper: str
    label: str  # "Fig. 3"
    path: str  # "chamfer.systems.servo.compensator.TrajectoryCompensator", or an experiment's name
    kind: str  # "experiment", "module", "class" or "function"


@cache
def mentions() -> tuple[Mention, ...]:
    """Return all mentions, by paper and in the order of its numbers."""
    found = {*_by_experiments(), *_by_docstrings()}
    return tuple(sorted(found, key=lambda one: (one.paper, _order(one.label), one.path)))


def labels(text: str, paper: str) -> list[str]:
    """Return what a text names: "Figs. 5 to 7" is "Fig. 5", "Fig. 6" and "Fig. 7"."""
    found = []
    for kind, numbers in _MENTION.findall(text):
        parts = re.split(r"(,\s+and\s+|,\s+|\s+and\s+|\s+to\s+)", numbers)
        last = ""
        for word, number in zip(["", *parts[1::2]], parts[::2], strict=True):
            bare = number.strip("()")
            span = paper != _THESIS and re.fullmatch(r"(\d+)-(\d+)", bare)
            if span:  # Figs. 12-14
                each = _range(span[1], span[2])
            elif word.strip() == "to" and kind.lower() != "section":
                each = _range(last, bare)[1:]
            else:
                each = [bare]
            most = _LARGEST.get(paper, {}).get(kind.lower(), 0)
            found += [_label(kind, one) for one in each if int(re.split("[-.]", one)[0]) <= most]
            last = bare
    return found


def _label(kind: str, number: str) -> str:
    shown = f"({number})" if kind.lower() == "eq" else number
    return f"{_KINDS[kind.lower()]} {shown}"


def _range(first: str, last: str) -> list[str]:
    head, _, tail = first.rpartition("-")
    begin = f"{head}-" if head else ""
    return [f"{begin}{i}" for i in range(int(tail), int(last.rpartition("-")[2]) + 1)]


def _by_experiments() -> Iterator[Mention]:
    for entry in CATALOGUE.entries:
        for label in labels(entry.figure, entry.paper):
            yield Mention(paper=entry.paper, label=label, path=entry.name, kind="experiment")


def _by_docstrings() -> Iterator[Mention]:
    for storey in ("models", "systems", "diagrams"):
        for file in sorted((ROOT / storey).rglob("*.py")):
            module = ".".join(("chamfer", *file.relative_to(ROOT).with_suffix("").parts))
            tree = ast.parse(file.read_text(encoding="utf-8"))
            above = ast.get_docstring(tree) or ""
            if file.name != "__init__.py":
                yield from _mentioned(above, above, module, "module", file.parent.name)
            for node in tree.body:
                if isinstance(node, ast.ClassDef | ast.FunctionDef) and node.name[0] != "_":
                    text = ast.get_docstring(node) or ""
                    kind = "class" if isinstance(node, ast.ClassDef) else "function"
                    path = f"{module}.{node.name}"
                    yield from _mentioned(text, above, path, kind, file.parent.name)


def _mentioned(text: str, above: str, path: str, kind: str, room: str) -> Iterator[Mention]:
    for match in _MENTION.finditer(text):
        paper = _paper(match[0], text, above, room)
        for label in labels(match[0], paper):
            yield Mention(paper=paper, label=label, path=path, kind=kind)


def _paper(mention: str, text: str, above: str, room: str) -> str:
    for said in (text, above):
        named = [paper for paper, author in _PAPERS.items() if author.search(said)]
        if len(named) == 1:
            return named[0]
    if re.search(r"\d-\d|\d\.\d+\.\d|chapter", mention, re.IGNORECASE):
        return _THESIS
    if re.search(r"\d\.\d", mention):  # the state machine's paper has no such sections
        return (
            "sensorimotor-primitives"
            if room in ("skills", "primitives", "strategies", "vision")
            else _THESIS
        )
    if room == "force" and re.search(r"(fig|eq)", mention, re.IGNORECASE):
        return "fsm-visual-servoing"
    return _ROOMS.get(room, _THESIS)


def _order(label: str) -> tuple[int, list[int]]:
    kind = next(i for i, name in enumerate(_KINDS.values()) if label.startswith(name))
    return kind, [int(number) for number in re.findall(r"\d+", label)]
