"""The errors that the command line says in one line, without a traceback."""

from collections.abc import Mapping
from typing import Any


class UserError(Exception):
    """A mistake in what was asked for.

    The message names the thing, its value and what would have been valid.
    """


class ExperimentError(Exception):
    """An experiment ended before it had a result; the message names it and says why."""


def valid_name(kind: str, name: str, names: Mapping[str, Any]) -> str:
    """Return the name if it is one of the names, and else say which are.

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
