from collections.abc import Sequence

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.skills.lissajous_figures import plot_lissajous

Array = NDArray[np.float64]

AMPLITUDE = 0.002  # m


def outcome(repeats: Sequence[int]) -> Outcome:
    time = np.linspace(0.0, 1.0, 50)
    rows = {name: [] for name in ("repeats", "time", "first", "second")}  # type: ignore[var-annotated]
    metrics = {}
    for n in repeats:
        rows["repeats"].append(np.full(50, float(n)))
        rows["time"].append(time)
        rows["first"].append(AMPLITUDE * np.sin(n * time))
        rows["second"].append(AMPLITUDE * np.sin((n + 1) * time))
        metrics[f"covering_radius.n{n}"] = Metric(value=1.05 * AMPLITUDE / n, unit="m")
        metrics[f"theory.covering_radius.n{n}"] = Metric(value=1.1 * AMPLITUDE / n, unit="m")
    return Outcome(
        metrics=metrics,
        traces={name: np.concatenate(values) for name, values in rows.items()},
        simulated_seconds=1.0,
    )


def drawn(repeats: Sequence[int]) -> Figure:
    figure = plot_lissajous(repeats, AMPLITUDE, outcome(repeats))
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    return figure


@pytest.fixture(scope="module")
def figure() -> Figure:
    return drawn((2, 4, 8, 16, 32))


def titles(figure: Figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes]


def points(axes: Axes, index: int) -> tuple[Array, Array]:
    line = axes.get_lines()[index]
    return np.asarray(line.get_xdata()), np.asarray(line.get_ydata())


def test_labels_have_units(figure: Figure) -> None:
    *patterns, radius = figure.axes
    assert [axes.get_xlabel() for axes in patterns] == 4 * ["slower axis / mm"]
    assert patterns[0].get_ylabel() == "y / mm"
    assert radius.get_xlabel() == "N, cycles until the pattern repeats"
    assert radius.get_ylabel() == "covering radius / mm"


def test_the_first_four_patterns_are_drawn(figure: Figure) -> None:
    assert titles(figure) == [
        "(a) N = 2, ratio 3/2",
        "(b) N = 4, ratio 5/4",
        "(c) N = 8, ratio 9/8",
        "(d) N = 16, ratio 17/16",
        "(e) Denser patterns take longer",
    ]
    time = np.linspace(0.0, 1.0, 50)
    for n, axes in zip((2, 4, 8, 16), figure.axes[:4], strict=True):
        first, second = points(axes, 0)
        np.testing.assert_allclose(first, 2.0 * np.sin(n * time))
        np.testing.assert_allclose(second, 2.0 * np.sin((n + 1) * time))
        (square,) = (one for one in axes.patches if isinstance(one, Rectangle))
        assert square.get_xy() == (-2.0, -2.0)
        assert (square.get_width(), square.get_height()) == (4.0, 4.0)


def test_fewer_patterns_are_lettered_on() -> None:
    assert titles(drawn((3,))) == ["(a) N = 3, ratio 4/3", "(b) Denser patterns take longer"]


def test_the_covering_radius_is_drawn_over_all_n(figure: Figure) -> None:
    radius = figure.axes[-1]
    repeats = np.array([2, 4, 8, 16, 32])
    for index, factor in ((0, 1.05), (1, 1.1)):
        x, y = points(radius, index)
        np.testing.assert_array_equal(x, repeats)
        np.testing.assert_allclose(y, factor * 2.0 / repeats)
    low, high = radius.get_ylim()
    assert low < 1.05 * 2.0 / 32
    assert high > 1.1 * 2.0 / 2
    legend = radius.get_legend()
    assert legend is not None
    assert [text.get_text()[:8] for text in legend.get_texts()] == ["measured", r"$\pi A /"]
