"""What the panels of the kit show."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_kit import (
    draw_cumulative,
    draw_means,
    metric_value,
    shade,
    spaced,
    state_visits,
    trial_curves,
)
from chamfer.analysis.scenario.experiment import Metric

TIME = np.linspace(0.0, 2.0, 5)


def test_a_metric_without_a_value_is_nan() -> None:
    metrics = {"a": Metric(value=2.0, unit="m"), "b": Metric(value=None, unit="m")}
    assert metric_value(metrics, "a", 1e3) == 2000.0
    assert math.isnan(metric_value(metrics, "b"))
    assert math.isnan(metric_value(metrics, "c"))


def test_visits_of_states_end_where_the_next_begins() -> None:
    visits = state_visits(TIME, [0, 0, 1, 1, 0], ["free", "failed"])
    assert visits == [(0.0, 1.0, "free"), (1.0, 2.0, "failed"), (2.0, 2.0, "free")]


def test_shade_lasts_until_the_next_row_and_names_itself_once() -> None:
    axes = Figure().subplots()
    shade(axes, TIME, TIME > 5, "never", {})
    shade(axes, TIME, TIME == 1.0, "once", {})
    assert axes.get_legend_handles_labels()[1] == ["once"]
    corners = axes.collections[-1].get_paths()[0].vertices
    assert (corners[:, 0].min(), corners[:, 0].max()) == (1.0, 1.5)


@given(places=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40).map(sorted))
def test_names_keep_their_order_their_distance_and_the_figure(places: list[float]) -> None:
    found = spaced(np.array(places))
    assert (np.diff(found) > 0.0179).all()
    assert found[-1] <= 1.0
    if len(places) == 1 or np.diff(places).min() > 0.018:
        np.testing.assert_array_equal(found, places)


def test_trials_are_curves_means_and_shares_of_all() -> None:
    bars, shares = Figure().subplots(2)
    trials = np.array([3, 3, 5, 5, 5])
    first, second = trial_curves(TIME, TIME**2, trials, {}, "each")
    assert (first.label, second.label) == ("each", None)
    np.testing.assert_array_equal(second.over, TIME[2:])
    np.testing.assert_array_equal(second.values, TIME[2:] ** 2)
    draw_means(bars, np.array([1.0, 3.0, np.nan]), np.array([0, 0, 1]), "red", offset=0.2)
    (bar,) = bars.patches
    assert (bar.get_width(), bar.get_y() + bar.get_height() / 2) == pytest.approx((2.0, 0.2))
    draw_cumulative(shares, np.array([2.0, np.inf, 1.0, np.nan]), {})
    np.testing.assert_array_equal(shares.lines[0].get_xydata(), [[0, 0], [1, 25], [2, 50]])
