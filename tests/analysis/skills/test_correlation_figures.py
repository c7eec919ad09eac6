import math

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.analysis.skills.correlation_figures import plot_correlation

Array = NDArray[np.float64]

CASES = ("free", "constrained", "one_sided", "noisy", "biased")
SAMPLES = 20


def outcome(undefined: str = "") -> Outcome:
    phase = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    table = {"sample": np.arange(float(SAMPLES)), "command": 0.006 * np.cos(phase)}
    for i, name in enumerate(CASES):
        table[f"{name}_motion"] = 0.001 * (i + 1) * np.cos(phase)
        table[f"{name}_later"] = 0.001 * (i + 1) * np.sin(phase)
    return Outcome(
        metrics={
            f"theory.{name}": Metric(value=None if name == undefined else 0.1 * (i + 1), unit="")
            for i, name in enumerate(CASES)
        },
        traces={"cycle": np.arange(4.0)}
        | {name: 0.1 * (i + 1) + 0.01 * np.arange(4) for i, name in enumerate(CASES)},
        simulated_seconds=1.0,
        tables={"cycles": table},
    )


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    return figure


@pytest.fixture(scope="module")
def figure() -> Figure:
    return drawn(plot_correlation(SAMPLES, outcome()))


def labels(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def line(axes: Axes, label: str) -> tuple[Array, Array]:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_labels_have_units(figure: Figure) -> None:
    *cases, values = figure.axes
    assert [axes.get_xlabel() for axes in cases] == 5 * ["phase / deg"]
    assert [axes.get_ylabel() for axes in cases] == [
        "velocity / (mm/s)",
        "",
        "",
        "velocity / (mm/s)",
        "",
    ]
    assert values.get_ylabel() == "C"
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        "(a) Free",
        "(b) Spring on both sides",
        "(c) Stop on one side",
        "(d) Noisy force sensor",
        "(e) Biased force sensor",
        "(f) Correlation, window by window",
    ]


def test_a_cycle_of_every_case_is_drawn_in_degrees_and_millimetres_a_second(
    figure: Figure,
) -> None:
    table = outcome().tables["cycles"]
    for name, axes in zip(CASES, figure.axes[:5], strict=True):
        phase, command = line(axes, "commanded")
        np.testing.assert_allclose(phase, 18.0 * np.arange(SAMPLES))
        np.testing.assert_allclose(command, 1e3 * table["command"])
        for label, key in (("first", "motion"), ("third", "later")):
            _, motion = line(axes, f"motion, {label} cycle")
            np.testing.assert_allclose(motion, 1e3 * table[f"{name}_{key}"])
    assert labels(figure.axes[0]) == ["commanded", "motion, first cycle", "motion, third cycle"]


def test_every_case_has_its_windows_and_its_theory_in_its_place(figure: Figure) -> None:
    values = figure.axes[5]
    ticks = [text.get_text() for text in values.get_xticklabels()]
    assert ticks == ["free", "both", "one", "noisy", "biased"]
    _, free = line(values, r"published: $\pi^2/8$")
    np.testing.assert_allclose(free, math.pi**2 / 8)
    drawn_lines = [(np.asarray(one.get_xdata()), one.get_ydata()) for one in values.get_lines()]
    for i in range(len(CASES)):
        (windows,) = (
            y for x, y in drawn_lines if len(x) == 4 and np.abs(x - i).max() <= 0.25 + 1e-9
        )
        np.testing.assert_allclose(windows, 0.1 * (i + 1) + 0.01 * np.arange(4))
        (theory,) = (y for x, y in drawn_lines if len(x) == 1 and x[0] == i)
        np.testing.assert_allclose(theory, 0.1 * (i + 1))
    assert labels(values) == [r"published: $\pi^2/8$", "windows", "theory"]


def test_a_theory_without_a_value_is_left_out() -> None:
    values = drawn(plot_correlation(SAMPLES, outcome(undefined="noisy"))).axes[5]
    marks = [
        float(x[0]) for one in values.get_lines() if len(x := np.asarray(one.get_xdata())) == 1
    ]
    assert marks == [0.0, 1.0, 2.0, 4.0]
