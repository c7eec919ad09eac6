"""The figure of the vision primitives, drawn from made-up trials."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.skills.vision_primitives_figures import plot_vision_primitives

NAMES = ("translation", "rotation", "fixed_point", "grasp")


@pytest.fixture(scope="module")
def figure() -> Figure:
    rows = [
        (k, trial, time, 0.01 * np.exp(-3 * time), np.nan if k == 0 else 0.1 * np.exp(-3 * time))
        for k in range(4)
        for trial in range(3)
        for time in np.linspace(0, 1, 20)
    ]
    columns = ("primitive", "trial", "time", "error_m", "error_rad")
    courses = dict(zip(columns, np.array(rows).T, strict=True))
    cells = {
        "focal_factor": np.repeat([0.2, 1.0], 4),
        "angle": np.tile(np.repeat([0.0, 1.0], 2), 2),
        "converged": np.array([0, 0, 0, 1, 1, 1, 1, 0.0]),
        "theory_root": np.array([1.1, 1.2, 1.1, 0.9, 0.9, 0.9, 0.9, np.inf]),
    }
    metrics = {f"{name}.converged": Metric(value=100.0, unit="%", note="3 of 3") for name in NAMES}
    metrics["fixed_point.unheld.max"] = Metric(value=0.006, unit="m")
    outcome = Outcome(
        metrics=metrics,
        traces={},
        simulated_seconds=1.0,
        tables={"courses": courses, "map": cells},
    )
    made = plot_vision_primitives(outcome, names=NAMES, wrong="all")
    FigureCanvasAgg(made)
    made.canvas.draw()
    return made


def test_each_panel_shows_its_trials_in_milli(figure: Figure) -> None:
    assert len(figure.axes) == 6
    for k, first in enumerate((10.0, 100.0, 100.0, 10.0)):
        axes = figure.axes[k]
        assert len(axes.lines) == 3
        assert np.asarray(axes.lines[0].get_ydata())[0] == pytest.approx(first)
        assert axes.get_yscale() == "log"
        assert axes.get_title(loc="left").endswith("3 of 3 settle")
    held = figure.axes[4]
    assert len(held.lines) == 4
    assert np.asarray(held.lines[3].get_ydata())[0] == pytest.approx(6.0)


def test_the_map_has_the_share_of_each_cell_and_a_mark_for_each_trial(figure: Figure) -> None:
    axes = figure.axes[5]
    (mesh,) = [one for one in axes.collections if isinstance(one, QuadMesh)]
    shades = np.asarray(mesh.get_array()).reshape(2, 2)
    # Rows: 0 and 1 rad; columns: factors 0.2 and 1. None, some and all settle.
    np.testing.assert_array_equal(shades, [[0, 2], [1, 1]])
    marks = [line for line in axes.lines if len(line.get_xydata()) == 1]
    assert [line.get_marker() for line in marks].count("x") == 4
    assert [line.get_marker() for line in marks].count("o") == 4
    assert [tick.get_text() for tick in axes.get_xticklabels()] == ["0.2", "1"]
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["0", "57"]
