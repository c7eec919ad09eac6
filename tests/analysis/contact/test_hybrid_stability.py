from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.contact.hybrid_stability import (
    CASES,
    HybridStabilityScenario,
    resolve_hybrid_stability,
    run_stability,
)
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.models.validation import ParameterError
from chamfer.systems.force.hybrid_linear import free_growth_rate
from chamfer.systems.force.projection import position_selection
from chamfer.systems.force.sampled_loop import NEUTRAL

Array = NDArray[np.float64]
POINTS = 20  # even: no point on an axis, where both elbows or the base meet


SCENARIO = HybridStabilityScenario(points=POINTS)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run_stability(resolve_hybrid_stability(SCENARIO), 0, quiet)


def grid(outcome: Outcome, case: int, name: str) -> Array:
    """A column of one case, shape (y, x)."""
    return outcome.traces[name][outcome.traces["case"] == case].reshape(POINTS, POINTS)


NEGATIVE, POSITIVE = CASES.index(("negative", "inverse")), CASES.index(("positive", "inverse"))


@pytest.mark.slow
def test_the_claim_that_does_not_hold(outcome: Outcome) -> None:
    asked = [value for value in PUBLISHED if value.experiment == "hybrid-stability"]
    failed = {c.published.metric for c in check(asked, outcome.metrics) if not c.ok}
    assert failed == {"positive.inverse.growth"}  # the finding


@pytest.mark.parametrize(("name", "tolerance"), [("least", 1e-9), ("growth", NEUTRAL)])
def test_the_elbows_maps_are_mirror_images(outcome: Outcome, name: str, tolerance: float) -> None:
    """Mirroring y turns one elbow into the other and leaves P as it is; half a turn neither."""
    negative, positive = (grid(outcome, case, name) for case in (NEGATIVE, POSITIVE))
    assert np.nanmax(np.abs(negative)) > 1
    np.testing.assert_allclose(positive, negative[::-1], rtol=1e-6, atol=tolerance)
    np.testing.assert_allclose(positive, negative[:, ::-1], rtol=1e-6, atol=tolerance)
    np.testing.assert_allclose(negative, negative[::-1, ::-1], rtol=1e-6, atol=tolerance)
    assert np.nanmax(np.abs(positive - negative)) > 1  # and not the same


def test_laws_with_a_projection_or_the_transpose_are_stable_everywhere(
    outcome: Outcome,
) -> None:
    for i, (elbow, law) in enumerate(CASES):
        share = outcome.metrics[f"{elbow}.{law}.unstable_share"].value
        if law == "inverse":
            assert share is not None
            assert share > 5
            continue
        assert share == 0.0
        assert np.nanmin(grid(outcome, i, "least")) == 0.0
        assert np.nanmax(grid(outcome, i, "growth")) < NEUTRAL
    assert {law for _, law in CASES} == {"inverse", "projected", "transpose"}


def test_a_negative_eigenvalue_is_a_growth(outcome: Outcome) -> None:
    for case in (NEGATIVE, POSITIVE):
        least, growth = grid(outcome, case, "least"), grid(outcome, case, "growth")
        reached = np.isfinite(least)
        np.testing.assert_array_equal(least[reached] < 0, growth[reached] > NEUTRAL)


def test_the_crucible_is_bad_for_one_elbow_only(outcome: Outcome) -> None:
    value = {name: metric.value for name, metric in outcome.metrics.items()}
    assert value["negative.inverse.unstable_share_in_crucible"] == 0.0
    inside = value["positive.inverse.unstable_share_in_crucible"]
    assert inside is not None
    assert 3 < inside < 20  # reference: 12 % of the scanned workspace
    assert value["negative.inverse.unstable_share"] == value["positive.inverse.unstable_share"]


@pytest.mark.parametrize(("row", "column"), [(3, 10), (12, 17)])
def test_a_point_of_the_map_is_that_of_the_loop_there(
    outcome: Outcome, row: int, column: int
) -> None:
    for case, (elbow, law) in enumerate(CASES):
        x, y = grid(outcome, case, "x")[row, column], grid(outcome, case, "y")[row, column]
        loop = SCENARIO.loop(elbow, law)
        q = loop.joint_positions(np.array([x, y]))
        expected = free_growth_rate(
            loop.dynamics().evaluate(q, np.zeros(2)).mass,
            loop.ARM.jacobian(q),
            position_selection(loop.direction),
            loop.controller,
            np.array(loop.arm.joint_friction.viscous),
        )
        assert grid(outcome, case, "growth")[row, column] == pytest.approx(
            expected, rel=1e-6, abs=1e-4
        )


@pytest.mark.slow
def test_growth_by_delay_and_force_integral(outcome: Outcome) -> None:
    delays, integrals = outcome.tables["delays"], outcome.tables["force_integrals"]
    for gains, margin in (
        (0, outcome.metrics["negative.inverse.delay_margin"].value),
        (1, outcome.metrics["late.delay_margin"].value),
    ):
        of = (delays["gains"] == gains) & (delays["growth"] > 0)
        assert delays["delay"][of].min() == pytest.approx(margin, abs=2.5e-4)
    assert not np.any(integrals["growth"][integrals["force_integral"] < 5])
    assert np.all(integrals["growth"][integrals["force_integral"] > 10] > 0.3)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"viscous": (1.0,)}, r"viscous is \(1\.0,\), allowed: 2 numbers"),
        ({"direction": (0.0, 1.0, 0.0)}, "direction is .*, allowed: 2 numbers"),
        ({"start": (1.9, 0.0)}, r"start is \(1\.9, 0\.0\), allowed: inside of the circle"),
        (
            {"controller": replace(SCENARIO.controller, stiffness=(1.0,))},
            r"controller\.stiffness is \(1\.0,\), allowed: 2 numbers, or one for all",
        ),
        (
            {"late": replace(SCENARIO.late, damping=(1.0, 2.0, 3.0))},
            r"late\.damping is \(1\.0, 2\.0, 3\.0\), allowed: 2 numbers, or one for all",
        ),
    ],
)
def test_loops_that_are_none(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}"):
        resolve_hybrid_stability(HybridStabilityScenario(**values))
