"""Builds scenarios from defaults, a YAML file and ``--set path=value``, and writes them.

A scenario is a frozen keyword-only dataclass, nested to any depth, of numbers, texts, booleans,
Literals, tuples of these and ``X | None``. Every mistake ends in a
:class:`~chamfer.analysis.scenario.errors.UserError` with the full dotted path of the field.

A scenario may declare that an open group equals another one: ``LIKE: ClassVar[Mapping[str,
str]]``, such as ``{"believed_part": "part"}``. If only some of its fields are given, the others
are those of that other group, and not defaults.

A group may be given by the name of a preset, ``parts=factory-8mm``. Its dataclass lists them:
``PRESETS: ClassVar[Mapping[str, Mapping[str, object]]]``, by name the fields that differ from the
default. A scenario may have presets of all of it, ``cell=ur5e-fixture``; other settings override
them: ``WHOLE: ClassVar[Mapping[str, Mapping[str, Mapping[str, object]]]]``, by their word and by
name. A field of a group in a dataclass may have a short name, ``connector.friction``: ``SHORT:
ClassVar[Mapping[str, tuple[str, str]]]``, by name the group and the field.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.plain_data import joined, plain_data, structured
from chamfer.analysis.scenario.scenario_yaml import block, one_line, parse_value

Scenario = TypeVar("Scenario")


def make_scenario(
    default: Scenario, *, given: Mapping[Any, Any] | None = None, settings: Sequence[str] = ()
) -> Scenario:
    """Return ``default`` with the given fields, overridden by the settings.

    Args:
        default: The scenario with the fields that nothing overrides.
        given: The fields to override, as a scenario file has them.
        settings: ``path=value``, where the path is dotted and the value is YAML. Single fields of
            a preset may follow its name.

    Raises:
        UserError: If a field doesn't exist or its value is not allowed.
    """
    plain: dict[Any, Any] = plain_data(default)
    overrides = [dict(given or {}), *_parse_settings(settings)]
    for override in (*_whole_presets(default, overrides), *overrides):
        plain = _merge(plain, override, default)
    for name, other in likes(type(default)).items():
        if getattr(default, name) is None and isinstance(plain[name], Mapping):
            plain[name] = _merge(plain[other], plain[name], None)
    scenario: Scenario = structured(plain, type(default))
    _refuse_not_finite(scenario, default, "")
    return scenario


def _whole_presets(default: object, overrides: list[dict[Any, Any]]) -> list[Mapping[str, object]]:
    """Return the fields of the named presets of a whole scenario; remove the names."""
    found = []
    for word, presets in getattr(type(default), "WHOLE", {}).items():
        for override in overrides:
            if word not in override:
                continue
            name = override.pop(word)
            if name not in presets:
                raise UserError(f"{word} is {name!r}, allowed: {', '.join(presets)}")
            found.append(presets[name])
    return found


def likes(cls: type[Any]) -> Mapping[str, str]:
    """Return the groups of a scenario that, left open, equal another one."""
    found: Mapping[str, str] = getattr(cls, "LIKE", {})
    return found


def unstructure(value: object) -> Any:
    """Return a scenario, or a field's value, as JSON can hold it: inf and -inf are texts."""
    return _json_ready(plain_data(value))


def value_text(value: object) -> str:
    """Return a field's value as ``--set`` takes it."""
    return one_line(plain_data(value))


def scenario_text(scenario: object) -> str:
    """Return the scenario as YAML, with a line for each field."""
    return block(plain_data(scenario))


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
            preset = isinstance(_at(parsed[other], other), str)
            if path.startswith(f"{other}.") and preset:
                continue
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


def _at(nested: Any, path: str) -> Any:
    for name in path.split("."):
        nested = nested[name]
    return nested


def _merge(
    plain: Mapping[Any, Any], override: Mapping[Any, Any], default: object, path: str = ""
) -> dict[Any, Any]:
    """Return plain data with its overrides; ``default`` has the presets."""
    merged = dict(plain)
    for name, (group, field) in getattr(type(default), "SHORT", {}).items():
        of = override.get(group)
        if name in override and isinstance(of, Mapping) and field in of:
            raise UserError(f"{name} and {group}.{field} are both set, allowed: one of them")
    for name, value in override.items():
        inner: Any = getattr(default, str(name), None)
        presets = getattr(type(inner), "PRESETS", {})
        if isinstance(value, str) and presets:
            if value not in presets:
                allowed = f"{', '.join(presets)}, or its fields"
                raise UserError(f"{joined(path, name)} is {value!r}, allowed: {allowed}")
            value = plain_data(type(inner)(**presets[value]))
        elif isinstance(value, Mapping) and isinstance(merged.get(name), Mapping):
            value = _merge(merged[name], value, inner, joined(path, str(name)))
        merged[name] = value
    return merged


def _refuse_not_finite(value: object, default: object, path: str) -> None:
    """Refuse NaN and infinity where the default is finite.

    Parameters check themselves; this covers those that don't, because a NaN in a derivative hangs
    the integrator. An infinite default means that infinity is allowed.
    """
    if is_dataclass(value):
        same = type(value) is type(default)
        for field in fields(value):
            inner = getattr(default, field.name) if same else field.default
            _refuse_not_finite(getattr(value, field.name), inner, joined(path, field.name))
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
