"""Unit and meaning of a dataclass's fields, read from the comments in its source.

A field's comment is at the end of its last line, on the lines below it, or both::

    period: float = 1 / 80  # s, between two exposures
    target: Vector3 = (0.0, 0.0, 0.1)
    # m, of the socket in the world

The text before the first comma, semicolon or colon is the unit if it reads as one (``m/s``, ``rad
above m``, ``N m or N``); the rest is the meaning. A field without a unit is a pure number. So is
an integer: its ``m`` is a symbol.

The class that introduces a field gives its meaning. One that overrides its default may give the
reason, which is added to the meaning. It may also narrow the unit.
"""

import ast
import inspect
import io
import re
import textwrap
import tokenize
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from functools import cache
from typing import Final

_SYMBOLS: Final = (
    *("s", "m", "mm", "km", "kg", "N", "rad", "deg", "Hz", "%", "pixels", "grey levels"),
    *("periods", "E", "C"),  # E and C of a block that takes any unit: its error's, its output's
)
_SYMBOL: Final = rf"(?:{'|'.join(map(re.escape, _SYMBOLS))})(?:\^-?[0-9])?"
_PRODUCT: Final = rf"{_SYMBOL}(?: {_SYMBOL})*"
_ONE_UNIT: Final = rf"(?:1|{_PRODUCT})(?:/(?:{_SYMBOL}|\({_PRODUCT}\)))*"
_UNIT: Final = re.compile(rf"(?!1$){_ONE_UNIT}(?: (?:or|and|above) {_ONE_UNIT})*")
_COMMENT: Final = re.compile(r"([^,;:]*)[,;:]?\s*(.*)", re.DOTALL)
_YAML_WORDS: Final = {"None": "null", "True": "true", "False": "false"}


@dataclass(frozen=True, kw_only=True)
class FieldComment:
    """The comment of a field."""

    unit: str  # "" for a pure number
    meaning: str  # "" if nothing is said


def field_comment(cls: type, name: str) -> FieldComment:
    """Return the comment of the field ``name`` in a dataclass and its ancestors."""
    said = [
        comments[name]
        for ancestor in cls.__mro__
        if is_dataclass(ancestor) and name in (comments := _own_comments(ancestor))
    ]
    unit = next((comment.unit for comment in said if comment.unit), "")
    meaning = next((comment.meaning for comment in reversed(said) if comment.meaning), "")
    override = said[0].meaning
    if override.startswith(meaning):
        meaning = override
    elif override:
        meaning += f"; here: {override}"
    return FieldComment(unit=unit, meaning=meaning)


def parse_comment(text: str, *, has_unit: bool = True) -> FieldComment:
    """Split a comment into unit and meaning; its words are those of YAML, as ``--set`` takes."""
    text = re.sub(r"\b(None|True|False)\b", lambda match: _YAML_WORDS[match[0]], text)
    text = text.rstrip(".;")
    match = _COMMENT.fullmatch(text)
    assert match is not None
    head, rest = match.groups()
    if has_unit and _UNIT.fullmatch(head.strip()):
        return FieldComment(unit=head.strip(), meaning=rest)
    return FieldComment(unit="", meaning=text)


@cache
def _own_comments(cls: type) -> Mapping[str, FieldComment]:
    """Return the comments of the fields that the body of ``cls`` itself declares."""
    source = textwrap.dedent(inspect.getsource(cls))
    (definition,) = ast.parse(source).body
    assert isinstance(definition, ast.ClassDef)
    behind, alone = _comments_by_line(source)
    found = {}
    for statement in definition.body:
        if not (isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)):
            continue
        line = statement.end_lineno or statement.lineno
        parts = [behind.get(line, "")]
        while (line := line + 1) in alone:
            parts.append(alone[line])
        text = " ".join(parts).strip()
        is_integer = re.search(r"\bint\b", ast.unparse(statement.annotation)) is not None
        found[statement.target.id] = parse_comment(text, has_unit=not is_integer)
    return found


def _comments_by_line(source: str) -> tuple[dict[int, str], dict[int, str]]:
    """Return the comments behind code and those on separate lines, by line number."""
    behind: dict[int, str] = {}
    alone: dict[int, str] = {}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            kind = alone if token.line.lstrip().startswith("#") else behind
            kind[token.start[0]] = token.string.lstrip("#").strip()
    return behind, alone
