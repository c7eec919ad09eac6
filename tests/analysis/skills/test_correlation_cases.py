"""Eq. (1), measured in five cases and against theory."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.analysis.skills.correlation_cases import CASES_SCENARIO, resolve_cases, run
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
