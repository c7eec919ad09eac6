"""The fields of a scenario: what each one is called, means and may be."""

import inspect
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from difflib import get_close_matches
from types import NoneType
from typing import Any, Final, TypeVar, get_args, get_type_hints

from chamfer.analysis.report.check_text import number
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.field_comments import field_comment
from chamfer.analysis.scenario.plain_data import default_of, joined
from chamfer.analysis.scenario.scenario_io import make_scenario, value_text

T = TypeVar("T")

_NESTED: Final = "a mapping of the fields below or null"
_NUMBERS: Final = (math.nan, -1, 0, 0.5, -(10**9), 10**9)  # that are tried
_INTEGER: Final = "an integer"
_LIST: Final = re.compile("a list( of [0-9]+)?")
_HOLDS_A_LIST: Final = re.compile(r"tuple|list|Sequence|Any|ndarray")  # in a type's name
_OR_NULL: Final = " or null"


@dataclass(frozen=True, kw_only=True)
class Leaf:
    """A field of a scenario that ``--set`` gives a single value.

    That is every field but a nested dataclass, which is a leaf too if it may be null.
    """

    path: str  # dotted
    kind: Any  # its type
    value: Any
    unit: str
    meaning: str
    nested: bool  # a dataclass, whose own fields follow
    above: str | None  # the path of the field above it that is null


def leaves(scenario: Any) -> Iterator[Leaf]:
    """Yield the leaves of a scenario, in the order in which they are declared.

    Below a nested dataclass that is null they are those of its type, with its defaults; a field
    that has none has to be given there, and is null.
    """
    return _leaves(type(scenario), _values(scenario), "", "", None)


def matching(found: Sequence[Leaf], prefix: str) -> list[Leaf]:
    """Return the leaves whose path begins with the prefix.

    Raises:
        UserError: If there is none.
    """
    matched = [leaf for leaf in found if leaf.path.startswith(prefix)]
    if matched:
        return matched
    parts = [leaf.path.split(".") for leaf in found]
    names = dict.fromkeys(".".join(part[: i + 1]) for part in parts for i in range(len(part)))
    close = get_close_matches(prefix, names) or dict.fromkeys(part[0] for part in parts)
    raise UserError(f"no field begins with {prefix!r}, close to it: {', '.join(close)}")


def allowed(scenario: object, leaf: Leaf) -> str:
    """Return in words what a leaf may be: wrong values are tried and the refusals read.

    So it is said once, where it is checked. The other fields are as in the scenario.
    """
    if leaf.nested:
        return _NESTED
    path = leaf.path
    needed = _refusal(scenario, path, {}).removesuffix(_OR_NULL)
    said = [_refusal(scenario, path, wrong) for wrong in _wrong_values(leaf)]
    said = [text.removesuffix(_OR_NULL) for text in said if text]
    by_words: dict[str, str] = {}  # the tried value itself may be among the numbers
    for text in said:
        by_words.setdefault(re.sub(r"[-+.e0-9]+", "#", text), text)
    limits = [text for text in by_words.values() if text != needed and _is_sharpest(text, said)]
    if (match := _LIST.match(needed)) and limits:
        text = f"{match[0]}: {'; '.join(limits)}"
    elif not limits or (needed == _INTEGER and _INTEGER not in " ".join(limits)):
        text = "; ".join([needed, *limits])
    else:
        text = "; ".join(limits)
    takes_null = _refusal(scenario, path, None) == ""
    return text + (_OR_NULL if takes_null else "")


def default_texts(scenario: T, resolve: Callable[[T], T]) -> dict[str, str]:
    """Return each leaf's default as ``--set`` takes it, and in brackets what a run makes of it."""
    # A group that is open in the scenario may be filled in, and no leaf any more.
    resolved = {leaf.path: leaf.value for leaf in leaves(resolve(scenario))}
    return {
        leaf.path: _default_text(leaf, resolved.get(leaf.path, leaf.value))
        for leaf in leaves(scenario)
    }


def _default_text(leaf: Leaf, resolved: object) -> str:
    if is_dataclass(leaf.value):
        return "as below"
    text = value_text(leaf.value)
    if resolved == leaf.value:
        return text
    derived = number(resolved) if isinstance(resolved, float) else value_text(resolved)
    return f"{text} ({derived})"


def _leaves(
    owner: type[Any], values: Mapping[str, Any], path: str, said: str, above: str | None
) -> Iterator[Leaf]:
    """Yield the leaves of a dataclass; ``said`` is what the field means that it is in."""
    hints = get_type_hints(owner)
    for name, value in values.items():
        comment = field_comment(owner, name)
        here = joined(path, name)
        nested = _nested_type(value, hints[name])
        if nested is None:
            meaning = comment.meaning or said
        else:
            meaning = comment.meaning or _first_sentence(nested)
        if nested is None or NoneType in get_args(hints[name]):
            yield Leaf(
                path=here,
                kind=hints[name],
                value=value,
                unit=comment.unit,
                meaning=meaning,
                nested=nested is not None,
                above=above,
            )
        if nested is not None and value is None:
            yield from _leaves(nested, _defaults(nested), here, comment.meaning, above or here)
        elif nested is not None:
            yield from _leaves(nested, _values(value), here, comment.meaning, above)


def _values(owner: Any) -> dict[str, Any]:
    return {field.name: getattr(owner, field.name) for field in fields(owner)}


def _defaults(owner: type[Any]) -> dict[str, Any]:
    """Return a dataclass's defaults, None for fields that have to be given."""
    defaults = {field.name: default_of(field) for field in fields(owner)}
    return {name: None if value is MISSING else value for name, value in defaults.items()}


def _nested_type(value: object, kind: Any) -> type[Any] | None:
    """Return the dataclass that a field holds, or could hold if it is null."""
    if is_dataclass(value):
        return type(value)
    candidates: list[Any] = [choice for choice in (kind, *get_args(kind)) if is_dataclass(choice)]
    return candidates[0] if value is None and candidates else None


def _first_sentence(cls: type[Any]) -> str:
    return " ".join((inspect.getdoc(cls) or "").split()).partition(". ")[0].rstrip(".")


def _wrong_values(leaf: Leaf) -> Iterator[Any]:
    """Yield values of every kind, among them some that this field can hardly allow."""
    yield from ("?", *_NUMBERS)
    if not _HOLDS_A_LIST.search(str(leaf.kind)):
        return
    elements = list(leaf.value) if isinstance(leaf.value, tuple) else []
    yield []
    for wrong in _NUMBERS:
        yield [wrong, *elements[1:]]


def _refusal(scenario: object, path: str, wrong: object) -> str:
    """Return what is said to be allowed when the field is ``wrong``; "" if nothing is said."""
    try:
        _with(scenario, path, wrong)
    except UserError as error:
        pattern = rf"{re.escape(path)}((?:\[[0-9]+\])*) is .*?, allowed: (.*)"
        if match := re.fullmatch(pattern, str(error), re.DOTALL):
            return f"each element {match[2]}" if match[1] else match[2]
    return ""


def _with(scenario: Any, path: str, value: object) -> Any:
    """Return the scenario with one field set; only the objects around the field are copied."""
    name, _, inner = path.partition(".")
    group = getattr(scenario, name)
    # Whether a number is finite is looked at last, when all dataclasses are made.
    not_a_number = math.nan in (value if isinstance(value, list) else [value])
    if not inner or group is None or not_a_number:
        given: Any = value
        for part in reversed(path.split(".")):
            given = {part: given}
        return make_scenario(scenario, given=given)
    try:
        made = _with(group, inner, value)
    except UserError as error:
        raise UserError(joined(name, str(error))) from error
    try:
        return replace(scenario, **{name: made})
    except ValueError as error:
        raise UserError(str(error)) from error


def _is_sharpest(text: str, said: list[str]) -> bool:
    """Whether nothing else says the same and more."""
    return not any(other != text and other.startswith(text) for other in said)
