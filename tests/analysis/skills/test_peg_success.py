"""Insertions of a peg with three searches in the same worlds."""

import math
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.sensorimotor_primitives import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.skills.connector_trials import DRAWN, PegSuccessScenario, attempt
from chamfer.analysis.skills.peg_success_figures import plot_searches
from chamfer.analysis.skills.randomised_scenario import WorldSpread
from chamfer.systems.strategies.peg_in_hole import Search

PEG_SUCCESS = load(select(CATALOGUE.entries, ["peg-skill-success"])[0])

# So short that no insertion comes to its end.
CUT = PegSuccessScenario(trials=2, duration=0.3, spread=WorldSpread(obstacles=0.0))


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return PEG_SUCCESS.run(CUT, 3, quiet)


def test_all_searches_are_tried_in_the_same_worlds(outcome: Outcome) -> None:
    rows = outcome.traces
    assert rows["search"].tolist() == ["dithers"] * 2 + ["spiral"] * 2 + ["tilt"] * 2
    assert rows["trial"].tolist() == [0, 1] * 3
    for name in DRAWN:
        np.testing.assert_array_equal(rows[name], np.tile(rows[name][:2], 3))
    assert outcome.simulated_seconds == pytest.approx(6 * 0.3)


def test_metrics_are_those_of_the_skill_s_search_and_of_each(outcome: Outcome) -> None:
    asked = [one for one in PUBLISHED if one.experiment == "peg-skill-success"]
    checked = {one.published.metric for one in check(asked, outcome.metrics)}
    assert checked == {"success_rate", "false_done", "force.peak_share"}
    for search in ("dithers", "spiral", "tilt"):
        assert outcome.metrics[f"{search}.success_rate"].value == 0.0
        assert outcome.metrics[f"{search}.duration"].value == pytest.approx(0.3)
    assert outcome.metrics["success_rate"] == outcome.metrics["dithers.success_rate"]
    other = replace(CUT, skill=replace(CUT.skill, search="spiral"), compared=())
    alone = PEG_SUCCESS.run(replace(other, trials=1), 3, quiet)
    assert "dithers.success_rate" not in alone.metrics
    assert set(PEG_SUCCESS.plot(other, alone)) == {"success"}


def test_figures_show_all_searches_and_take_runs_without_success(outcome: Outcome) -> None:
    assert set(PEG_SUCCESS.plot(CUT, outcome)) == {"success", "searches"}
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


def test_a_search_is_compared_once() -> None:
    twice = replace(CUT, trials=1, compared=("spiral", "dithers", "spiral"))
    assert PEG_SUCCESS.run(twice, 0, quiet).traces["search"].tolist() == ["dithers", "spiral"]


@pytest.mark.slow
@pytest.mark.parametrize("search", ["dithers", "spiral", "tilt"])
def test_every_search_finds_a_tight_hole_with_nearly_twice_the_friction(search: Search) -> None:
    held = replace(CUT, sight=None, duration=60.0, skill=replace(CUT.skill, search=search))
    hard = replace(held, spread=replace(CUT.spread, friction=0.9, tight=1.0))
    row = attempt(hard, 5, 8)
    assert row["friction"] > 1.3 * CUT.connector.material.friction
    assert (row["success"], row["tight"], row["false_reason"]) == (1.0, 1.0, 0.0)
