"""Holds the project's prose to the rules of ``docs/contributing.md``.

``python -m docs._ext.prose`` reads the pages, the help of the command line, the docstrings and
fields of public blocks, the notes of checks and the first line of every docstring. It prints one
line for each breach and ends with status 1 if there is one. Paths as arguments choose sources:
``python -m docs._ext.prose docs/design.md systems/force``.
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from docs._ext.blocks import ROOT, blocks, rooms

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cli import _parser
from chamfer.analysis.report.checks import load_paper

LONGEST: Final = 30  # words of a sentence
MEAN: Final = 20.0  # words of a source's sentences
_RULES: Final = ROOT / "docs" / "contributing.md"
_GLOSSARY: Final = ROOT / "docs" / "glossary.md"

_FENCE: Final = re.compile(r"^(`{3,}|~{3,}|:{3,})(.*?)\n.*?^\1\s*$", re.MULTILINE | re.DOTALL)
_FRONT: Final = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
_INDENTED: Final = re.compile(r"(?:\A|\n)\n(?:(?: {4}|\t).*\n)+")
_FORMULA: Final = re.compile(r"\$\$.*?\$\$", re.DOTALL)
_CODE: Final = re.compile(r"``.+?``|`[^`\n]+`|\$[^$\n]+\$", re.DOTALL)
_LINK: Final = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_ROLE: Final = re.compile(r"[{:][a-z:]+[}:]`~?([^`]*)`")
_SHORT: Final = re.compile(r"\b(Figs?|eqs?|Eqs?|e\.g|i\.e|cf|vs|approx|et al|resp|No|sec)\.")
_END: Final = re.compile(r"(?<=[.!?])[\"')*_]*\s+(?=[\"'(*_\[]*[A-Z0-9`])")
_LAYOUT: Final = re.compile(r"^(Args|Returns|Raises|Yields|Attributes|Note):\s*$", re.MULTILINE)
_WORD: Final = re.compile(r"[\w\x00][\w\x00'./%^+-]*")
_ASKS: Final = re.compile(r"^(what|which|how|why|who|whose|where|when|is|does|do|can)\b", re.I)


@dataclass(frozen=True)
class Text:
    """Prose of one source, by paragraphs; a heading is one of them."""

    name: str
    paragraphs: tuple[str, ...]
    headings: tuple[str, ...] = ()


def breaches(text: Text) -> Iterator[str]:
    """Yield what of a text is against the rules, one line each."""
    found = [one for part in text.paragraphs for one in sentences(part)]
    for one in found:
        if words(one) > LONGEST:
            yield f"{text.name}: {words(one)} words, {LONGEST} allowed: {_cut(one)}"
        if re.match(r"(What|Who|Whose|Whoever|Whatever)\b", one) and not one.endswith("?"):
            yield f"{text.name}: begins with a free relative: {_cut(one)}"
    for one in (*found, *text.headings):
        for word in forbidden().findall(_CODE.sub("", one)):
            yield f"{text.name}: {word!r}, write {instead()[word.lower()]}: {_cut(one)}"
    for one in text.headings:
        if one.endswith("?") or _ASKS.match(one):
            yield f"{text.name}: a heading is a noun phrase: {one}"
    long = [words(one) for one in found]
    if len(long) >= 5 and sum(long) > MEAN * len(long):
        mean = sum(long) / len(long)
        yield f"{text.name}: {mean:.1f} words a sentence on average, {MEAN:g} allowed"


def sentences(paragraph: str) -> list[str]:
    """Return a paragraph's sentences; code, formulas and links count as one word each."""
    plain = _SHORT.sub(lambda match: f"{match[1]}\x01", paragraph)
    plain = " ".join(plain.split())
    return [one.replace("\x01", ".") for one in _END.split(plain) if words(one)]


def words(sentence: str) -> int:
    """Return how many words a sentence has; numbers and names in code are words."""
    return len(_WORD.findall(_CODE.sub("\x00", sentence)))


@cache
def instead() -> dict[str, str]:
    """Return what to write in place of each forbidden word, from the rules and the glossary."""
    table = _RULES.read_text(encoding="utf-8").split("| avoid | write |")[1]
    rows = re.findall(r"^\| ([^|]+) \| ([^|]+) \|$", table, re.M)
    found = {
        word.strip().lower(): better.strip() for old, better in rows for word in old.split(",")
    }
    term = ""
    for line in _GLOSSARY.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith((" ", "`", "#")):
            term = line.strip()
        if match := re.search(r"\*Not: (.+?)\.\*", line):
            found |= {word.strip().lower(): f'"{term}"' for word in match[1].split(",")}
    return found


@cache
def forbidden() -> re.Pattern[str]:
    """Return what finds a forbidden word."""
    longest = sorted(instead(), key=len, reverse=True)
    return re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, longest))})(?![\w-])", re.I)


def page_text(path: Path) -> Text:
    """Return the prose of a Markdown page: paragraphs, items of lists and cells of tables."""
    text = _FRONT.sub("", path.read_text(encoding="utf-8"))
    text = re.sub(r"\*Not: .+?\.\*", "", text)  # words to avoid
    captions = re.findall(r"^\s*(?:caption|alt): *[|>]?-? *(.*(?:\n {4,}.+)*)", text, re.M)
    for fence in _FENCE.finditer(text):
        if re.match(r"\{(note|tip|warning|important|admonition|glossary|figure)", fence[2]):
            captions.append(re.sub(r"^(?::.*|[`:]{3}.*)$", "", fence[0], flags=re.M))
    if path == _RULES:  # so has its table
        text = re.sub(r"^\|.*\n", "", text, flags=re.M)
    text = _FORMULA.sub("\n\n", _FENCE.sub("\n\n", text))
    text = _ROLE.sub(r"`\1`", _LINK.sub(r"\1", _INDENTED.sub("\n\n", text)))
    paragraphs, headings = [], []
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", "\n\n".join([text, *captions])):
        for line in part.splitlines() if part.lstrip().startswith("|") else [part]:
            for cell in line.strip().strip("|").split(" | ") if "|" in line else [line]:
                if match := re.match(r"\s*#+ (.*)", cell):
                    headings.append(match[1])
                    cell = cell[match.end() :]
                paragraphs.append(re.sub(r"^\s*(?:[-*]|\d+\.) |^[|: -]+$", "", cell))
    name = str(path.relative_to(ROOT))
    return Text(name, tuple(filter(str.strip, paragraphs)), tuple(headings))


def code_texts() -> Iterator[Text]:
    """Yield the help, what experiments are, notes of checks, public blocks and their fields."""
    yield Text("chamfer --help", tuple(_help(_parser())))
    for entry in CATALOGUE.entries:
        yield Text(f"analysis/catalogue.py, {entry.name}", (entry.summary,))
    for paper in {entry.paper: None for entry in CATALOGUE.entries}:
        for one in load_paper(paper, CATALOGUE).published:
            if one.note:
                yield Text(f"analysis/published, {one.metric} of {one.experiment}", (one.note,))
    for room in (*rooms("systems"), *rooms("diagrams")):
        for block in blocks(room):
            place = f"{block.module.removeprefix('chamfer.').replace('.', '/')}.py, {block.name}"
            yield Text(place, tuple(_docstring(block.text)))
            for kind, fields in block.parameters:
                for field in fields:
                    yield Text(f"{place}, {kind}.{field.name}", (field.meaning,))


def first_lines(folders: Sequence[str]) -> Iterator[Text]:
    """Yield the first line of every docstring in the code."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                    continue
                if said := ast.get_docstring(node):
                    place = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}"
                    yield Text(place, tuple(_docstring(said.split("\n\n")[0])))


def _help(parser: argparse.ArgumentParser) -> Iterator[str]:
    yield from filter(None, (parser.description, parser.epilog))
    for action in parser._actions:
        if action.help and action.help != argparse.SUPPRESS:
            yield action.help
        if isinstance(action, argparse._SubParsersAction):
            for choice in action._choices_actions:
                yield choice.help or ""
            for one in action.choices.values():
                yield from _help(one)


def _docstring(text: str) -> Iterator[str]:
    plain = _INDENTED.sub("\n\n", _LAYOUT.sub("\n", text) + "\n")
    plain = re.sub(r"^\.\. .*(?:\n(?: +.*)?)*", "", plain, flags=re.M)
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\w+: ))", _ROLE.sub(r"`\1`", plain)):
        yield re.sub(r"^\s*(?:[-*]|\w+:) ", "", part)


def _cut(sentence: str) -> str:
    return sentence if len(sentence) < 150 else f"{sentence[:147]}..."


def texts() -> Iterator[Text]:
    """Yield all prose that the rules hold for."""
    pages = [
        ROOT / "README.md",
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / "docs/reference").glob("*.md"),
    ]
    yield from map(page_text, sorted(pages))
    yield from code_texts()
    yield from first_lines(("models", "systems", "diagrams", "analysis"))


def main(arguments: Sequence[str]) -> int:
    """Print the breaches in the sources whose name begins as an argument says, or in all."""
    chosen = [one for one in texts() if not arguments or one.name.startswith(tuple(arguments))]
    if not chosen:
        raise SystemExit(f"prose: nothing begins with {' or '.join(arguments)}")
    found = [line for one in chosen for line in breaches(one)]
    for line in dict.fromkeys(found):
        print(line)
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
