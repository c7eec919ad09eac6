"""What the panels of the kit show."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    colour_legend,
    draw_counts,
    draw_cumulative,
    draw_distribution,
    draw_intervals,
    draw_lines,
    draw_means,
    draw_shares,
    metric_value,
    name_rows,
    shade,
    spaced,
    state_visits,
    time_axes,
    trial_curves,
)

TIME = np.linspace(0.0, 2.0, 5)


@dataclass(frozen=True)
class Number:
    value: float | None


@pytest.fixture
def figure() -> Figure:
    figure = Figure(layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def test_a_metric_without_a_value_is_nan() -> None:
    metrics = {"a": Number(2.0), "b": Number(None)}
    assert metric_value(metrics, "a", 1e3) == 2000.0
    assert math.isnan(metric_value(metrics, "b"))
    assert math.isnan(metric_value(metrics, "c"))


def test_panels_share_their_time_and_the_states_behind(figure: Figure) -> None:
    visits = state_visits(TIME, [0, 0, 1, 1, 0], ["free", "failed"])
    assert visits == [(0.0, 1.0, "free"), (1.0, 2.0, "failed"), (2.0, 2.0, "free")]
    upper, lower = time_axes(figure, TIME, (2.0, 1.0), visits=visits, strip=0.5)
    band, level = FilledBand(-1.0, 1.0, "zone"), ReferenceLine(0.5, "limit", {"color": "red"})
    draw_lines(
        lower,
        TIME,
        [Curve(TIME**2, "square", {"color": "blue"})],
        title="t",
        y="y / m",
        bands=[band, FilledBand(TIME - 1, TIME + 1, "around")],
        levels=[level, ReferenceLine(1.0, None, {}, upright=True)],
        key="beside",
    )
    shade(upper, TIME, TIME > 5, "never", {})
    shade(upper, TIME, TIME == 1.0, "once", {})
    figure.canvas.draw()
    assert upper.get_xlim() == lower.get_xlim() == (0.0, 2.0)
    names = [text.get_text() for text in lower.get_legend().get_texts()]
    assert sorted(names) == ["around", "limit", "square", "zone"]
    assert upper.get_legend_handles_labels()[1] == ["once"]
    corners = upper.collections[-1].get_paths()[0].vertices
    assert (corners[:, 0].min(), corners[:, 0].max()) == (1.0, 1.5)
    strip = figure.axes[0]
    assert [text.get_text() for text in strip.texts] == ["free", "failed", "free"]
    assert [text.get_weight() for text in strip.texts] == ["normal", "bold", "normal"]


@given(places=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40).map(sorted))
def test_names_keep_their_order_their_distance_and_the_figure(places: list[float]) -> None:
    found = spaced(np.array(places))
    assert (np.diff(found) > 0.0124).all()
    assert found[-1] <= 1.0
    if len(places) == 1 or np.diff(places).min() > 0.0125:
        np.testing.assert_array_equal(found, places)


def test_trials_are_curves_means_and_shares_of_all(figure: Figure) -> None:
    bars, shares = figure.subplots(2)
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


def test_distributions_and_tables(figure: Figure) -> None:
    bars, shares, counts = figure.subplots(3)
    draw_distribution(bars, np.array([1.0, np.nan, 3.0]), least=4.0)
    assert bars.get_xlim() == pytest.approx((0.0, 4.2))
    colours = {"found": "#8fc79a", "wrong": "#800000"}
    rows = [{"found": 99.0, "wrong": 1.0}, {"found": 0.0, "wrong": 100.0}]
    draw_shares(shares, rows, colours, [{"wrong": "1 !"}, {}])
    name_rows(shares, ["first", "second"])
    colour_legend(figure, colours)
    assert [text.get_text() for text in shares.texts] == ["99", "1 !", "100"]
    assert [text.get_color() for text in shares.texts] == ["black", "white", "white"]
    assert shares.get_ylim() == (1.5, -0.5)
    draw_counts(counts, np.array([[3, 1]]), ["said"], ["seated", "stopped"])
    draw_intervals(bars, [1.0], [2.0], [1.5], [np.nan], {"color": "blue"})
    assert [text.get_text() for text in counts.texts] == ["3", "1"]
    figure.canvas.draw()
