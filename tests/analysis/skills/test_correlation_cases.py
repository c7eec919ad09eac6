"""Eq. (1), measured in five cases and against theory."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.analysis.skills.correlation_cases import (
    CASES,
    CASES_SCENARIO,
    figures,
    resolve_cases,
    run,
)
from chamfer.systems.primitives.trajectory_primitives import Dither

SHORT = replace(CASES_SCENARIO, dither=Dither(cycles=6.0))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run(resolve_cases(SHORT), 0, quiet)


@pytest.fixture(scope="module")
def value(outcome: Outcome) -> Callable[[str], float]:
    def get(name: str) -> float:
        measured = outcome.metrics[name].value
        assert measured is not None
        return measured

    return get


Value = Callable[[str], float]


@pytest.mark.parametrize(
    ("case", "tolerance"),
    [
        ("free", 1e-9),
        ("constrained", 1e-9),
        ("one_sided", 2e-3),
        ("noisy", 0.05),
        ("biased", 1e-9),
    ],
)
def test_measured_against_theory(value: Value, case: str, tolerance: float) -> None:
    assert value(f"correlation.{case}") == pytest.approx(value(f"theory.{case}"), abs=tolerance)


def test_the_free_value_is_that_of_a_hundred_samples(value: Value) -> None:
    assert value("correlation.free") == pytest.approx(1.2345, abs=5e-5)
    assert value("amplitude_ratio.free") == 1.0


def test_the_figure_has_every_case_in_its_place(outcome: Outcome) -> None:
    *cases, values = figures(resolve_cases(SHORT), outcome)["correlation"].axes
    for name, axes in zip(CASES, cases, strict=True):
        lines = {str(one.get_label()): np.asarray(one.get_ydata()) for one in axes.get_lines()}
        later = 1e3 * outcome.tables["cycles"][f"{name}_later"]
        np.testing.assert_allclose(lines["motion, third cycle"], later)
    points = [(np.asarray(one.get_xdata()), one.get_ydata()) for one in values.get_lines()]
    for i, name in enumerate(CASES):
        (marked,) = (y for x, y in points if len(x) == 1 and x[0] == i)
        np.testing.assert_allclose(marked, outcome.metrics[f"theory.{name}"].value)
