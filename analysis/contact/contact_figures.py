"""Force and position over time, like the thesis' figures, with published values and limits."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from chamfer.analysis.drawing import figure_style
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_lines,
    metric_value,
    shade,
)
from chamfer.analysis.drawing.figure_style import (
    BAND,
    CONTACT_LOST,
    DESIRED,
    FORCE,
    LIMIT,
    NOTE,
    POSITION,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import Published
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    ADEPT_NUGGET_MOTION,
    ADEPT_ROLLER_HOLD,
    ADEPT_ROLLER_MOTION,
    PLANAR_HOLD,
    PLANAR_SLIDE,
    PLANAR_SLIDE_LATE,
    PUMA_NUGGET_HOLD,
    PUMA_NUGGET_MOTION,
    PUMA_ROLLER_HOLD,
    PUMA_ROLLER_MOTION,
    PUMA_ROLLER_MOTION_SOFT,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.models.surfaces.damage import SAFE_SPEED, SCRATCH_FORCE, impact_speed_limit
from chamfer.systems.force.contact_detection_law import LOST

_LEAST_HEIGHT = 0.02  # mm, of the position's axis
_ABOVE = 1.3  # of the largest force drawn, the axis' end


def plot_contact(
    experiment: str, default: HybridScenario, scenario: HybridScenario, outcome: Outcome
) -> dict[str, Figure]:
    """Draw a run: force, position along the motion, distance from the surface.

    Published values are drawn with ``default``, the experiment's scenario as written, alone; the
    figure's file is called as the ``experiment``.
    """
    published = [value for value in PUBLISHED if value.experiment == experiment]
    if scenario != fill(default):
        published = []
    metrics = outcome.metrics
    off, peak = (metric_value(metrics, f"force.{of}") for of in ("deviation", "peak"))
    desired, after = scenario.task.force, scenario.measure_after
    within = (
        f"within {off:.2g} N of {desired:g} N" if off < desired else f"off by up to {off:.2g} N"
    )
    figure = new_figure(
        height=8.5,
        caption=f"The contact force is {within} after {after:g} s; its peak is {peak:.3g} N. "
        "Below: position along the surface and distance from it.",
    )
    force, position, approach = figure.subplots(3, 1, sharex=True, height_ratios=(3, 3, 2))
    traces = outcome.traces
    _force(force, scenario, traces, published, f"(a) Force {within} after {after:g} s")
    lag = metric_value(metrics, "position.lag_error", 1e3)
    said = f"(b) Position error up to {lag:.2g} mm after {after:g} s"
    said = said if np.isfinite(lag) else "(b) Position along the surface"
    _position(position, scenario, traces, published, said)
    _approach(approach, scenario, outcome)
    low, high = position.get_ylim()
    if high - low < _LEAST_HEIGHT:  # rounding of a position that is held
        position.set_ylim(-_LEAST_HEIGHT / 2, _LEAST_HEIGHT / 2)
    approach.set_xlim(0, scenario.duration)
    note_stability(figure, outcome)
    return {experiment: figure}


planar_hold = partial(plot_contact, "planar-hold", PLANAR_HOLD)
planar_slide = partial(plot_contact, "planar-slide", PLANAR_SLIDE)
planar_slide_late = partial(plot_contact, "planar-slide-late", PLANAR_SLIDE_LATE)
puma_roller_hold = partial(plot_contact, "puma-roller-hold", PUMA_ROLLER_HOLD)
puma_roller_motion = partial(plot_contact, "puma-roller-motion", PUMA_ROLLER_MOTION)
puma_roller_motion_soft = partial(plot_contact, "puma-roller-motion-soft", PUMA_ROLLER_MOTION_SOFT)
puma_nugget_hold = partial(plot_contact, "puma-nugget-hold", PUMA_NUGGET_HOLD)
puma_nugget_motion = partial(plot_contact, "puma-nugget-motion", PUMA_NUGGET_MOTION)
adept_roller_hold = partial(plot_contact, "adept-roller-hold", ADEPT_ROLLER_HOLD)
adept_roller_motion = partial(plot_contact, "adept-roller-motion", ADEPT_ROLLER_MOTION)
adept_nugget_hold = partial(plot_contact, "adept-nugget-hold", ADEPT_NUGGET_HOLD)
adept_nugget_motion = partial(plot_contact, "adept-nugget-motion", ADEPT_NUGGET_MOTION)


def _force(
    axes: Axes,
    scenario: HybridScenario,
    traces: Table,
    published: Sequence[Published],
    title: str,
) -> None:
    time, desired = traces["time"], scenario.task.force
    after = time >= scenario.measure_after
    band = _published_band(published)
    if band is not None:
        label = f"published deviation, {band[0]:+g} to {band[1]:+g} N"
        axes.fill_between(time[after], desired + band[0], desired + band[1], label=label, **BAND)
    levels = [ReferenceLine(desired, f"desired, {desired:g} N", DESIRED)]
    for value in published:
        if value.metric == "contact_time" and value.value is not None:
            label = f"published contact, {value.value:g} s"
            levels.append(ReferenceLine(value.value, label, figure_style.PUBLISHED, upright=True))
    label = f"scratches glass, {SCRATCH_FORCE:g} N sustained"
    levels.append(ReferenceLine(SCRATCH_FORCE, label, LIMIT))
    shade_losses(axes, traces)
    measured = [Curve(traces["measured_force"], "measured", FORCE)]
    draw_lines(axes, time, measured, title=title, y="force / N", over="", levels=levels)
    legend(axes, ncols=3)
    regular = float(np.max(traces["measured_force"][after], initial=desired))
    top = _ABOVE * max(regular, desired)
    peak = float(traces["measured_force"].max())
    if peak > top:
        axes.annotate(
            f"peak {float(traces['peak_force'].max()):.3g} N",
            (float(time[np.argmax(traces["measured_force"])]), top),
            textcoords="offset points",
            xytext=(6, -12),
            **NOTE,
        )
    axes.set_ylim(min(-0.05 * top, float(traces["measured_force"].min())), top)


def _published_band(published: Sequence[Published]) -> tuple[float, float] | None:
    values = {
        one.metric: one.value
        for one in published
        if one.value is not None and one.relation == "near"
    }
    if "force.deviation" in values:
        return -values["force.deviation"], values["force.deviation"]
    if "force.above" in values and "force.below" in values:
        return values["force.below"], values["force.above"]
    return None


def _position(
    axes: Axes,
    scenario: HybridScenario,
    traces: Table,
    published: Sequence[Published],
    title: str,
) -> None:
    middle = 1e3 * float(np.array(scenario.task.start) @ scenario.along)
    actual = 1e3 * traces["position"] - middle
    desired = actual + 1e3 * traces["position_error"]
    bands = []
    for value in published:
        if value.metric == "position.lag_error" and value.value is not None:
            off = 1e3 * value.value
            bands.append(FilledBand(desired - off, desired + off, f"published error, {off:g} mm"))
    names = dict(zip(scenario.ARM.coordinates, scenario.along, strict=True))
    which = " ".join(name for name, part in names.items() if part)
    draw_lines(
        axes,
        traces["time"],
        [Curve(desired, "desired", DESIRED), Curve(actual, "actual", POSITION)],
        title=title,
        y=f"{which} from start / mm",
        over="",
        bands=bands,
    )
    legend(axes, ncols=3)


def _approach(axes: Axes, scenario: HybridScenario, outcome: Outcome) -> None:
    traces = outcome.traces
    axes.plot(traces["time"], 1e3 * traces["gap"], label="distance", **POSITION)
    axes.axhline(0.0, **DESIRED)
    shade_losses(axes, traces)
    impact = outcome.metrics["impact.speed"].value
    if impact is not None:
        against = "above" if impact > SAFE_SPEED else "below"
        axes.annotate(
            f"impact {impact:.3g} m/s, {against} the safe {SAFE_SPEED:g} m/s; "
            f"damage begins at {impact_speed_limit(scenario.task.nugget_mass):g} m/s",
            (0.99, 0.9),
            xycoords="axes fraction",
            ha="right",
            va="top",
            **NOTE,
        )
    axes.set_yscale("symlog", linthresh=1.0)
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())
    losses = metric_value(outcome.metrics, "contact.losses")
    lost = {0.0: "no contact is lost", 1.0: "contact is lost once"}
    said = lost.get(losses, f"contact is lost {losses:.2g} times")
    title = f"(c) Distance from the surface: {said}" if np.isfinite(losses) else "(c) Distance"
    dress(axes, title=title, x="time / s", y="distance / mm")


def shade_losses(axes: Axes, traces: Table) -> None:
    """Shade the times at which contact was lost."""
    shade(axes, traces["time"], traces["mode"] == LOST, "contact lost", CONTACT_LOST)


def note_stability(figure: Figure, outcome: Outcome) -> None:
    """Write growth and margins, the metrics of ``loop``."""
    found = {
        name.removeprefix("loop."): metric
        for name, metric in outcome.metrics.items()
        if name.startswith("loop.")
    }
    if not found:
        return
    grows = max(found[name].value or 0.0 for name in found if name.startswith("growth"))
    gain, delay = found["gain_margin"].value, found["delay_margin"].value
    parts = (
        f"unstable, grows at {grows:.3g} 1/s" if grows else "stable",
        "no gain margin" if gain is None else f"gain margin {gain:.3g}",
        "no delay margin" if delay is None else f"delay margin {1e3 * delay:.3g} ms",
    )
    where = found["delay_margin"].note.removeprefix("of the torque; ")
    figure.supxlabel(
        f"linear loop: {', '.join(parts)} ({where})",
        x=0.01,
        ha="left",
        fontsize=8,
        color="#b00020" if grows else "#333333",
    )
