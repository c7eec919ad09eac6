import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.cell.alignment_comparison import plot_comparison
from chamfer.analysis.cell.alignment_runs import AlignmentTrialsScenario
from chamfer.analysis.scenario.experiment import Outcome

Array = NDArray[np.float64]

RUNS = 3
SCENARIO = AlignmentTrialsScenario(trials=RUNS)
TIME = np.arange(321) / 80
SIZES = {"lateral": (0.004, 1e-4), "rotational": (0.06, 5e-3)}  # first and last errors


def errors(kind: str, controller: int, run: int) -> Array:
    first, last = SIZES[kind]
    share = np.clip((TIME - 1.5) / (2.0 - controller), 0.0, 1.0)
    scale = (1 + run) ** 2  # the median is not the mean
    values: Array = scale * first * (last / first * (1 - 0.8 * controller)) ** share
    return values


@pytest.fixture(scope="module")
def figure() -> Figure:
    order = [(controller, run) for controller in range(2) for run in range(RUNS)]
    table = {
        "controller": np.repeat([float(controller) for controller, _ in order], len(TIME)),
        "trial": np.repeat([float(run) for _, run in order], len(TIME)),
        "time": np.tile(TIME, len(order)),
    }
    traces = {}
    for kind in SIZES:
        name = f"{kind}_error"
        table[name] = np.concatenate([errors(kind, *one) for one in order])
        for i, controller in enumerate(("fsm", "pid")):
            traces[f"{controller}.{name}"] = np.array(
                [errors(kind, i, run)[-1] for run in range(RUNS)]
            )
    outcome = Outcome(metrics={}, traces=traces, simulated_seconds=0.0, tables={"errors": table})
    made = plot_comparison(SCENARIO, outcome)
    FigureCanvasAgg(made)
    made.canvas.draw()
    return made


def thick(axes: Axes, label: str) -> Array:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_ydata())


def test_labels_have_units(figure: Figure) -> None:
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "error / mm",
        "error / mm",
        "error / mrad",
        "error / mrad",
    ]
    for axes in figure.axes[::2]:
        assert axes.get_xlabel() == "time since the compensation's begin / s"
        assert axes.get_xlim() == (-0.25, 2.5)
    for axes in figure.axes[1::2]:
        assert [text.get_text() for text in axes.get_xticklabels()] == ["FSM", "PID"]
        assert axes.get_title(loc="left")[3:] == " After 2.5 s, same starts joined"
    assert [axes.get_title(loc="left")[:3] for axes in figure.axes] == ["(a)", "(b)", "(c)", "(d)"]


def test_legends_name_everything_once_and_lie_on_no_curve(figure: Figure) -> None:
    for axes in figure.axes[::2]:
        legend = axes.get_legend()
        names = [text.get_text() for text in legend.get_texts()]
        assert names == ["FSM", "PID", "published mean, FSM"]
        box = legend.get_window_extent()
        for one in axes.get_lines():
            points = axes.transData.transform(np.asarray(one.get_xydata()))
            if len(points) > 2:
                assert not box.count_contains(points)


def test_runs_are_thin_and_the_median_is_thick(figure: Figure) -> None:
    for axes, kind in zip(figure.axes[::2], SIZES, strict=True):
        for i, label in enumerate(("FSM", "PID")):
            np.testing.assert_allclose(thick(axes, label), 1e3 * errors(kind, i, 1))
        thin = [
            np.asarray(one.get_ydata())
            for one in axes.get_lines()
            if one.get_label().startswith("_")
        ]
        expected = [1e3 * errors(kind, i, run) for i in range(2) for run in range(RUNS)]
        np.testing.assert_allclose(thin, expected)


def test_ends_of_the_same_start_are_joined(figure: Figure) -> None:
    for axes, kind in zip(figure.axes[1::2], SIZES, strict=True):
        ends = 1e3 * np.array([[errors(kind, i, run)[-1] for i in range(2)] for run in range(3)])
        lines = [np.asarray(one.get_ydata()) for one in axes.get_lines()]
        np.testing.assert_allclose(lines[:3], ends)
        np.testing.assert_allclose(lines[3:5], ends.T)


def test_the_published_mean_is_that_of_its_kind(figure: Figure) -> None:
    for axes, published in zip(figure.axes, (2.5, 2.5, 22.0, 22.0), strict=True):
        np.testing.assert_allclose(thick(axes, "published mean, FSM"), published)
