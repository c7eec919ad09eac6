"""Figs. 5 and 6: insertion of the D and the BNC connector, from grasp to lock; other parts too."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.drawing.figure_kit import Visit, state_visits, time_axes
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FORCE,
    LIMIT,
    POSITION,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table
from chamfer.analysis.skills.insertion_metrics import INSERTION, failure, insertion_metrics, peak
from chamfer.analysis.skills.skill_run import AXES, SkillResult, path_table, run_skill
from chamfer.diagrams.skills.connector_scenario import (
    ResolvedConnectorScenario,
    ResolvedStrategyScenario,
)
from chamfer.diagrams.skills.connector_view import make_connector_view
from chamfer.models.connectors.connector import Connector
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import make_skill_chart
from chamfer.systems.statechart.chart import Chart

Array = NDArray[np.float64]

SPEED: Final = "simulated over wall-clock time, one core, the machine's own"
_EYE: Final = np.array([0.07, -0.05, 0.04])  # m; assumed
_TARGET: Final = np.array([-0.01, 0.01, 0.012])  # m; assumed
_FLOOR: Final = np.array([0.0, 0.0, -0.05])  # m; assumed


def run(scenario: ResolvedStrategyScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the connector once."""
    done = run_to_end(scenario.make_skill(), scenario, seed, progress)
    return insertion_outcome(done, scenario.connector)


def run_to_end(
    skill: Skill, scenario: ResolvedConnectorScenario, seed: int, progress: Progress
) -> SkillResult:
    """Run a skill, and report its progress by the simulated time."""

    def annotated(fraction: float, doing: str = "") -> None:
        # The skill ends long before its time is up: the time is what tells.
        progress(fraction, doing or f"{fraction * scenario.duration:.0f} s of the skill")

    return run_skill(skill, scenario, seed=seed, progress=annotated)


def insertion_outcome(done: SkillResult, connector: Connector) -> Outcome:
    """Return the metrics and traces of a skill's run."""
    metrics = over_trials([insertion_metrics(done, connector)], INSERTION)
    at = peak(done)
    at["depth"], at["tilt"] = 1e3 * at["depth"], math.degrees(at["tilt"])
    where = "in {state}, at {depth:.1f} mm, {tilt:.1f} degrees".format(**at)
    metrics["force.peak"] = replace(metrics["force.peak"], note=where)
    if failed := failure(done, connector):
        metrics["success"] = replace(metrics["success"], note=failed.text)
        metrics["answer"] = Metric(value=0.0, unit="", note=failed.text)
    metrics["real_time_factor"] = replace(metrics["real_time_factor"], note=SPEED)
    return Outcome(
        metrics=metrics,
        traces=done.traces,
        simulated_seconds=float(done.traces["time"][-1]),
        tables={"path": path_table(done.path)},
    )


def figures(scenario: ResolvedStrategyScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    success = outcome.metrics["success"]
    ended = "inserted" if success.value else f"failed: {success.note}"
    return insertion_figures(scenario.make_skill(), scenario.connector, outcome, ended)


def insertion_figures(
    skill: Skill, connector: Connector, outcome: Outcome, ended: str
) -> dict[str, Figure]:
    """Return the figures of a run of a skill; ``ended`` names its end."""
    chart, path = make_skill_chart(skill), outcome.tables["path"]
    result = f"{ended}, after {outcome.metrics['duration'].value:.2f} s"
    return {
        "path": plot_chart_path(chart, path, result=result),
        "signals": plot_insertion(
            outcome.traces,
            path,
            states=[state.name for state in chart.states],
            mated=connector.mated_depth,
            mating_force=connector.mating_force,
        ),
    }


_COMMAND: Final[Style] = {"color": "#111111", "linestyle": "-", "linewidth": 0.9, "zorder": 3}
_MOTION: Final[Style] = {"color": "#e07b00", "linestyle": "-", "linewidth": 1.4}
_TORQUES: Final = {"rx": "#1b4f9c", "ry": "#e07b00", "rz": "#4a8c3a"}
_BESIDE: Final = 0.01  # m, from which on a plug is not above its socket


def plot_insertion(
    traces: Table, path: Table, *, states: Sequence[str], mated: float, mating_force: float
) -> Figure:
    """Draw V_cmd and V_ref axis by axis as in the paper, forces, torques and the depth."""
    caption = (
        "Commanded velocity V_cmd and velocity V_ref after accommodation by axis, then push, "
        "torques and depth. The states of the skill are on top."
    )
    figure = new_figure(8.0, 11.0, caption=caption)
    time, visits = traces["time"], _visits(traces, path, states)
    heights = (*(0.8,) * 6, 1.15, 0.9, 1.15)
    *axis_by_axis, force, torque, depth = time_axes(
        figure, time, heights, visits=visits, strip=1.15
    )
    for axes, axis in zip(axis_by_axis, (*AXES[3:], *AXES[:3]), strict=True):
        linear = len(axis) == 1
        for name, style in (("ref", _MOTION), ("cmd", _COMMAND)):
            values = (1e3 if linear else 1.0) * traces[f"V_{name}_{axis}"]
            axes.plot(time, values, label=f"$V_{{{name}}}$", **style)
        _dress(axes, f"along {axis}\nmm/s" if linear else f"about {axis[1]}\nrad/s")
    _legend(axis_by_axis[0])
    force.plot(time, traces["wrench_z"], **FORCE)
    force.axhline(mating_force, label=f"mating force, {mating_force:.3g} N", **LIMIT)
    peak = float(np.nanmax(traces["wrench_z"]))
    share = peak / mating_force
    _dress(force, "push\nN", title=f"Largest push {peak:.3g} N, {share:.2g} of the mating force")
    for axis, colour in _TORQUES.items():
        look: Style = {"color": colour, "linewidth": 1.0, "label": f"about {axis[1]}"}
        torque.plot(time, traces[f"wrench_{axis}"], **look)
    most = max(_TORQUES, key=lambda axis: float(np.nanmax(np.abs(traces[f"wrench_{axis}"]))))
    _dress(torque, "torque\nN m", title=f"Largest torque about {most[1]}")
    beside = np.hypot(traces["lateral_x"], traces["lateral_y"]) > _BESIDE
    deep = np.where(beside, np.nan, traces["depth"])
    _draw_depth(depth, time, deep, mated, "depth, of a plug above its socket")
    reached = 1e3 * float(np.nanmax(deep, initial=0.0))
    _dress(depth, "depth\nmm", x="time / s", title=f"Depth reaches {reached:.3g} mm")
    for axes in (force, torque, depth):
        _legend(axes)
    return figure


def _draw_depth(axes: Axes, time: Array, deep: Array, mated: float, label: str) -> None:
    axes.plot(time, 1e3 * deep, label=label, **POSITION)
    axes.axhline(1e3 * mated, label=f"mated, {1e3 * mated:.3g} mm", **LIMIT)
    axes.axhline(0.0, **DESIRED | {"linewidth": 0.7})
    axes.set_ylim(-8.0, 1e3 * max(mated, float(np.nanmax(deep, initial=0.0))) + 2.0)


def plot_failure(
    course: Table, row: Mapping[str, Any], *, title: str, states: Sequence[str], mated: float
) -> Figure:
    """Draw states, depth, force and tilt over the time of a failed trial, with its row."""
    caption = "Depth, push and tilt of the plug in a failed trial, with the states on top."
    figure, time = new_figure(8.0, 6.5, caption=caption), course["time"]
    lines = title.replace(": ", ":\n", 1).replace("; ", ";\n")
    figure.suptitle(lines, fontsize=10, fontweight="bold")
    visits = state_visits(time, course["state"], states)
    depth, force, tilt = time_axes(figure, time, (1.2, 1.0, 0.7), visits=visits, strip=0.9)
    _draw_depth(depth, time, course["depth"], mated, "true depth")
    force.plot(time, course["true_wrench_z"], label="true force", **FORCE)
    force.axhline(row["mating_force"], label=f"mating force, {row['mating_force']:.3g} N", **LIMIT)
    tilt.plot(time, np.rad2deg(course["tilt"]), label="true tilt", **POSITION)
    for axes, y in ((depth, "depth\nmm"), (force, "push\nN"), (tilt, "tilt\ndegrees")):
        axes.axvline(row["reason.time"], label="gave up", **PUBLISHED)
        _dress(axes, y, x="time / s" if axes is tilt else "")
        _legend(axes)
    return figure


def _visits(traces: Table, path: Table, states: Sequence[str]) -> list[Visit]:
    columns = (path[name] for name in ("entered", "time", "source", "outcome"))
    visits: list[Visit] = [
        (float(entered), float(left), f"{source}: {outcome}")
        for entered, left, source, outcome in zip(*columns, strict=True)
    ]
    begin = visits[-1][1] if visits else 0.0
    return [*visits, (begin, float(traces["time"][-1]), states[round(float(traces["state"][-1]))])]


def _dress(axes: Axes, y: str, x: str = "", title: str = "") -> None:
    dress(axes, title=title, x=x, y=y)
    axes.yaxis.label.set_fontsize(8.5)


def _legend(axes: Axes) -> None:
    """Draw a legend above the right end of a panel, where it hides nothing."""
    legend(axes, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)


def skill_charts(scenario: Any) -> tuple[Chart[Any, Any], ...]:
    """Return the chart of the scenario's skill."""
    return (make_skill_chart(scenario.make_skill()),)


def replay_insertion(
    scenario: ResolvedConnectorScenario, outcome: Outcome, meshcat: Meshcat
) -> None:
    """Show a run as an animation, with the first view near the socket.

    Raises:
        ValueError: If a column of the traces is missing, or any error of ``record``.
    """
    view = make_connector_view(scenario, meshcat)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    plug, carriage = (
        np.column_stack([_column(outcome.traces, f"{name}_{axis}") for axis in AXES])
        for name in ("plug", "carriage")
    )
    time = _column(outcome.traces, "time")
    record(meshcat, view.diagram, view.plant, time, view.positions(plug, carriage))


def _column(traces: Table, name: str) -> Array:
    if name not in traces:
        raise ValueError(f"the traces lack the column {name!r}, which the replay needs")
    return np.asarray(traces[name], dtype=np.float64)
