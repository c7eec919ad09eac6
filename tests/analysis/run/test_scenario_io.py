import math
import string
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.run.errors import UserError
from analysis.run.scenario_io import make_scenario, overrides, sha256, unstructure
from models.validation import require_not_negative, require_positive


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


DEFAULT = Scenario()


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scenario.yaml"
    path.write_text(text)
    return path


def refused(*given_settings: str, file: Path | None = None) -> str:
    with pytest.raises(UserError) as raised:
        make_scenario(DEFAULT, file=file, settings=given_settings)
    return str(raised.value)


def test_nothing_overridden_is_the_default() -> None:
    assert make_scenario(DEFAULT) == DEFAULT


def test_partial_file_keeps_the_other_fields_of_this_scenarios_default(tmp_path: Path) -> None:
    made = make_scenario(DEFAULT, file=write(tmp_path, "plant:\n  stiffness: 1e-3\n"))
    assert made.plant == Plant(mass=3.0, stiffness=0.001)


def test_settings_win_over_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, "plant: {mass: 7, stiffness: 8}\nticks: 9\n")
    made = make_scenario(DEFAULT, file=path, settings=["plant.mass=1"])
    assert made.plant == Plant(mass=1.0, stiffness=8.0)
    assert made.ticks == 9


@pytest.mark.parametrize(
    ("setting", "path", "value"),
    [
        ("plant.mass=4", "plant.mass", 4.0),
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
        ("plant.mas.x=1", "plant.mas: no such field, valid fields: form, mass, stiffness"),
        (
            "plnt=1",
            "plnt: no such field, valid fields: duration, gains, level, limits, name, noise, "
            "plant, plants, ticks, verbose",
        ),
        ("noise.lvl=1", "noise.lvl: no such field, valid fields: level"),
        ("plant.mass=-1", "plant.mass is -1.0, allowed: a finite number > 0"),
        ("plant.mass=.nan", "plant.mass is nan, allowed: a finite number > 0"),
        ("plant.mass=nan", "plant.mass is nan, allowed: a finite number > 0"),
        ("plant.mass=inf", "plant.mass is inf, allowed: a finite number > 0"),
        ("noise.level=nan", "noise.level is nan, allowed: a finite number"),
        ("duration=inf", "duration is inf, allowed: a finite number"),
        ("limits.high=nan", "limits.high is nan, allowed: a finite number"),
        ("gains=[1, inf]", "gains[1] is inf, allowed: a finite number"),
        ("plant.mass=abc", "plant.mass is 'abc', allowed: a number"),
        ("plant.mass='1'", "plant.mass is '1', allowed: a number"),
        ("plant.mass=true", "plant.mass is True, allowed: a number"),
        ("plant.mass=", "plant.mass is None, allowed: a number"),
        ("plant.mass=1:30", "plant.mass is '1:30', allowed: a number"),
        ("plant.mass.x=1", "plant.mass is {'x': 1}, allowed: a number"),
        (
            f"plant.mass=1{'0' * 400}",
            f"plant.mass is 1{'0' * 59}..., allowed: a number",
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("plant:\n  mass: 1\n  mass: 2\n", ": line 3: the key 'mass' is given twice"),
        ("a: 1\nb: [2\nc: 3\n", ": line 3: expected ',' or ']', but got ':'"),
        ("a: !!python/object:os.system x\n", None),
        ("", " is empty, allowed: a mapping of scenario fields"),
        ("# plant: 1\n", " is empty, allowed: a mapping of scenario fields"),
        ("- 1\n", " is a list, allowed: a mapping of scenario fields"),
        ("plant\n", " is a text, allowed: a mapping of scenario fields"),
        ("[" * 5000, ": nested too deeply"),
        ("a: 1\n---\nb: 2\n", ": line 2: but found another document"),
    ],
)
def test_bad_files_are_named_with_the_line(tmp_path: Path, text: str, message: str | None) -> None:
    path = write(tmp_path, text)
    line = refused(file=path)
    assert "\n" not in line
    if message is None:
        assert line.startswith(f"{path}: line 1: could not determine a constructor for the tag")
    else:
        assert line == f"{path}{message}"


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    assert refused(file=tmp_path / "no.yaml") == f"{tmp_path}/no.yaml: No such file or directory"
    assert refused(file=tmp_path) == f"{tmp_path}: Is a directory"
    (tmp_path / "latin.yaml").write_bytes(b"name: \xe9\n")
    assert refused(file=tmp_path / "latin.yaml") == f"{tmp_path}/latin.yaml: not a text in UTF-8"


def test_mistakes_in_a_file_have_the_same_form(tmp_path: Path) -> None:
    assert refused(file=write(tmp_path, "plant: {mass: abc}\n")) == (
        "plant.mass is 'abc', allowed: a number"
    )
    assert refused(file=write(tmp_path, "plant: {1: 2}\n")) == (
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


@dataclass(frozen=True, kw_only=True)
class Controller:
    RENAMED: ClassVar[Mapping[str, str]] = {"form": "kind", "coulomb": "joint_friction.coulomb"}

    kind: Literal["fsm", "pid"] = "fsm"
    gain: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Campaign:
    RENAMED: ClassVar[Mapping[str, str]] = {
        "runs": "trials",
        "controller": "controller.kind",
        "controller.mass": "plant.mass",
    }

    trials: int = 5
    controller: Controller = Controller()


@dataclass(frozen=True, kw_only=True)
class LongCampaign(Campaign):
    RENAMED: ClassVar[Mapping[str, str]] = {"longest": "duration"}

    duration: float = 5.0
    inner: Campaign = Campaign()
    others: tuple[Controller, ...] = ()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("longest=3", "longest is now duration"),
        ("runs=3", "runs is now trials"),
        ("inner.runs=3", "inner.runs is now inner.trials"),
        ("controller=pid", "controller is now controller.kind"),
        ("inner.controller=pid", "inner.controller is now inner.controller.kind"),
        ("controller.form=pid", "controller.form is now controller.kind"),
        ("inner.controller.mass=1", "inner.controller.mass is now inner.plant.mass"),
        ("controller.coulomb.x=1", "controller.coulomb is now controller.joint_friction.coulomb"),
        ("others=[{form: pid}]", "others[0].form is now others[0].kind"),
        ("controller.kind=off", "controller.kind is 'off', allowed: fsm, pid"),
        ("controller.longest=3", "controller.longest: no such field, valid fields: gain, kind"),
    ],
)
def test_an_old_name_is_answered_by_its_new_one(setting: str, message: str) -> None:
    with pytest.raises(UserError) as raised:
        make_scenario(LongCampaign(), settings=[setting])
    assert str(raised.value) == message


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


@settings(max_examples=200)
@given(scenario=SCENARIOS, default=SCENARIOS)
def test_overrides_remake_the_scenario_from_any_default(
    scenario: Scenario, default: Scenario
) -> None:
    # An infinite limit is allowed where the default has one.
    if math.isfinite(default.limits.low) or math.isfinite(default.limits.high):
        scenario = Scenario(**{**vars(scenario), "limits": default.limits})
    remake = overrides(scenario, default)
    assert make_scenario(default, settings=remake) == scenario
    assert bool(remake) == (scenario != default)


def test_overrides_are_what_one_would_type() -> None:
    scenario = make_scenario(
        DEFAULT,
        settings=["plant.mass=1e-05", "plant.form=velocity", "gains=[1,3]", "noise={level: 1}"],
    )
    assert overrides(scenario, DEFAULT) == [
        "plant.mass=1e-05",
        "plant.form=velocity",
        "noise={level: 1.0}",
        "gains=[1.0, 3.0]",
    ]


def test_unstructured_scenario_is_json_and_its_digest_ignores_how_a_number_was_written() -> None:
    plain = unstructure(make_scenario(DEFAULT, settings=["duration=2"]))
    assert plain["limits"] == {"low": "-inf", "high": "inf"}
    assert plain["gains"] == [1.0, 2.0]
    assert plain["plants"] == []
    same = unstructure(make_scenario(DEFAULT, settings=["duration=2.0"]))
    assert sha256(plain) == sha256(dict(reversed(same.items())))
    assert sha256(plain) != sha256(unstructure(DEFAULT))
