"""The settings that make one scenario of another."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import pytest

from chamfer.analysis.scenario.scenario_io import make_scenario, unstructure
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.models.validation import ParameterError


@dataclass(frozen=True, kw_only=True)
class Plant:
    mass: float = 3.0
    form: Literal["position", "velocity"] = "position"


@dataclass(frozen=True, kw_only=True)
class Noise:
    level: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Scenario:
    plant: Plant = field(default_factory=Plant)
    noise: Noise | None = None
    gains: tuple[float, float] = (1.0, 2.0)
    ticks: int = 5
    duration: float | None = None


DEFAULT = Scenario()


def unresolved(scenario: Scenario) -> Scenario:
    return scenario


def test_overrides_are_what_one_would_type() -> None:
    scenario = make_scenario(
        DEFAULT,
        settings=["plant.mass=1e-05", "plant.form=velocity", "gains=[1,3]", "noise={level: 1}"],
    )
    assert overrides(scenario, DEFAULT, unresolved) == [
        "plant.mass=1e-05",
        "plant.form=velocity",
        "noise={level: 1.0}",
        "gains=[1.0, 3.0]",
    ]


def resolve(scenario: Scenario) -> Scenario:
    """Let a run last twice as many seconds as it has ticks, with some noise."""
    if scenario.ticks > 50:
        raise ParameterError("ticks", scenario.ticks, "at most 50")
    duration = 2.0 * scenario.ticks if scenario.duration is None else scenario.duration
    return replace(scenario, duration=duration, noise=scenario.noise or Noise())


@pytest.mark.parametrize(
    "given_settings",
    [[], ["ticks=7"], ["ticks=7", "duration=3.0"], ["noise.level=2.0"], ["duration=3.0"]],
)
def test_a_resolved_scenario_needs_no_more_overrides_than_the_one_it_came_from(
    given_settings: list[str],
) -> None:
    resolved = resolve(make_scenario(DEFAULT, settings=given_settings))
    if "noise.level=2.0" in given_settings:
        given_settings = ["noise={level: 2.0}"]
    assert sorted(overrides(resolved, DEFAULT, resolve)) == sorted(given_settings)


def test_overrides_keep_a_value_without_which_the_rest_is_refused() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Pair:
        whole: float = 1.0
        part: float | None = None

        def __post_init__(self) -> None:
            if self.part is None and self.whole > 5:
                raise ParameterError("whole", self.whole, "at most 5, without a part")

    def halved(pair: Pair) -> Pair:
        return replace(pair, part=pair.whole / 2) if pair.part is None else pair

    assert overrides(Pair(whole=8.0, part=4.0), Pair(), halved) == ["whole=8.0", "part=4.0"]


def test_overrides_spell_out_a_default_that_resolves_the_same_as_none() -> None:
    assert overrides(replace(DEFAULT, duration=10.0), DEFAULT, resolve) == []


def test_fields_that_follow_are_left_out_without_asking_for_each() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Many:
        size: float = 1.0
        one: float | None = None
        two: float | None = None
        three: float | None = None

    asked = []

    def sized(many: Many) -> Many:
        asked.append(many)
        open_ = {name: many.size for name, value in vars(many).items() if value is None}
        return replace(many, **open_)

    assert overrides(sized(Many(size=2.0, two=5.0)), Many(), sized) == ["size=2.0", "two=5.0"]
    # The scenario, the resolved one, the default, without what is open, with what is likely, and
    # without the one that is.
    assert len(asked) == 6


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
    mass = 1.0 if "believed.mass=1.0" in settings else 3.0
    form = "position" if "believed.form=position" in settings else "velocity"
    assert cell.believed == Plant(mass=mass, form=form)
    assert sorted(overrides(cell, Cell(), lambda cell: cell)) == sorted(settings)
    assert make_scenario(Cell(), given=unstructure(cell)) == cell
    assert make_scenario(Cell(), settings=["plant.mass=1"]).believed is None
