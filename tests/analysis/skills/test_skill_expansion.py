"""What a skill file says in short is what is written out, and mistakes are told in a line."""

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.analysis.skills.skill_expansion import quantity
from chamfer.analysis.skills.skill_file import read_skill, skill_of, skill_text
from chamfer.models.connectors.round_peg import RoundPeg
from chamfer.systems.primitives.force_primitives import GuardedMove, Stick
from chamfer.systems.primitives.primitive import TICK
from chamfer.systems.primitives.skill import PRIMITIVES, Retry, Skill
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, Spiral, lissajous
from chamfer.systems.strategies.face_and_search import TiltSearchParams
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams
from chamfer.systems.strategies.state_groups import STATE_GROUPS

UP: Final = "\nretract: [{MoveDx: }]"


def skill(text: str) -> Skill:
    return skill_of(parse_value(f"name: x\n{text}{UP}"))


def one(run: str, more: str = "", on: str = "{timed out: done}") -> Any:
    """Return what a state runs."""
    state = f"states: [{{name: a, run: [{run}], on: {on}, timeout: 60 s}}]"
    return skill(f"{more}\n{state}").states[0].run


@pytest.mark.parametrize(
    ("text", "si", "unit"),
    [
        ("5.6 mm", 0.0056, "m"),
        ("12  N", 12.0, "N"),
        ("-10 mm/s", -0.01, "m/s"),
        ("0.3 N m", 0.3, "N m"),
        ("20 N m s/rad", 20.0, "N m s/rad"),
        ("180 deg", math.pi, "rad"),
        ("2 Hz", 2.0, "1/s"),
        ("2 /s", 2.0, "Hz"),
        ("50 mm/s^2", 0.05, "m/s^2"),
        ("1e2 um", 1e-4, "m"),
        ("(3 + 1) * 5 mm / (2 s) - 1 mm/s", 0.009, "m/s"),
        ("2 N / (4 mm)", 500.0, "N/m"),
    ],
)
def test_a_quantity_is_in_si_units(text: str, si: float, unit: str) -> None:
    found = quantity(text, {})
    assert found is not None
    assert float(found.size) == si
    one = quantity(f"1 * ({unit})", {})
    assert one is not None
    assert found.unit == one.unit


@pytest.mark.parametrize(
    "text",
    [
        "",
        "5 mmm",
        "mm",
        "1 N 2",
        "2 ** 3",
        "2 // 3",
        "x + 1",
        "q0",
        "(1",
        "1 N" + " " * 200,
        "1 m + 2",
    ],
)
def test_other_texts_are_no_quantities(text: str) -> None:
    assert quantity(text, {}) is None


@given(st.floats(1e-9, 1e9))
def test_a_millimetre_is_rounded_once(size: float) -> None:
    found = quantity(f"{size!r} mm", {})
    assert found is not None
    assert float(found.size) == float(Fraction(repr(size)) / 1000)


def test_units_are_those_of_the_fields() -> None:
    text = "{GuardedMove: {speed: 20 mm/s, threshold: 5 N, limit: 3 mm}}"
    assert one(text) == (GuardedMove(speed=0.02, threshold=5.0, limit=0.003),)
    # About an axis a threshold is a torque, and a limit an angle.
    turn = "{GuardedMove: {direction: +rz, speed: 1 rad/s, threshold: 0.1 N m, limit: 90 deg}}"
    assert one(turn)[0].limit == math.pi / 2
    way = "{MoveDx: {displacement: [0, 90 deg, 0, 0, 0, -2 mm], duration: 500 ms}}"
    assert one(way) == (MoveDx(displacement=(0, math.pi / 2, 0, 0, 0, -0.002), duration=0.5),)
    assert one("{Stick: {speed: 8 mm/s, threshold: inf}}")[0].threshold == math.inf
    rotary = "{Centre: {dither: {kind: rotary, amplitude: 2 deg}, offset: 1 deg, gain: 2 /s}}"
    assert one(rotary)[0].dither.amplitude == pytest.approx(math.radians(2))


def test_variables_are_values_and_expressions() -> None:
    let = "let: {depth: 6 mm, half: 0.5 * $depth, n: 3, way: -x, f: 2 Hz}"
    dither = "{Dither: {amplitude: $half - 1 mm, cycles: 2$n, frequency: $f}}"
    stick = "{Stick: {direction: $way, threshold: $depth}}"
    expected = (Dither(amplitude=0.002, cycles=6.0, frequency=2.0),)
    assert one(f"{dither}, {stick}", let) == (*expected, Stick(direction="-x", threshold=0.006))


def test_a_lissajous_figure_is_two_dithers() -> None:
    first = Dither(axis="y", amplitude=0.002, frequency=0.6)
    dithers = lissajous(first=first, axis="x", repeats=5)
    fields = "axes: [y, x], amplitude: 2 mm, frequency: 0.6 Hz, repeats: 5"
    assert one(f"{{Lissajous: {{{fields}}}}}") == dithers


def test_a_primitive_needs_no_source() -> None:
    known: dict[str, Any] = {"Dither": Dither, "dataclass": dataclass}
    exec("@dataclass(frozen=True, kw_only=True)\nclass Mine(Dither):\n    size: float", known)
    plain = parse_value("name: x\n" + MOVE % "Mine: {size: 3}" + UP)
    primitives = {**PRIMITIVES, "Mine": known["Mine"]}
    assert skill_of(plain, primitives).states[0].run == (known["Mine"](size=3.0),)


def test_groups_are_the_strategies_own_states() -> None:
    peg, params = RoundPeg(), PegInHoleSkillParams(search="spiral")
    search = "search-by-spiral, found: insert"
    text = f"""
let: {{depth: {peg.mated_depth} m}}
states:
- {{use: touch-face, search: search, found: insert}}
- {{use: {search}}}
- {{use: push, force: {peg.mating_force} N, depth: $depth, then: depth}}
- {{use: at-depth, depth: $depth, then: done}}"""
    assert skill(text).states == params.states(peg, TICK)
    wide = text.replace(search, f"{search}, retries: 1, spiral: {{pitch: 0.7 mm, radius: 9 mm}}")
    found = skill(wide).states[8]
    assert found.run[1].radius == 0.009  # type: ignore[attr-defined]
    assert found.on["done"] == Retry("out", 1)
    tilted = text.replace(search, f"search-by-tilt, radius: {peg.peg_radius} m, found: insert")
    text = tilted.replace("touch-face, search: search, found: insert", "lay-flat, then: lean")
    assert skill(text).states == PegInHoleSkillParams(search="tilt").states(peg, TICK)


@pytest.mark.parametrize("name", STATE_GROUPS)
def test_the_arguments_of_a_group_are_those_that_matter(name: str) -> None:
    group = STATE_GROUPS[name]
    given = dict.fromkeys(group.sizes, 0.01) | dict.fromkeys(group.exits.split(), "x")

    def more(value: Any) -> Any:
        if isinstance(value, Spiral | TiltSearchParams):
            return replace(value, speed=0.007)
        if isinstance(value, tuple):
            return tuple(map(more, value))
        return value + 1 if isinstance(value, int) else 1.01 * value

    params: Any = group.params()  # type: ignore[call-arg]
    numbers = {key: value for key, value in vars(params).items() if not isinstance(value, str)}
    changed = {key: replace(params, **{key: more(value)}) for key, value in numbers.items()}
    usual = group.make(params, **given)
    matter = {key for key, one in changed.items() if group.make(one, **given) != usual}
    assert matter == set(group.fields.split())


TAP: Final = """
let: {again: {target: tap, at_most: 2}}
define:
  tap:
    with: {name: tap, force: 4 N, half: 0.5 * $force, then: ~}
    states:
    - name: $name
      run: [{GuardedMove: {threshold: $force, limit: 3 mm}}, {GuardedMove: {threshold: $half}}]
      on: {contact: $then, lost: $again}
      timeout: 9 s
"""


def test_groups_of_ones_own_have_arguments() -> None:
    text = TAP + "states: [{use: tap, then: t 2}, {use: tap, name: t 2, force: 2 N, then: done}]"
    found = skill(text)
    assert [state.name for state in found.states] == ["tap", "t 2"]
    assert [[each.threshold for each in state.run] for state in found.states] == [  # type: ignore
        [4.0, 2.0],
        [2.0, 1.0],
    ]
    assert found.states[1].on == {"contact": "done", "lost": Retry("tap", 2)}
    assert skill_of(parse_value(skill_text(found))) == found


def test_a_factor_is_one_of_the_further_tries() -> None:
    on = (
        "{contact: done, lost: {target: a, at_most: 2, speed: 1.5x, then: {target: a, limit: 2x}}}"
    )
    text = f"states: [{{name: a, run: [{{GuardedMove: }}], on: {on}, timeout: 60 s}}]"
    found = skill(text)
    expected = Retry("a", 2, Retry("a", factors={"limit": 2.0}), {"speed": 1.5})
    assert found.states[0].on["lost"] == expected
    assert skill_of(parse_value(skill_text(found))) == found


LOST: Final = "states: [{name: a, run: [{Stick: }], on: {lost: {target: a, %s}}, timeout: 9}]"
RUN: Final = "state 'a': run[0]."
MOVE: Final = "states: [{name: a, run: [{%s}], on: {timed out: done}, timeout: 9}]"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MOVE % "Stick: {speed: 4 N}", RUN + "Stick.speed is 4 N, allowed: a number in m/s"),
        (MOVE % "Dither: {cycles: $n}", "state 'a': unknown variable 'n', valid names: none"),
        (MOVE % "Stick: {speed: 4 mms}", RUN + "Stick.speed is '4 mms', allowed: a number in"),
        (MOVE % "Stick: {speed: 1 m / 0 s}", "state 'a': '1 m / 0 s' divides by zero, allowed: o"),
        ("let: {x: 5 mm}\n" + MOVE % "Dither: {cycles: $x}", RUN + "Dither.cycles is 5 mm, allow"),
        (
            "let: {x: 5 mm}\n" + MOVE % "Stick: {speed: $x + 1 N}",
            "state 'a': run[0].Stick.speed is '5 mm + 1 N', allowed: a number in m/s",
        ),
        (MOVE % "Stick: {speed: 0 N}", RUN + "Stick.speed is 0 N, allowed: a number in m/s"),
        (
            "let: {x: 5 mm}\n" + MOVE % "Stick: ",
            "let.x has no effect, allowed: names that are used",
        ),
        (TAP + MOVE % "Stick: ", "define.tap has no effect, allowed: names that are used"),
        (
            "define: {a: {with: {x: 1}, states: [b]}}\nstates: [{use: a}]",
            "use 'a': with.x has no effect, allowed: names that are used",
        ),
        ("define: {a: }\nstates: [{use: a}]", "use 'a': states is None, allowed: a list of state"),
        ("states: [~]", "state None: name has to be given"),
        ("let: 5\n" + MOVE % "Stick: ", "let is 5, allowed: a mapping"),
        (MOVE % "Lissajous: {amplitude: 1 mm}", RUN + "Lissajous.frequency has to be given"),
        ("states: [{use: seatle}]", "use 'seatle': unknown group 'seatle', did you mean 'settle'"),
        ("states: [{use: settle}]", "use 'settle': then has to be given"),
        ("states: [{use: settle, beside: 1, then: x}]", "use 'settle': unknown argument 'beside'"),
        ("states: [{use: push, depth: 4 N, then: x, force: 4 N}]", "use 'push': depth is 4 N, al"),
        ("states: [{use: lay-flat, name: x, then: y}]", "use 'lay-flat': unknown argument 'name'"),
        ("states: [{use: settle, maintained: -1, then: y}]", "use 'settle': maintained is -1.0,"),
        (TAP + "states: [{use: tap}]", "use 'tap': then has to be given"),
        (TAP + "states: [{use: tap, forse: 1, then: x}]", "use 'tap': unknown argument 'forse',"),
        (TAP + "states: [{use: tap, then: x, force: 1 m}]", "use 'tap': state 'tap': run[0].Guar"),
        ("define: {a: {states: [{use: a}]}}\nstates: [{use: a}]", "use 'a': use 'a': a group use"),
        (
            "define: {a: {states: [{use: b}, {use: b}]}, b: {state: []}}\nstates: [{use: a}]",
            "use 'a': use 'b': unknown field 'state', did you mean 'states'? valid names",
        ),
        (LOST % "speed: 2", "state 'a': on.lost.speed is 2, allowed: at_most, target, then, or a"),
        (LOST % "sped: 2x", "skill 'x': 'a' is tried again with sped 2x, which changes nothing,"),
        (LOST % "speed: 1x", "state 'a': on.lost.factors.speed is 1.0, allowed: a finite number"),
        (LOST % "at_most: 100000, speed: 2x", "skill 'x': 'a', in its last try: a number is too"),
        (
            LOST.replace("Stick", "GuardedMove") % "limit: 9x",
            "skill 'x': 'a', in its last try: the timeout is 9 s, allowed: more than 2187 s",
        ),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "skill.yaml"
    path.write_text(f"name: x\n{text}{UP}")
    with pytest.raises(UserError) as refused:
        read_skill(path)
    told = str(refused.value)
    assert "\n" not in told
    assert told.startswith(f"{path}: {message}")


def test_a_file_can_t_grow_without_bound() -> None:
    text = "define: {g0: {states: [{use: settle, then: x}]}"
    text += "".join(f", g{i + 1}: {{states: [{{use: g{i}}}, {{use: g{i}}}]}}" for i in range(40))
    with pytest.raises(UserError, match=r"^there are more than 500 states, allowed: 500$"):
        skill(text + "}\nstates: [{use: g40}]")
    assert quantity("1e99" + "*1e99" * 4, {}) is None
