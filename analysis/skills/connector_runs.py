"""Runs of insertions, measured against the truth that no skill sees."""

import time
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, Diagram

from analysis.run.experiment import Progress, Table, column
from analysis.run.simulate import simulate
from analysis.run.trial_metrics import Quantity, Trial
from diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    make_connector_diagram,
)
from models.wrist import tip_pose
from systems.skills.skill import DONE, FAILED, RETRACT
from systems.skills.skill_chart import make_skill_chart
from systems.skills.skill_machine import SkillMachine
from systems.statechart.chart import Chart, TransitionRecord

Array = NDArray[np.float64]
Traces = dict[str, Array]
AnyConnectorScenario = DConnectorScenario | BncConnectorScenario

# What :func:`insertion_metrics` measures.
INSERTION: Final = {
    "success": Quantity(""),
    "duration": Quantity("s"),
    "depth": Quantity("m"),
    "force.peak": Quantity("N"),
    "force.peak_share": Quantity(""),
    "torque.peak": Quantity("N m"),
    "retries": Quantity(""),
    "real_time_factor": Quantity(""),
}
AXES: Final = ("rx", "ry", "rz", "x", "y", "z")
_MATED: Final = 0.0005  # m, of the mated depth, within which a plug is in
_SIX: Final = ("V_cmd", "V_ref", "wrench", "carriage", "plug")


class Step(NamedTuple):
    """A transition that a skill took."""

    time: float  # s
    source: str
    target: str
    outcome: str  # of the source
    label: str  # of the transition in the chart


class Insertion(NamedTuple):
    """A finished run."""

    traces: Traces
    path: tuple[Step, ...]
    reason: str  # why it failed; empty if it did not
    wall_seconds: float


def run_insertion(
    scenario: AnyConnectorScenario, seed: int, progress: Progress | None = None
) -> Insertion:
    """Simulate a resolved scenario until the skill ends.

    The traces have a row per tick: ``time`` s; ``V_cmd_<axis>`` and ``V_ref_<axis>``, rad/s or
    m/s; ``wrench_<axis>`` as measured, N m or N; ``carriage_<axis>``, rad or m; of the truth
    ``plug_<axis>``, the tip's displacement, rad or m, ``depth`` m, ``lateral_x`` and
    ``lateral_y`` m, ``tilt`` and ``turn`` rad; ``holding``, ``retries``, and ``state``, the index
    of the chart's state.
    """
    diagram = make_connector_diagram(scenario)
    machine = skill_machine(diagram)
    ends = {state.name for state in machine.chart.states if state.outcome is not None}

    def ended(root: Context) -> bool:
        return machine.snapshot(machine.GetMyContextFromRoot(root)).state in ends

    started = time.perf_counter()
    run = simulate(
        diagram,
        duration=scenario.duration,
        step=scenario.accommodation.period,
        seed=seed,
        progress=progress,
        ended=ended,
    )
    wall = time.perf_counter() - started
    outputs = run.outputs
    traces = {"time": run.time}
    for name in _SIX:
        for i, axis in enumerate(AXES):
            traces[f"{name}_{axis}"] = outputs[name][:, i]
    for name in ("holding", "retries", "state"):
        traces[name] = outputs[name]
    traces |= true_motion(outputs["plug"][:, :6], np.array(scenario.initial_error[:3]))
    assert run.final is not None
    context = machine.GetMyContextFromRoot(run.final)
    reason = machine.snapshot(context).memory.reason
    path = tuple(_step(one, reason) for one in machine.transitions(context))
    return Insertion(traces, path, reason, wall)


def _step(taken: TransitionRecord, reason: str) -> Step:
    """Return a step; a state that fails has its outcome in the reason alone."""
    outcome = taken.label.partition(",")[0].removesuffix(" again")
    if taken.target == RETRACT:
        outcome = reason.partition(": ")[2]
    return Step(taken.time, taken.source, taken.target, outcome, taken.label)


def skill_machine(diagram: Diagram) -> SkillMachine:
    """Return the block that runs an insertion's skill."""
    machine: SkillMachine = diagram.GetSubsystemByName("skill")
    return machine


def true_motion(displacement: Array, grasp: Array) -> Traces:
    """Return depth, lateral displacement, tilt and turn of the plug in the socket.

    Args:
        displacement: Of the tool, rad above m, shape (n, 6).
        grasp: How the plug is turned in the tool, rad about x, y and z, shape (3,).
    """
    X_TP = tip_pose(np.concatenate([grasp, np.zeros(3)]))
    rows = np.empty((len(displacement), 5))
    for i, one in enumerate(displacement):
        X_SP = tip_pose(one) @ X_TP
        R, p = X_SP.rotation().matrix(), X_SP.translation()
        tilt = np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])
        rows[i] = -p[2], p[0], p[1], tilt, np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    return dict(zip(("depth", "lateral_x", "lateral_y", "tilt", "turn"), rows.T, strict=True))


def insertion_metrics(done: Insertion, scenario: AnyConnectorScenario) -> Trial:
    """Return what a run measured.

    ``success`` is 1 if the skill says so and the plug is in, by the truth; ``force.peak`` is the
    largest push or pull along the insertion.
    """
    traces = done.traces
    connector = scenario.connector
    depth = float(traces["depth"][-1])
    peak = float(np.abs(traces["wrench_z"]).max())
    torque = np.abs(np.stack([traces[f"wrench_{axis}"] for axis in AXES[:3]])).max()
    return {
        "success": float(not failure(done, scenario)),
        "duration": float(traces["time"][-1]),
        "depth": depth,
        "force.peak": peak,
        "force.peak_share": peak / connector.mating_force,
        "torque.peak": float(torque),
        "retries": float(traces["retries"][-1]),
        "real_time_factor": round(float(traces["time"][-1]) / done.wall_seconds, 2),
    }


def failure(done: Insertion, scenario: AnyConnectorScenario) -> str:
    """Return why a run is no success; empty if it is one."""
    depth, mated = float(done.traces["depth"][-1]), scenario.connector.mated_depth
    (chart,) = skill_charts(scenario)
    state = done.path[-1].target if done.path else chart.initial
    if state == DONE:
        if abs(depth - mated) <= _MATED:
            return ""
        return f"said to be done {1e3 * depth:.2f} mm deep, mated is {1e3 * mated:.2f} mm"
    if state == FAILED:
        return done.reason
    return f"{state}: still running after {done.traces['time'][-1]:g} s"


def path_table(path: Sequence[Step]) -> Table:
    """Return the columns of the transitions taken, each with when its source was entered, s."""
    times = [one.time for one in path]
    names = {
        name: np.array([getattr(one, name) for one in path], dtype=np.str_)
        for name in ("source", "target", "outcome", "label")
    }
    return {"entered": column([0.0, *times[:-1]] if times else []), "time": column(times), **names}


def skill_charts(scenario: AnyConnectorScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the chart of the scenario's skill."""
    return (make_skill_chart(scenario.make_skill()),)
