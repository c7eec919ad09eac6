import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.surface.observer_comparison import OBSERVERS, plot_comparison

CASES = {"first_case": False, "second": True}
SEEDS = 101
PERCENT = {"thesis": 97.0, "adaptive": 99.5}


def outcome() -> Outcome:
    """Observer j has an rms of 1 + j in the first case, of 11 + j in the second, +-0.5."""
    rows = []
    metrics = {}
    for i, case in enumerate(CASES):
        for j, observer in enumerate(OBSERVERS):
            rms = 10.0 * i + 1 + j
            metrics[f"{case}.{observer}.rms"] = Metric(value=rms, unit="deg")
            covered = PERCENT.get(observer, 90.0) - i
            metrics[f"{case}.{observer}.coverage"] = Metric(value=covered, unit="%")
            spread = np.linspace(-0.5, 0.5, SEEDS)
            rows += [(i, j, trial, rms + spread[trial]) for trial in range(SEEDS)]
    columns = ("case", "observer", "trial", "rms")
    traces = dict(zip(columns, np.array(rows).T, strict=True))
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=0.0)


@pytest.fixture(scope="module")
def figure() -> Figure:
    return plot_comparison(outcome(), cases=CASES, observers=OBSERVERS)


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_titles_and_labels_with_units(figure: Figure) -> None:
    errors, coverage = figure.axes
    assert errors.get_xlabel() == "rms error / °"
    assert coverage.get_xlabel() == "coverage / %"
    assert errors.get_title(loc="left").startswith("Error of the normal")
    assert coverage.get_title(loc="left") == "Share of errors within 3 standard deviations"
    assert coverage.get_xlim() == (0, 101)
    assert errors.get_xlim()[0] == 0


def test_every_observer_has_a_name_of_its_own(figure: Figure) -> None:
    names = texts(figure.axes[1])
    assert names == [
        "thesis",
        "gated",
        "weights from the prior",
        "the same, with a camera's prediction",
        "curvature state",
        "friction-angle state",
        "adaptive",
        "adaptive, with the prediction",
        "asked for, 99 %",
    ]
    assert figure.axes[0].get_legend() is None  # one is enough
    looks = {
        (one.get_color(), one.get_marker())
        for one in figure.axes[0].get_lines()
        if one.get_label() in names
    }
    assert len(looks) == len(OBSERVERS)


def test_cases_are_read_from_the_top_and_say_whether_they_were_tuned_on(figure: Figure) -> None:
    errors, coverage = figure.axes
    labels = [text.get_text() for text in errors.get_yticklabels()]
    assert labels == ["first case\n(tuned on)", "second\n(reported)"]
    for axes in (errors, coverage):
        bottom, top = axes.get_ylim()
        assert bottom > top


def test_points_and_spread_are_those_of_the_trials(figure: Figure) -> None:
    errors, coverage = figure.axes
    names = texts(coverage)
    lines = {one.get_label(): one for one in errors.get_lines()}
    shares = {one.get_label(): one for one in coverage.get_lines()}
    spans = [one.get_segments() for one in errors.collections]
    assert len(spans) == len(OBSERVERS)
    for j, observer in enumerate(OBSERVERS):
        line, share = lines[names[j]], shares[names[j]]
        np.testing.assert_allclose(line.get_xdata(), [1.0 + j, 11.0 + j])
        percent = PERCENT.get(observer, 90.0)
        np.testing.assert_allclose(share.get_xdata(), [percent, percent - 1])
        # Both at the same height, between the neighbouring cases'.
        heights = np.asarray(line.get_ydata())
        np.testing.assert_array_equal(heights, share.get_ydata())
        assert np.all(np.abs(heights - [0, 1]) < 0.5)
        for i, ends in enumerate(spans[j]):
            middle = 10.0 * i + 1 + j
            np.testing.assert_allclose(ends[:, 0], [middle - 0.45, middle + 0.45])
            np.testing.assert_allclose(ends[:, 1], heights[i])
    heights = [np.asarray(lines[name].get_ydata())[0] for name in names[:-1]]
    assert heights == sorted(heights)
    assert len(set(heights)) == len(OBSERVERS)


def test_the_target_is_drawn(figure: Figure) -> None:
    (target,) = (one for one in figure.axes[1].get_lines() if "asked for" in str(one.get_label()))
    np.testing.assert_array_equal(target.get_xdata(), 99.0)


def test_the_legend_is_beside_the_data(figure: Figure) -> None:
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    errors, coverage = figure.axes
    box = coverage.get_legend().get_window_extent()
    assert box.x0 >= coverage.get_window_extent().x1
    assert box.x1 <= figure.bbox.width
    assert box.y0 >= 0
    labels = [text.get_window_extent() for text in errors.get_yticklabels()]
    assert all(one.x0 >= 0 for one in labels)
