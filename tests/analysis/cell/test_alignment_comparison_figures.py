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
