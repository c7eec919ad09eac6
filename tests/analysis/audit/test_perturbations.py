import math
from dataclasses import dataclass
from typing import Any, Literal

import pytest

from chamfer.analysis.audit.perturbations import perturbations


@dataclass(frozen=True)
class Nested:
    x: float = 1.0


@dataclass(frozen=True)
class Given:
    x: float
    y: float = 1.0


def of(value: Any, kind: Any, resolved: Any = None) -> list[Any]:
    return list(perturbations(value, kind, value if resolved is None else resolved))


@pytest.mark.parametrize(
    ("value", "kind", "first"),
    [
        (2.0, float, [2.2, 1.8]),
        (0.0, float, [0.01, -0.1]),
        (math.inf, float, [1.0, 0.01]),
        (3, int, [4, 2, 6, 0, 8]),
        (True, bool, [False]),
        ("a", Literal["a", "b", "c"], ["b", "c"]),
        (None, float | None, [1.0, 0.1]),
        (None, bool | None, [False, True]),
        (None, tuple[float, ...] | None, [[1.0], [0.1]]),
        (None, tuple[int, int] | None, [[1, 1], [2, 2]]),
        (None, Nested | None, [{}]),
        (None, Given | None, [{"x": 1.0}, {"x": 0.1}]),
        (Nested(), Nested | None, [None]),
        ((1.0, 0.0), tuple[float, ...], [[1.1, 0.01], [0.9, -0.1]]),
        ((), tuple[int, ...], [[0], [1]]),
    ],
)
def test_mild_values_come_first(value: Any, kind: Any, first: list[Any]) -> None:
    found = of(value, kind)[: len(first)]
    if isinstance(value, float) and math.isfinite(value):
        assert found == pytest.approx(first)
    else:
        assert found == first


def test_none_of_them_is_the_value_and_none_comes_twice() -> None:
    for value, kind in ((1, int), (0.0, float), ((0.0,), tuple[float, ...]), ("a", Literal["a"])):
        found = of(value, kind)
        assert value not in found
        assert len(found) == len({repr(one) for one in found})


def test_a_derived_value_is_perturbed_about_what_it_comes_to() -> None:
    assert of(None, float | None, 2.0)[:2] == pytest.approx([2.2, 1.8])


def test_what_may_be_null_is_tried_as_null_too() -> None:
    assert of(2.0, float | None)[-1] is None
    assert None not in of(2.0, float)


def test_elements_are_perturbed_one_by_one_and_the_length_too() -> None:
    found = of((1.0, 2.0), tuple[float, ...])
    assert [1.1, 2.0] in found
    assert [1.0, 2.2] in found
    assert [1.0] in found
    assert [1.0, 2.0, 2.0] in found
