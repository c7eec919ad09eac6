import warnings
from collections.abc import Mapping

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from chamfer.analysis.scenario.experiment import Catalogue, quiet
from chamfer.analysis.sweep.sweep import make_plan, run_sweep
from chamfer.analysis.sweep.sweep_design import Drawn, Spec
from chamfer.analysis.sweep.sweep_figures import plot_sweep


def plotted(toys: Catalogue, vary: Mapping[str, Spec], **options: int | None) -> Figure | None:
    plan = make_plan("fall", vary, metrics=["end"], catalogue=toys, **options)  # type: ignore[arg-type]
    return plot_sweep(run_sweep(plan, quiet))


def figure(toys: Catalogue, vary: Mapping[str, Spec], **options: int | None) -> Figure:
    drawn = plotted(toys, vary, **options)
    assert drawn is not None
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # such as of a layout that has no room
        drawn.canvas.draw()
    return drawn


def test_one_field_is_a_line_with_its_interval(toys: Catalogue) -> None:
    drawn = figure(toys, {"height": [3.0, 1.0, 2.0, 200.0]}, trials=3)
    (axes,) = drawn.axes
    line = axes.get_lines()[0]
    assert np.asarray(line.get_xdata()).tolist() == [1.0, 2.0, 3.0, 200.0]  # in order
    missing = np.isnan(np.asarray(line.get_ydata(), dtype=float))
    assert missing.tolist() == [False, False, False, True]
    assert (axes.get_ylabel(), axes.get_xscale()) == ("end / m", "log")
    assert len(axes.collections) == 1  # the interval


def test_two_fields_are_a_map_with_contours(toys: Catalogue) -> None:
    drawn = figure(toys, {"height": [1.0, 2.0, 4.0, 200.0], "body.mass": [1, 2, 3]})
    axes = drawn.axes[0]
    assert axes.get_ylabel() == "body.mass / kg"
    (mesh,) = (one for one in axes.collections if isinstance(one, QuadMesh))
    values = np.asarray(mesh.get_array(), dtype=float)
    assert np.isnan(values).sum() == 3  # height of 200 m
    assert any(isinstance(one, ContourSet) for one in axes.collections)


def test_drawn_points_are_a_map_too(toys: Catalogue) -> None:
    drawn = figure(toys, {"height": Drawn(1, 2), "body.mass": Drawn(1, 2)}, points=16)
    assert any(isinstance(one, ContourSet) for one in drawn.axes[0].collections)


def test_names_are_lines_of_their_own(toys: Catalogue) -> None:
    drawn = figure(toys, {"body.form": ["ball", "plate"], "height": [1.0, 2.0]})
    (axes,) = drawn.axes
    assert [line.get_label() for line in axes.get_lines()] == ["ball", "plate"]
    assert axes.get_xlabel() == "height"


def test_numbers_beyond_any_axis_are_names(toys: Catalogue) -> None:
    drawn = figure(toys, {"height": [1.0, 2.0, float("inf"), 10**400, -1e308, 1e308]})
    labels = [text.get_text() for text in drawn.axes[0].get_xticklabels()]
    assert labels[2:4] == [".inf", "1" + 400 * "0"]


def test_three_fields_have_a_panel_each(toys: Catalogue) -> None:
    vary: dict[str, Spec] = {
        "height": Drawn(1, 2),
        "body.mass": Drawn(1, 2),
        "body.form": ["ball", "plate"],
    }
    drawn = figure(toys, vary, points=32)
    assert [axes.get_xlabel() for axes in drawn.axes] == ["height", "body.mass / kg", "body.form"]
    means = next(line for line in drawn.axes[0].get_lines() if line.get_color() == "#e07b00")
    assert isinstance(means, Line2D)
    # The end is the height and a number that depends on the seed alone.
    assert np.diff(np.asarray(means.get_ydata(), dtype=float)) == pytest.approx(0.25, abs=0.05)


def test_nothing_is_drawn_of_one_point(toys: Catalogue) -> None:
    assert plotted(toys, {"height": [1.0]}) is None
    assert plotted(toys, {"height": [200.0, 300.0]}) is None
