"""The experiment with observers that are told wrong, on two surfaces."""

import math
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.surface.observer_model_error import (
    OBSERVERS,
    ModelErrorScenario,
    Wrong,
    corners,
    drawn,
    run_model_error,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.model_error import ModelErrorParams

SCENARIO = ModelErrorScenario(surfaces=("sharper", "space_saddle"), trials=1, latest=1)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run_model_error(SCENARIO, 0, lambda *_: None)


def test_who_knows_of_errors_is_honest_and_who_trusts_is_not(outcome: Outcome, value: Any) -> None:
    for surface in SCENARIO.surfaces:
        assert value(outcome, f"{surface}.trusting.corner.coverage") < 60
        assert value(outcome, f"{surface}.trusting.corner.nees") > 5
        assert value(outcome, f"{surface}.adaptive.corner.coverage") > 95
        assert value(outcome, f"{surface}.adaptive.corner.nees") < 2
        trusting, adaptive = (
            value(outcome, f"{surface}.{one}.corner.rms") for one in ("trusting", "adaptive")
        )
        assert adaptive < 0.3 * trusting
    assert value(outcome, "adaptive.rms_ratio.worst") < 1.5
    assert value(outcome, "trusting.rms_ratio.worst") == 1.0


def test_the_summary_is_of_the_worst_surface(outcome: Outcome, value: Any) -> None:
    for observer in OBSERVERS:
        each = {s: value(outcome, f"{s}.{observer}.corner.nees") for s in SCENARIO.surfaces}
        worst = outcome.metrics[f"{observer}.corner.nees.worst"]
        assert worst.value == max(each.values())
        assert worst.note == max(each, key=each.__getitem__)


def test_corners_are_as_wrong_as_it_may_be_and_draws_less() -> None:
    scenario = ModelErrorScenario()
    for d in (2, 3):
        found = corners(scenario, d)
        assert len(set(found)) == 8
        for wrong in found:
            assert wrong.bias is not None
            assert abs(wrong.told - 1) == pytest.approx(0.3)
            assert math.hypot(*wrong.bias) == 2.0
            assert wrong.late in (1, 2)
            assert wrong.differenced
        random = np.random.default_rng(0)
        draws = [drawn(scenario, d, random) for _ in range(200)]
        assert all(abs(one.told - 1) <= 0.3 for one in draws)
        assert {one.late for one in draws} == {1, 2}
        sizes = [math.hypot(*one.bias) for one in draws if one.bias is not None]
        assert max(sizes) <= 2
        assert np.mean(sizes) == pytest.approx(1, abs=0.15)
    assert Wrong() == Wrong(1.0, None, 0, False)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"surfaces": ("moon",)}, "surfaces is ('moon',), allowed: some of constant, ripple"),
        ({"surfaces": ()}, "surfaces is (), allowed: some of constant"),
        (
            {"model_error": ModelErrorParams(bias=1.0, tare=2.0)},
            "model_error.tare is 2.0, allowed: at most 1 s",
        ),
    ],
)
def test_what_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        ModelErrorScenario(**changes)  # type: ignore[arg-type]
    assert str(caught.value).startswith(message)
