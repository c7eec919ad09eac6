"""What skill files may say in short: variables, units, states by name, searches in one line.

All of it is written out as a file is read; what runs knows nothing of it.
"""

import ast
import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from fractions import Fraction
from itertools import islice
from typing import Any, Final, get_type_hints

from chamfer.analysis.scenario.errors import UserError, valid_name
from chamfer.analysis.scenario.field_comments import field_comment
from chamfer.analysis.scenario.plain_data import structured
from chamfer.models.validation import ParameterError, shown
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import Retry, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import Axis, Dither, lissajous
from chamfer.systems.strategies.state_groups import STATE_GROUPS, StateGroup

Primitives = Mapping[str, type[Primitive]]

_LONGEST: Final = 200  # characters of an expression
_MOST: Final = 500  # states


@dataclass(frozen=True, repr=False)
class Quantity:
    """A number with a unit: in SI units, and where base units have other sizes, which tells it."""

    text: str
    values: tuple[Fraction, Fraction]

    def __repr__(self) -> str:
        """Return its text."""
        return self.text


_BASES: Final = {"m": 10007, "s": 20011, "rad": 30011, "N": 40009, "pixels": 50021}  # primes
_UNITS: Final = {
    **{base: (Fraction(1), Fraction(other)) for base, other in _BASES.items()},
    "cm": (Fraction(1, 100), Fraction(_BASES["m"], 100)),
    "mm": (Fraction(1, 1000), Fraction(_BASES["m"], 1000)),
    "um": (Fraction(1, 10**6), Fraction(_BASES["m"], 10**6)),
    "ms": (Fraction(1, 1000), Fraction(_BASES["s"], 1000)),
    "deg": (Fraction(math.pi) / 180, Fraction(math.pi) / 180 * _BASES["rad"]),
    "Hz": (Fraction(1), Fraction(1, _BASES["s"])),
}
_OPERATORS: Final[Mapping[type, Callable[[Fraction, Fraction], Fraction]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}


def quantity(text: str, variables: Mapping[str, Any]) -> Quantity | None:
    """Return what a text such as ``4 N`` or ``0.5 * $depth`` comes to, None if it is none.

    What stands side by side is a product: ``4 N / 2 mm`` is ``4 N / 2 * mm``.
    """
    if len(text) > _LONGEST or not re.search("[0-9$]", text):
        return None
    known: dict[str, Any] = dict(_UNITS)
    for name in re.findall(r"\$(\w+)", text):
        value = _variable(name, variables)
        known[f"_{name}"] = getattr(value, "values", (value, value))
    source = re.sub(r"(?<=[\w.)]) (?=[A-Za-z$])", "*", text).replace("$", "_")

    def value_of(node: Any, way: int) -> Fraction:
        match node:
            case ast.BinOp(left, op, right):
                return _OPERATORS[type(op)](value_of(left, way), value_of(right, way))
            case ast.UnaryOp(ast.USub(), operand):
                return -value_of(operand, way)
            case ast.Constant(int() | float() as number):
                return Fraction(repr(number))
            case ast.Name(name):
                return Fraction(known[name][way])
        raise SyntaxError

    try:
        tree = ast.parse(source.strip(), mode="eval").body
        found = Quantity(text, (value_of(tree, 0), value_of(tree, 1)))
        return found if math.isfinite(float(found.values[0])) else None
    except (SyntaxError, LookupError, TypeError, ValueError, OverflowError):  # it is none
        return None
    except ZeroDivisionError as error:
        raise UserError(f"{text!r} divides by zero, allowed: other numbers") from error


def _variable(name: str, variables: Mapping[str, Any]) -> Any:
    return variables[valid_name("variable", name, variables)]


def _filled(plain: Any, variables: Mapping[str, Any]) -> Any:
    """Return plain data with the values of variables in the place of their names."""
    if isinstance(plain, Mapping):
        return {name: _filled(value, variables) for name, value in plain.items()}
    if isinstance(plain, list):
        return [_filled(value, variables) for value in plain]
    if not isinstance(plain, str) or "$" not in plain:
        return plain
    if whole := re.fullmatch(r"\$(\w+)", plain):
        return _variable(whole[1], variables)
    found = quantity(plain, variables)
    named = re.sub(r"\$(\w+)", lambda match: str(_variable(match[1], variables)), plain)
    return named if found is None else found


def _defined(plain: Any, variables: Mapping[str, Any]) -> Any:
    """Return the value of a variable or an argument."""
    value = _filled(plain, variables)
    return (quantity(value, {}) or value) if isinstance(value, str) else value


def _in_si(given: Any, cls: type, path: str = "") -> Any:
    """Return a dataclass's plain fields with numbers in the place of quantities of their units."""
    if not isinstance(given, Mapping):
        return given
    kinds, changed = get_type_hints(cls), dict(given)
    for name in [one.name for one in fields(cls) if one.name in given]:
        if is_dataclass(kind := kinds[name]):
            changed[name] = _in_si(given[name], kind, f"{path}{name}.")  # type: ignore[arg-type]
        else:
            changed[name] = _number(given[name], _units(cls, name, given), f"{path}{name}")
    return changed


def _units(cls: type, name: str, given: Mapping[str, Any]) -> list[str]:
    """Return the unit of a field's number, or of those of the first and the second half."""
    try:
        units = re.split(" (?:above|and) ", field_comment(cls, name).unit)
    except (OSError, TypeError):  # one's own, whose source is not in a file
        return [""]
    linear, _, rotary = units[0].partition(" or ")
    of = given.get("dither", given)
    turns = isinstance(of, Mapping) and (
        of.get("kind") == "rotary" or "r" in str(of.get("direction"))
    )
    return units if len(units) > 1 else [rotary if rotary and turns else linear]


def _number(value: Any, units: list[str], path: str) -> Any:
    """Return numbers in SI units; what is none stays as it is."""
    if isinstance(value, list):
        half = (len(value) + 1) // len(units)
        return [_number(one, [units[i // half]], path) for i, one in enumerate(value)]
    (unit,) = units
    allowed = f"a number in {unit}" if unit else "a number without a unit"
    if isinstance(value, str) and unit and value not in ("inf", "-inf"):
        if (found := quantity(value, {})) is None:
            allowed += f"; units: {', '.join(_UNITS)}"
            raise UserError(f"{path} is {shown(value)}, allowed: {allowed}")
        value = found
    if not isinstance(value, Quantity):
        return value
    (size, other), of = value.values, quantity(f"1 {unit}" if unit[:1] != "1" else unit, {})
    if of is None or other != size * of.values[1]:
        raise UserError(f"{path} is {value}, allowed: {allowed}")
    return float(size) if unit or size.denominator > 1 else int(size)


@dataclass(frozen=True, kw_only=True)
class Lissajous:
    """Two dithers that cover an area."""

    axes: tuple[Axis, Axis] = ("x", "y")  # of the slower and of the faster one
    amplitude: float  # m, of each
    frequency: float  # Hz, of the slower one
    repeats: int  # cycles of it until the pattern repeats

    @property
    def dithers(self) -> tuple[Dither, Dither]:
        """The dithers that it stands for."""
        slow = Dither(axis=self.axes[0], amplitude=self.amplitude, frequency=self.frequency)
        return lissajous(first=slow, axis=self.axes[1], repeats=self.repeats)


class SkillReader:
    """Makes a skill of the plain data of a file, in which it may name the primitives."""

    def __init__(self, primitives: Primitives) -> None:
        self._primitives: Mapping[str, Any] = {"Lissajous": Lissajous, **primitives}
        self._groups: Mapping[str, Any] = {}  # of the file's own

    def skill(self, plain: Mapping[Any, Any]) -> Skill:
        """Return the skill, whose states are not checked.

        Raises:
            UserError: If something is none that a skill may have; it says where.
        """
        given, variables = dict(plain), dict[str, Any]()
        for name, value in _mapping(given.pop("let", None), "let").items():
            variables[name] = _defined(value, variables)
        self._groups = _mapping(given.pop("define", None), "define")
        lists = {name: one for name, one in given.items() if isinstance(one, list)}
        given = _filled({**given, **{name: [] for name in lists}}, variables)
        skill: Skill = structured(_in_si(given, Skill), Skill)
        states = tuple(islice(self._states(lists["states"], variables, ()), _MOST + 1))
        if len(states) > _MOST:
            raise UserError(f"there are more than {_MOST} states, allowed: {_MOST}")
        retract = self._run(_filled(lists["retract"], variables), "retract")
        return replace(skill, states=states, retract=retract)

    def _states(
        self, listed: Any, variables: Mapping[str, Any], within: tuple[str, ...]
    ) -> Iterator[SkillState]:
        """Yield the states of a list of states and groups, of which some are written out."""
        for item in listed if isinstance(listed, list) else [listed]:
            called = _mapping(item, "a state")
            kind, name = ("use", "use") if "use" in called else ("state", "name")
            with _at(f"{kind} {_filled(called.get(name), variables)!r}"):
                given = _filled(item, variables)
                if kind == "state":
                    yield self._state(given)
                    continue
                known = {**STATE_GROUPS, **self._groups}
                group = known[name := valid_name("group", str(given.pop("use")), known)]
                if isinstance(group, StateGroup):
                    yield from _built_in(group, given)
                    continue
                if name in within:
                    raise UserError("a group uses itself, allowed: other groups")
                for field in _mapping(group, "a group"):
                    valid_name("field", field, {"with": (), "states": ()})
                inner = _arguments(given, _mapping(group.get("with"), "with"), variables)
                yield from self._states(group.get("states"), inner, (*within, name))

    def _state(self, given: Mapping[str, Any]) -> SkillState:
        changed, run = dict(given), given.get("run")
        if isinstance(run, list):
            changed["run"] = []
        if isinstance(on := given.get("on"), Mapping):
            changed["on"] = {name: _answer(one, f"on.{name}") for name, one in on.items()}
        state: SkillState = structured(_in_si(changed, SkillState), SkillState)
        return replace(state, run=self._run(run, "run"))

    def _run(self, listed: Any, path: str) -> tuple[Primitive, ...]:
        found: list[Primitive] = []
        for i, one in enumerate(listed):
            place, plain = f"{path}[{i}]", one
            if isinstance(one, Mapping):
                plain = {
                    name: _in_si(given, self._primitives.get(name, Lissajous), f"{place}.{name}.")
                    for name, given in one.items()
                }
            made = structured(plain, Primitive, path=place, named={Primitive: self._primitives})
            with _at(place):
                found += made.dithers if isinstance(made, Lissajous) else [made]
        return tuple(found)


def _arguments(
    given: Mapping[str, Any], defaults: Mapping[str, Any], variables: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the variables of a group; a default of None is none."""
    inner = dict(variables)
    for name in given:
        valid_name("argument", name, defaults)
    for name, default in defaults.items():
        if (value := given.get(name, default)) is None:
            raise UserError(f"{name} has to be given, it has no default")
        inner[name] = value if name in given else _defined(value, inner)
    return inner


def _built_in(group: StateGroup, given: Mapping[str, Any]) -> Iterable[SkillState]:
    """Return the states of a group that is built in."""
    needed = dict.fromkeys((*group.exits.split(), *group.sizes))
    _arguments(given, {**needed, **dict.fromkeys(group.fields.split(), "")}, {})
    made = {}
    for name in needed:
        if unit := group.sizes.get(name):
            made[name] = structured(_number(given[name], [unit], name), float, path=name)
        else:
            made[name] = structured(_answer(given[name], name), str | Retry, path=name)
    plain = {name: value for name, value in given.items() if name not in needed}
    params = structured(_in_si(plain, group.params), group.params)
    return group.make(params, **made)


def _answer(plain: Any, path: str) -> Any:
    """Return an answer with the factors such as ``1.2x`` where they belong."""
    if not isinstance(plain, Mapping):
        return plain
    changed, factors = dict(plain), {}
    for name in [name for name in plain if name not in {one.name for one in fields(Retry)}]:
        found = re.fullmatch(r"([0-9]+(?:\.[0-9]*)?)x", str(changed.pop(name)))
        if not found:
            known = "at_most, target, then, or a factor such as 1.2x"
            raise UserError(f"{path}.{name} is {shown(plain[name])}, allowed: {known}")
        factors[name] = float(found[1])
    if "then" in plain:
        changed["then"] = _answer(plain["then"], f"{path}.then")
    if factors:
        changed["factors"] = {**_mapping(plain.get("factors"), f"{path}.factors"), **factors}
    return changed


@contextmanager
def _at(where: str) -> Iterator[None]:
    """Say where something is wrong."""
    try:
        yield
    except (UserError, ParameterError) as error:
        raise UserError(f"{where}: {error}") from error


def _mapping(plain: Any, what: str) -> Mapping[str, Any]:
    if plain is not None and not isinstance(plain, Mapping):
        raise UserError(f"{what} is {shown(plain)}, allowed: a mapping")
    return plain or {}
