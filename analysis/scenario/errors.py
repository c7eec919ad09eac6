"""Errors that the command line reports in one line, without a traceback."""

from collections.abc import Mapping
from typing import Any


class UserError(Exception):
    """A mistake in the user's input.

    The message names the item, its value and the valid values.
    """


class ExperimentError(Exception):
    """An experiment ended before it had a result; the message names it and says why."""


def valid_name(kind: str, name: str, names: Mapping[str, Any]) -> str:
    """Return the name if it is one of the names, and else list them.

    Raises:
        UserError: If it is none of them.
    """
    if name in names:
        return name
    from difflib import get_close_matches

    close = get_close_matches(name, names, n=1)
    suggestion = f", did you mean {close[0]!r}?" if close else ","
    valid = ", ".join(names) or "none"
    raise UserError(f"unknown {kind} {name!r}{suggestion} valid names: {valid}")
