"""Figs. 8 and 9 with the published values drawn in."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_lines,
    metric_value,
)
from chamfer.analysis.drawing.figure_style import DESIRED, LOOPS, NOTE, PUBLISHED, new_figure
from chamfer.analysis.published.fsm_visual_servoing import OVERSHOOT, RISE_TIME
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.servo.servo_scenario import STEP, ResolvedServoScenario, resolve

_SWEPT = ("pid", "fsm", "fsm_compensation")
_OTHERS = ("fsm_feedforward", "fsm_velocity", "pid_position", "pid_command")
_ERROR, _RESPONSE = "desired minus actual / mm", "trajectory / m"


def plot_step(scenario: ResolvedServoScenario, outcome: Outcome) -> Figure:
    """Draw Fig. 8: the responses, the PID's rise, the errors at the end, the other plants."""
    figure = new_figure()
    overview, rise, errors, others = figure.subplots(2, 2).ravel()
    time, height = outcome.traces["time"], scenario.desired.amplitude
    lines = [_desired(outcome), *_responses(outcome, "pid", "fsm")]
    draw_lines(overview, time, lines, title="(a) Step response", y=_RESPONSE, key="lower right")
    _step_rise(rise, scenario, outcome)
    zone, lines = _dead_zone(scenario), _errors(outcome, "pid", "fsm", "fsm_velocity")
    title = "(c) The error that remains"
    draw_lines(
        errors, time, lines, title=title, y=_ERROR, bands=[zone], key="lower left", columns=2
    )
    errors.set_ylim(-6e3 * scenario.fsm.dead_zone, 6e3 * scenario.fsm.dead_zone)
    lines = [_desired(outcome, None), *_responses(outcome, *_OTHERS, beyond=3.0 * abs(height))]
    title = "(d) The same controllers on the other plants"
    draw_lines(others, time, lines, title=title, y=_RESPONSE, key="upper right", columns=2)
    growth = outcome.metrics["pid_command.growth_rate"].value
    if growth:
        others.text(0.06, 2.1 * height, f"unstable, {growth:.3g} 1/s", fontsize=8)
    others.set_ylim(*sorted((-0.6 * height, 3.4 * height)))
    others.set_xlim(0, min(1.0, float(time[-1])))
    return figure


def _step_rise(axes: Axes, scenario: ResolvedServoScenario, outcome: Outcome) -> None:
    traces, metrics = outcome.traces, outcome.metrics
    time, lines = traces["time"], _responses(outcome, "pid", "fsm")
    rise = metric_value(metrics, "pid.rise_time")
    title, over = "(b) The PID's rise and overshoot", "time / ms"
    if not np.isfinite(rise):
        draw_lines(axes, 1e3 * time, lines, title=title, y=_RESPONSE, over=over)
        axes.text(0.05, 0.9, "the PID loop does not settle", transform=axes.transAxes, **NOTE)
        return
    final = scenario.desired.amplitude - (metrics["pid.steady_state_error"].value or 0.0)
    levels = [ReferenceLine(final, None, {"color": "#999999", "linewidth": 0.8})]
    if scenario == resolve(STEP):  # the published values are of no other
        peak = final * (1 + OVERSHOOT / 100)
        levels.append(ReferenceLine(peak, f"published overshoot {OVERSHOOT:g} %", PUBLISHED))
        response = traces["pid.actual_trajectory"]
        start = float(np.interp(0.1, np.maximum.accumulate(response / final), time))
        end = (start + RISE_TIME) * 1e3
        bar = {"arrowstyle": "|-|", "color": PUBLISHED["color"], "mutation_scale": 3}
        axes.annotate("", (end, 0.9 * final), (start * 1e3, 0.9 * final), arrowprops=bar)
        said = f"published rise time {RISE_TIME * 1e3:g} ms\nmeasured {rise * 1e3:.3g} ms"
        axes.text(end * 1.15, 0.85 * final, said, **NOTE)
    draw_lines(
        axes,
        1e3 * time,
        lines,
        title=title,
        y=_RESPONSE,
        over=over,
        levels=levels,
        key="center right",
    )
    axes.set_xlim(0, 8e3 * rise)
    axes.text(8e3 * rise, 0.95 * final, f"final {final:.3f} m ", ha="right", fontsize=8)


def plot_sinusoid(scenario: ResolvedServoScenario, outcome: Outcome) -> Figure:
    """Draw Fig. 9: the responses, the errors, and the error over the frequency."""
    figure = new_figure(10.0, 7.5)
    panels = figure.subplot_mosaic([["response", "response"], ["error", "sweep"]])
    time, sweep = outcome.traces["time"], outcome.tables["frequencies"]
    response, error = panels["response"], panels["error"]
    response.margins(y=0.18)
    lines = [_desired(outcome), *_responses(outcome, *_SWEPT)]
    title = "(a) Response to a sinusoid"
    draw_lines(response, time, lines, title=title, y=_RESPONSE, key="upper right", columns=4)
    zone, lines = _dead_zone(scenario), _errors(outcome, "pid", "fsm")
    draw_lines(error, time, lines, title="(b) Error", y=_ERROR, bands=[zone], key="upper right")
    loops, marked = {name: LOOPS[name] for name in _SWEPT}, {"marker": "o", "ms": 3}
    here = ReferenceLine(scenario.frequency, "frequency of (a), (b)", DESIRED, upright=True)
    draw_lines(
        panels["sweep"],
        sweep["frequency"],
        [Curve(1e3 * sweep[name], label, marked | look) for name, (label, look) in loops.items()],
        title="(c) Where the FSM is better: rms error after a period",
        y="rms error / mm",
        over="frequency / (rad/s)",
        levels=[here],
        log=True,
        key="upper left",
    )
    return figure


def _desired(outcome: Outcome, label: str | None = "desired") -> Curve:
    return Curve(outcome.traces["desired_trajectory"], label, DESIRED)


def _dead_zone(scenario: ResolvedServoScenario) -> FilledBand:
    zone = 1e3 * scenario.fsm.dead_zone
    return FilledBand(-zone, zone, "dead zone")


def _responses(outcome: Outcome, *names: str, beyond: float = np.inf) -> list[Curve]:
    """Return what loops do, up to where they leave the picture."""
    lines = []
    for name in names:
        shown = outcome.traces[f"{name}.actual_trajectory"].copy()
        gone = np.flatnonzero(~(np.abs(shown) < beyond))
        if len(gone):
            shown[gone[0] + 1 :] = np.nan
        lines.append(Curve(shown, *LOOPS[name]))
    return lines


def _errors(outcome: Outcome, *names: str) -> list[Curve]:
    desired = outcome.traces["desired_trajectory"]
    actual = ((name, outcome.traces[f"{name}.actual_trajectory"]) for name in names)
    return [Curve(1e3 * (desired - values), *LOOPS[name]) for name, values in actual]
