from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell.wedging_diagram import WedgingScenario
from chamfer.analysis.cell.wedging_diagram_figures import STARTS, plot_wedging
from chamfer.analysis.scenario.experiment import Outcome, load, select

WEDGING_DIAGRAM = load(select(CATALOGUE.entries, ["wedging-diagram"])[0])

Array = NDArray[np.float64]
SCENARIO = WedgingScenario(points=51, alignment=None)


def run(scenario: WedgingScenario) -> Outcome:
    return WEDGING_DIAGRAM.run(scenario, 0, lambda fraction, doing="": None)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run(SCENARIO)


@pytest.fixture(scope="module")
def figure(outcome: Outcome) -> Figure:
    figures = WEDGING_DIAGRAM.plot(SCENARIO, outcome)
    assert set(figures) == {"wedging-diagram"}
    return drawn(figures["wedging-diagram"])


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    return figure


def labels(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def line(axes: Axes, label: str) -> tuple[Array, Array]:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_sides_in_millimetres_and_milliradians(figure: Figure, outcome: Outcome) -> None:
    table = outcome.tables["boundaries"]
    x, y = line(figure.axes[0], "exact sides, $L_g$ 100 mm")
    inside = (table["centre_distance"] == 0.1) & (np.abs(table["lateral"]) <= 0.019814)
    np.testing.assert_allclose(x, 1e3 * table["lateral"][inside])
    np.testing.assert_allclose(y, 1e3 * table["exact_upper"][inside])
    assert x[-1] == pytest.approx(19.814)
    box = figure.axes[0].patches[-1].get_bbox()
    np.testing.assert_allclose(box.extents, [-19.814, -58.1745, 19.814, 58.1745], atol=1e-4)


def test_starts_and_their_margins(figure: Figure) -> None:
    for axes in figure.axes[:2]:
        x, y = line(axes, "largest of the ten runs")
        assert (x.item(), y.item()) == pytest.approx((3.2, 40.0))
        left, right = axes.get_xlim()
        assert left <= 3.2 <= right
    assert [text.get_text() for text in figure.axes[1].texts] == ["49 %", "13 %", "-4 %"]


def test_force_over_depth_in_millimetres(figure: Figure, outcome: Outcome) -> None:
    force = figure.axes[2]
    x, y = line(force, "mean of the ten runs")
    of = outcome.traces["start"] == 0
    np.testing.assert_allclose(x, 1e3 * outcome.traces["depth"][of])
    np.testing.assert_array_equal(y, outcome.traces["force"][of])
    assert force.get_ylim()[1] > outcome.traces["force"].max()
    band = force.patches[0].get_bbox()
    assert (band.x0, band.x1) == pytest.approx((0.0, 8.8011))


def test_ends_of_simulated_runs_are_drawn_and_in_view(outcome: Outcome) -> None:
    starts = dict.fromkeys(STARTS, (0.001, 0.01))
    ends = np.array([-0.002, 0.006]), np.array([-0.03, 0.02])
    x = np.array([-0.004, 0.0, 0.004])
    arms = {"lateral": x, "exact_lower": x - 0.06, "exact_upper": x + 0.06}
    outcome = replace(outcome, tables={**outcome.tables, "arms": arms})
    figure = drawn(plot_wedging(SCENARIO.parts, starts, outcome, ends))
    for axes in figure.axes[:2]:
        x, y = line(axes, "exact sides, the arms of the simulation")
        np.testing.assert_allclose(x, [-4.0, 0.0, 4.0])
        np.testing.assert_allclose(y, [56.0, 60.0, 64.0])
        x, y = line(axes, "simulated alignments")
        np.testing.assert_allclose(x, [-2.0, 6.0])
        np.testing.assert_allclose(y, [-30.0, 20.0])
        for low, high, values in ((*axes.get_xlim(), x), (*axes.get_ylim(), y)):
            assert low < values.min()
            assert high > values.max()
    assert "simulated alignments" in labels(figure.axes[0])
