from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.sweep.sweep_design import (
    Design,
    Drawn,
    Spec,
    design_points,
    parse_vary,
    varied_fields,
)


@dataclass(frozen=True, kw_only=True)
class Plant:
    mass: float = 2.0  # kg, of what moves
    axes: int = 3
    form: str = "position"
    damping: float | None = None


@dataclass(frozen=True, kw_only=True)
class Scenario:
    plant: Plant = field(default_factory=Plant)
    seen: tuple[float, float] = (0.0, 1.0)
    part: Mapping[str, Any] | None = None  # whose fields only a run knows


def points(
    *texts: str, design: Design | None = None, count: int | None = None, seed: int = 0
) -> list[tuple[Any, ...]]:
    varied = varied_fields(Scenario(), dict(map(parse_vary, texts)))
    return design_points(varied, design=design, points=count, seed=seed)[1]


@pytest.mark.parametrize(
    ("text", "path", "spec"),
    [
        ("plant.mass=1:3:5", "plant.mass", [1.0, 1.5, 2.0, 2.5, 3.0]),
        ("m=1:3:3", "m", [1, 2, 3]),
        ("m=0:1:11", "m", [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]),
        ("m=-1e-3:1e-3:2", "m", [-0.001, 0.001]),
        ("m=5", "m", [5]),
        ("m=1, 2.5,null", "m", [1, 2.5, None]),
        ("form=position,velocity", "form", ["position", "velocity"]),
        ("seen=[0, 1],[2, 3]", "seen", [[0, 1], [2, 3]]),
        ("law='a=b','c~d'", "law", ["a=b", "c~d"]),
        ("m~1:2.5", "m", Drawn(1.0, 2.5)),
    ],
)
def test_vary_is_values_or_an_interval(text: str, path: str, spec: Spec) -> None:
    assert parse_vary(text) == (path, spec)


@pytest.mark.parametrize(
    "text",
    ["m", "=1", "m=", "m~", "m~1", "m~2:1", "m~1:1", "m=1:2", "m=1:2:0", "m=1:2:1.5", "m=[1", "~"],
)
def test_vary_that_says_neither_is_refused(text: str) -> None:
    with pytest.raises(UserError, match="allowed: "):
        parse_vary(text)


def test_grid_has_every_combination_in_order() -> None:
    found = points("plant.mass=1,2", "plant.form=a,b")
    assert found == [(1, "a"), (1, "b"), (2, "a"), (2, "b")]


@pytest.mark.parametrize("design", ["sobol", "random"])
def test_draws_follow_from_the_seed(design: Design) -> None:
    def draw(seed: int) -> list[tuple[Any, ...]]:
        return points("plant.mass~1:3", "plant.axes~1:4", design=design, count=20, seed=seed)

    drawn = draw(1)
    assert drawn == draw(1)
    assert drawn != draw(2)
    assert len(drawn) == 20
    assert all(1.0 <= mass < 3.0 for mass, _ in drawn)
    assert {axes for _, axes in drawn} == {1, 2, 3, 4}  # whole numbers, both ends included
    assert {type(axes) for _, axes in drawn} == {int}


def test_sobol_spreads_evenly_and_takes_values_as_often() -> None:
    drawn = points("plant.mass~0:1", "plant.form=a,b", count=16)
    counts, _ = np.histogram([mass for mass, _ in drawn], bins=16, range=(0.0, 1.0))
    assert counts.tolist() == [1] * 16
    assert [form for _, form in drawn].count("a") == 8


def test_fields_of_a_mapping_are_varied_unseen() -> None:
    (friction,) = varied_fields(Scenario(), {"part.friction": Drawn(0.1, 0.5)})
    assert (friction.path, friction.whole) == ("part.friction", False)


def test_field_knows_its_unit_and_the_text_that_makes_it() -> None:
    (mass, seen) = varied_fields(Scenario(), {"plant.mass": Drawn(1, 2), "seen": [[0, 1.5]]})
    assert (mass.unit, mass.meaning, mass.text) == ("kg", "of what moves", "plant.mass~1:2")
    assert parse_vary(seen.text) == ("seen", [[0, 1.5]])


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({}, "no field is varied"),
        ({"plant.mas": [1]}, "unknown field 'plant.mas', did you mean 'plant.mass'"),
        ({"plant": [1]}, "valid names: plant.mass, plant.axes"),
        ({"plant.form": Drawn(0, 1)}, "plant.form is no number"),
        ({"plant.mass": []}, "plant.mass is"),
        ({"plant.mass": "12"}, "plant.mass is '12'"),
        ({"plant.mass": [1, 2, 1]}, "plant.mass is 1 twice"),
    ],
)
def test_field_that_cannot_be_varied_is_refused(vary: dict[str, Spec], message: str) -> None:
    with pytest.raises(UserError, match=message):
        varied_fields(Scenario(), vary)


def test_design_that_does_not_fit_is_refused() -> None:
    with pytest.raises(UserError, match=r"plant.mass is drawn, but --design is 'grid'"):
        points("plant.mass~1:2", design="grid")
    with pytest.raises(UserError, match="--points is 5, but a grid"):
        points("plant.mass=1,2", count=5)
    with pytest.raises(UserError, match="1000000 points, allowed: 1 to 100000"):
        points("plant.mass=0:1:1000", "plant.axes=0:1:1000")
