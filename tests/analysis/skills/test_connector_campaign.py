"""Campaigns of insertions: what trials draw, what they measure, and what is compared."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.scenario.experiment import quiet
from chamfer.analysis.skills.connector_campaign import (
    BNC_CONNECTOR,
    D_CONNECTOR,
    DRAWN,
    ROUND_PEG,
    ResolvedCampaignScenario,
    ScenarioSpread,
    median_failure,
    plot_searches,
    randomised,
    resolve_campaign,
    resolve_peg_campaign,
    run_searches,
    run_success,
    search_figures,
    success_figures,
    success_metrics,
)
from chamfer.analysis.skills.insertion_metrics import INSERTION, InsertionVerdict
from chamfer.analysis.skills.skill_run import AXES
from chamfer.models.validation import ParameterError

D, BNC = resolve_campaign(D_CONNECTOR), resolve_campaign(BNC_CONNECTOR)
FREE = ScenarioSpread(obstacles=0.0)
# So short that no insertion comes to its end.
CUT = resolve_peg_campaign(replace(ROUND_PEG, trials=2, duration=0.3, spread=FREE))
ERROR = (0.01, 0.02, 0.03, 0.001, 0.002, 0.0)


def attempts(*rows: dict[str, float | None], reasons: list[str] | None = None) -> Trials[int]:
    plain: dict[str, float | None] = dict.fromkeys(INSERTION, 1.0)
    plain |= dict.fromkeys(InsertionVerdict._fields, 0.0) | dict.fromkeys(DRAWN, 0.5)
    plain |= {f"initial_{axis}": error for axis, error in zip(AXES, ERROR, strict=True)}
    plain["obstacle"] = None
    reasons = reasons or [""] * len(rows)
    return Trials(
        tasks=tuple(range(len(rows))),
        rows=tuple(
            {**plain, **row, "reason": why} for row, why in zip(rows, reasons, strict=True)
        ),
    )


KNOWN = ScenarioSpread(
    **{one.name: 0.0 for one in fields(ScenarioSpread) if one.name != "mating_force"},
    mating_force=1.0,
)


def randomised_ones(scenario: Any, number: int, **changes: Any) -> list[Any]:
    spread = replace(scenario.spread, **changes)
    return [randomised(replace(scenario, spread=spread), 0, trial) for trial in range(number)]


def focal_factors(one: Any) -> list[float]:
    return [one.sight.xz.focal_factor, one.sight.yz.focal_factor]


@settings(max_examples=20)
@given(seed=st.integers(0, 2**63 - 1), trial=st.integers(0, 10_000_000))
def test_a_scenario_is_its_seed_and_its_trial(seed: int, trial: int) -> None:
    first = randomised(D, seed, trial)
    assert randomised(D, seed, trial) == first
    for other in (randomised(D, seed, trial + 1), randomised(D, seed + 1, trial)):
        assert other.initial_error != first.initial_error
        assert other.connector != first.connector
        assert other.sensor != first.sensor


@pytest.mark.parametrize("scenario", [D, BNC])
def test_without_a_spread_all_is_as_believed(scenario: ResolvedCampaignScenario) -> None:
    scenario = replace(scenario, spread=KNOWN)
    found = randomised(scenario, 3, 4)
    assert found.connector.mating_force == pytest.approx(scenario.connector.mating_force)
    assert replace(found, connector=scenario.connector, sensor=scenario.sensor) == scenario
    assert found.sensor.bias == (0.0,) * 6


@pytest.mark.parametrize("scenario", [D, BNC])
def test_draws_reach_both_ends_and_no_further(scenario: ResolvedCampaignScenario) -> None:
    found = randomised_ones(scenario, 300)
    off = np.array([one.initial_error for one in found]) - scenario.initial_error
    believed = scenario.connector
    columns = {
        "rotational": off[:, :3] / math.radians(3),
        "lateral": off[:, 3:5] / 0.002,
        "force bias": np.array([one.sensor.bias[:3] for one in found]),
        "torque bias": np.array([one.sensor.bias[3:] for one in found]) / 0.03,
        "friction": 2 * np.array([[w.connector.material.friction] for w in found]) / 0.2 - 2,
        "wrist": (np.array([[w.wrist.stiffness[3]] for w in found]) / 2e4 - 1) / 0.3,
        "mating force": np.log2(
            [[w.connector.mating_force / believed.mating_force] for w in found]
        ),
        "focal": np.array([focal_factors(one) for one in found]) / 0.1 - 10,
    }
    for values in columns.values():
        for column in values.T:
            assert stats.kstest(column, stats.uniform(-1, 2).cdf).pvalue > 1e-4
    np.testing.assert_array_equal(off[:, 5], 0.0)
    everything = np.hstack(list(columns.values()))
    between = np.corrcoef(everything.T) - np.eye(everything.shape[1])
    assert np.abs(between).max() < 0.25


def test_what_is_believed_is_the_scenario_s_own() -> None:
    for one in randomised_ones(D, 20):
        assert one.believed_connector == D.connector
        assert one.believed_wrist == D.wrist
        assert one.accommodation == D.accommodation
        # One factor: the wrist is all stiffer or all softer.
        assert np.ptp(np.divide(one.wrist.stiffness, D.wrist.stiffness)) < 1e-12


def test_some_fits_are_tight_and_some_sockets_blocked() -> None:
    found = randomised_ones(D, 400, tight=0.25, obstacles=0.5)
    tight = [one.connector.tolerance == "worst" for one in found]
    assert sum(tight) == pytest.approx(100, abs=40)
    depths = np.array([one.obstacle for one in found if one.obstacle is not None])
    assert len(depths) == pytest.approx(200, abs=40)
    assert depths.min() > 0
    assert depths.max() < D.connector.mated_depth - 0.0005
    assert np.ptp(depths) > 0.9 * (D.connector.mated_depth - 0.0008)


@pytest.mark.parametrize("name", [one.name for one in fields(ScenarioSpread)])
def test_a_spread_changes_no_other_s_draws(name: str) -> None:
    changed = {"mating_force": 1.5, "obstacle_short": 0.001}.get(name, 0.01)
    spread = replace(D.spread, obstacles=0.6)
    one, other = (
        replace(randomised(replace(D, spread=each), 0, 5), spread=D.spread)
        for each in (spread, replace(spread, **{name: changed}))
    )
    # Of the fields of a scenario one at most differs.
    assert sum(getattr(one, f.name) != getattr(other, f.name) for f in fields(one)) <= 1


def test_an_obstacle_has_room_in_the_socket() -> None:
    with pytest.raises(ParameterError, match=r"^spread\.obstacle_short is 0\.006, allowed: less"):
        randomised(replace(D, spread=ScenarioSpread(obstacle_short=0.006)), 0, 0)


def test_a_run_with_an_obstacle_is_no_insertion_but_what_it_says_counts() -> None:
    blocked = {"obstacle": 0.003}
    found = success_metrics(
        attempts(
            {"hindered": 2.0},
            {"hindered": 1.0, "false_hindered": 1.0},
            {**blocked, "hindered": 2.0},
            {**blocked, "false_done": 1.0},
            {**blocked, "false_reason": 1.0},
            reasons=["", "push: jammed", "feel: jammed", "said to be done", "lost"],
        )
    )
    assert found["success_rate"].value == 50.0
    expected = "1 of 2, 3 more with an obstacle; failed: push: jammed (1)"
    assert found["success_rate"].note == expected
    assert found["false_done"].value == 20.0
    assert found["false_hindered"].value == 20.0
    assert found["false_hindered"].note == "1 of 5 detected obstructions"
    assert found["false_reason"].value == 25.0
    only = success_metrics(attempts(blocked, reasons=["feel: jammed"]))
    assert only["success_rate"].value is None
    assert only["success_rate.low"].value is None
    assert only["false_hindered"].value is None


def test_peaks_are_the_largest_and_the_rest_are_means() -> None:
    found = success_metrics(
        attempts(
            {"force.peak": 10.0, "force.peak_share": 0.5, "torque.peak": 3.0, "duration": 4.0},
            {"force.peak": 30.0, "force.peak_share": 1.5, "torque.peak": 2.0, "retries": 3.0},
        )
    )
    values = {name: metric.value for name, metric in found.items()}
    assert values["force.peak"] == 30.0
    assert values["force.peak_mean"] == 20.0
    assert values["force.peak_share"] == 1.5
    assert values["torque.peak"] == 3.0
    assert values["duration"] == 2.5
    assert values["retries"] == 2.0
    assert values["real_time_factor"] == 1.0
    assert found["force.peak"].note == "largest of 2 trials, 10 to 30"
    assert found["duration"].note == "mean of 2 trials, 1 to 4"


def test_all_searches_are_tried_in_the_same_scenarios() -> None:
    outcome = run_searches(CUT, 3, quiet)
    rows = outcome.traces
    assert rows["search"].tolist() == ["dithers"] * 2 + ["spiral"] * 2 + ["tilt"] * 2
    assert rows["trial"].tolist() == [0, 1] * 3
    for name in DRAWN:
        np.testing.assert_array_equal(rows[name], np.tile(rows[name][:2], 3))
    assert outcome.simulated_seconds == pytest.approx(6 * 0.3)
    assert outcome.metrics["success_rate"] == outcome.metrics["dithers.success_rate"]
    assert outcome.metrics["tilt.duration"].value == pytest.approx(0.3)
    assert set(search_figures(CUT, outcome)) == {"success", "searches"}


def test_searches_are_compared_trial_by_trial() -> None:
    rows = {
        "search": np.repeat(["dithers", "spiral", "tilt"], 4),
        "trial": np.array([0.0, 1.0, 2.0, 3.0] * 3),
        "success": np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]),
        "duration": np.array([10.0, 20.0, 90.0, 60.0, 12.0, 11.0, 13.0, 60.0, *[14.0] * 4]),
        "obstacle": np.array([math.nan, math.nan, math.nan, 0.004] * 3),
    }
    share, pairs = plot_searches(rows).axes
    dithers, spiral, tilt = share.get_lines()
    assert dithers.get_ydata()[-1] == pytest.approx(200 / 3)
    assert spiral.get_ydata()[-1] == pytest.approx(100.0)
    assert tilt.get_ydata()[-1] == pytest.approx(200 / 3)
    along, leaning = pairs.collections
    np.testing.assert_allclose(along.get_offsets(), [[10.0, 12.0], [20.0, 11.0]])
    np.testing.assert_allclose(leaning.get_offsets(), [[20.0, 14.0]])


def test_the_failure_that_is_drawn_is_the_one_nearest_to_the_median_time() -> None:
    found = run_success(replace(CUT, trials=3), 3, quiet)
    assert found.traces["reason"].tolist() == ["reach: still running"] * 3
    course = found.tables["failure"]
    assert set(course["trial"]) == {0}  # all fail at once, the first is drawn
    assert len(course["time"]) == len(course["state"]) == 31
    depth, force, tilt = success_figures(CUT, found)["failure"].axes[1:]
    assert [axes.get_ylabel() for axes in (depth, force, tilt)] == [
        *("depth\nmm", "push\nN", "tilt\ndegrees")
    ]
    said = "trial 0, the failure nearest to the median time: reach: still running at "
    assert found.metrics["answer"].note.startswith(said)
    trials = (
        *(("", None, None), ("a: lost", 9.0, None), ("a: lost", 20.0, None)),
        *(("b: done", 10.0, 0.003), ("a: lost", 11.0, None)),
    )
    rows = [{"reason": why, "reason.time": time, "obstacle": at} for why, time, at in trials]
    assert median_failure(rows) == 4
    assert median_failure(rows[:1]) is None
