"""Assignment of a file's columns to the quantities of a log, with units.

A quantity has a column an element, such as ``force_x``, ``force[0]`` or ``Fx``; others are named:
``force=load1,load2,load3:lbf``. A name may also be that of ``name[0]``, ``name[1]`` and so on, of
which ``name[3..5]`` are three.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import takewhile
from math import pi
from typing import Final, NamedTuple

from scipy.constants import foot, inch, kgf, lbf

from chamfer.analysis.scenario.errors import UserError, valid_name


class Kind(NamedTuple):
    """Kind of a quantity: its columns and unit."""

    unit: str  # in a Log
    stems: tuple[str, ...]  # with which its columns' titles begin, in any case
    sizes: Sequence[int] = (3,)  # elements that it may have


_JOINTS: Final = range(1, 100)
QUANTITIES: Final[Mapping[str, Kind]] = {
    "time": Kind("s", ("time", "t", "timestamp"), (1,)),
    "force": Kind("N", ("force", "f")),
    "moment": Kind("N m", ("moment", "torque", "m", "t")),
    "position": Kind("m", ("position", "pos", "p", "")),
    "rotation": Kind("rad", ("rotation", "orientation", "r", "q"), (4, 3)),
    "velocity": Kind("m/s", ("velocity", "vel", "v")),
    "reference_position": Kind("m", ("reference_position", "virtual_position")),
    "joint_position": Kind("rad", ("joint_position", "q"), _JOINTS),
    "joint_velocity": Kind("rad/s", ("joint_velocity", "dq"), _JOINTS),
    "joint_torque": Kind("N m", ("joint_torque", "tau"), _JOINTS),
}
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


class Chosen(NamedTuple):
    """The columns of a quantity, and its unit if one was given."""

    columns: tuple[str, ...]
    unit: str = ""


def parse_columns(texts: Sequence[str]) -> dict[str, Chosen]:
    """Return the columns of ``--columns`` by quantity; a mistake in it is a UserError."""
    found: dict[str, Chosen] = {}
    for text in texts:
        name, _, said = text.partition("=")
        columns, _, unit = said.partition(":")
        names = tuple(name for one in columns.split(",") for name in _range(one.strip()))
        if not all(names):
            raise UserError(f"--columns is {text!r}, allowed: such as force=Fx,Fy,Fz or time=t:ms")
        name = valid_name("quantity", name.replace("virtual_", "reference_"), QUANTITIES)
        if name in found:
            raise UserError(f"--columns has {name} twice")
        factor(name, unit, "--columns")
        found[name] = Chosen(names, unit)
    return found


def _range(name: str) -> list[str]:
    """Return the names of ``name[3..5]``, else the name."""
    if not (match := re.fullmatch(r"(.*)\[([0-9]{1,2})\.\.([0-9]{1,2})\]", name)):
        return [name]
    return [f"{match[1]}[{i}]" for i in range(int(match[2]), int(match[3]) + 1)]


def factor(quantity: str, unit: str, where: object) -> float:
    """Return a unit's factor to that of a log, 1 if there is none; refuse an unknown one."""
    units = UNITS[QUANTITIES[quantity].unit]
    plain = re.sub(r"[\s*.]", "", unit)
    for name, value in units.items():
        if plain in ("", name.replace(" ", "")):
            return value
    raise UserError(f"{where}: {quantity} is in {unit!r}, allowed: {', '.join(units)}")


def choose(
    titles: Sequence[str], said: Mapping[str, Chosen], path: object
) -> dict[str, tuple[str, ...]]:
    """Return the columns of each quantity that a file with these titles has.

    Too few quantities, and columns that are not there, or twice, or too many are a UserError.
    """
    more = len(titles) - _MOST_SHOWN
    shown = ", ".join(titles[:_MOST_SHOWN]) + (f" and {more} more" if more > 0 else "")
    usual = {name: kind for name, kind in QUANTITIES.items() if name not in said}
    found = {name: _spelled(name, kind, titles, path) for name, kind in usual.items()}
    if found.get("rotation") == found.get("joint_position"):
        found["rotation"] = ()  # q[0], q[1], ... are joints
    for name, one in said.items():
        columns, sizes = one.columns, QUANTITIES[name].sizes
        if len(columns) == 1 and columns[0] not in titles:
            parts = (f"{columns[0]}[{i}]" for i in range(len(titles)))
            columns = _there(parts, titles) or columns
        found[name] = columns
        if len(columns) not in sizes:
            allowed = " or ".join(map(str, sorted(sizes)))
            raise UserError(f"--columns has {len(columns)} of {name}, allowed: {allowed}")
    for column in (column for columns in found.values() for column in columns):
        if not (there := titles.count(column)):
            raise UserError(f"{path} has no column {column}, but {shown}")
        if there > 1:
            raise UserError(f"{path} has {there} columns {column}, must have one")
    joints = found["joint_torque"] and found["joint_position"]
    for name in ("time", "force") if not joints else ("time",):
        if not found[name]:
            raise UserError(f"{path} has no {name}, but {shown}; say --columns {name}=COLUMNS")
    return {name: columns for name, columns in found.items() if columns}


def _spelled(name: str, kind: Kind, titles: Sequence[str], path: object) -> tuple[str, ...]:
    """Return the columns whose titles are as usual, empty if there are none."""
    by_case = {title.casefold(): title for title in reversed(titles)}
    endings: list[list[str]] = [[f"[{i}]" for i in range(len(titles))]]
    if kind.sizes == _JOINTS:
        endings += [[f"{before}{i + 1}" for i in range(len(titles))] for before in ("_", "")]
    elif 3 in kind.sizes:
        of = ["wxyz"[-size:] for size in kind.sizes]
        endings += [[f"{b}{one}" for one in axes] for axes in of for b in ("_", ".", "")]
    else:
        endings = [[""]]
    for stem in kind.stems:
        for some in endings:
            there = _there((f"{stem}{ending}" for ending in some), by_case)
            if len(there) in kind.sizes:
                return tuple(by_case[one] for one in there)
    if some := [one for of in endings for e in of if (one := f"{name}{e}") in by_case]:
        allowed = " or ".join(map(str, sorted(kind.sizes)))
        raise UserError(f"{path} has {len(some)} of {name}, from {some[0]} on, allowed: {allowed}")
    return ()


def _there(names: Iterable[str], titles: Iterable[str]) -> tuple[str, ...]:
    return tuple(takewhile(set(titles).__contains__, names))
