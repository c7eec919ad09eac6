"""Dataclasses of plain data, as YAML and JSON hold it, and back; cattrs, made strict.

Every mistake ends in a :class:`~chamfer.analysis.scenario.errors.UserError` with the full dotted
path of the field. A type may stand for several dataclasses, each given by its name: ``Stick:
{speed: 0.1}``.
"""

import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin

import numpy as np
from cattrs import ClassValidationError, Converter, ForbiddenExtraKeysError
from cattrs.gen import make_dict_structure_fn

from chamfer.analysis.scenario.errors import UserError
from chamfer.models.validation import ParameterError, shown

Structured = TypeVar("Structured")
Named = Mapping[str, type[Any]]

_DESCRIPTIONS: Final[dict[Any, str]] = {
    float: "a number",
    int: "an integer",
    bool: "true or false",
    str: "a text",
    type(None): "null",
}


class _RefusedError(ValueError):
    """A value that is not of the field's type."""

    def __init__(self, value: object, allowed: str) -> None:
        super().__init__(f"is {shown(value)}, allowed: {allowed}")


class _ElementError(ValueError):
    """An element of a list or a mapping is wrong; ``__cause__`` says how."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self.place = place  # as a path goes on, such as "[2]"


def make_converter(
    named: Mapping[Any, Named] | None = None, *, omit_defaults: bool = False
) -> Converter:
    """Return what makes dataclasses of plain data and back.

    Args:
        named: Types that stand for several dataclasses, and these by name.
        omit_defaults: Whether fields that are as by default are left out on the way back.
    """
    return _Hooks(named or {}, omit_defaults).converter


def structured(converter: Converter, plain: Any, cls: type[Structured]) -> Structured:
    """Return the dataclass that plain data stands for.

    Raises:
        UserError: If a field doesn't exist or its value is not allowed.
    """
    try:
        return converter.structure(plain, cls)
    except (ClassValidationError, _ElementError, _RefusedError) as error:
        raise UserError(next(_messages(error, ""))) from error


def _messages(error: BaseException, path: str) -> Iterator[str]:
    """Yield a line for each mistake in what cattrs raised, with the path in front."""
    if isinstance(error, ClassValidationError):
        inside, outside = error.group_exceptions()
        for inner, note in inside:
            yield from _messages(inner, joined(path, note.name))
        for inner in outside:
            yield from _messages(inner, path)
    elif isinstance(error, _ElementError):
        assert error.__cause__ is not None
        yield from _messages(error.__cause__, f"{path}{error.place}")
    elif isinstance(error, ForbiddenExtraKeysError):
        valid = ", ".join(sorted(field.name for field in fields(error.cl)))
        for name in sorted(map(str, error.extra_fields)):
            yield f"{joined(path, name)}: no such field, valid fields: {valid}"
    elif isinstance(error, ParameterError):
        yield joined(path, str(error))
    elif isinstance(error, KeyError) and error.args == (path.rpartition(".")[2],):
        yield f"{path} has to be given, it has no default"
    elif isinstance(error, _RefusedError):
        yield f"{path} {error}"
    elif isinstance(error, ValueError):
        yield f"{path}: {error}" if path else str(error)
    else:
        raise error


def joined(path: str, name: str) -> str:
    """Return the path of a field in what a path leads to."""
    return f"{path}.{name}" if path else name


def _float(value: Any, _: Any) -> float:
    if value in ("inf", "-inf"):  # as JSON holds them
        return float(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise _RefusedError(value, "a number")
    try:
        return float(value)
    except OverflowError as error:
        raise _RefusedError(value, "a number") from error


def _int(value: Any, _: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise _RefusedError(value, "an integer")
    return value


def _bool(value: Any, _: Any) -> bool:
    if not isinstance(value, bool):
        raise _RefusedError(value, "true or false")
    return value


def _str(value: Any, _: Any) -> str:
    if not isinstance(value, str):
        raise _RefusedError(value, "a text")
    return value


def _literal(value: Any, cls: Any) -> Any:
    for choice in get_args(cls):
        if type(value) is type(choice) and value == choice:
            return value
    raise _RefusedError(value, _described(cls))


class _Hooks:
    """How a converter treats each type."""

    def __init__(self, named: Mapping[Any, Named], omit_defaults: bool) -> None:
        self._named = named
        converter = Converter(detailed_validation=True, omit_if_default=omit_defaults)
        self.converter = converter
        converter.register_structure_hook(float, _float)
        converter.register_structure_hook(int, _int)
        converter.register_structure_hook(bool, _bool)
        converter.register_structure_hook(str, _str)
        converter.register_structure_hook_func(_is_literal, _literal)
        converter.register_structure_hook_func(_is_tuple, self._tuple)
        converter.register_structure_hook_func(_is_sequence, self._sequence)
        converter.register_structure_hook_func(_is_mapping, self._mapping)
        converter.register_structure_hook_func(_is_array, self._array)
        converter.register_structure_hook_func(_is_union, self._union)
        converter.register_structure_hook_factory(is_dataclass, self._dataclass_hook)
        converter.register_unstructure_hook(float, float)
        converter.register_unstructure_hook_func(_is_array, lambda array: array.tolist())
        converter.register_structure_hook_func(self._is_named, self._choice)
        converter.register_unstructure_hook_factory(self._is_named, self._chosen)

    def _is_named(self, cls: Any) -> bool:
        return any(cls is one for one in self._named)

    def _tuple(self, value: Any, cls: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            raise _RefusedError(value, _described(cls))
        types_ = get_args(cls)
        if types_[-1] is Ellipsis:
            types_ = (types_[0],) * len(value)
        if len(types_) != len(value):
            raise _RefusedError(value, _described(cls))
        pairs = enumerate(zip(value, types_, strict=True))
        return tuple(self._element(one, kind, f"[{i}]") for i, (one, kind) in pairs)

    def _sequence(self, value: Any, cls: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple):
            raise _RefusedError(value, _described(cls))
        (kind,) = get_args(cls)
        return tuple(self._element(one, kind, f"[{i}]") for i, one in enumerate(value))

    def _mapping(self, value: Any, cls: Any) -> dict[Any, Any]:
        if not isinstance(value, Mapping):
            raise _RefusedError(value, _described(cls))
        key, kind = get_args(cls)
        return {
            self._element(name, key, f".{name}"): self._element(one, kind, f".{name}")
            for name, one in value.items()
        }

    def _array(self, value: Any, cls: Any) -> Any:
        try:
            return np.array(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise _RefusedError(value, "numbers, in lists of equal length") from error

    def _element(self, value: Any, kind: Any, place: str) -> Any:
        try:
            return self.converter.structure(value, kind)
        except (ValueError, ClassValidationError) as error:
            raise _ElementError(place) from error

    def _union(self, value: Any, cls: Any) -> Any:
        """Structure ``value`` as the first type that takes it.

        A mapping can only be meant for a dataclass, whose own message is the better one.
        """
        if value is None and type(None) in get_args(cls):
            return None
        choices: list[Any] = [choice for choice in get_args(cls) if choice is not type(None)]
        dataclasses: list[Any] = [choice for choice in choices if is_dataclass(choice)]
        if isinstance(value, Mapping) and dataclasses:
            return self.converter.structure(value, dataclasses[0])
        for choice in choices:
            try:
                return self.converter.structure(value, choice)
            except (ValueError, ClassValidationError):
                continue
        raise _RefusedError(value, _described(cls))

    def _choice(self, value: Any, cls: Any) -> Any:
        """Structure a mapping of one name, that of a dataclass, to its fields."""
        choices = self._named[cls]
        if not isinstance(value, Mapping) or len(value) != 1:
            raise _RefusedError(value, f"one of {', '.join(choices)}, with its fields")
        ((name, given),) = value.items()
        if name not in choices:
            raise _RefusedError(name, ", ".join(choices))
        return self._element({} if given is None else given, choices[name], f".{name}")

    def _chosen(self, cls: Any) -> Callable[[Any], Any]:
        choices = self._named[cls]
        names = {choice: name for name, choice in choices.items()}

        def unstructure(value: Any) -> Any:
            if type(value) not in names:
                raise UserError(
                    f"{type(value).__name__} has no name in a file, valid names: "
                    f"{', '.join(choices)}"
                )
            return {names[type(value)]: self.converter.unstructure(value)}

        return unstructure

    def _dataclass_hook(self, cls: Any) -> Callable[[Any, Any], Any]:
        structure = make_dict_structure_fn(cls, self.converter, _cattrs_forbid_extra_keys=True)

        def checked(value: Any, _: Any) -> Any:
            if not isinstance(value, Mapping):
                raise _RefusedError(value, _described(cls))
            return structure(value, cls)

        return checked


def _described(cls: Any) -> str:
    """Return in words what a type allows."""
    arguments = get_args(cls)
    if _is_literal(cls):
        return ", ".join(map(str, arguments))
    if _is_union(cls):
        return " or ".join(_described(choice) for choice in arguments)
    if _is_tuple(cls):
        if arguments[-1] is Ellipsis:
            return f"a list, each element {_described(arguments[0])}"
        return f"a list of {len(arguments)}: {', '.join(map(_described, arguments))}"
    if _is_sequence(cls):
        return "a list"
    if _is_mapping(cls):
        return f"a mapping of {_described(arguments[0])}"
    if is_dataclass(cls):
        return f"a mapping of {', '.join(sorted(field.name for field in fields(cls)))}"
    return _DESCRIPTIONS[cls]


def _is_union(cls: Any) -> bool:
    origin: Any = get_origin(cls)
    return origin in (Union, types.UnionType)


def _is_literal(cls: Any) -> bool:
    origin: Any = get_origin(cls)
    return origin is Literal


def _is_tuple(cls: Any) -> bool:
    origin: Any = get_origin(cls)
    return origin is tuple


def _is_sequence(cls: Any) -> bool:
    origin: Any = get_origin(cls)
    return origin is Sequence


def _is_mapping(cls: Any) -> bool:
    origin: Any = get_origin(cls)
    return origin is Mapping


def _is_array(cls: Any) -> bool:
    origin: Any = get_origin(cls)
    return origin is np.ndarray
