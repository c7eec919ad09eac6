"""The settings that make one scenario of another."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

from analysis.run.errors import UserError
from analysis.run.scenario_io import make_scenario, value_text
from models.validation import ParameterError

Scenario = TypeVar("Scenario")


def overrides(
    scenario: Scenario, default: Scenario, resolve: Callable[[Scenario], Scenario]
) -> list[str]:
    """Return the settings, ``path=value``, that make from ``default`` what ``scenario`` means.

    Two scenarios mean the same if they resolve to the same. A value that the default leaves open
    (None) is not among the settings where it is the one that resolving gives anyway, so those of
    a resolved scenario are as few as those of the scenario that it came from.
    """
    if scenario == default or (resolved := resolve(scenario)) == resolve(default):
        return []
    settings = {}
    left_open = []
    for path, value, usual in _differences(scenario, default, ""):
        settings[path] = f"{path}={value_text(value)}"
        if usual is None:
            left_open.append(path)
    follow = _follow(scenario, default, resolve, settings, left_open)
    fewer = [setting for path, setting in settings.items() if path not in follow]
    if follow and resolve(make_scenario(default, settings=fewer)) == resolved:
        settings = {path: setting for path, setting in settings.items() if path not in follow}
    for path in [path for path in left_open if path in settings]:
        fewer = [setting for other, setting in settings.items() if other != path]
        try:
            needed = resolve(make_scenario(default, settings=fewer)) != resolved
        except (UserError, ParameterError):
            needed = True
        if not needed:
            del settings[path]
    return list(settings.values())


def _follow(
    scenario: Scenario,
    default: Scenario,
    resolve: Callable[[Scenario], Scenario],
    settings: Mapping[str, str],
    left_open: Sequence[str],
) -> set[str]:
    """Return which of the fields that may be left open come out alike if all of them are."""
    given = [setting for path, setting in settings.items() if path not in left_open]
    try:
        without = resolve(make_scenario(default, settings=given))
    except (UserError, ParameterError):
        return set()
    return set(left_open) - {path for path, _, _ in _differences(scenario, without, "")}


def _differences(value: Any, default: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield path, value and default of each field that differs."""
    if is_dataclass(value) and type(value) is type(default):
        for field in fields(value):
            inner = f"{path}.{field.name}" if path else field.name
            yield from _differences(
                getattr(value, field.name), getattr(default, field.name), inner
            )
    elif value != default:
        yield path, value, default
