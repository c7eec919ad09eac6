"""What a log tells of one thing, with its 95 % interval, from blocks of correlated samples."""

from typing import NamedTuple


class Quantity(NamedTuple):
    """A value and its 95 % interval; None: the log can't tell it, and the note says why."""

    value: float | None
    low: float | None
    high: float | None
    unit: str
    note: str = ""


def unknown(unit: str, note: str) -> Quantity:
    """Return what can't be told, and why."""
    return Quantity(None, None, None, unit, note)
