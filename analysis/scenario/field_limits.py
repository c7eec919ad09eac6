"""What a field of a scenario may be: found by trying wrong values and reading the refusals.

So it is said once, where it is checked.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.plain_data import joined
from chamfer.analysis.scenario.scenario_io import make_scenario

_NUMBERS: Final = (math.nan, -1, 0, 0.5, -(10**9), 10**9)
_INTEGER: Final = "an integer"
_LIST: Final = re.compile("a list( of [0-9]+)?")
_HOLDS_A_LIST: Final = re.compile(r"tuple|list|Sequence|Any|ndarray")  # in a type's name
_OR_NULL: Final = " or null"


def allowed(scenario: object, path: str, kind: object, value: object) -> str:
    """Return in words what a field may be.

    Args:
        scenario: What the other fields are taken from.
        path: The field's dotted path.
        kind: Its type: lists are tried where that holds any.
        value: What the field is by default, so that elements of a tuple can be tried.
    """
    needed = _refusal(scenario, path, {}).removesuffix(_OR_NULL)
    said = [_refusal(scenario, path, wrong) for wrong in _wrong_values(kind, value)]
    said = [text.removesuffix(_OR_NULL) for text in said if text]
    by_words: dict[str, str] = {}  # the tried value itself may be among the numbers
    for text in said:
        by_words.setdefault(re.sub(r"[-+.e0-9]+", "#", text), text)
    limits = [text for text in by_words.values() if text != needed and _is_sharpest(text, said)]
    if (match := _LIST.match(needed)) and limits:
        text = f"{match[0]}: {'; '.join(limits)}"
    elif not limits or (needed == _INTEGER and _INTEGER not in " ".join(limits)):
        text = "; ".join([needed, *limits])
    else:
        text = "; ".join(limits)
    takes_null = _refusal(scenario, path, None) == ""
    return text + (_OR_NULL if takes_null else "")


def _wrong_values(kind: object, value: object) -> Iterator[Any]:
    """Yield values of every kind, among them some that this field can hardly allow."""
    yield from ("?", *_NUMBERS)
    if not _HOLDS_A_LIST.search(str(kind)):
        return
    elements = list(value) if isinstance(value, tuple) else []
    yield []
    for number in _NUMBERS:
        yield [number, *elements[1:]]


def _refusal(scenario: object, path: str, wrong: object) -> str:
    """Return what is said to be allowed when the field is ``wrong``; "" if nothing is said."""
    try:
        _with(scenario, path, wrong)
    except UserError as error:
        pattern = rf"{re.escape(path)}((?:\[[0-9]+\])*) is .*?, allowed: (.*)"
        if match := re.fullmatch(pattern, str(error), re.DOTALL):
            return f"each element {match[2]}" if match[1] else match[2]
    return ""


def _with(scenario: Any, path: str, value: object) -> Any:
    """Return the scenario with a field set; only the dataclasses around the field are made anew.

    Raises:
        UserError: As :func:`chamfer.analysis.scenario.scenario_io.make_scenario` says it.
    """
    name, _, inner = path.partition(".")
    group = getattr(scenario, name)
    # Whether a number is finite is looked at last, when all dataclasses are made.
    not_a_number = math.nan in (value if isinstance(value, list) else [value])
    if not inner or group is None or not_a_number:
        given: Any = value
        for part in reversed(path.split(".")):
            given = {part: given}
        return make_scenario(scenario, given=given)
    try:
        made = _with(group, inner, value)
    except UserError as error:
        raise UserError(joined(name, str(error))) from error
    try:
        return replace(scenario, **{name: made})
    except ValueError as error:
        raise UserError(str(error)) from error


def _is_sharpest(text: str, said: list[str]) -> bool:
    """Whether nothing else says the same and more."""
    return not any(other != text and other.startswith(text) for other in said)
