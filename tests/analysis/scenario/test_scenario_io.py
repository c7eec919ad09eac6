import json
import math
import string
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.scenario_io import (
    make_scenario,
    scenario_text,
    sha256,
    unstructure,
)
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.analysis.scenario.scenario_yaml import parse_value
from chamfer.models.validation import ParameterError, require_not_negative, require_positive


@dataclass(frozen=True, kw_only=True)
class Plant:
    mass: float = 2.0
    stiffness: float = 700.0
    form: Literal["position", "velocity"] = "position"

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_not_negative(self, "stiffness")


@dataclass(frozen=True, kw_only=True)
class Noise:
    level: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Limits:
    low: float = -math.inf
    high: float = math.inf


@dataclass(frozen=True, kw_only=True)
class Scenario:
    plant: Plant = field(default_factory=lambda: Plant(mass=3.0))
    limits: Limits = Limits()
    noise: Noise | None = None
    plants: tuple[Plant, ...] = ()
    gains: tuple[float, float] = (1.0, 2.0)
    ticks: int = 5
    duration: float | None = None
    name: str = "one"
    level: Literal[1, 2] = 1
    verbose: bool = False

    def __post_init__(self) -> None:
        if self.ticks == 13:
            raise ValueError("ticks can't be 13")


@dataclass(frozen=True, kw_only=True)
class Filter:
    bandwidth: float
    order: int = 1


@dataclass(frozen=True, kw_only=True)
class Filtered:
    filter: Filter | None = None


DEFAULT = Scenario()


def test_a_field_without_a_default_has_to_be_given() -> None:
    with pytest.raises(UserError, match=r"^filter\.bandwidth has to be given, it has no default$"):
        make_scenario(Filtered(), settings=["filter.order=2"])


def refused(*given_settings: str, given: Mapping[Any, Any] | None = None) -> str:
    with pytest.raises(UserError) as raised:
        make_scenario(DEFAULT, given=given, settings=given_settings)
    return str(raised.value)


def test_what_is_given_in_part_keeps_the_other_fields_of_this_scenarios_default() -> None:
    made = make_scenario(DEFAULT, given={"plant": {"stiffness": 1e-3}})
    assert made.plant == Plant(mass=3.0, stiffness=0.001)


def test_settings_win_over_what_is_given() -> None:
    given = {"plant": {"mass": 7, "stiffness": 8}, "ticks": 9}
    made = make_scenario(DEFAULT, given=given, settings=["plant.mass=1"])
    assert made.plant == Plant(mass=1.0, stiffness=8.0)
    assert made.ticks == 9


@pytest.mark.parametrize(
    ("setting", "path", "value"),
    [
        ("plant.mass=1e-3", "plant.mass", 1e-3),
        ("plant.mass= +.5E2", "plant.mass", 50.0),
        ("plant.form=velocity", "plant.form", "velocity"),
        ("ticks=010", "ticks", 10),
        ("duration=2", "duration", 2.0),
        ("duration=null", "duration", None),
        ("duration=", "duration", None),
        ("name=off", "name", "off"),
        ("name='1e3'", "name", "1e3"),
        ("gains=[3, 4.5]", "gains", (3.0, 4.5)),
        ("plants=[{mass: 4}]", "plants", (Plant(mass=4.0),)),
        ("noise={level: 2}", "noise", Noise(level=2.0)),
        ("noise.level=2", "noise", Noise(level=2.0)),
        ("limits.high=1", "limits", Limits(high=1.0)),
        ("limits.low=-inf", "limits.low", -math.inf),
        ("level=2", "level", 2),
        ("verbose=true", "verbose", True),
    ],
)
def test_values_of_every_type(setting: str, path: str, value: object) -> None:
    made: Any = make_scenario(DEFAULT, settings=[setting])
    for name in path.split("."):
        made = getattr(made, name)
    assert made == value
    assert type(made) is type(value)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("plant.mas=1", "plant.mas: no such field, valid fields: form, mass, stiffness"),
        ("plant.mass=-1", "plant.mass is -1.0, allowed: a finite number > 0"),
        ("plant.mass=nan", "plant.mass is nan, allowed: a finite number > 0"),
        ("duration=inf", "duration is inf, allowed: a finite number"),
        ("limits.high=nan", "limits.high is nan, allowed: a finite number or inf"),
        ("gains=[1, inf]", "gains[1] is inf, allowed: a finite number"),
        ("plant.mass='1'", "plant.mass is '1', allowed: a number"),
        ("plant.mass='inf'", "plant.mass is inf, allowed: a finite number > 0"),
        ("plant.mass=true", "plant.mass is True, allowed: a number"),
        ("plant.mass=", "plant.mass is None, allowed: a number"),
        ("plant.mass.x=1", "plant.mass is {'x': 1}, allowed: a number"),
        (
            f"plant.mass=1{'0' * 400}",
            f"plant.mass is 1{'0' * 27}...{'0' * 29}, allowed: a number",
        ),
        ("plant.form=bend", "plant.form is 'bend', allowed: position, velocity"),
        ("level=true", "level is True, allowed: 1, 2"),
        ("plant=5", "plant is 5, allowed: a mapping of form, mass, stiffness"),
        ("ticks=2.0", "ticks is 2.0, allowed: an integer"),
        ("ticks=true", "ticks is True, allowed: an integer"),
        ("ticks=13", "ticks can't be 13"),
        ("duration=x", "duration is 'x', allowed: a number or null"),
        ("noise=3", "noise is 3, allowed: a mapping of level or null"),
        ("name=3", "name is 3, allowed: a text"),
        ("verbose=1", "verbose is 1, allowed: true or false"),
        ("gains=ab", "gains is 'ab', allowed: a list of 2: a number, a number"),
        ("gains=[1]", "gains is [1], allowed: a list of 2: a number, a number"),
        ("gains=[1, x]", "gains[1] is 'x', allowed: a number"),
        ("plants=[{mass: 1}, {mass: 0}]", "plants[1].mass is 0.0, allowed: a finite number > 0"),
        (
            "plants=x",
            "plants is 'x', allowed: a list, each element a mapping of form, mass, stiffness",
        ),
        (
            "plant.mass=[1",
            "plant.mass is '[1', allowed: a value in YAML "
            "(line 1: expected ',' or ']', but got '<stream end>')",
        ),
        ("plant.mass", "--set is 'plant.mass', allowed: path=value"),
        ("=3", "--set is '=3', allowed: path=value"),
        ("plant..mass=3", "--set is 'plant..mass=3', allowed: path=value"),
    ],
)
def test_mistakes_are_one_line_with_path_value_and_what_is_allowed(
    setting: str, message: str
) -> None:
    assert refused(setting) == message


def test_two_settings_of_one_field_are_refused() -> None:
    assert refused("plant.mass=1", "plant.mass=1") == "plant.mass is set twice"
    assert refused("plant={mass: 1}", "plant.mass=2") == (
        "plant and plant.mass are both set, but one contains the other"
    )


def test_mistakes_in_what_is_given_have_the_same_form() -> None:
    assert refused(given={"plant": {"mass": "abc"}}) == "plant.mass is 'abc', allowed: a number"
    assert refused(given={"plant": {1: 2}}) == (
        "plant.1: no such field, valid fields: form, mass, stiffness"
    )


def test_a_bug_in_a_check_is_not_taken_for_a_mistake() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Broken:
        value: float = 1.0

        def __post_init__(self) -> None:
            if self.value == 2.0:
                raise ZeroDivisionError("bug")

    with pytest.raises(ZeroDivisionError, match="bug"):
        make_scenario(Broken(), settings=["value=2"])


FINITE = st.floats(allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(min_value=1e-300, allow_nan=False, allow_infinity=False)
PLANTS = st.builds(
    Plant,
    mass=POSITIVE,
    stiffness=POSITIVE,
    form=st.sampled_from(["position", "velocity"]),
)
SCENARIOS = st.builds(
    Scenario,
    plant=PLANTS,
    limits=st.builds(Limits, low=st.just(-math.inf) | FINITE, high=st.just(math.inf) | FINITE),
    noise=st.none() | st.builds(Noise, level=FINITE),
    plants=st.lists(PLANTS, max_size=2).map(tuple),
    gains=st.tuples(FINITE, FINITE),
    ticks=st.integers().filter(lambda ticks: ticks != 13),
    duration=st.none() | FINITE,
    name=st.text(max_size=8)
    | st.sampled_from(["null", "~", "1e3", "true", ".inf", "a: b", "- a", "# a", "x=y", "1_0"])
    | st.text(string.printable, max_size=4),
    level=st.sampled_from([1, 2]),
    verbose=st.booleans(),
)


@settings(max_examples=60)
@given(scenario=SCENARIOS, default=SCENARIOS)
def test_a_scenario_is_remade_from_any_default(scenario: Scenario, default: Scenario) -> None:
    # An infinite limit is allowed where the default has one.
    if math.isfinite(default.limits.low) or math.isfinite(default.limits.high):
        scenario = Scenario(**{**vars(scenario), "limits": default.limits})
    remake = overrides(scenario, default, lambda one: one)
    assert make_scenario(default, settings=remake) == scenario
    assert bool(remake) == (scenario != default)
    assert make_scenario(default, given=parse_value(scenario_text(scenario))) == scenario
    document = json.loads(json.dumps(unstructure(scenario), allow_nan=False))
    assert make_scenario(default, given=document) == scenario


def test_the_text_of_a_scenario_is_yaml_with_a_line_for_each_field() -> None:
    scenario = Scenario(plants=(Plant(), Plant(mass=4.0)), name="a: b")
    plant = "stiffness: 700.0\n  form: position\n"
    assert scenario_text(scenario) == (
        f"plant:\n  mass: 3.0\n  {plant}limits:\n  low: -.inf\n  high: .inf\nnoise: null\n"
        f"plants:\n- mass: 2.0\n  {plant}- mass: 4.0\n  {plant}gains: [1.0, 2.0]\nticks: 5\n"
        'duration: null\nname: "a: b"\nlevel: 1\nverbose: false\n'
    )


def test_unstructured_scenario_is_json_and_its_digest_ignores_how_a_number_was_written() -> None:
    plain = unstructure(make_scenario(DEFAULT, settings=["duration=2"]))
    assert plain["limits"] == {"low": "-inf", "high": "inf"}
    assert plain["gains"] == [1.0, 2.0]
    assert plain["plants"] == []
    same = unstructure(make_scenario(DEFAULT, settings=["duration=2.0"]))
    assert sha256(plain) == sha256(dict(reversed(same.items())))
    assert sha256(plain) != sha256(unstructure(DEFAULT))


def resolve(scenario: Scenario) -> Scenario:
    """Let a run last twice as many seconds as it has ticks, with some noise."""
    if scenario.ticks > 50:
        raise ParameterError("ticks", scenario.ticks, "at most 50")
    duration = 2.0 * scenario.ticks if scenario.duration is None else scenario.duration
    return replace(scenario, duration=duration, noise=scenario.noise or Noise())


@pytest.mark.parametrize(
    "given_settings",
    [[], ["ticks=7"], ["ticks=7", "duration=3.0"], ["noise={level: 2.0}"], ["duration=3.0"]],
)
def test_a_resolved_scenario_needs_no_more_overrides_than_the_one_it_came_from(
    given_settings: list[str],
) -> None:
    resolved = resolve(make_scenario(DEFAULT, settings=given_settings))
    assert sorted(overrides(resolved, DEFAULT, resolve)) == sorted(given_settings)


def test_values_that_only_go_together_are_all_kept() -> None:
    """As two controllers that are given, where designing either is refused at this tolerance."""

    @dataclass(frozen=True, kw_only=True)
    class Loop:
        tolerance: float | None = None
        first: float | None = None
        second: float | None = None

    def designed(loop: Loop) -> Loop:
        if None in (loop.first, loop.second) and (loop.tolerance or 9.0) < 5.0:
            raise ParameterError("tolerance", loop.tolerance, "at least 5")
        tolerance = 9.0 if loop.tolerance is None else loop.tolerance
        return Loop(tolerance=tolerance, first=loop.first or 1.0, second=loop.second or 2.0)

    given = Loop(tolerance=4.0, first=1.0, second=2.0)
    settings = overrides(given, Loop(), designed)
    assert settings == ["tolerance=4.0", "first=1.0", "second=2.0"]
    assert make_scenario(Loop(), settings=settings) == given


@dataclass(frozen=True, kw_only=True)
class Cell:
    plant: Plant = field(default_factory=Plant)
    believed: Plant | None = None

    LIKE: ClassVar[Mapping[str, str]] = {"believed": "plant"}


@pytest.mark.parametrize(
    "settings",
    [
        ["believed.mass=1.0", "plant.form=velocity"],
        ["plant.form=velocity", "believed.mass=1.0"],
        ["plant.form=velocity", "believed.form=position"],
    ],
)
def test_what_is_not_given_of_a_belief_is_as_it_is(settings: list[str]) -> None:
    cell = make_scenario(Cell(), settings=settings)
    assert cell.plant == Plant(form="velocity")
    mass = 1.0 if "believed.mass=1.0" in settings else 2.0
    form = "position" if "believed.form=position" in settings else "velocity"
    assert cell.believed == Plant(mass=mass, form=form)
    assert sorted(overrides(cell, Cell(), lambda cell: cell)) == sorted(settings)
    assert make_scenario(Cell(), given=unstructure(cell)) == cell
    assert make_scenario(Cell(), settings=["plant.mass=1"]).believed is None
