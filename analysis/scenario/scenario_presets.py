"""Fields that are given by the name of a preset: ``parts=factory-8mm``.

A dataclass says what its presets are: ``PRESETS: ClassVar[Mapping[str, Mapping[str, object]]]``,
by name the fields that are not as by default.
"""

from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.plain_data import joined


def presets_of(value: object) -> Mapping[str, Mapping[str, object]]:
    """Return the presets of a dataclass by name; none of anything else."""
    found: Mapping[str, Mapping[str, object]] = getattr(type(value), "PRESETS", {})
    return found if is_dataclass(value) else {}


def with_presets(given: Mapping[Any, Any], default: object, path: str = "") -> dict[Any, Any]:
    """Return what is given, with instances of dataclasses in place of their presets' names.

    Args:
        given: Fields, as a scenario file has them.
        default: The dataclass whose fields they are.
        path: To it, for messages.

    Raises:
        UserError: If there is no such preset.
    """
    found: dict[Any, Any] = {}
    for name, value in given.items():
        inner: Any = getattr(default, name, None) if isinstance(name, str) else None
        here = joined(path, str(name))
        presets = presets_of(inner)
        if isinstance(value, Mapping):
            value = with_presets(value, inner, here)
        elif isinstance(value, str) and presets:
            if value not in presets:
                raise UserError(
                    f"{here} is {value!r}, allowed: {', '.join(presets)}, or its fields"
                )
            value = type(inner)(**presets[value])
        found[name] = value
    return found
