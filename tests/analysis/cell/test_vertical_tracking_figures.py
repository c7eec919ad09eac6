import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from chamfer.analysis.cell.vertical_tracking import plot_heights
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import VERTICAL_TRACKING

SCENARIO = resolve(VERTICAL_TRACKING)
TIME = np.arange(321) / 80
GOAL = np.interp(TIME, [0.0, 2.0], [0.128, 0.158])
LIFT = np.interp(TIME, [0.1, 1.2], [0.0, 0.0015])


@pytest.fixture(scope="module")
def figure() -> Figure:
    traces = {
        "time": TIME,
        "desired_height": GOAL,
        "uncompensated_height": GOAL - 0.0015,
        "compensated_height": GOAL - 0.0015 + LIFT,
        "compensation": LIFT,
    }
    made = plot_heights(SCENARIO, Outcome(metrics={}, traces=traces, simulated_seconds=8.0))
    FigureCanvasAgg(made)
    made.canvas.draw()
    return made


def end(axes: Axes, label: str) -> float:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return float(np.asarray(found.get_ydata())[-1])


def test_curves_are_in_millimetres(figure: Figure) -> None:
    height, error = figure.axes
    assert end(height, "desired") == pytest.approx(158.0)
    assert end(height, "without compensation") == pytest.approx(156.5)
    assert end(height, "with compensation by sight") == pytest.approx(158.0)
    assert end(error, "published: 1.5 mm low") == pytest.approx(-1.5)
    assert end(error, "without compensation") == pytest.approx(-1.5)
    assert end(error, "with compensation by sight") == pytest.approx(0.0, abs=1e-9)
    assert end(error, "compensation added") == pytest.approx(1.5)
    (band,) = error.patches
    low, high = error.transData.inverted().transform(band.get_extents())[:, 1]
    zone = SCENARIO.compensator.axes[0].dead_zone * 0.5
    assert (low, high) == pytest.approx((-zone, zone))
    assert error.get_xlim() == (0.0, 4.0)
