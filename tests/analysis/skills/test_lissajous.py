"""What two dithers cover."""

import math
from typing import Any

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.analysis.skills.lissajous import LissajousScenario, covering_radius, figures, run

SHORT = LissajousScenario(repeats=(2, 6))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return run(SHORT, 0, quiet)


def test_the_pattern_closes_and_is_centred(outcome: Outcome, value: Any) -> None:
    assert value(outcome, "repeats_after") == pytest.approx(0.0, abs=1e-12)
    assert value(outcome, "sine_start.offset") == 0.002
    for n in (2, 6):
        assert value(outcome, f"centre_offset.n{n}") < 0.005 * 0.002
        assert value(outcome, f"duration.n{n}") == pytest.approx(n)


def test_the_covering_radius_is_that_of_the_curve(outcome: Outcome, value: Any) -> None:
    for n in (2, 6):
        time = np.linspace(0.0, n, 4000 * n)
        curve = 0.002 * np.column_stack(
            [np.sin(2 * np.pi * time), np.sin(2 * np.pi * (n + 1) / n * time)]
        )
        expected = covering_radius(curve, 0.002)
        assert value(outcome, f"covering_radius.n{n}") == pytest.approx(expected, abs=1e-5)
        assert value(outcome, f"covering_ratio.n{n}") == pytest.approx(
            n * expected / 0.002, abs=0.03
        )
    # The reference gives about 1.05 A / N.
    assert value(outcome, "covering_ratio.n6") == pytest.approx(1.05, abs=0.12)


@pytest.mark.parametrize(("cells", "amplitude"), [(2, 1.0), (5, 0.003), (20, 0.002)])
def test_a_dense_grid_leaves_half_a_cells_diagonal(cells: int, amplitude: float) -> None:
    side = np.linspace(-amplitude, amplitude, cells + 1)
    x, y = np.meshgrid(side, side)
    found = covering_radius(np.column_stack([x.ravel(), y.ravel()]), amplitude)
    assert found == pytest.approx(math.sqrt(2) * amplitude / cells)


def test_the_figure_has_patterns_in_millimetres_and_the_radius_over_n(outcome: Outcome) -> None:
    *patterns, radius = figures(SHORT, outcome)["lissajous"].axes
    for n, axes in zip((2, 6), patterns, strict=True):
        of = outcome.traces["repeats"] == n
        drawn = np.asarray(axes.get_lines()[0].get_ydata())
        np.testing.assert_allclose(drawn, 1e3 * outcome.traces["second"][of])
        (square,) = (one for one in axes.patches if isinstance(one, Rectangle))
        assert (square.get_xy(), square.get_width()) == ((-2.0, -2.0), 4.0)
    measured, expected = (np.asarray(one.get_ydata()) for one in radius.get_lines()[:2])
    np.testing.assert_allclose(expected, 2.0 * math.pi / (2 * math.sqrt(2) * np.array([2, 6])))
    radii = [1e3 * (outcome.metrics[f"covering_radius.n{n}"].value or 0.0) for n in (2, 6)]
    np.testing.assert_allclose(measured, radii)
