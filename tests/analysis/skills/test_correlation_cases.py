"""Eq. (1), measured in five cases and against theory."""

from dataclasses import replace
from typing import Any

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
def test_measured_against_theory(
    outcome: Outcome, value: Any, case: str, tolerance: float
) -> None:
    assert value(outcome, f"correlation.{case}") == pytest.approx(
        value(outcome, f"theory.{case}"), abs=tolerance
    )


def test_the_free_value_is_that_of_a_hundred_samples(outcome: Outcome, value: Any) -> None:
    assert value(outcome, "correlation.free") == pytest.approx(1.2345, abs=5e-5)
    assert value(outcome, "amplitude_ratio.free") == 1.0


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
