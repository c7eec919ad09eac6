from dataclasses import dataclass

import pytest

from chamfer.analysis.scenario.field_comments import FieldComment, field_comment, parse_comment


@dataclass(frozen=True, kw_only=True)
class Arm:
    """An arm."""

    mass: float = 1.0  # kg, of all links
    reach: float  # m
    posture: tuple[float, ...] = (
        0.0,  # m, the first joint
        1.0,
    )  # rad, at rest
    tool: str = "# N, none"
    # what it holds,
    # by name
    speed: float = 1.0  # m/s, at most;
    # None: any
    load: float = 2.0
    steps: tuple[int, ...] = ()  # m, a symbol: of an integer.
    bare: int = 3


@dataclass(frozen=True, kw_only=True)
class HeavyArm(Arm):
    """An arm whose defaults differ."""

    mass: float = 9.0  # N s^2/m, weighed in another laboratory
    reach: float = 2.0
    bare: int = 4
    speed: float = 2.0  # m/s, at most; None: any; it is heavy


class NotADataclass:
    mass: float = 1.0  # s, never read


@dataclass(frozen=True, kw_only=True)
class HeaviestArm(NotADataclass, HeavyArm):
    """Inherits all."""


@pytest.mark.parametrize(
    ("name", "unit", "meaning"),
    [
        ("mass", "kg", "of all links"),
        ("reach", "m", ""),
        ("posture", "rad", "at rest"),
        ("tool", "", "what it holds, by name"),
        ("speed", "m/s", "at most; null: any"),
        ("load", "", ""),
        ("steps", "", "m, a symbol: of an integer"),
        ("bare", "", ""),
    ],
)
def test_a_comment_is_found_behind_and_below_its_field(name: str, unit: str, meaning: str) -> None:
    assert field_comment(Arm, name) == FieldComment(unit=unit, meaning=meaning)


def test_the_class_that_introduces_a_field_says_what_it_means() -> None:
    assert field_comment(HeavyArm, "load") == field_comment(Arm, "load")
    assert field_comment(HeavyArm, "reach") == field_comment(Arm, "reach")


def test_an_override_may_narrow_the_unit_and_say_why_it_differs() -> None:
    said = FieldComment(
        unit="N s^2/m", meaning="of all links; here: weighed in another laboratory"
    )
    assert field_comment(HeavyArm, "mass") == said
    assert field_comment(HeaviestArm, "mass") == said
    assert field_comment(HeavyArm, "speed").meaning == "at most; null: any; it is heavy"


@pytest.mark.parametrize(
    ("text", "unit", "meaning"),
    [
        ("N m/rad, K", "N m/rad", "K"),
        ("1/s: Kif", "1/s", "Kif"),
        ("rad above m; pose", "rad above m", "pose"),
        ("N m s/rad and N s/m, about and along", "N m s/rad and N s/m", "about and along"),
        ("kg m^2", "kg m^2", ""),
        ("%, of the step", "%", "of the step"),
        ("grey levels, noise", "grey levels", "noise"),
        ("s; None: derived", "s", "null: derived"),
        ("True: both, False: one", "", "true: both, false: one"),
        ("1, 2 or 3", "", "1, 2 or 3"),
        ("mu, section 4", "", "mu, section 4"),
        ("", "", ""),
    ],
)
def test_the_unit_is_what_comes_first_if_it_reads_as_one(
    text: str, unit: str, meaning: str
) -> None:
    assert parse_comment(text) == FieldComment(unit=unit, meaning=meaning)
