"""Which points a sweep has: every combination of values, or draws from values and intervals."""

import itertools
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NamedTuple, get_args, get_origin

import numpy as np
import scipy  # whose submodules are imported where they are used

from chamfer.analysis.command.scenario_fields import Leaf, leaves
from chamfer.analysis.scenario.errors import UserError, valid_name
from chamfer.analysis.scenario.scenario_yaml import one_line, parse_value

Design = Literal["grid", "sobol", "random"]

MOST_POINTS: Final = 100_000
_DRAWS: Final = 64  # points unless said otherwise; a power of two balances Sobol's sequence
_DIGITS: Final = 15  # significant, so that 0:1:11 has 0.3 and not 0.30000000000000004
_SPECS: Final = "PATH=a:b:n, PATH=v1,v2,... or PATH~a:b"
_NUMBER: Final = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
_RANGE: Final = re.compile(rf"({_NUMBER}):({_NUMBER}):([0-9]{{1,6}})")
_INTERVAL: Final = re.compile(rf"({_NUMBER}):({_NUMBER})")


@dataclass(frozen=True)
class Drawn:
    """Numbers are drawn evenly from ``low`` to ``high``; integers where the field is one."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise UserError(
                f"the interval is {self.low:g}:{self.high:g}, allowed: finite, the lower end first"
            )


Spec = Sequence[Any] | Drawn  # the values that a field takes, or where they are drawn from


class VariedField(NamedTuple):
    """A field of a scenario and what it is given."""

    path: str  # dotted
    unit: str
    meaning: str
    whole: bool  # whether only integers are allowed
    spec: Spec

    @property
    def text(self) -> str:
        """Return it as ``--vary`` takes it."""
        if isinstance(self.spec, Drawn):
            return f"{self.path}~{self.spec.low!r}:{self.spec.high!r}"
        return f"{self.path}={','.join(map(one_line, self.spec))}"


def parse_vary(text: str) -> tuple[str, Spec]:
    """Return the path and the values or the interval that ``--vary`` says.

    Raises:
        UserError: If it says neither.
    """
    match = re.fullmatch(r"\s*([^=~\s]+)\s*([=~])(.*)", text, re.DOTALL)
    if match is None:
        raise UserError(f"--vary is {text!r}, allowed: {_SPECS}")
    path, sign, given = match[1], match[2], match[3].strip()
    if sign == "~":
        ends = _INTERVAL.fullmatch(given)
        if ends is None:
            raise UserError(f"--vary {path} is drawn from {given!r}, allowed: a:b, two numbers")
        return path, Drawn(float(ends[1]), float(ends[2]))
    if bounds := _RANGE.fullmatch(given):
        return path, _range(path, bounds[1], bounds[2], int(bounds[3]))
    if re.match(rf"{_NUMBER}:", given):
        raise UserError(f"--vary {path} is {given!r}, allowed: {_SPECS}, n from 1")
    try:
        values = parse_value(f"[{given}]")
    except ValueError as error:
        raise UserError(f"--vary {path} is {given!r}, allowed: {_SPECS} ({error})") from error
    if not isinstance(values, list) or not values:
        raise UserError(f"--vary {path} has no value, allowed: {_SPECS}")
    return path, values


def varied_fields(scenario: Any, vary: Mapping[str, Spec]) -> tuple[VariedField, ...]:
    """Return the fields of a scenario that are to be varied.

    Raises:
        UserError: If there are none, one doesn't exist, has no value or one twice, or can't be
            drawn.
    """
    if not vary:
        raise UserError(f"no field is varied, allowed: one --vary or more, each {_SPECS}")
    known = {leaf.path: leaf for leaf in leaves(scenario)}
    found = []
    for path, spec in vary.items():
        leaf = _inside(path, known) or known[valid_name("field", path, known)]
        kinds = {leaf.kind, *get_args(leaf.kind)}
        if isinstance(spec, Drawn):
            if not kinds & {int, float}:
                raise UserError(f"{path} is no number, allowed: {path}=v1,v2,...")
        elif isinstance(spec, str) or len(spec) == 0:
            raise UserError(f"{path} is {spec!r}, allowed: one value or more, in a list")
        elif twice := [text for text, n in Counter(map(one_line, spec)).items() if n > 1]:
            raise UserError(f"{path} is {twice[0]} twice")
        whole = int in kinds and float not in kinds
        found.append(VariedField(path, leaf.unit, leaf.meaning, whole, spec))
    return tuple(found)


def _inside(path: str, known: Mapping[str, Leaf]) -> Leaf | None:
    """Return what a path in a mapping stands for, whose fields only a run knows; else none."""
    leaf = known.get(path.partition(".")[0])
    if leaf is None or leaf.path == path:
        return None
    kinds = [get_origin(kind) for kind in (leaf.kind, *get_args(leaf.kind))]
    return replace(leaf, path=path, kind=float) if Mapping in kinds else None


def design_points(
    varied: Sequence[VariedField], *, design: Design | None, points: int | None, seed: int
) -> tuple[Design, list[tuple[Any, ...]]]:
    """Return the design and its points, each the fields' values in their order.

    A grid has every combination of the fields' values. The others have as many points as asked
    for, each field at one of its values or anywhere in its interval: evenly spread (the scrambled
    sequence of Sobol) or independent of each other.

    Unless given the design is a grid, or Sobol's where a field is drawn from an interval, with 64
    points.

    Raises:
        UserError: If the design doesn't fit the fields, or has too many points.
    """
    drawn = [field.path for field in varied if isinstance(field.spec, Drawn)]
    chosen: Design = design or ("sobol" if drawn else "grid")
    if chosen == "grid":
        if drawn:
            raise UserError(f"{drawn[0]} is drawn, but --design is 'grid', allowed: sobol, random")
        if points is not None:
            raise UserError(
                f"--points is {points}, but a grid has a point for each combination of values, "
                "allowed: with --design sobol or random"
            )
        values = [field.spec for field in varied if not isinstance(field.spec, Drawn)]
        _require_count(math.prod(map(len, values)))
        return chosen, list(itertools.product(*values))
    count = _DRAWS if points is None else points
    _require_count(count)
    if chosen == "sobol":
        sequence = scipy.stats.qmc.Sobol(len(varied), rng=np.random.default_rng(seed))
        # Taken as a whole power of two, as other numbers make it warn.
        shares = sequence.random_base2(max(0, math.ceil(math.log2(count))))[:count]
    else:
        shares = np.random.default_rng(seed).random((count, len(varied)))
    return chosen, [tuple(map(_at, varied, row)) for row in shares.tolist()]


def _range(path: str, low: str, high: str, count: int) -> list[float] | list[int]:
    if not 1 <= count <= MOST_POINTS:
        raise UserError(f"--vary {path} has {count} values, allowed: 1 to {MOST_POINTS}")
    found = np.linspace(float(low), float(high), count).tolist()
    if all(math.isfinite(value) and value == int(value) for value in found):
        return [int(value) for value in found]
    return [float(f"{value:.{_DIGITS}g}") for value in found]


def _at(field: VariedField, share: float) -> Any:
    """Return the value at a share, 0 to below 1, of what a field is given."""
    spec = field.spec
    if not isinstance(spec, Drawn):
        return spec[int(share * len(spec))]
    if field.whole:
        low, high = math.ceil(spec.low), math.floor(spec.high)
        return low + int(share * (high - low + 1))
    return spec.low + share * (spec.high - spec.low)


def _require_count(count: int) -> None:
    if not 1 <= count <= MOST_POINTS:
        raise UserError(f"the sweep has {count} points, allowed: 1 to {MOST_POINTS}")
