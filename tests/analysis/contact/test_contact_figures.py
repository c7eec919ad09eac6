from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.contact.contact_metrics import QUANTITIES
from chamfer.analysis.contact.contact_runs import measure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetMotionScenario,
    AdeptRollerMotionScenario,
    PlanarScenario,
    PlanarSlideScenario,
    PumaRollerMotionScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario

Array = NDArray[np.float64]

TITLES = ["(a) Contact force", "(b) Position along the surface", "(c) Distance from the surface"]


def outcome(scenario: HybridScenario, **columns: Array) -> Outcome:
    """A run as it might have been: contact at 2 s with a spike, lost from 3 s to 3.5 s."""
    time = np.arange(0.0, scenario.duration + 1e-9, 0.005)
    touching = (time >= 2.0) & ~((time >= 3.0) & (time < 3.5))
    force = np.where(touching, scenario.task.force, 0.0)
    force[(time >= 2.0) & (time < 2.05)] = 3 * scenario.task.force
    force += np.where(time > 5.0, 0.2 * np.sin(time), 0.0) * touching
    middle = float(np.array(scenario.task.start) @ scenario.along)
    impact = np.zeros_like(time)
    impact[np.isclose(time, 2.0)] = 0.3
    traces = {
        "time": time,
        "force": force,
        "measured_force": force,
        "peak_force": 1.2 * force,
        "impact_speed": impact,
        "mode": np.select([time < 2.0, touching], [0.0, 1.0], 2.0),
        "position": middle + 0.01 * np.sin(time),
        "position_error": 0.002 * np.cos(time),
        "gap": np.where(touching, -1e-4, 0.01),
    } | columns
    return Outcome(
        metrics=over_trials([measure(scenario, traces)], QUANTITIES),
        traces=traces,
        simulated_seconds=0.0,
    )


def drawn(figure: Figure) -> Figure:
    FigureCanvasAgg(figure)
    figure.canvas.draw()
    return figure


def labels(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def published(figure: Figure) -> list[str]:
    return [text for axes in figure.axes for text in labels(axes) if "published" in text]


DEFAULTS = {
    "planar-hold": PlanarScenario(),
    "planar-slide": PlanarSlideScenario(),
    "puma-roller-motion": PumaRollerMotionScenario(),
    "adept-roller-motion": AdeptRollerMotionScenario(),
    "adept-nugget-motion": AdeptNuggetMotionScenario(),
}


@pytest.mark.parametrize("name", DEFAULTS)
def test_titles_and_labels_with_units(name: str) -> None:
    scenario = DEFAULTS[name]
    figure = plot_contact(name, scenario, outcome(scenario))
    assert [axes.get_title(loc="left") for axes in figure.axes] == TITLES
    force, position, approach = figure.axes
    assert force.get_ylabel() == "force / N"
    assert approach.get_ylabel() == "distance / mm"
    assert approach.get_xlabel() == "time / s"
    along = {"planar-hold": "x", "planar-slide": "x", "puma-roller-motion": "y"}
    along |= {"adept-roller-motion": "x", "adept-nugget-motion": "z"}
    assert position.get_ylabel() == f"{along[name]} from start / mm"
    # The three share their time axis, so that one label is enough.
    assert force.get_shared_x_axes().joined(force, approach)
    assert position.get_shared_x_axes().joined(position, approach)
    assert approach.get_xlim() == (0, scenario.duration)


@pytest.mark.parametrize("name", DEFAULTS)
def test_legends_are_beside_the_data(name: str) -> None:
    scenario = DEFAULTS[name]
    figure = drawn(plot_contact(name, scenario, outcome(scenario)))
    legends = [(axes, axes.get_legend()) for axes in figure.axes]
    assert sum(legend is not None for _, legend in legends) == 2
    for _, legend in legends:
        if legend is None:
            continue
        box = legend.get_window_extent()
        assert box.x1 <= figure.bbox.width
        assert box.y0 >= 0
        for axes in figure.axes:
            inside = axes.get_window_extent()
            assert not box.overlaps(inside)
            assert box.x0 >= inside.x1


def test_published_values_are_drawn_for_the_default_scenario() -> None:
    slide = resolve(PlanarSlideScenario())
    assert published(plot_contact("planar-slide", slide, outcome(slide))) == [
        "published deviation, -0.5 to +0.5 N",
        "published contact, 4.5 s",
        "published error, 3 mm",
    ]
    hold = resolve(PlanarScenario())
    assert published(plot_contact("planar-hold", hold, outcome(hold))) == [
        "published contact, 4.5 s"
    ]
    nugget = resolve(AdeptNuggetMotionScenario())
    assert published(plot_contact("adept-nugget-motion", nugget, outcome(nugget))) == [
        "published deviation, -2.5 to +1 N",
        "published contact, 1 s",
        "published error, 2 mm",
    ]


@pytest.mark.parametrize(
    "values",
    [
        {"duration": 19.0},
        {"task": replace(PlanarSlideScenario().task, amplitude=0.021)},
        {"controller": replace(PlanarSlideScenario().controller, force_integral=2.0)},
        {"measure_after": 7.0},
    ],
)
def test_published_values_are_not_drawn_for_another_scenario(values: dict[str, Any]) -> None:
    scenario = resolve(PlanarSlideScenario(**values))
    assert published(plot_contact("planar-slide", scenario, outcome(scenario))) == []


def test_each_experiment_has_its_own_published_values() -> None:
    scenario = resolve(PlanarSlideScenario())
    assert published(plot_contact("another", scenario, outcome(scenario))) == []


def band(axes: Axes, label: str) -> Array:
    """Corners of a shaded band by the beginning of its label."""
    (found,) = (
        one
        for one in axes.collections
        if isinstance(one, PolyCollection) and str(one.get_label()).startswith(label)
    )
    return np.asarray(found.get_paths()[0].vertices)


def test_the_published_band_lies_about_the_desired_force_where_it_counts() -> None:
    scenario = resolve(AdeptNuggetMotionScenario())
    figure = plot_contact("adept-nugget-motion", scenario, outcome(scenario))
    corners = band(figure.axes[0], "published deviation")
    assert corners[:, 1].min() == pytest.approx(5.0 - 2.5)
    assert corners[:, 1].max() == pytest.approx(5.0 + 1.0)
    assert corners[:, 0].min() == pytest.approx(scenario.measure_after, abs=1e-6)


def test_the_position_is_drawn_from_the_start_in_millimetres() -> None:
    scenario = AdeptRollerMotionScenario()
    run = outcome(scenario)
    position = plot_contact("adept-roller-motion", scenario, run).axes[1]
    lines = {line.get_label(): np.asarray(line.get_ydata()) for line in position.get_lines()}
    time = run.traces["time"]
    np.testing.assert_allclose(lines["actual"], 10 * np.sin(time), atol=1e-9)
    np.testing.assert_allclose(lines["desired"], 10 * np.sin(time) + 2 * np.cos(time), atol=1e-9)
    assert labels(position)[:2] == ["desired", "actual"]


def test_force_and_limits_are_named() -> None:
    scenario = PlanarScenario(duration=8.0)
    force = plot_contact("planar-hold", scenario, outcome(scenario)).axes[0]
    assert labels(force) == [
        "measured",
        "desired, 15 N",
        "scratches glass if sustained, 5 N",
        "contact lost",
    ]


def notes(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def test_a_spike_beyond_the_axis_is_said_in_words() -> None:
    scenario = resolve(PlanarScenario())
    force = plot_contact("planar-hold", scenario, outcome(scenario)).axes[0]
    assert notes(force) == ["peak 54 N"]
    assert force.get_ylim()[1] < 45
    calm = np.full(2401, 15.0)
    quiet = plot_contact(
        "planar-hold", scenario, outcome(scenario, measured_force=calm, peak_force=calm)
    ).axes[0]
    assert notes(quiet) == []


@pytest.mark.parametrize(("speed", "said"), [(0.3, "above"), (0.15, "below")])
def test_the_impact_is_held_against_what_is_safe(speed: float, said: str) -> None:
    scenario = resolve(PlanarScenario())
    impact = np.zeros(2401)
    impact[400] = speed
    approach = plot_contact("planar-hold", scenario, outcome(scenario, impact_speed=impact)).axes[
        2
    ]
    assert notes(approach) == [
        f"impact {speed:g} m/s, {said} the safe 0.2 m/s; damage begins at 0.44 m/s"
    ]


def test_a_run_without_contact_can_be_drawn() -> None:
    scenario = PlanarScenario(duration=1.0)
    nothing = np.zeros(201)
    run = outcome(
        scenario, mode=nothing, impact_speed=nothing, measured_force=nothing, peak_force=nothing
    )
    figure = drawn(plot_contact("planar-hold", scenario, run))
    assert notes(figure.axes[2]) == []
    assert "contact lost" not in labels(figure.axes[0])
