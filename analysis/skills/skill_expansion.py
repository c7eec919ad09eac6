"""Short forms of skill files: variables, units, states by name, searches in one line.

All of them are expanded when a file is read; runs only see the result.
"""

import ast
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
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
_NAMED: Final = re.compile(r"\$(\w+)")  # a variable


@dataclass(frozen=True, repr=False)
class Quantity:
    """A number with a unit."""

    text: str
    size: Fraction  # in SI units
    unit: tuple[int, ...]  # exponents of _BASES

    def __repr__(self) -> str:
        """Return its text."""
        return self.text


_BASES: Final = ("m", "s", "rad", "N", "pixels")
_NONE: Final = (0,) * len(_BASES)


def _unit(size: Fraction | int, base: str, power: int = 1) -> Quantity:
    return Quantity(base, Fraction(size), tuple(power * (one == base) for one in _BASES))


_UNITS: Final = {
    **{base: _unit(1, base) for base in _BASES},
    "cm": _unit(Fraction(1, 100), "m"),
    "mm": _unit(Fraction(1, 1000), "m"),
    "um": _unit(Fraction(1, 10**6), "m"),
    "ms": _unit(Fraction(1, 1000), "s"),
    "deg": _unit(Fraction(math.pi) / 180, "rad"),
    "Hz": _unit(1, "s", -1),
}


def quantity(text: str, variables: Mapping[str, Any]) -> Quantity | None:
    """Return the value of a text such as ``4 N`` or ``0.5 * $depth``, None if it has none.

    Adjacent terms are a product: ``4 N / 2 mm`` is ``4 N / 2 * mm``.
    """
    if len(text) > _LONGEST or not re.search("[0-9$]", text):
        return None
    named = {f"_{name}": _variable(name, variables) for name in _NAMED.findall(text)}
    known: Mapping[str, Any] = {**_UNITS, **named}
    squares = re.sub(r"([A-Za-z]+)\^2", r"(\1*\1)", text)
    products = re.sub(r"(?<=[\w.)])( +(?=[A-Za-z(])| *(?=\$))", "*", squares)
    source = products.replace("$", "_")

    def value_of(node: Any) -> tuple[Fraction, tuple[int, ...]]:
        match node:
            case ast.BinOp(left, op, right):
                (a, unit), (b, other) = value_of(left), value_of(right)
                sign = 1 if isinstance(op, ast.Mult | ast.Add) else -1
                if isinstance(op, ast.Mult | ast.Div):
                    power = tuple(m + sign * n for m, n in zip(unit, other, strict=True))
                    return a * b**sign, power
                if isinstance(op, ast.Add | ast.Sub) and unit == other:
                    return a + sign * b, unit
            case ast.UnaryOp(ast.USub(), operand):
                size, unit = value_of(operand)
                return -size, unit
            case ast.Constant(int() | float() as number):
                return Fraction(repr(number)), _NONE
            case ast.Name(name):
                one = known[name]
                return (
                    (one.size, one.unit) if isinstance(one, Quantity) else (Fraction(one), _NONE)
                )
        raise SyntaxError

    try:
        found = Quantity(text, *value_of(ast.parse(source.strip(), mode="eval").body))
        return found if math.isfinite(float(found.size)) else None
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
    if whole := _NAMED.fullmatch(plain):
        return _variable(whole[1], variables)
    found = quantity(plain, variables)
    named = _NAMED.sub(lambda match: str(_variable(match[1], variables)), plain)
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
    """Return numbers in SI units; other values stay the same."""
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
    of = quantity(f"1 * ({unit or 1})", {})
    if of is None or of.unit != value.unit:
        raise UserError(f"{path} is {value}, allowed: {allowed}")
    size = value.size
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
        """The two dithers."""
        slow = Dither(axis=self.axes[0], amplitude=self.amplitude, frequency=self.frequency)
        return lissajous(first=slow, axis=self.axes[1], repeats=self.repeats)


class SkillReader:
    """Makes a skill of the plain data of a file, in which it may name the primitives."""

    def __init__(self, primitives: Primitives) -> None:
        self._primitives: Mapping[str, Any] = {"Lissajous": Lissajous, **primitives}
        self._groups: Mapping[str, Any] = {}  # of the file's own
        self._used: set[str] = set()  # of these

    def skill(self, plain: Mapping[Any, Any]) -> Skill:
        """Return the skill, whose states are not checked.

        Raises:
            UserError: If a part of the file is not allowed in a skill; it names the place.
        """
        given, variables = dict(plain), dict[str, Any]()
        for name, value in _mapping(given.pop("let", None), "let").items():
            with _at(f"let.{name}"):
                variables[name] = _defined(value, variables)
        self._groups = _mapping(given.pop("define", None), "define")
        lists = {name: one for name, one in given.items() if isinstance(one, list)}
        given = _filled({**given, **{name: [] for name in lists}}, variables)
        skill: Skill = structured(_in_si(given, Skill), Skill)
        states = tuple(islice(self._states(lists["states"], variables, ()), _MOST + 1))
        if len(states) > _MOST:
            raise UserError(f"there are more than {_MOST} states, allowed: {_MOST}")
        _check_used("let", variables, _NAMED.findall(str(plain)))
        _check_used("define", self._groups, self._used)
        retract = self._run(_filled(lists["retract"], variables), "retract")
        return replace(skill, states=states, retract=retract)

    def _states(
        self, listed: Any, variables: Mapping[str, Any], within: tuple[str, ...]
    ) -> Iterator[SkillState]:
        """Yield the states of a list of states and groups, with groups expanded."""
        if not isinstance(listed, list) or not listed:
            raise UserError(f"states is {shown(listed)}, allowed: a list of states")
        for item in listed:
            called = _mapping(item, "a state")
            kind, key = ("use", "use") if "use" in called else ("state", "name")
            with _at(f"{kind} {_filled(called.get(key), variables)!r}"):
                given = _filled(called, variables)
                if kind == "state":
                    yield self._state(given)
                else:
                    yield from self._group(given, variables, within)

    def _group(
        self, given: dict[str, Any], variables: Mapping[str, Any], within: tuple[str, ...]
    ) -> Iterable[SkillState]:
        known = {**STATE_GROUPS, **self._groups}
        group = known[name := valid_name("group", str(given.pop("use")), known)]
        if isinstance(group, StateGroup):
            return _built_in(group, given)
        if name in within:
            raise UserError("a group uses itself, allowed: other groups")
        self._used.add(name)
        own = _mapping(group, "a group")
        for field in own:
            valid_name("field", field, {"with": (), "states": ()})
        defaults = _mapping(own.get("with"), "with")
        _check_used("with", defaults, _NAMED.findall(str(own)))
        inner = _arguments(given, defaults, variables)
        return self._states(own.get("states"), inner, (*within, name))

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
    """Return the states of a built-in group."""
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
    """Return an entry with factors such as ``1.2x`` in their places."""
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


def _check_used(where: str, names: Iterable[str], used: Collection[str]) -> None:
    for name in names:
        if name not in used:
            raise UserError(f"{where}.{name} has no effect, allowed: names that are used")


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
