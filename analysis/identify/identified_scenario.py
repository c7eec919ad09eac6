"""A scenario of the insertion from a log: its fields, and the rest as comments."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from chamfer.analysis.identify.quantity import Quantity
from chamfer.analysis.report.check_text import number
from chamfer.analysis.scenario.scenario_yaml import block
from chamfer.diagrams.insertion.cells import CELLS

_USUAL: Final = "wam-pair"
_STIFFNESS: Final = 400.0  # N/m, of the cells' springs where the log doesn't tell
_JOINTS: Final = 7  # of a WAM


class _Field(NamedTuple):
    """A field of the insertion, and the quantities that it follows from."""

    path: str
    value: Any
    names: Sequence[str]
    allowed: tuple[float, float]  # with which the cells come to rest and hold themselves
    note: str = ""


def fragment_text(found: Mapping[str, Quantity], cell: str, *, of: str) -> str:
    """Return the scenario in YAML, of a preset cell, for ``run`` and ``design``; ``of`` a log."""
    plain: dict[str, Any] = {} if cell == _USUAL else {"cell": cell}
    lines, used = [f"# Identified from {of}, for {cell}; in brackets 95 % intervals."], set[str]()
    for field in _fields(found, CELLS[cell].get("arm", {}).get("control") == "position"):
        value = np.round(field.value, 6).tolist()
        low, high = field.allowed
        if not low <= np.min(value) <= np.max(value) <= high:
            limits = f"the cell takes {number(low)} to {number(high)}"
            lines.append(f"# Left out, {limits}: {field.path}: {value}")
            continue
        used |= set(field.names)
        lines.append(f"# {field.path}: from {', '.join(field.names)}{field.note}")
        *groups, name = field.path.split(".")
        inside = plain
        for group in groups:
            inside = inside.setdefault(group, {})
        inside[name] = value
    said = {name: f"# {_said(name, one)}" for name, one in found.items()}
    lines += [text for name, text in said.items() if name in used]
    lines += [(block(plain) or "{}\n") + "#"]
    lines += ["# No field of the cell has these, or the log does not determine them."]
    return "\n".join([*lines, *(text for name, text in said.items() if name not in used)]) + "\n"


def _said(name: str, one: Quantity) -> str:
    note = f"; {' '.join(one.note.split())}" if one.note else ""
    if one.value is None:
        return f"{name}: unknown{note}"
    return (
        f"{name}: {number(one.value)} {one.unit} ({number(one.low)} to {number(one.high)}){note}"
    )


def _fields(found: Mapping[str, Quantity], takes_positions: bool) -> Iterator[_Field]:
    told = {name: one.value for name, one in found.items() if one.value is not None}
    for path, name, allowed in (
        ("parts.friction", "friction", (1e-3, 2.0)),
        ("peg.tool.mass", "tool.mass", (1e-3, 5.0)),
    ):
        if name in told:
            yield _Field(path, told[name], [name], allowed)
    stiffness, offset = (
        [f"{of}.{axis}" for axis in "xyz"] for of in ("stiffness", "sensor.offset")
    )
    if takes_positions:
        if "sensor.noise" in told:
            width, note = math.sqrt(3) * told["sensor.noise"], "; half-width, of a uniform noise"
            yield _Field("sensor.noise", width, ["sensor.noise"], (0.0, 50.0), note)
        if told.keys() >= set(offset):
            bias = [*(told[name] for name in offset), 0.0, 0.0, 0.0]
            yield _Field("sensor.bias", bias, offset, (-100.0, 100.0), "; none of the moments")
        return
    if told.keys() & set(stiffness):
        springs = [told.get(name, _STIFFNESS) for name in stiffness]
        note = "; along the base's axes, x is the peg's way"
        if not told.keys() >= set(stiffness):
            note += f"; {_STIFFNESS:g} N/m, the cell's own, where the log gives none"
        yield _Field("impedance.stiffness", springs, stiffness, (10.0, 5e4), note)
    for kind, path in (("coulomb", "joint_friction"), ("viscous", "joint_damping")):
        sides = [f"joint_friction.{kind}_{side}" for side in ("plus", "minus")]
        names = [f"{side}.{i + 1}" for side in sides for i in range(_JOINTS)]
        if not told.keys() >= set(names) or f"{sides[0]}.{_JOINTS + 1}" in found:
            continue
        plus, minus = np.reshape([told[name] for name in names], (2, _JOINTS))
        mean = (plus + minus) / 2
        yield _Field(f"peg.{path}", mean, names, (0.0, 30.0), "; the mean of both directions")
        if kind == "coulomb" and mean.min() > 0:
            share = (plus - minus) / (plus + minus)
            note = "; forward less backward, over their sum"
            yield _Field("peg.friction_asymmetry", share, names, (-1.0, 1.0), note)
