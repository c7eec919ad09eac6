"""What is drawn of a run in contact, and said of its loop's stability."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.contact.contact_figures import note_stability, plot_contact
from chamfer.analysis.contact.contact_metrics import QUANTITIES, stability_metrics
from chamfer.analysis.contact.contact_runs import measure
from chamfer.analysis.drawing.figure_style import new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_MOTION,
    PLANAR_HOLD,
    PLANAR_SLIDE,
    PlanarScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import Stability, resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario


def outcome(scenario: HybridScenario, *, touches: bool = True) -> Outcome:
    """A run as it might have been: contact at 2 s, lost from 3 s to 3.5 s; or none."""
    time = np.arange(0.0, scenario.duration + 1e-9, 0.005)
    touching = (time >= 2.0) & ~((time >= 3.0) & (time < 3.5)) & touches
    force = scenario.task.force * touching
    traces = {
        "time": time,
        "force": force,
        "measured_force": force,
        "peak_force": 1.2 * force,
        "impact_speed": 0.3 * np.isclose(time, 2.0) * touches,
        "mode": np.select([time < 2.0, touching], [0.0, 1.0], 2.0) * touches,
        "position": 0.01 * np.sin(time),
        "position_error": 0.002 * np.cos(time),
        "gap": np.where(touching, -1e-4, 0.01),
    }
    metrics = over_trials([measure(scenario, traces)], QUANTITIES)
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=0.0)


def labels(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def published(figure: Figure) -> list[str]:
    return [text for axes in figure.axes for text in labels(axes) if "published" in text]


DEFAULTS = {
    "planar-hold": PLANAR_HOLD,
    "planar-slide": PLANAR_SLIDE,
    "adept-nugget-motion": ADEPT_NUGGET_MOTION,
}


def drawing(name: str, scenario: HybridScenario, *, touches: bool = True) -> Figure:
    run = outcome(scenario, touches=touches)
    return plot_contact(name, DEFAULTS[name], scenario, run)[name]


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("planar-slide", ["deviation, -0.5 to +0.5 N", "contact, 4.5 s", "error, 3 mm"]),
        ("planar-hold", ["contact, 4.5 s"]),
        ("adept-nugget-motion", ["deviation, -2.5 to +1 N", "contact, 1 s", "error, 2 mm"]),
    ],
)
def test_published_values_are_drawn_for_the_default_scenario(name: str, said: list[str]) -> None:
    figure = drawing(name, resolve(DEFAULTS[name]))
    assert published(figure) == [f"published {one}" for one in said]


@pytest.mark.parametrize(
    "values",
    [
        {"duration": 19.0},
        {"task": replace(PLANAR_SLIDE.task, amplitude=0.021)},
    ],
)
def test_published_values_are_not_drawn_for_another_scenario(values: dict[str, Any]) -> None:
    scenario = resolve(replace(PLANAR_SLIDE, **values))
    assert published(drawing("planar-slide", scenario)) == []


def test_a_run_without_contact_can_be_drawn() -> None:
    figure = drawing("planar-hold", PlanarScenario(duration=1.0), touches=False)
    figure.draw_without_rendering()
    assert not figure.axes[2].texts
    assert "contact lost" not in labels(figure.axes[0])


FOUND = Stability(
    growth=1e-9,
    growth_contact=0.0,
    gain_margin=1.25,
    delay_margin=0.0031,
    least_gain="contact",
    least_delay="the approach's end",
)


def noted(found: Stability) -> str:
    figure = new_figure()
    note_stability(
        figure, Outcome(metrics=stability_metrics(found), traces={}, simulated_seconds=0.0)
    )
    return figure.get_supxlabel()


def test_what_is_said_of_the_loops_stability() -> None:
    metrics = stability_metrics(FOUND)
    assert {name: metric.value for name, metric in metrics.items()} == {
        "loop.growth": 0.0,
        "loop.growth_contact": 0.0,
        "loop.gain_margin": 1.25,
        "loop.delay_margin": 0.0031,
    }
    assert noted(FOUND) == (
        "linear loop: stable, gain margin 1.25, delay margin 3.1 ms (the approach's end)"
    )
    grows = FOUND._replace(growth_contact=4.93, gain_margin=0.36, delay_margin=0.0)
    assert noted(grows).startswith("linear loop: unstable, grows at 4.93 1/s, gain margin 0.36")
    always = FOUND._replace(growth=None, delay_margin=None, least_delay="")
    assert "loop.growth" not in stability_metrics(always)
    assert noted(always).endswith("no delay margin (none up to 10 periods)")
