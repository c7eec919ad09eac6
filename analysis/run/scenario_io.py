"""Scenarios from defaults, a YAML file and ``--set path=value``, and back.

A scenario is a frozen keyword-only dataclass, nested as deep as it likes, of numbers, texts,
booleans, Literals, tuples of these and ``X | None``. Every mistake ends in a
:class:`~analysis.run.errors.UserError` with the full dotted path of the field.

A dataclass may say what became of its fields: ``RENAMED: ClassVar[Mapping[str, str]]`` from old
paths to new ones, both relative to that dataclass and inherited, such as ``{"runs": "trials"}`` or
``{"controller": "controller.kind"}``. Who uses the old path is told the new one.
"""

import hashlib
import json
import math
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin

from cattrs import ClassValidationError, Converter, ForbiddenExtraKeysError
from cattrs.gen import make_dict_structure_fn

from analysis.run.errors import UserError
from analysis.run.scenario_yaml import block, one_line, parse_value
from models.validation import ParameterError, shown

Scenario = TypeVar("Scenario")


class _RefusedError(ValueError):
    """A value that is not of the field's type."""

    def __init__(self, value: object, allowed: str) -> None:
        super().__init__(f"is {shown(value)}, allowed: {allowed}")


class _ElementError(ValueError):
    """An element of a tuple is wrong; ``__cause__`` says how."""

    def __init__(self, index: int) -> None:
        super().__init__(index)
        self.index = index


def make_scenario(
    default: Scenario, *, given: Mapping[Any, Any] | None = None, settings: Sequence[str] = ()
) -> Scenario:
    """Return ``default`` with what is given, and then what the settings override.

    Args:
        default: The scenario that every field comes from that nothing overrides.
        given: The fields to override, as a scenario file has them.
        settings: ``path=value``, where the path is dotted and the value is YAML.

    Raises:
        UserError: If a field doesn't exist or its value is not allowed.
    """
    plain: dict[Any, Any] = _CONVERTER.unstructure(default)
    if given is not None:
        plain = _merge(plain, given)
    for setting in _parse_settings(settings):
        plain = _merge(plain, setting)
    try:
        scenario = _CONVERTER.structure(plain, type(default))
    except ClassValidationError as error:
        raise UserError(next(_messages(error, "", ()))) from error
    _refuse_not_finite(scenario, default, "")
    return scenario


def unstructure(scenario: object) -> dict[str, Any]:
    """Return the scenario as JSON can hold it: infinite numbers are the texts inf and -inf."""
    plain: dict[str, Any] = plain_value(scenario)
    return plain


def plain_value(value: object) -> Any:
    """Return a field's value as JSON can hold it, as :func:`unstructure` does."""
    return _json_ready(_CONVERTER.unstructure(value))


def value_text(value: object) -> str:
    """Return a field's value as ``--set`` takes it."""
    return one_line(_CONVERTER.unstructure(value))


def scenario_text(scenario: object) -> str:
    """Return the scenario as YAML, with a line for each field."""
    return block(_CONVERTER.unstructure(scenario))


def sha256(plain: Mapping[str, Any]) -> str:
    """Return the digest of an unstructured scenario, whatever the order of its fields."""
    text = json.dumps(plain, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _parse_settings(settings: Sequence[str]) -> list[dict[str, Any]]:
    parsed: dict[str, dict[str, Any]] = {}
    for setting in settings:
        path, equals, text = setting.partition("=")
        path = path.strip()
        if not equals or not all(path.split(".")):
            raise UserError(f"--set is {setting!r}, allowed: path=value")
        for other in parsed:
            if path == other:
                raise UserError(f"{path} is set twice")
            if path.startswith(f"{other}.") or other.startswith(f"{path}."):
                raise UserError(f"{other} and {path} are both set, but one contains the other")
        try:
            value = parse_value(text)
        except ValueError as error:
            raise UserError(f"{path} is {text!r}, allowed: a value in YAML ({error})") from error
        for name in reversed(path.split(".")):
            value = {name: value}
        parsed[path] = value
    return list(parsed.values())


def _merge(plain: Mapping[Any, Any], override: Mapping[Any, Any]) -> dict[Any, Any]:
    merged = dict(plain)
    for name, value in override.items():
        inner = merged.get(name)
        if isinstance(inner, Mapping) and isinstance(value, Mapping):
            value = _merge(inner, value)
        merged[name] = value
    return merged


def _messages(
    error: BaseException, path: str, outer: Sequence[tuple[str, type[Any]]]
) -> Iterator[str]:
    """Yield a line for each mistake in what cattrs raised, with the path in front.

    ``outer`` has the dataclasses around the mistake, each with its path.
    """
    if isinstance(error, ClassValidationError):
        outer = [*outer, (path, error.cl)]
        inside, outside = error.group_exceptions()
        for inner, note in inside:
            yield from _messages(inner, _join(path, note.name), outer)
        for inner in outside:
            yield from _messages(inner, path, outer)
    elif isinstance(error, _ElementError):
        assert error.__cause__ is not None
        yield from _messages(error.__cause__, f"{path}[{error.index}]", outer)
    elif isinstance(error, ForbiddenExtraKeysError):
        valid = ", ".join(sorted(field.name for field in fields(error.cl)))
        for name in sorted(map(str, error.extra_fields)):
            old = _join(path, name)
            yield _renamed(old, outer) or f"{old}: no such field, valid fields: {valid}"
    elif isinstance(error, ParameterError):
        yield _join(path, str(error))
    elif isinstance(error, KeyError) and error.args == (path.rpartition(".")[2],):
        yield f"{path} has to be given, it has no default"
    elif isinstance(error, _RefusedError):
        yield _renamed(path, outer) or f"{path} {error}"
    elif isinstance(error, ValueError):
        yield f"{path}: {error}" if path else str(error)
    else:
        raise error


def _renamed(old: str, outer: Sequence[tuple[str, type[Any]]]) -> str | None:
    """Return what a path, or what was below it, is now, if a dataclass around it says so."""
    for path, cls in reversed(outer):
        for ancestor in cls.__mro__:
            answers = {
                _join(path, name): f"{_join(path, name)} is now {_join(path, new)}"
                for name, new in vars(ancestor).get("RENAMED", {}).items()
            }
            if old in answers:
                return answers[old]
            if below := [told for name, told in answers.items() if name.startswith(f"{old}.")]:
                return ", ".join(below)
    return None


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _refuse_not_finite(value: object, default: object, path: str) -> None:
    """Refuse NaN and infinity where the default is finite.

    Parameters check themselves; this is the net below those that don't, because a NaN in a
    derivative hangs the integrator. An infinite default says that infinity is allowed.
    """
    if is_dataclass(value):
        same = type(value) is type(default)
        for field in fields(value):
            inner = getattr(default, field.name) if same else field.default
            _refuse_not_finite(getattr(value, field.name), inner, _join(path, field.name))
    elif isinstance(value, tuple):
        defaults = default if isinstance(default, tuple) else ()
        for i, element in enumerate(value):
            inner = defaults[i] if i < len(defaults) else None
            _refuse_not_finite(element, inner, f"{path}[{i}]")
    elif isinstance(value, float) and not math.isfinite(value):
        unbounded = isinstance(default, float) and math.isinf(default)
        if unbounded and math.isinf(value):
            return
        allowed = f"a finite number or {default}" if unbounded else "a finite number"
        raise UserError(f"{path} is {value!r}, allowed: {allowed}")


def _json_ready(plain: Any) -> Any:
    if isinstance(plain, dict):
        return {name: _json_ready(value) for name, value in plain.items()}
    if isinstance(plain, list | tuple):
        return [_json_ready(value) for value in plain]
    if isinstance(plain, float) and not math.isfinite(plain):
        return str(plain)
    return plain


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


def _tuple(value: Any, cls: Any) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise _RefusedError(value, _described(cls))
    types_ = get_args(cls)
    if types_[-1] is Ellipsis:
        types_ = (types_[0],) * len(value)
    if len(types_) != len(value):
        raise _RefusedError(value, _described(cls))
    elements = []
    for i, (element, element_type) in enumerate(zip(value, types_, strict=True)):
        try:
            elements.append(_CONVERTER.structure(element, element_type))
        except (ValueError, ClassValidationError) as error:
            raise _ElementError(i) from error
    return tuple(elements)


def _union(value: Any, cls: Any) -> Any:
    """Structure ``value`` as the first type that takes it.

    A mapping can only be meant for a dataclass, whose own message is the better one.
    """
    if value is None and type(None) in get_args(cls):
        return None
    choices: list[Any] = [choice for choice in get_args(cls) if choice is not type(None)]
    dataclasses: list[Any] = [choice for choice in choices if is_dataclass(choice)]
    if isinstance(value, Mapping) and dataclasses:
        return _CONVERTER.structure(value, dataclasses[0])
    for choice in choices:
        try:
            return _CONVERTER.structure(value, choice)
        except (ValueError, ClassValidationError):
            continue
    raise _RefusedError(value, _described(cls))


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


def _dataclass_hook(cls: Any) -> Callable[[Any, Any], Any]:
    structure = make_dict_structure_fn(cls, _CONVERTER, _cattrs_forbid_extra_keys=True)

    def checked(value: Any, _: Any) -> Any:
        if not isinstance(value, Mapping):
            raise _RefusedError(value, _described(cls))
        return structure(value, cls)

    return checked


def _converter() -> Converter:
    converter = Converter(detailed_validation=True)
    converter.register_structure_hook(float, _float)
    converter.register_structure_hook(int, _int)
    converter.register_structure_hook(bool, _bool)
    converter.register_structure_hook(str, _str)
    converter.register_structure_hook_func(_is_literal, _literal)
    converter.register_structure_hook_func(_is_tuple, _tuple)
    converter.register_structure_hook_func(_is_union, _union)
    converter.register_structure_hook_factory(is_dataclass, _dataclass_hook)
    converter.register_unstructure_hook(float, float)
    return converter


_DESCRIPTIONS: Final[dict[Any, str]] = {
    float: "a number",
    int: "an integer",
    bool: "true or false",
    str: "a text",
    type(None): "null",
}
_CONVERTER: Final = _converter()
