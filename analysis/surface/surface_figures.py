"""The normal of an unknown surface over time, and the force held along it."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import note_stability
from chamfer.analysis.drawing.figure_style import (
    BAND,
    DESIRED,
    FORCE,
    NOTE,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.hybrid_force_position_observer import OBSERVER
from chamfer.analysis.report.checks import Published
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.analysis.surface.normal_metrics import BAND as DEVIATIONS
from chamfer.analysis.surface.normal_metrics import TOLERANCE
from chamfer.diagrams.surface.surface_estimation import EstimationScenario, resolve_estimation
from chamfer.diagrams.surface.surface_scenario import SurfaceScenario
from chamfer.diagrams.surface.surface_tracking import resolve_tracking
from chamfer.diagrams.surface.tracking_scenario import TrackingScenario

TRUTH: Final[Style] = {"color": "#111111", "linestyle": (0, (5, 2)), "linewidth": 1.3}
ESTIMATE: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.3}
UNCERTAIN: Final[Style] = {"color": "#6fa0e8", "alpha": 0.35, "linewidth": 0}
SAMPLE: Final[Style] = {"color": "#b5b5b5", "linestyle": "", "marker": ".", "markersize": 2.5}
_BESIDE = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
_MARGIN: Final = 6.0  # deg, around estimate and band; single samples may be anywhere


def plot_estimation(experiment: str, scenario: EstimationScenario, outcome: Outcome) -> Figure:
    """Draw a run that is only observed: position of the contact point, and the normal."""
    default = resolve_estimation(type(scenario)())
    published = _published(experiment, scenario == default)
    figure = new_figure(11.0, 6.5)
    position, normal = figure.subplots(2, 1, sharex=True, height_ratios=(2, 4))
    _position(position, scenario, outcome.traces)
    _normal(normal, scenario, outcome.traces, published)
    halt = scenario.lead.halt
    if halt < scenario.duration:
        for axes in (position, normal):
            axes.axvline(halt, color="#555555", linewidth=0.8, linestyle=":")
        normal.annotate("halt", (halt, normal.get_ylim()[0]), xytext=(3, 4), **_OFFSET, **NOTE)
    normal.set_xlim(0, scenario.duration)
    return figure


def plot_tracking(experiment: str, scenario: TrackingScenario, outcome: Outcome) -> Figure:
    """Draw a controlled run: force, position of the contact point, and the normal."""
    default = resolve_tracking(type(scenario)())
    published = _published(experiment, scenario == default)
    figure = new_figure(11.0, 8.5)
    force, position, normal = figure.subplots(3, 1, sharex=True, height_ratios=(4, 2, 4))
    _force(force, scenario, outcome.traces, published)
    _position(position, scenario, outcome.traces)
    _normal(normal, scenario, outcome.traces, published)
    normal.set_xlim(0, scenario.duration)
    note_stability(figure, outcome)
    return figure


_OFFSET: Final = {"textcoords": "offset points"}


def _published(experiment: str, default: bool) -> dict[str, Published]:
    """Return the published numbers by metric; they are those of the default scenario only."""
    if not default:
        return {}
    return {one.metric: one for one in OBSERVER if one.experiment == experiment}


def _force(
    axes: Axes, scenario: TrackingScenario, traces: Table, published: dict[str, Published]
) -> None:
    time, desired = traces["time"], scenario.task.force
    off = TOLERANCE * desired
    axes.fill_between(
        time, desired - off, desired + off, label=f"within {100 * TOLERANCE:g} %", **BAND
    )
    axes.plot(time, traces["force"], label="true normal force", **FORCE)
    axes.axhline(desired, label=f"desired, {desired:g} N", **DESIRED)
    for metric in ("force.min", "force.max"):
        value = published[metric].value if metric in published else None
        if value is not None:
            name = "least" if metric == "force.min" else "largest"
            axes.axhline(value, label=f"published {name}, {value:g} N", **PUBLISHED)
    dress(axes, title="Contact force (first seed)", x="", y="force / N")
    legend(axes, **_BESIDE)


def _position(axes: Axes, scenario: SurfaceScenario, traces: Table) -> None:
    colors: Sequence[str] = ("#1b4f9c", "#e07b00", "#2e7d32")
    for axis, color in zip("xyz"[: scenario.dimension], colors, strict=False):
        axes.plot(
            traces["time"],
            traces[f"nominal_{axis}"],
            color=color,
            linewidth=0.9,
            linestyle=":",
            label=f"{axis}, nominal",
        )
        axes.plot(traces["time"], traces[f"point_{axis}"], color=color, linewidth=1.4, label=axis)
    dress(axes, title="Contact point", x="", y="position / m")
    legend(axes, **_BESIDE, ncols=1)


def _normal(
    axes: Axes, scenario: SurfaceScenario, traces: Table, published: dict[str, Published]
) -> None:
    every = max(1, round(scenario.observer.period / (traces["time"][1] - traces["time"][0])))
    time, band = traces["time"], traces["band"]
    if "angle" in traces:
        estimate, truth = traces["angle"], traces["true_angle"]
        axes.plot(time[::every], traces["instantaneous"][::every], label="single sample", **SAMPLE)
        axes.plot(time, truth, label="true normal", **TRUTH)
        title, unit = "Surface normal", "angle above x / °"
        low, high = estimate - band, estimate + band
    else:
        estimate, truth = traces["error"], np.zeros(len(time))
        title, unit = "Angle between estimated and true normal", "angle / °"
        low, high = np.zeros(len(time)), band
    axes.fill_between(time, low, high, label=f"{DEVIATIONS:g} standard deviations", **UNCERTAIN)
    axes.plot(time, estimate, label=f"estimate, {scenario.observer.kind}", **ESTIMATE)
    for metric, window in (("band.equilibrium", (8.0, 14.9)), ("band.mean", (1.0, 15.0))):
        _published_band(axes, published.get(metric), window, time, truth)
    if "band.final" in published:
        _published_band(axes, published["band.final"], (time[-1] - 0.1, time[-1]), time, truth)
    axes.set_ylim(float(np.min(low)) - _MARGIN, float(np.max(high)) + _MARGIN)
    dress(axes, title=f"{title} (first seed)", x="time / s", y=unit)
    legend(axes, **_BESIDE)


def _published_band(
    axes: Axes,
    published: Published | None,
    window: tuple[float, float],
    time: np.ndarray,
    truth: np.ndarray,
) -> None:
    if published is None or not published.value or published.relation != "near":
        return  # a band of 0 is the line of the truth
    rows = (time >= window[0]) & (time <= window[1])
    value = published.value
    for sign, label in ((1, f"published band, ±{value:g}°"), (-1, None)):
        axes.plot(time[rows], truth[rows] + sign * value, label=label, **PUBLISHED)
