"""Checks of parameters, with one-line messages.

Parameter dataclasses call these from ``__post_init__``. Every message has the form ``mass is -1.0,
allowed: a finite number > 0``. A caller that knows the source of the value (the command line) only
has to put the path in front.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from reprlib import Repr
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Value = TypeVar("Value")

MOST_FRICTION: Final = 2.0  # of Coulomb's coefficients: more may be per cent or degrees

_SHOWN: Final = Repr()  # looks at some elements only, so that a large value takes no time
_SHOWN.maxtuple = _SHOWN.maxlist = _SHOWN.maxdict = 8
_SHOWN.maxlevel = 2
_SHOWN.maxstring = _SHOWN.maxlong = _SHOWN.maxother = 60  # characters


class ParameterError(ValueError):
    """A parameter is outside what is allowed; the message names it, its value and the range."""

    def __init__(self, name: str, value: object, allowed: str) -> None:
        super().__init__(f"{name} is {shown(value)}, allowed: {allowed}")
        self.name = name
        self.value = value
        self.allowed = allowed

    def __reduce__(self) -> tuple[type["ParameterError"], tuple[str, object, str]]:
        """Return how to make it again in another process: not from its message."""
        return type(self), (self.name, self.value, self.allowed)


def shown(value: object) -> str:
    """Return a value as a message shows it, in at most a line."""
    return _SHOWN.repr(value)


def finite(name: str, value: Array) -> Array:
    """Return a vector if all of it is finite.

    Raises:
        ParameterError: If it is not; it stops values that would hang or crash an integrator.
    """
    if not all(map(math.isfinite, value.tolist())):
        raise ParameterError(name, value.tolist(), "finite numbers")
    return value


def known(name: str, value: Value | None) -> Value:
    """Return a value that a scenario may leave open, but not its user.

    Raises:
        ParameterError: If it is None.
    """
    if value is None:
        raise ParameterError(name, None, "a value; what is open in a scenario, resolve fills in")
    return value


@contextmanager
def within(path: str) -> Iterator[None]:
    """Put a path in front of the names of refused parameters."""
    try:
        yield
    except ParameterError as error:
        raise ParameterError(f"{path}.{error.name}", error.value, error.allowed) from error


def require_finite(params: object, *names: str) -> None:
    """Raise :class:`ParameterError` unless every named field is a finite number."""
    for name in names:
        value = getattr(params, name)
        if not math.isfinite(value):
            raise ParameterError(name, value, "a finite number")


def require_numbers(params: object, count: int, *names: str) -> None:
    """Raise :class:`ParameterError` unless every named field holds ``count`` finite numbers."""
    for name in names:
        values = getattr(params, name)
        if len(values) != count or not all(map(math.isfinite, values)):
            raise ParameterError(name, values, f"{count} finite numbers")


def require_positive(params: object, *names: str, most: float = math.inf, unit: str = "") -> None:
    """Raise :class:`ParameterError` unless every named field is finite, > 0 and <= ``most``.

    None, the value of an open field, is allowed, here and by :func:`require_not_negative`.
    """
    for name in names:
        if (value := getattr(params, name)) is None:
            continue
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(name, value, "a finite number > 0")
        if value > most:
            allowed = f"a finite number > 0 and <= {most:g} {unit}".rstrip()
            raise ParameterError(name, value, allowed)


def require_all_positive(params: Any, *but: str) -> None:
    """Raise :class:`ParameterError` unless every float of a dataclass but some is positive."""
    names = [one.name for one in fields(params) if one.type is float and one.name not in but]
    require_positive(params, *names)


def require_whole(params: object, *names: str) -> None:
    """Raise :class:`ParameterError` unless every named field is a whole number, 1 or more."""
    for name in names:
        value = getattr(params, name)
        if not (isinstance(value, int) and value >= 1):
            raise ParameterError(name, value, "a whole number >= 1")


def require_not_negative(params: object, *names: str) -> None:
    """Raise :class:`ParameterError` unless every named field is finite and >= 0."""
    for name in names:
        value = getattr(params, name)
        if value is not None and not (math.isfinite(value) and value >= 0):
            raise ParameterError(name, value, "a finite number >= 0")


def require_between(params: object, low: float, high: float, *names: str, unit: str = "") -> None:
    """Raise :class:`ParameterError` unless every named field is from ``low`` to ``high``."""
    for name in names:
        value = getattr(params, name)
        if not low <= value <= high:
            allowed = f"a number from {low:g} to {high:g} {unit}".rstrip()
            raise ParameterError(name, value, allowed)


def require_same(params: object, default: object, path: str, *names: str, why: str) -> None:
    """Raise :class:`ParameterError` unless every named field, which nothing reads, is unchanged.

    Args:
        params: The dataclass with the fields.
        default: The defaults; the dataclass itself, or one of its kind.
        path: The path of the fields in the scenario; empty where the builder names it.
        names: The fields.
        why: The reason why nothing reads them.
    """
    for name in names:
        value, was = getattr(params, name), getattr(default, name)
        if value != was:
            raise ParameterError(f"{path}.{name}".lstrip("."), value, f"{shown(was)}, {why}")


def require_one_of(params: object, name: str, choices: Iterable[object]) -> None:
    """Raise :class:`ParameterError` unless the named field is one of ``choices``."""
    value = getattr(params, name)
    allowed = tuple(choices)
    if value not in allowed:
        raise ParameterError(name, value, ", ".join(str(choice) for choice in allowed))
