import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Final, Literal

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.scenario_fields import Leaf, allowed, default_texts, leaves, matching
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, load
from chamfer.analysis.scenario.scenario_io import make_scenario, value_text
from chamfer.models.validation import ParameterError, require_positive


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where something is. In the world."""

    position: tuple[float, float] = (0.0, 1.0)  # m
    turn: float = math.inf  # rad, about z


@dataclass(frozen=True, kw_only=True)
class Wave:
    height: float = 1.0  # m, peak to peak


@dataclass(frozen=True, kw_only=True)
class Filter:
    bandwidth: float  # Hz, of what passes
    place: Place  # in the chain
    order: tuple[int, ...] = field(default_factory=lambda: (1,))  # of the filter


@dataclass(frozen=True, kw_only=True)
class Scenario:
    law: Literal["inverse", "projected"] = "inverse"  # of control
    quiet: bool = False  # whether it says nothing
    name: str = "a b"  # of the run
    mass: float = 2.0  # kg, of the body
    trials: int = 2  # how many
    step: float | None = None  # s, of time
    base: Place = field(default_factory=Place)  # of the arm
    camera: Place | None = None  # what sees it
    eye: Place | None = field(default_factory=Place)
    places: tuple[float, ...] = ()  # m, to go to
    signal: Wave | Place = field(default_factory=Wave)
    turns: tuple[float, ...] | None = None  # rad, where it turns
    filter: Filter | None = None  # of the signal

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        if self.mass > 1000 + self.trials:
            raise ParameterError("mass", self.mass, f"at most {1000 + self.trials}")
        if self.trials < 1:
            raise ParameterError("trials", self.trials, "1 or more")
        if any(not math.isfinite(place) for place in self.places):
            raise ParameterError("places", self.places, "finite numbers")


BY_PATH: Final[dict[str, Leaf]] = {leaf.path: leaf for leaf in leaves(Scenario())}


def test_leaves_are_what_set_takes_a_single_value_for() -> None:
    below = ["position", "turn"]
    assert [leaf.path for leaf in leaves(Scenario())] == [
        *("law", "quiet", "name", "mass", "trials", "step"),
        *(f"base.{name}" for name in below),
        *("camera", *(f"camera.{name}" for name in below)),
        *("eye", *(f"eye.{name}" for name in below)),
        *("places", "signal.height", "turns", "filter", "filter.bandwidth"),
        *("filter.place.position", "filter.place.turn", "filter.order"),
    ]


def test_a_leaf_below_a_null_names_it_and_is_null_if_it_has_no_default() -> None:
    assert {leaf.path: leaf.value for leaf in BY_PATH.values() if leaf.above == "filter"} == {
        "filter.bandwidth": None,
        "filter.place.position": (0.0, 1.0),
        "filter.place.turn": math.inf,
        "filter.order": (1,),
    }
    assert [leaf.path for leaf in BY_PATH.values() if leaf.above == "camera"] == [
        "camera.position",
        "camera.turn",
    ]


@pytest.mark.parametrize(
    ("path", "meaning"),
    [
        ("mass", "of the body"),
        ("base.turn", "about z"),
        ("base.position", "of the arm"),  # says nothing itself
        ("camera.position", "what sees it"),
        ("eye", "Where something is"),  # of its type
        ("eye.position", ""),
    ],
)
def test_what_a_field_does_not_say_is_said_above_it(path: str, meaning: str) -> None:
    assert BY_PATH[path].meaning == meaning


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("law", "inverse, projected"),
        ("quiet", "true or false"),
        ("name", "a text"),
        ("mass", "a finite number > 0; at most 1002"),
        ("trials", "an integer; 1 or more"),
        ("step", "a finite number or null"),
        ("base.position", "a list of 2: each element a finite number"),
        ("base.turn", "a finite number or inf"),
        ("camera", "a mapping of the fields below or null"),
        ("places", "a list: finite numbers"),
        ("turns", "a list: each element a finite number or null"),
        ("filter.bandwidth", "a number"),
    ],
)
def test_allowed_is_what_refusals_say(path: str, words: str) -> None:
    assert allowed(Scenario(), BY_PATH[path]) == words


def test_a_default_shows_what_a_run_makes_of_it(toys: Catalogue) -> None:
    (fall,) = (entry for entry in toys.entries if entry.name == "fall")
    experiment = load(fall)
    assert default_texts(experiment.default, experiment.resolve) == {
        "body.mass": "2.0",
        "body.form": "ball",
        "height": "5.0",
        "step": "null (0.1)",
    }


@pytest.mark.parametrize(("prefix", "count"), [("", 22), ("base", 2), ("base.p", 1), ("ca", 3)])
def test_a_prefix_chooses(prefix: str, count: int) -> None:
    assert len(matching(list(leaves(Scenario())), prefix)) == count


@pytest.mark.parametrize(
    ("prefix", "close"),
    [("camra.turn", "camera.turn"), ("xyz", "law, quiet"), ("plces", "places")],
)
def test_a_prefix_of_nothing_is_answered_by_what_is_close(prefix: str, close: str) -> None:
    with pytest.raises(
        UserError, match=f"no field begins with '{prefix}', close to it: .*{close}"
    ):
        matching(list(leaves(Scenario())), prefix)


def registered() -> list[Any]:
    return [load(entry) for entry in CATALOGUE.entries]


def test_the_printed_default_of_any_field_changes_nothing() -> None:
    for experiment in registered():
        default = experiment.default
        settings = [
            f"{leaf.path}={value_text(leaf.value)}"
            for leaf in leaves(default)
            if not (leaf.nested or leaf.above)
        ]
        assert len(settings) >= len(fields(default)) / 2
        assert make_scenario(default, settings=settings) == default, experiment.name


# What says where a value is from, or names it, but not what it means.
SOURCE = re.compile(
    r"((in |of |on )?(section|Fig\.|Figs\.|eq\.|appendix|reference) .*"
    r"|(not published|from memory|assumed|calibrated|identified|predicted|published)\b.*"
    r"|likewise|[A-Za-z]{1,2}(_[A-Za-z]+)?|)"
)


def test_every_field_of_every_experiment_says_what_it_means() -> None:
    silent = {
        (experiment.name, leaf.path, leaf.meaning)
        for experiment in registered()
        for leaf in leaves(experiment.default)
        if all(SOURCE.fullmatch(part.strip()) for part in re.split("[,;:]", leaf.meaning))
    }
    assert not silent


def dataclasses_in(scenario: Any) -> Iterator[type[Any]]:
    yield type(scenario)
    for one in fields(scenario):
        value = getattr(scenario, one.name)
        if is_dataclass(value):
            yield from dataclasses_in(value)


def test_a_default_is_that_of_the_class_from_which_python_takes_the_field() -> None:
    """Of two bases of one root the first one brings the root's defaults for what it leaves."""
    for kind in {one for known in registered() for one in dataclasses_in(known.default)}:
        for one in fields(kind):
            owner = next(
                base for base in kind.__mro__ if one.name in vars(base).get("__annotations__", ())
            )
            (told,) = (own for own in fields(owner) if own.name == one.name)
            same = (one.default, one.default_factory) == (told.default, told.default_factory)
            assert same, f"{kind.__name__}.{one.name} is not {owner.__name__}'s"
