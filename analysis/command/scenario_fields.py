"""The fields of a scenario: what each one is called, means and may be."""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from difflib import get_close_matches
from types import NoneType
from typing import Any, Final, TypeVar, get_args, get_type_hints

from chamfer.analysis.report.check_text import number
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.field_comments import field_comment
from chamfer.analysis.scenario.field_limits import allowed
from chamfer.analysis.scenario.scenario_io import plain_value, value_text

T = TypeVar("T")

_NESTED: Final = "a mapping of the fields below or null"


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


@dataclass(frozen=True, kw_only=True)
class Field:
    """What is said of a field of an experiment's scenario."""

    path: str
    default: Any  # as JSON can hold it
    unit: str
    meaning: str
    allowed: str


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


def describe(scenario: object, leaf: Leaf) -> Field:
    """Return what a leaf of the scenario may be, with the rest that is known of it."""
    limits = _NESTED if leaf.nested else allowed(scenario, leaf.path, leaf.kind, leaf.value)
    return Field(
        path=leaf.path,
        default=plain_value(leaf.value),
        unit=leaf.unit,
        meaning=leaf.meaning,
        allowed=limits,
    )


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
        here = f"{path}.{name}" if path else name
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
    return {
        field.name: field.default_factory()
        if field.default_factory is not MISSING
        else None
        if field.default is MISSING
        else field.default
        for field in fields(owner)
    }


def _nested_type(value: object, kind: Any) -> type[Any] | None:
    """Return the dataclass that a field holds, or could hold if it is null."""
    if is_dataclass(value):
        return type(value)
    candidates: list[Any] = [choice for choice in (kind, *get_args(kind)) if is_dataclass(choice)]
    return candidates[0] if value is None and candidates else None


def _first_sentence(cls: type[Any]) -> str:
    return " ".join((inspect.getdoc(cls) or "").split()).partition(". ")[0].rstrip(".")
