"""Run any skill in a scenario, until it has ended."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, LeafSystem

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Progress, Table, column
from chamfer.diagrams.skills.connector_loop import LOADS, make_connector_diagram
from chamfer.diagrams.skills.connector_scenario import ResolvedConnectorScenario
from chamfer.models.arms.wrist import tip_pose
from chamfer.systems.primitives.skill import DONE, FAILED, RETRACT, Skill
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.statechart.chart import TransitionRecord

Array = NDArray[np.float64]
Traces = dict[str, Array]
Ended = Literal["done", "failed", "running"]

AXES: Final = ("rx", "ry", "rz", "x", "y", "z")
_SIX: Final = ("V_cmd", "V_ref", "wrench", "carriage", "plug", "true_wrench")
_ENDS: Final[dict[str, Ended]] = {DONE: "done", FAILED: "failed"}


class SkillStep(NamedTuple):
    """A transition that a skill took."""

    time: float  # s
    source: str
    target: str
    outcome: str  # of the source
    label: str  # of the transition in the chart


@dataclass(frozen=True, kw_only=True)
class SkillResult:
    """A finished run of a skill.

    The traces have a row per tick:

    - ``time`` s; ``V_cmd_<axis>`` and ``V_ref_<axis>``, rad/s or m/s;
    - ``wrench_<axis>`` as measured, N m or N; ``carriage_<axis>``, rad or m;
    - the truth: ``plug_<axis>``, the tip's displacement, rad or m, ``true_wrench_<axis>``,
      ``depth`` m, ``lateral_x`` and ``lateral_y`` m, ``tilt`` and ``turn`` rad;
    - ``holding``, ``retries``, and ``state``, the index of the chart's state.
    """

    outcome: Ended  # as the skill reports; running: the scenario's duration was over
    state: str  # at the end
    reason: str  # why it failed, "<state>: <outcome>"; empty if it did not
    expected: str  # event that this state waited for, in words
    path: tuple[SkillStep, ...]  # the transitions that it took
    traces: Traces
    peaks: Array  # largest true load about and along each axis, N m above N, of all plant steps
    peak_time: float  # s, of the largest one along the insertion
    wall_seconds: float


def run_skill(
    skill: Skill | SkillMachine,
    scenario: ResolvedConnectorScenario,
    *,
    seed: int = 0,
    progress: Progress | None = None,
    controller: LeafSystem | None = None,
) -> SkillResult:
    """Simulate a skill until it has ended, or the scenario's duration is over.

    The seed is that of the sensors' noise. A controller takes the place of accommodation, see
    :func:`chamfer.diagrams.skills.connector_loop.make_connector_diagram`.
    """
    diagram = make_connector_diagram(scenario, skill, controller=controller)
    machine: SkillMachine = diagram.GetSubsystemByName("skill")
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
    last = machine.snapshot(context)
    log = diagram.GetSubsystemByName(LOADS).FindLog(run.final)
    loads = np.abs(log.data())
    return SkillResult(
        outcome=_ENDS.get(last.state, "running"),
        state=last.state,
        reason=last.memory.reason,
        expected=last.memory.expected,
        path=tuple(_step(one, last.memory.reason) for one in machine.transitions(context)),
        traces=traces,
        peaks=loads.max(axis=1),
        peak_time=float(log.sample_times()[loads[-1].argmax()]),
        wall_seconds=wall,
    )


def _step(taken: TransitionRecord, reason: str) -> SkillStep:
    """Return a step; a state that fails has its outcome in the reason alone."""
    outcome = taken.label.partition(",")[0].removesuffix(" again")
    if taken.target == RETRACT:
        outcome = reason.partition(": ")[2]
    return SkillStep(taken.time, taken.source, taken.target, outcome, taken.label)


def true_motion(displacement: Array, grasp: Array) -> Traces:
    """Return depth, lateral displacement, tilt and turn of the plug in the socket.

    The ``displacement`` is the tool's, rad above m, shape (n, 6), ``grasp`` the rotation of the
    plug in it, rad about x, y and z, shape (3,).
    """
    X_TP = tip_pose(np.concatenate([grasp, np.zeros(3)]))
    rows = np.empty((len(displacement), 5))
    for i, one in enumerate(displacement):
        X_SP = tip_pose(one) @ X_TP
        R, p = X_SP.rotation().matrix(), X_SP.translation()
        tilt = np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])
        rows[i] = -p[2], p[0], p[1], tilt, np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1])
    return dict(zip(("depth", "lateral_x", "lateral_y", "tilt", "turn"), rows.T, strict=True))


def path_table(path: Sequence[SkillStep]) -> Table:
    """Return the columns of the transitions, each with the start of its source, s."""
    times = [one.time for one in path]
    names = {
        name: np.array([getattr(one, name) for one in path], dtype=np.str_)
        for name in ("source", "target", "outcome", "label")
    }
    return {"entered": column([0.0, *times[:-1]] if times else []), "time": column(times), **names}
