from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.surface.unknown_surface import plot_estimation, plot_tracking
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LargeNoiseEstimationScenario,
    NoiseFreeEstimationScenario,
    SmoothEstimationScenario,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, SurfaceSettings
from chamfer.diagrams.surface.surface_tracking import (
    TrackingScenario,
    TrackingTask,
    resolve_tracking,
)

Array = NDArray[np.float64]

LED, CONTROLLED = EstimationScenario(), TrackingScenario()
SPACE = SurfaceSettings(shape="sphere")


def outcome(scenario: EstimationScenario | TrackingScenario, **columns: Array) -> Outcome:
    """A run as it might have been: the normal turns by 12 degrees, the estimate lags by 2."""
    period = 0.005 if isinstance(scenario, TrackingScenario) else 0.05
    time = period * np.arange(round(scenario.duration / period) + 1)
    flat = np.ones_like(time)
    traces = {
        "time": time,
        "force": 5.0 + np.sin(time),
        "error": -2.0 * flat,
        "band": 6.0 * flat,
    }
    if scenario.dimension == 2:
        truth = 90.0 + 12.0 * time / scenario.duration
        traces |= {"angle": truth - 2.0, "true_angle": truth, "instantaneous": truth + 30.0}
    else:
        traces["error"] = 2.0 * flat
    for i, axis in enumerate("xyz"[: scenario.dimension]):
        traces[f"point_{axis}"] = i + 0.2 * time
        traces[f"nominal_{axis}"] = i + 0.3 * time
    return Outcome(metrics={}, traces=traces | columns, simulated_seconds=0.0)


def led(
    name: str = "surface-estimation", scenario: EstimationScenario = LED, **columns: Array
) -> Figure:
    resolved = resolve_estimation(scenario)
    return plot_estimation(name, resolved, outcome(resolved, **columns))


def controlled(
    name: str = "unknown-surface-control", scenario: TrackingScenario = CONTROLLED
) -> Figure:
    resolved = resolve_tracking(scenario)
    return plot_tracking(name, resolved, outcome(resolved))


def labels(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def published(figure: Figure) -> list[str]:
    return [text for axes in figure.axes for text in labels(axes) if "published" in text]


def line(axes: Axes, label: str) -> tuple[Array, Array]:
    (found,) = (one for one in axes.get_lines() if one.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def edges(axes: Axes, label: str) -> Array:
    """Corners of a shaded band."""
    (found,) = (
        one
        for one in axes.collections
        if isinstance(one, PolyCollection) and str(one.get_label()).startswith(label)
    )
    return np.asarray(found.get_paths()[0].vertices)


def test_titles_and_labels_with_units() -> None:
    for figure, titles, units in (
        (led(), ["Contact point", "Surface normal (first seed)"], ["position / m"]),
        (
            controlled(),
            ["Contact force (first seed)", "Contact point", "Surface normal (first seed)"],
            ["force / N", "position / m"],
        ),
    ):
        assert [axes.get_title(loc="left") for axes in figure.axes] == titles
        assert [axes.get_ylabel() for axes in figure.axes] == [*units, "angle above x / °"]
        assert figure.axes[-1].get_xlabel() == "time / s"
        for axes in figure.axes[:-1]:
            assert axes.get_shared_x_axes().joined(axes, figure.axes[-1])
    assert led().axes[-1].get_xlim() == (0, 20)
    assert controlled().axes[-1].get_xlim() == (0, 10)


@pytest.mark.parametrize("figure", [led, controlled])
def test_legends_are_beside_the_data(figure: Any) -> None:
    drawn = figure()
    FigureCanvasAgg(drawn)
    drawn.canvas.draw()
    for axes in drawn.axes:
        box = axes.get_legend().get_window_extent()
        assert box.x0 >= axes.get_window_extent().x1
        assert box.x1 <= drawn.bbox.width
        assert box.y0 >= 0


def test_truth_estimate_and_band_are_those_of_the_run() -> None:
    normal = led().axes[1]
    time, truth = line(normal, "true normal")
    np.testing.assert_allclose(truth, 90 + 12 * time / 20)
    np.testing.assert_allclose(line(normal, "estimate, thesis")[1], truth - 2)
    np.testing.assert_allclose(line(normal, "single sample")[1], truth + 30)
    corners = edges(normal, "3 standard deviations")
    assert corners[:, 1].min() == pytest.approx(88 - 6)
    assert corners[:, 1].max() == pytest.approx(100 + 6)
    # Estimate and band are all there, whatever single samples do.
    low, high = normal.get_ylim()
    assert low == pytest.approx(88 - 6 - 6)
    assert high == pytest.approx(100 + 6 + 6)
    kind = replace(LED, observer=ObserverSettings(kind="adaptive"))
    assert "estimate, adaptive" in labels(led(scenario=kind).axes[1])


def test_single_samples_are_drawn_once_a_sample_of_the_observer() -> None:
    assert len(line(led().axes[1], "single sample")[0]) == 401
    time, _ = line(controlled().axes[2], "single sample")
    np.testing.assert_allclose(time, 0.05 * np.arange(201))


def test_points_are_drawn_with_where_the_gripper_would_be() -> None:
    for figure, axes in ((led(), "xy"), (led(scenario=replace(LED, surface=SPACE)), "xyz")):
        position = figure.axes[0]
        assert labels(position) == [text for axis in axes for text in (f"{axis}, nominal", axis)]
        for i, axis in enumerate(axes):
            time, point = line(position, axis)
            np.testing.assert_allclose(point, i + 0.2 * time)
            np.testing.assert_allclose(line(position, f"{axis}, nominal")[1], i + 0.3 * time)


def test_in_space_the_error_is_drawn() -> None:
    for figure in (
        led(scenario=replace(LED, surface=SPACE)),
        controlled(scenario=replace(CONTROLLED, surface=SPACE)),
    ):
        normal = figure.axes[-1]
        title = "Angle between estimated and true normal (first seed)"
        assert normal.get_title(loc="left") == title
        assert normal.get_ylabel() == "angle / °"
        np.testing.assert_array_equal(line(normal, "estimate, thesis")[1], 2.0)
        corners = edges(normal, "3 standard deviations")
        assert (corners[:, 1].min(), corners[:, 1].max()) == (0, 6)
        assert "true normal" not in labels(normal)
        assert published(figure) == []


def test_the_halt_is_marked_if_it_is_in_the_run() -> None:
    def halts(figure: Figure) -> list[float]:
        return [
            float(np.asarray(one.get_xdata())[0])
            for axes in figure.axes
            for one in axes.get_lines()
            if len(np.asarray(one.get_xdata())) == 2
        ]

    figure = led()
    assert halts(figure) == [15.0, 15.0]
    assert [text.get_text() for text in figure.axes[1].texts] == ["halt"]
    short = led(scenario=replace(LED, duration=10.0))
    assert halts(short) == []
    assert not short.axes[1].texts


@pytest.mark.parametrize(
    ("name", "scenario", "value", "window"),
    [
        ("surface-estimation", LED, 6.0, (8.0, 14.9)),
        ("surface-estimation-smooth", SmoothEstimationScenario(), 3.0, (1.0, 15.0)),
        ("surface-estimation-large-noise", LargeNoiseEstimationScenario(), 20.0, (3.4, 3.5)),
    ],
)
def test_the_published_band_is_about_the_true_normal_where_it_counts(
    name: str, scenario: EstimationScenario, value: float, window: tuple[float, float]
) -> None:
    figure = led(name, scenario)
    assert published(figure) == [f"published band, ±{value:g}°"]
    normal = figure.axes[1]
    time, above = line(normal, f"published band, ±{value:g}°")
    assert (time[0], time[-1]) == (
        pytest.approx(window[0], abs=0.051),
        pytest.approx(window[1], abs=0.051),
    )
    np.testing.assert_allclose(above, 90 + 12 * time / scenario.duration + value)
    below = 90 + 12 * time / scenario.duration - value
    assert any(
        len(np.asarray(one.get_ydata())) == len(below) and np.allclose(one.get_ydata(), below)
        for one in normal.get_lines()
    )


def test_published_forces_are_drawn() -> None:
    figure = controlled()
    forces = ["published least, 4.5 N", "published largest, 5.2 N"]
    assert published(figure) == [*forces, "published band, ±6°"]
    for label, value in zip(forces, (4.5, 5.2), strict=True):
        np.testing.assert_array_equal(line(figure.axes[0], label)[1], value)


@pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("surface-estimation", replace(LED, trials=39)),
        ("surface-estimation", replace(LED, observer=ObserverSettings(kind="gated"))),
        ("another", LED),
        ("surface-estimation-noise-free", NoiseFreeEstimationScenario()),
    ],
)
def test_published_bands_are_of_the_default_scenario_and_the_experiment(
    name: str, scenario: EstimationScenario
) -> None:
    assert published(led(name, scenario)) == []


@pytest.mark.parametrize(
    ("name", "scenario"),
    [
        ("unknown-surface-control", replace(CONTROLLED, task=TrackingTask(force=4.0))),
        ("another", CONTROLLED),
    ],
)
def test_published_forces_are_of_the_default_scenario_and_the_experiment(
    name: str, scenario: TrackingScenario
) -> None:
    assert published(controlled(name, scenario)) == []


def test_force_is_drawn_with_what_is_desired() -> None:
    scenario = replace(CONTROLLED, task=TrackingTask(force=4.0))
    force = controlled(scenario=scenario).axes[0]
    assert labels(force) == ["within 10 %", "true normal force", "desired, 4 N"]
    corners = edges(force, "within 10 %")
    assert (corners[:, 1].min(), corners[:, 1].max()) == (pytest.approx(3.6), pytest.approx(4.4))
    time, drawn = line(force, "true normal force")
    np.testing.assert_allclose(drawn, 5 + np.sin(time))
    np.testing.assert_array_equal(line(force, "desired, 4 N")[1], 4.0)


def test_a_run_without_contact_can_be_drawn() -> None:
    nothing = np.full(401, np.nan)
    figure = led(true_angle=nothing, error=nothing, instantaneous=nothing)
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    assert np.all(np.isfinite(figure.axes[1].get_ylim()))
