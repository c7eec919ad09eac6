"""What a log tells as a scenario of the insertion: its fields, and the rest as comments."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from chamfer.analysis.identify.quantity import Quantity
from chamfer.analysis.report.check_text import number
from chamfer.analysis.scenario.scenario_yaml import block
from chamfer.diagrams.insertion.cells import CELLS

_AXES: Final = "xyz"
_USUAL: Final = "wam-pair"
_JOINTS: Final = 7  # of a WAM
_MEAN: Final = "; the mean of both directions"
_UNIFORM: Final = math.sqrt(3)  # half-width of a uniform noise over its standard deviation


class _Field(NamedTuple):
    """A field of the insertion, and the quantities that it follows from."""

    path: str
    value: Any
    names: Sequence[str]
    allowed: tuple[float, float]  # with which the cells come to rest and hold themselves
    note: str = ""


def fragment_text(found: Mapping[str, Quantity], cell: str, *, of: str) -> str:
    """Return the scenario in YAML, for ``run`` and ``design`` of the insertion.

    Args:
        found: The quantities.
        cell: Name of a preset, whose fields it is to be of.
        of: The log, for the first line.
    """
    takes_positions = CELLS[cell].get("arm", {}).get("control") == "position"
    fields = [*_of_any(found), *(_of_positions if takes_positions else _of_torques)(found)]
    plain: dict[str, Any] = {} if cell == _USUAL else {"cell": cell}
    lines, used = [f"# Identified from {of}, for {cell}; in brackets 95 % intervals."], set[str]()
    for field in fields:
        used |= set(field.names)
        low, high = field.allowed
        values = field.value if isinstance(field.value, list) else [field.value]
        if not all(low <= one <= high for one in values):
            limits = f"the cell takes {number(low)} to {number(high)}"
            lines.append(f"# Left out, {limits}: {field.path}: {field.value}")
            continue
        lines.append(f"# {field.path}: from {', '.join(field.names)}{field.note}")
        *groups, name = field.path.split(".")
        inside = plain
        for group in groups:
            inside = inside.setdefault(group, {})
        inside[name] = field.value
    lines += ["# " + _said(name, found[name]) for name in found if name in used]
    rest = [_said(name, one) for name, one in found.items() if name not in used]
    none = ["#", "# The insertion has no field for these, or the log can't tell them."]
    fields_text = block(plain) or "{}\n"
    after = [*none, *(f"# {line}" for line in rest)] if rest else []
    return "\n".join(lines) + "\n" + fields_text + "".join(f"{line}\n" for line in after)


def _said(name: str, one: Quantity) -> str:
    note = f"; {' '.join(one.note.split())}" if one.note else ""
    if one.value is None:
        return f"{name}: not told{note}"
    interval = f"({number(one.low)} to {number(one.high)})"
    return f"{name}: {number(one.value)} {one.unit}".rstrip() + f" {interval}{note}"


def _values(found: Mapping[str, Quantity], *names: str) -> list[float] | None:
    """Return the values of quantities, None unless the log tells all of them."""
    values = [found[name].value for name in names if name in found]
    known = [one for one in values if one is not None]
    return known if len(known) == len(names) else None


def _of_any(found: Mapping[str, Quantity]) -> Iterator[_Field]:
    for path, name, allowed in (
        ("parts.friction", "friction", (1e-3, 2.0)),
        ("peg.tool.mass", "tool.mass", (1e-3, 5.0)),
    ):
        if values := _values(found, name):
            yield _Field(path, round(values[0], 6), [name], allowed)


def _of_torques(found: Mapping[str, Quantity]) -> Iterator[_Field]:
    names = [f"stiffness.{axis}" for axis in _AXES]
    told = [found[name].value if name in found else None for name in names]
    if any(one is not None for one in told):
        usual = 400.0  # N/m, of the cell
        note = "; the cell's own, 400 N/m, where the log does not tell" if None in told else ""
        values = [usual if one is None else round(one, 3) for one in told]
        note += "; along the axes of the base, x is the peg's way"
        yield _Field("impedance.stiffness", values, names, (10.0, 5e4), note)
    dry, viscous = _both_ways(found, "coulomb"), _both_ways(found, "viscous")
    if dry is not None and min(means := dry.means()) > 0:
        yield _Field("peg.joint_friction", means, dry.names, (0.0, 30.0), _MEAN)
        shares = [(p - m) / (p + m) for p, m in zip(dry.plus, dry.minus, strict=True)]
        note = "; what is more forward than backward"
        yield _Field("peg.friction_asymmetry", _rounded(shares), dry.names, (-1.0, 1.0), note)
    if viscous is not None:
        path = "peg.joint_damping"
        yield _Field(path, viscous.means(), viscous.names, (0.0, 30.0), _MEAN)


class _BothWays(NamedTuple):
    """A coefficient of the seven joints of a WAM, either way."""

    names: Sequence[str]
    plus: Sequence[float]
    minus: Sequence[float]

    def means(self) -> list[float]:
        return _rounded([(p + m) / 2 for p, m in zip(self.plus, self.minus, strict=True)])


def _both_ways(found: Mapping[str, Quantity], kind: str) -> _BothWays | None:
    sides = [
        [f"joint_friction.{kind}_{side}.{i}" for i in range(1, _JOINTS + 1)]
        for side in ("plus", "minus")
    ]
    more = f"joint_friction.{kind}_plus.{_JOINTS + 1}"
    both = [_values(found, *side) for side in sides]
    if both[0] is None or both[1] is None or more in found:
        return None
    return _BothWays([*sides[0], *sides[1]], both[0], both[1])


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(one, 6) for one in values]


def _of_positions(found: Mapping[str, Quantity]) -> Iterator[_Field]:
    if noise := _values(found, "sensor.noise"):
        half_width = round(_UNIFORM * noise[0], 6)
        note = "; half-width of a uniform noise of this deviation"
        yield _Field("sensor.noise", half_width, ["sensor.noise"], (0.0, 50.0), note)
    names = [f"sensor.offset.{axis}" for axis in _AXES]
    if offset := _values(found, *names):
        bias = [*_rounded(offset), 0.0, 0.0, 0.0]
        yield _Field("sensor.bias", bias, names, (-100.0, 100.0), "; none of the moments")
