"""Which columns of a file hold which quantity of a log, and in which unit.

A quantity has a column an element, such as ``force_x``, ``force[0]`` or ``Fx``; others are named:
``force=load1,load2,load3:lbf``. A name may also be that of ``name[0]``, ``name[1]`` and so on, of
which ``name[3..5]`` are three.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import takewhile
from math import pi
from typing import Final, NamedTuple

from scipy.constants import foot, inch, kgf, lbf

from chamfer.analysis.scenario.errors import UserError, valid_name


class Kind(NamedTuple):
    """What a quantity is made of."""

    unit: str  # in a Log
    sizes: tuple[int, ...]  # elements that it may have; none: any number, of joints
    stems: tuple[str, ...]  # with which its columns' titles begin, in any case


_ANY: Final[tuple[int, ...]] = ()
QUANTITIES: Final[Mapping[str, Kind]] = {
    "time": Kind("s", (1,), ("time", "t", "timestamp")),
    "force": Kind("N", (3,), ("force", "f")),
    "moment": Kind("N m", (3,), ("moment", "torque", "m", "t")),
    "position": Kind("m", (3,), ("position", "pos", "p", "")),
    "rotation": Kind("rad", (3, 4), ("rotation", "orientation", "r", "q")),
    "velocity": Kind("m/s", (3,), ("velocity", "vel", "v")),
    "reference_position": Kind("m", (3,), ("reference_position", "virtual_position")),
    "joint_position": Kind("rad", _ANY, ("joint_position", "q")),
    "joint_velocity": Kind("rad/s", _ANY, ("joint_velocity", "dq")),
    "joint_torque": Kind("N m", _ANY, ("joint_torque", "tau")),
}
ALIASES: Final = {"virtual_position": "reference_position"}
_METRES: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_ANGLES: Final = {"rad": 1.0, "deg": pi / 180}
UNITS: Final[Mapping[str, Mapping[str, float]]] = {  # by the unit in a Log, what others are of it
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "N": {"N": 1.0, "kN": 1e3, "lbf": lbf, "kgf": kgf},
    "N m": {"N m": 1.0, "N mm": 1e-3, "lbf in": lbf * inch, "lbf ft": lbf * foot, "kgf m": kgf},
    "m": _METRES,
    "rad": _ANGLES,
    "m/s": {f"{unit}/s": of for unit, of in _METRES.items()},
    "rad/s": {f"{unit}/s": of for unit, of in _ANGLES.items()},
}
_MOST_SHOWN: Final = 24  # columns of a file, in a message
_MOST: Final = 100  # elements of a quantity


class Chosen(NamedTuple):
    """The columns of a quantity, and its unit if it was said."""

    columns: tuple[str, ...]
    unit: str = ""


def parse_columns(texts: Sequence[str]) -> dict[str, Chosen]:
    """Return what ``--columns`` says: ``force=Fx,Fy,Fz:lbf``, by quantity.

    Raises:
        UserError: If a text is none, or names an unknown quantity, an unknown unit, or one twice.
    """
    found: dict[str, Chosen] = {}
    for text in texts:
        name, _, said = text.partition("=")
        columns, colon, unit = said.rpartition(":")
        if not (colon or columns):
            columns, unit = unit, ""
        names = tuple(name for one in columns.split(",") for name in _range(one.strip()))
        if not all(names):
            raise UserError(f"--columns is {text!r}, allowed: such as force=Fx,Fy,Fz or time=t:ms")
        quantity = ALIASES.get(name) or valid_name("quantity", name, QUANTITIES)
        if quantity in found:
            raise UserError(f"--columns has {quantity} twice")
        if colon:
            factor(quantity, unit, "--columns")
        found[quantity] = Chosen(names, unit)
    return found


def _range(name: str) -> list[str]:
    """Return the names of ``name[3..5]``, else the name."""
    if not (match := re.fullmatch(r"(.*)\[([0-9]{1,2})\.\.([0-9]{1,2})\]", name)):
        return [name]
    return [f"{match[1]}[{i}]" for i in range(int(match[2]), int(match[3]) + 1)]


def factor(quantity: str, unit: str, where: object) -> float:
    """Return what a unit is in that of a log; without one it is that.

    Raises:
        UserError: If it is not known.
    """
    units = UNITS[QUANTITIES[quantity].unit]
    plain = re.sub(r"[\s*.]", "", unit)
    for name, value in units.items():
        if plain in ("", name.replace(" ", "")):
            return value
    raise UserError(f"{where}: {quantity} is in {unit!r}, allowed: {', '.join(units)}")


def choose(
    titles: Sequence[str], said: Mapping[str, Chosen], path: object
) -> dict[str, tuple[str, ...]]:
    """Return the columns of each quantity that a file with these titles has, as they are named.

    Raises:
        UserError: If a column is not there, or there twice, or a quantity has too few or too
            many, or too few quantities are there.
    """
    found = {name: _named(name, one.columns, titles, path) for name, one in said.items()}
    for name, kind in QUANTITIES.items():
        if name not in said and (columns := _spelled(kind, titles)):
            found[name] = columns
    for columns in found.values():
        for one in columns:
            if titles.count(one) > 1:
                raise UserError(f"{path} has {titles.count(one)} columns {one}, must have one")
    lacking = [] if "time" in found else ["time"]
    if "force" not in found and not {"joint_torque", "joint_position"} <= found.keys():
        lacking += ["force"]
    if lacking:
        words = {"time": "time=COLUMN", "force": "force=COLUMNS"}
        raise UserError(
            f"{path} has no {' and no '.join(lacking)} among its columns "
            f"{_shown(titles)}; say --columns {' '.join(words[one] for one in lacking)}"
        )
    return found


def _named(
    quantity: str, names: Sequence[str], titles: Sequence[str], path: object
) -> tuple[str, ...]:
    if len(names) == 1 and names[0] not in titles:
        names = _there((f"{names[0]}[{i}]" for i in range(_MOST)), titles) or names
    for name in names:
        if name not in titles:
            raise UserError(f"{path} has no column {name}, but {_shown(titles)}")
    sizes = QUANTITIES[quantity].sizes
    if sizes and len(names) not in sizes:
        allowed = " or ".join(map(str, sizes))
        raise UserError(f"--columns has {len(names)} of {quantity}, allowed: {allowed}")
    return tuple(names)


def _spelled(kind: Kind, titles: Sequence[str]) -> tuple[str, ...]:
    """Return the columns whose titles are as usual, empty if they are not all there."""
    by_case = {title.casefold(): title for title in reversed(titles)}
    for stem in kind.stems:
        for endings in _endings(kind):
            there = _there((f"{stem}{ending}" for ending in endings), list(by_case))
            if len(there) in (kind.sizes or range(1, _MOST + 1)):
                return tuple(by_case[one] for one in there)
    return ()


def _endings(kind: Kind) -> Iterator[Sequence[str]]:
    if kind.sizes == (1,):
        yield [""]
        return
    yield [f"[{i}]" for i in range(_MOST)]
    if kind.sizes:
        for letters in ("wxyz", "xyz") if 4 in kind.sizes else ("xyz",):
            for before in ("_", ".", ""):
                yield [f"{before}{letter}" for letter in letters]
    else:
        for before in ("_", ""):
            yield [f"{before}{i + 1}" for i in range(_MOST)]


def _there(names: Iterator[str], titles: Sequence[str]) -> tuple[str, ...]:
    return tuple(takewhile(set(titles).__contains__, names))


def _shown(titles: Sequence[str]) -> str:
    more = len(titles) - _MOST_SHOWN
    return ", ".join(titles[:_MOST_SHOWN]) + (f" and {more} more" if more > 0 else "")
