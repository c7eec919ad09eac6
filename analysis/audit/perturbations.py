"""Other values that a field could have."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, fields, is_dataclass
from itertools import islice
from types import NoneType
from typing import Any, Final, Literal, get_args, get_origin, get_type_hints

# Mild ones first: they are the least likely to be refused or to end the run early. A bound that
# is out of reach is told only by the strong ones.
_FACTORS: Final = (1.1, 0.9, 0.5, 2.0, 0.1, 10.0, 0.01, -1.0)
_INSTEAD_OF_ZERO: Final = (0.01, -0.1, 0.1, 1.0, 10.0)
_ALONE: Final = 2  # values of an element while the others stay
_INSTEAD_OF_INFINITY: Final = (1.0, 0.01, 100.0)


def perturbations(value: Any, kind: Any, resolved: Any) -> Iterator[Any]:
    """Yield values other than ``value``, as YAML would give them; not all need be allowed.

    Args:
        value: What the field is.
        kind: Its type, which says what it could be where the value doesn't.
        resolved: What a run takes it to be; it differs where None is derived.
    """
    seen = [list(value) if isinstance(value, tuple) else value]
    for candidate in _candidates(value, kind, resolved):
        if candidate not in seen:
            seen.append(candidate)
            yield candidate


def _candidates(value: Any, kind: Any, resolved: Any) -> Iterator[Any]:
    choices = get_args(kind)
    if value is None:
        if resolved is not None:
            yield from _candidates(resolved, kind, resolved)
        for choice in choices:
            yield from _values_of(choice)
    elif is_dataclass(value):
        yield None  # a leaf only if it may be
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1, 2 * value, value // 5, value + 5)
    elif isinstance(value, float):
        yield from _numbers(value)
    elif isinstance(value, tuple):
        yield from _tuples(value)
    else:
        yield from _values_of(kind)
    if value is not None and NoneType in choices:
        yield None


def _numbers(value: float) -> Iterator[float]:
    if value == 0:
        yield from _INSTEAD_OF_ZERO
    elif math.isinf(value):
        yield from (math.copysign(one, value) for one in _INSTEAD_OF_INFINITY)
    else:
        yield from (factor * value for factor in _FACTORS)


def _tuples(value: Sequence[Any]) -> Iterator[list[Any]]:
    """Yield lists whose elements are all perturbed, then one at a time, then of other lengths."""
    for together in zip(*(_candidates(one, type(one), one) for one in value), strict=False):
        yield list(together)
    for i, element in enumerate(value):
        for candidate in islice(_candidates(element, type(element), element), _ALONE):
            yield [*value[:i], candidate, *value[i + 1 :]]
    yield list(value[:-1])
    yield [*value, *value[-1:]]
    if not value:
        yield from ([0], [1], [0.01])


def _values_of(kind: Any) -> Iterator[Any]:
    """Yield values of a type of which none is known."""
    if get_origin(kind) is Literal:
        yield from get_args(kind)
    elif kind is bool:
        yield from (False, True)
    elif kind is int:
        yield from (1, 2, 10)
    elif kind is float:
        yield from (1.0, 0.1, 0.01, 0.001, 10.0)
    elif get_origin(kind) is tuple:
        yield from _lists_of(get_args(kind))
    elif is_dataclass(kind):
        yield from _mappings_of(kind)


def _mappings_of(kind: Any) -> Iterator[dict[str, Any]]:
    """Yield mappings that give a dataclass the fields without a default."""
    hints = get_type_hints(kind)
    required = [
        field.name
        for field in fields(kind)
        if field.default is MISSING and field.default_factory is MISSING
    ]
    if not required:
        yield {}
        return
    for values in zip(*(_values_of(hints[name]) for name in required), strict=False):
        yield dict(zip(required, values, strict=True))


def _lists_of(kinds: Sequence[Any]) -> Iterator[list[Any]]:
    lengths = (1, 2, 3, 6, 7) if kinds[-1] is Ellipsis else (len(kinds),)
    for length in lengths:
        for one in _values_of(kinds[0]):
            yield [one] * length
