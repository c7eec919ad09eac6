"""Converts dataclasses to plain data, as YAML and JSON hold it, and back.

A type may stand for several dataclasses, each given by its name: ``Stick: {speed: 0.1}``.
"""

import types
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.models.validation import ParameterError, shown

Named = Mapping[Any, Mapping[str, type[Any]]]  # types that stand for dataclasses, these by name

_NONE: Final[Named] = types.MappingProxyType({})
_DESCRIPTIONS: Final[dict[Any, str]] = {
    float: "a number",
    int: "an integer",
    bool: "true or false",
    str: "a text",
    type(None): "null",
}


def structured(plain: Any, kind: Any, *, path: str = "", named: Named = _NONE) -> Any:
    """Return the dataclass, or another value of the type ``kind``, for plain data.

    ``path`` leads to it, for messages; ``named`` has types that stand for several dataclasses.

    Raises:
        UserError: If a field doesn't exist or its value is not allowed; the message has the path.
    """
    if type(plain) is kind and kind in _DESCRIPTIONS:
        return plain

    def inside(value: Any, inner: Any, place: str) -> Any:
        return structured(value, inner, path=f"{path}{place}", named=named)

    origin, arguments = get_origin(kind), get_args(kind)
    if kind in named:
        choices = named[kind]
        if not isinstance(plain, Mapping) or len(plain) != 1:
            raise _refused(path, plain, f"one of {', '.join(choices)}, with its fields")
        ((name, given),) = plain.items()
        if name not in choices:
            raise _refused(path, name, ", ".join(choices))
        return inside({} if given is None else given, choices[name], f".{name}")
    if _is_union(kind):
        return _of_union(plain, kind, path, named)
    if is_dataclass(kind) and isinstance(plain, Mapping):
        return _made(plain, kind, path, named)
    if origin is Mapping and isinstance(plain, Mapping):
        key, element = arguments
        return {
            inside(name, key, f".{name}"): inside(value, element, f".{name}")
            for name, value in plain.items()
        }
    if origin in (tuple, Sequence) and isinstance(plain, list | tuple):
        kinds = _element_kinds(kind, len(plain))
        if len(kinds) == len(plain):
            pairs = enumerate(zip(plain, kinds, strict=True))
            return tuple(inside(value, element, f"[{i}]") for i, (value, element) in pairs)
    try:
        return _scalar(plain, kind)
    except (TypeError, ValueError, OverflowError) as error:
        raise _refused(path, plain, _described(kind)) from error


def plain_data(
    value: Any, kind: Any = Any, *, named: Named = _NONE, omit_defaults: bool = False
) -> Any:
    """Return a value, whose declared type is ``kind``, as :func:`structured` takes it.

    Fields with their default may be left out.

    Raises:
        UserError: If a dataclass has no name although its type stands for several.
    """
    if type(value) in _DESCRIPTIONS and type(value) is not int:
        return value  # an integer may stand where a number does

    def inside(inner: Any, its_kind: Any) -> Any:
        return plain_data(inner, its_kind, named=named, omit_defaults=omit_defaults)

    if _is_union(kind):
        choices = [choice for choice in get_args(kind) if choice is not types.NoneType]
        kind = choices[0] if len(choices) == 1 else Any
    if kind in named:
        for name, choice in named[kind].items():
            if type(value) is choice:
                return {name: inside(value, choice)}
        raise UserError(
            f"{type(value).__name__} has no name in a file, valid names: {', '.join(named[kind])}"
        )
    if is_dataclass(value):
        values = {field: getattr(value, field.name) for field in fields(value)}
        return {
            field.name: inside(inner, _hints(value.__class__)[field.name])
            for field, inner in values.items()
            if not (omit_defaults and _is_default(field, inner))
        }
    if isinstance(value, Mapping):
        element = get_args(kind)[1] if get_args(kind) else Any
        return {name: inside(inner, element) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [
            inside(*pair) for pair in zip(value, _element_kinds(kind, len(value)), strict=True)
        ]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return float(value) if kind is float and value is not None else value


def joined(path: str, name: str) -> str:
    """Return the path of a field below another path."""
    return f"{path}.{name}" if path else name


def _refused(path: str, value: object, allowed: str) -> UserError:
    return UserError(f"{path} is {shown(value)}, allowed: {allowed}")


def _made(plain: Mapping[Any, Any], cls: Any, path: str, named: Named) -> Any:
    values = {}
    short: Mapping[str, tuple[str, str]] = getattr(cls, "SHORT", {})
    for name in short.keys() & plain.keys():
        group, inner = short[name]
        rest = {one: value for one, value in plain.items() if one != name}
        of = rest.get(group, {})
        if not isinstance(of, Mapping):
            both = f"{joined(path, name)} and {joined(path, group)} are both set"
            raise UserError(f"{both}, allowed: one of them")
        plain = rest | {group: {**of, inner: plain[name]}}
    for field in fields(cls):
        here = joined(path, field.name)
        if field.name in plain:
            kind = _hints(cls)[field.name]
            values[field.name] = structured(plain[field.name], kind, path=here, named=named)
        elif default_of(field) is MISSING:
            raise UserError(f"{here} has to be given, it has no default")
    for name in sorted(map(str, plain.keys() - values.keys())):
        valid = ", ".join(sorted([*(field.name for field in fields(cls)), *short]))
        raise UserError(f"{joined(path, name)}: no such field, valid fields: {valid}")
    try:
        return cls(**values)
    except ParameterError as error:
        raise UserError(joined(path, str(error))) from error
    except ValueError as error:
        raise UserError(f"{path}: {error}" if path else str(error)) from error


def _of_union(plain: Any, kind: Any, path: str, named: Named) -> Any:
    """Return a value of the first type that takes it.

    A mapping can only mean a dataclass, whose own message is the better one.
    """
    choices = [choice for choice in get_args(kind) if choice is not types.NoneType]
    if plain is None and len(choices) < len(get_args(kind)):
        return None
    for choice in choices:
        try:
            return structured(plain, choice, path=path, named=named)
        except UserError:
            if isinstance(plain, Mapping) and is_dataclass(choice):
                raise
    raise _refused(path, plain, _described(kind))


def _scalar(value: Any, kind: Any) -> Any:
    """Return a value of a type without element types.

    Raises:
        ValueError: If it is none; TypeError and OverflowError too.
    """
    if kind is Any:
        return value
    if get_origin(kind) is np.ndarray:
        return np.array(value, dtype=np.float64)
    if (type(value), value) in ((type(one), one) for one in get_args(kind)):
        return value  # of a Literal
    number = not isinstance(value, bool)
    if kind is float and number and (isinstance(value, int | float) or value in ("inf", "-inf")):
        return float(value)  # JSON holds infinite ones as texts
    if kind in (bool, int, str) and isinstance(value, kind) and (number or kind is bool):
        return value
    raise ValueError


def _described(kind: Any) -> str:
    """Return a description of the values that a type allows."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Literal:
        return ", ".join(map(str, arguments))
    if _is_union(kind):
        return " or ".join(map(_described, arguments))
    if origin is tuple and arguments[-1] is Ellipsis:
        return f"a list, each element {_described(arguments[0])}"
    if origin is tuple:
        return f"a list of {len(arguments)}: {', '.join(map(_described, arguments))}"
    if origin is Sequence:
        return "a list"
    if origin is Mapping:
        return f"a mapping of {_described(arguments[0])}"
    if is_dataclass(kind):
        return f"a mapping of {', '.join(sorted(field.name for field in fields(kind)))}"
    if origin is np.ndarray:
        return "numbers, in lists of equal length"
    return _DESCRIPTIONS[kind]


def _is_union(kind: Any) -> bool:
    return get_origin(kind) in (Union, types.UnionType)


def _element_kinds(kind: Any, count: int) -> Sequence[Any]:
    """Return the element types of a tuple or a sequence of this length."""
    arguments = get_args(kind) or (Any,)
    fixed = get_origin(kind) is tuple and arguments[-1] is not Ellipsis
    return arguments if fixed else (arguments[0],) * count


def default_of(field: Any) -> Any:
    """Return a dataclass field's default, MISSING if it has none."""
    return field.default if field.default_factory is MISSING else field.default_factory()


def _is_default(field: Any, value: object) -> bool:
    default = default_of(field)
    return default is not MISSING and bool(value == default)


@cache
def _hints(cls: type[Any]) -> Mapping[str, Any]:
    return get_type_hints(cls)
