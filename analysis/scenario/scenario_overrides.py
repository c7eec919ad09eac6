"""The settings that turn one scenario into another."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import likes, make_scenario, value_text
from chamfer.models.validation import ParameterError

Scenario = TypeVar("Scenario")


def overrides(
    scenario: Scenario, default: Scenario, resolve: Callable[[Scenario], Scenario]
) -> list[str]:
    """Return the settings, ``path=value``, that turn ``default`` into ``scenario``.

    Two scenarios are equivalent if they resolve to the same. A value that the default leaves open
    (None) is no setting if resolving derives the same value. So a resolved scenario has as few
    settings as the scenario from which it came.
    """
    if scenario == default or (resolved := resolve(scenario)) == resolve(default):
        return []
    settings = {}
    left_open = []
    for path, value, usual in _differences(scenario, default, ""):
        settings[path] = f"{path}={value_text(value)}"
        if usual is None:
            left_open.append(path)

    def without(some: Collection[str]) -> Scenario | None:
        """Return the scenario of the settings but some, None where they are refused."""
        others = [setting for path, setting in settings.items() if path not in some]
        try:
            return resolve(make_scenario(default, settings=others))
        except (UserError, ParameterError):
            return None

    bare = without(left_open)  # of what comes out alike there all can be left out at once
    differ = left_open if bare is None else [path for path, *_ in _differences(scenario, bare, "")]
    left_out: set[str] = set()
    for some in (set(left_open).difference(differ), *({path} for path in left_open)):
        if not some <= left_out and without(left_out | some) == resolved:
            left_out |= some
    return [setting for path, setting in settings.items() if path not in left_out]


def _differences(value: Any, default: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield path, value and default of each field that differs."""
    if is_dataclass(value) and type(value) is type(default):
        for field in fields(value):
            inner = f"{path}.{field.name}" if path else field.name
            given, usual = getattr(value, field.name), getattr(default, field.name)
            if given is not None and usual is None and field.name in likes(type(value)):
                usual = getattr(value, likes(type(value))[field.name])
            yield from _differences(given, usual, inner)
    elif value != default:
        yield path, value, default
