"""Figs. 8 and 9 with the published values drawn in."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_style import (
    BAND,
    DESIRED,
    LOOPS,
    NOTE,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.fsm_visual_servoing import OVERSHOOT, RISE_TIME
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.servo.servo_scenario import (
    ServoScenario,
    SinusoidScenario,
    StepScenario,
    resolve,
)

_SWEPT = ("pid", "fsm", "fsm_compensation")


def plot_step(scenario: StepScenario, outcome: Outcome) -> Figure:
    """Draw Fig. 8: the responses, the PID's rise, the errors at the end, the other plants."""
    figure = new_figure()
    axes = figure.subplots(2, 2)
    _step_overview(axes[0, 0], outcome)
    _step_rise(axes[0, 1], scenario, outcome)
    _step_errors(axes[1, 0], scenario, outcome)
    _step_other_plants(axes[1, 1], scenario, outcome)
    return figure


def _step_overview(axes: Axes, outcome: Outcome) -> None:
    traces = outcome.traces
    time = traces["time"]
    axes.plot(time, traces["desired_trajectory"], label="desired", **DESIRED)
    for name in ("pid", "fsm"):
        _line(axes, time, traces[f"{name}.actual_trajectory"], name)
    dress(axes, title="(a) Step response", x="time / s", y="trajectory / m")
    legend(axes, loc="lower right")


def _step_rise(axes: Axes, scenario: StepScenario, outcome: Outcome) -> None:
    traces, metrics = outcome.traces, outcome.metrics
    response = traces["pid.actual_trajectory"]
    rise = metrics["pid.rise_time"].value if "pid.rise_time" in metrics else None
    for name in ("pid", "fsm"):
        _line(axes, 1e3 * traces["time"], traces[f"{name}.actual_trajectory"], name)
    dress(axes, title="(b) The PID's rise and overshoot", x="time / ms", y="trajectory / m")
    if rise is None:
        axes.text(0.05, 0.9, "the PID loop does not settle", transform=axes.transAxes, **NOTE)
        return
    final = scenario.desired.amplitude - (metrics["pid.steady_state_error"].value or 0.0)
    peak = final * (1 + OVERSHOOT / 100)
    start = float(np.interp(0.1, np.maximum.accumulate(response / final), traces["time"]))
    axes.set_xlim(0, 8e3 * rise)
    axes.axhline(final, color="#999999", linewidth=0.8)
    if scenario == resolve(StepScenario()):  # the published values are of no other
        axes.axhline(peak, label=f"published overshoot {OVERSHOOT:g} %", **PUBLISHED)
        axes.annotate(
            "",
            xy=((start + RISE_TIME) * 1e3, 0.9 * final),
            xytext=(start * 1e3, 0.9 * final),
            arrowprops={"arrowstyle": "|-|", "color": PUBLISHED["color"], "mutation_scale": 3},
        )
        axes.text(
            (start + RISE_TIME) * 1e3 * 1.15,
            0.85 * final,
            f"published rise time {RISE_TIME * 1e3:g} ms\nmeasured {rise * 1e3:.3g} ms",
            **NOTE,
        )
    axes.text(8e3 * rise, 0.95 * final, f"final {final:.3f} m ", ha="right", fontsize=8)
    legend(axes, loc="center right")


def _step_errors(axes: Axes, scenario: StepScenario, outcome: Outcome) -> None:
    traces = outcome.traces
    time, desired = traces["time"], traces["desired_trajectory"]
    zone = 1e3 * scenario.fsm.dead_zone
    axes.axhspan(-zone, zone, label="dead zone", **BAND)
    for name in ("pid", "fsm", "fsm_velocity"):
        _line(axes, time, 1e3 * (desired - traces[f"{name}.actual_trajectory"]), name)
    reach = 6 * zone
    axes.set_ylim(-reach, reach)
    title = "(c) The error that remains"
    dress(axes, title=title, x="time / s", y="desired minus actual / mm")
    legend(axes, loc="lower left", ncols=2)


def _step_other_plants(axes: Axes, scenario: StepScenario, outcome: Outcome) -> None:
    traces = outcome.traces
    time, height = traces["time"], scenario.desired.amplitude
    axes.plot(time, traces["desired_trajectory"], **DESIRED)
    for name in ("fsm_feedforward", "fsm_velocity", "pid_position", "pid_command"):
        response = traces[f"{name}.actual_trajectory"]
        _line(axes, time, _until(response, 3.0 * abs(height)), name)
    growth = outcome.metrics["pid_command.growth_rate"].value
    if growth:
        axes.text(0.06, 2.1 * height, f"unstable, {growth:.3g} 1/s", fontsize=8)
    axes.set_ylim(*sorted((-0.6 * height, 3.4 * height)))
    axes.set_xlim(0, min(1.0, float(time[-1])))
    title = "(d) The same controllers on the other plants"
    dress(axes, title=title, x="time / s", y="trajectory / m")
    legend(axes, loc="upper right", ncols=2)


def _line(axes: Axes, x: NDArray[np.float64], y: NDArray[np.float64], name: str) -> None:
    label, style = LOOPS[name]
    axes.plot(x, y, label=label, **style)


def _until(values: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    beyond = np.flatnonzero(~(np.abs(values) < limit))
    shown = values.copy()
    if len(beyond):
        shown[beyond[0] + 1 :] = np.nan
    return shown


def plot_sinusoid(scenario: SinusoidScenario, outcome: Outcome) -> Figure:
    """Draw Fig. 9: the responses, the errors, and the error over the frequency."""
    figure = new_figure(10.0, 7.5)
    panels = figure.subplot_mosaic([["response", "response"], ["error", "sweep"]])
    traces = outcome.traces
    time = traces["time"]
    panels["response"].plot(time, traces["desired_trajectory"], label="desired", **DESIRED)
    for name in _SWEPT:
        _line(panels["response"], time, traces[f"{name}.actual_trajectory"], name)
    panels["response"].margins(y=0.18)
    title = "(a) Response to a sinusoid"
    dress(panels["response"], title=title, x="time / s", y="trajectory / m")
    legend(panels["response"], loc="upper right", ncols=4)
    _tracking_error(panels["error"], scenario, outcome)
    _error_over_frequency(panels["sweep"], scenario, outcome)
    return figure


def _tracking_error(axes: Axes, scenario: ServoScenario, outcome: Outcome) -> None:
    traces = outcome.traces
    zone = 1e3 * scenario.fsm.dead_zone
    axes.axhspan(-zone, zone, label="dead zone", **BAND)
    for name in ("pid", "fsm"):
        error = traces["desired_trajectory"] - traces[f"{name}.actual_trajectory"]
        _line(axes, traces["time"], 1e3 * error, name)
    dress(axes, title="(b) Error", x="time / s", y="desired minus actual / mm")
    legend(axes, loc="upper right")


def _error_over_frequency(axes: Axes, scenario: SinusoidScenario, outcome: Outcome) -> None:
    sweep = outcome.tables["frequencies"]
    for name in _SWEPT:
        label, style = LOOPS[name]
        axes.loglog(sweep["frequency"], 1e3 * sweep[name], marker="o", ms=3, label=label, **style)
    axes.axvline(scenario.desired.frequency, label="frequency of (a), (b)", **DESIRED)
    title = "(c) Where the FSM is better: rms error after a period"
    dress(axes, title=title, x="frequency / (rad/s)", y="rms error / mm")
    legend(axes, loc="upper left")
