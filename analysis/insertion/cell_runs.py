"""One insertion in the work cell: simulated, measured against the truth, and by planar theory."""

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from chamfer.analysis.campaign.trial_metrics import Quantity, metrics_of
from chamfer.analysis.cell.alignment_runs import (
    ARM_LIMITS,
    Traces,
    alignment_traces,
    arm_limits,
    row_before,
)
from chamfer.analysis.insertion.insertion_runs import jamming_loads, median, onset_of
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Progress, Table, column
from chamfer.diagrams.insertion.insertion import (
    ResolvedInsertionScenario,
    make_insertion_diagram,
    task_params,
)
from chamfer.models.peg.peg_and_hole import SEATED, PegAndHole
from chamfer.models.peg_theory.fed_insertion import FeedVerdict, predict_feed
from chamfer.models.peg_theory.wedging import jamming_level
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, ContactState
from chamfer.systems.statechart.chart import Chart, Snapshot, TransitionRecord
from chamfer.systems.strategies.insertion_controller import TASK
from chamfer.systems.strategies.insertion_law import (
    SEARCHES,
    STOPPED,
    WORDS,
    make_insertion_chart,
)
from chamfer.systems.strategies.insertion_task import InsertionTask

Array = NDArray[np.float64]

# What :func:`insertion_metrics` measures; times count from when the cameras do.
INSERTION: Final = {
    "seated": Quantity(""),
    "said_seated": Quantity(""),
    "seated.first": Quantity(""),
    "depth": Quantity("m"),
    "force.axial": Quantity("N"),
    "force.lateral": Quantity("N"),
    "force.contact": Quantity("N"),
    "force.raw_peak": Quantity("N"),
    "force.peak": Quantity("N"),
    "force.share": Quantity("%"),
    "compliance.deflection": Quantity("%"),
    **ARM_LIMITS,
    "force.sensed_error": Quantity("N"),
    "time_to_seated": Quantity("s"),
    "cycle_time": Quantity("s"),
    "attempts": Quantity(""),
    "search.time": Quantity("s"),
    "search.found": Quantity(""),
    "decision.time": Quantity("s"),
    "decision.lateral_error": Quantity("m"),
    "decision.rotational_error": Quantity("rad"),
    "decision.lateral_uncertainty": Quantity("m"),
    "decision.rotational_uncertainty": Quantity("rad"),
    "decision.true_lateral_error": Quantity("m"),
    "decision.true_rotational_error": Quantity("rad"),
    "touch.lateral_error": Quantity("m"),
    "touch.rotational_error": Quantity("rad"),
    "two_point.onset": Quantity("m"),
    "wedged": Quantity(""),
    "jammed": Quantity(""),
    "pull_out.force": Quantity("N"),
}
_DECIDED: Final = "decide", "insert"
_AFTER: Final = 0.3  # s, that a run goes on once its chart has ended
_SLIPS: Final = 0.001  # m, that a peg moves out by if nothing but the push holds it
_TOUCHING: Final = 0.01  # N
_MOUTH, _TIP, _BOTTOM = (FEATURES.index(name) for name in ("mouth", "tip", "bottom"))


class CellInsertion(NamedTuple):
    """A finished run; the traces have a row a step of the plant."""

    traces: Traces
    path: tuple[TransitionRecord, ...]
    states: tuple[str, ...]  # names of the chart's states, by their numbers
    cpu_seconds: float

    @property
    def state(self) -> str:
        """The state that the task ended in."""
        return self.path[-1].target if self.path else self.states[0]

    def when(self, *states: str) -> NDArray[np.bool_]:
        """Return when the task was in one of these states, shape (n,)."""
        numbers = [self.states.index(name) for name in states]
        found: NDArray[np.bool_] = np.isin(self.traces["task_state"], numbers)
        return found

    def entered(self, state: str, *, first: bool = False) -> float | None:
        """Return when a state was entered last, or first, s."""
        times = [one.time for one in self.path if one.target == state]
        return times[0 if first else -1] if times else None

    def began(self, *, first: bool = False) -> float | None:
        """When it was decided to insert last, or first, s; a search is part of its attempt."""
        times = [one.time for one in self.path if (one.source, one.target) == _DECIDED]
        return times[0 if first else -1] if times else None


def run_cell_insertion(
    scenario: ResolvedInsertionScenario,
    seed: int,
    progress: Progress | None = None,
    *,
    until_advance: bool = False,
) -> CellInsertion:
    """Simulate a resolved scenario until its task has ended, or until the peg first advances."""
    diagram = make_insertion_diagram(scenario)
    task: InsertionTask = diagram.GetSubsystemByName(TASK)

    def ended(root: Context) -> bool:
        snapshot, now = task.snapshot(task.GetMyContextFromRoot(root)), root.get_time()
        if until_advance and snapshot.state == "insert":
            return bool(now - snapshot.entered_at >= scenario.insert.pause)
        return is_over(task.chart, snapshot, now)

    started = time.process_time()
    run = simulate(
        diagram,
        duration=scenario.duration,
        step=scenario.step,
        seed=seed,
        progress=progress,
        ended=ended,
    )
    cpu = time.process_time() - started
    assert run.final is not None
    path = task.transitions(task.GetMyContextFromRoot(run.final))
    return cell_insertion(scenario, run.time, run.outputs, task.chart, path, cpu)


def is_over(chart: Chart[Any, Any], snapshot: Snapshot[Any], now: float) -> bool:
    """Return whether the chart and the motions that it left have ended; the time is in s."""
    return chart.state(snapshot.state).outcome is not None and now - snapshot.entered_at > _AFTER


def cell_insertion(
    scenario: ResolvedInsertionScenario,
    moments: Array,
    outputs: Mapping[str, Array],
    chart: Chart[Any, Any],
    path: tuple[TransitionRecord, ...],
    cpu_seconds: float,
) -> CellInsertion:
    """Return a run of its outputs, a row a time, s.

    Columns beside those of :func:`chamfer.analysis.cell.alignment_runs.alignment_traces`: of the
    true contact ``contact_state``, ``depth`` m, ``loss`` W, in the mouth's frame the force of the
    hole on the peg ``force_x``, ``force_y``, ``force_z``, N, and its moment about the mouth,
    ``moment_x``, ... N m, ``normal_<feature>`` N; of the task ``task_state``, ``attempts``,
    ``trouble``, ``feed`` m, ``sensed_depth`` m, ``sensed_x``, ... N, and of its last decision
    ``measured_lateral`` m, ``measured_rotational`` rad and their uncertainties; of a remote
    centre compliance its ``deflection``, as a share of its limits.
    """
    traces = alignment_traces(scenario, moments, outputs)
    for name in ("state", "depth", "loss"):
        traces["contact_state" if name == "state" else name] = outputs[f"contact.{name}"]
    for i, axis in enumerate("xyz"):
        traces[f"force_{axis}"] = outputs["contact.wrench"][:, 3 + i]
        traces[f"moment_{axis}"] = outputs["contact.wrench"][:, i]
        traces[f"sensed_{axis}"] = outputs["sensed_force"][:, i]
    for i, name in enumerate(FEATURES):
        traces[f"normal_{name}"] = outputs["contact.normal_forces"][:, i]
    traces["sides_apart"] = np.cos(
        outputs["contact.sides"][:, _MOUTH] - outputs["contact.sides"][:, _TIP]
    )
    traces["task_state"] = outputs["state"]
    for name in ("attempts", "trouble", "sensed_depth"):
        traces[name] = outputs[name]
    traces["feed"] = outputs["feed"][:, 0]
    compliance = scenario.compliance.resolved()
    if scenario.servo is not None and compliance.kind == "rcc":
        traces["deflection"] = compliance.deflection(compliance.strain(outputs["wrist_wrench"]))
    for i, name in enumerate(("lateral", "rotational")):
        traces[f"measured_{name}"] = outputs["measured"][:, i]
        traces[f"measured_{name}_uncertainty"] = outputs["measured"][:, 2 + i]
    return CellInsertion(traces, path, chart.state_names, cpu_seconds)


def force_medians(traces: Table, step: float) -> tuple[Array, Array]:
    """Return the forces against the insertion and across, N, as medians of 10 ms, (n,) each."""
    x, y, z = (median(traces[f"force_{axis}"], step) for axis in "xyz")
    return -x, np.hypot(y, z)


def two_point(traces: Table) -> NDArray[np.bool_]:
    """Return when mouth and tip touched on opposite sides."""
    touch = (traces["normal_mouth"] > _TOUCHING) & (traces["normal_tip"] > _TOUCHING)
    opposite: NDArray[np.bool_] = traces["sides_apart"] < 0
    return touch & opposite


def touch_row(done: CellInsertion, *, first: bool = False) -> int | None:
    """Return the row of the last or first attempt's touch: a contact, or the tip at the mouth."""
    traces = done.traces
    began = done.began(first=first)
    if began is None:
        return None
    near = (traces["contact_state"] != ContactState.NONE) | (traces["depth"] >= 0)
    rows = np.flatnonzero(near & (traces["time"] >= began - 1e-9))
    return int(rows[0]) if len(rows) else None


def insertion_metrics(
    done: CellInsertion, scenario: ResolvedInsertionScenario
) -> dict[str, float | None]:
    """Measure a run, see :data:`INSERTION`; a value is None where it is undefined."""
    traces, values = done.traces, dict[str, float | None].fromkeys(INSERTION)
    moments, depth = traces["time"], traces["depth"]
    axial, lateral = force_medians(traces, scenario.step)
    enough = SEATED * task_params(scenario).target
    bottom = traces["normal_bottom"] > _TOUCHING
    deep = (depth >= enough) & (traces["lateral_error"] < scenario.parts.hole_radius) | bottom
    seated = bool(deep[-1])
    values["seated"] = float(seated)
    values["said_seated"] = float(done.state == "seated")
    values["seated.first"] = float(seated and traces["attempts"][-1] <= 1)
    began = done.began()
    values["depth"] = float(depth[moments >= (0.0 if began is None else began)].max())
    # On the bottom the force is that of the stop, not of the way.
    free = np.logical_and.accumulate(~bottom)
    values["force.axial"] = float(axial[free].max())
    values["force.lateral"] = float(lateral[free].max())
    contact = float(np.hypot(axial, lateral)[free].max())
    values["force.contact"] = contact
    values["force.share"] = 100 * contact / scenario.insert.force_limit
    values |= arm_limits(traces, scenario)
    values["force.raw_peak"] = float(-traces["force_x"][free].min())
    values["force.peak"] = float(
        np.sqrt(sum(traces[f"force_{a}"][free] ** 2 for a in "xyz")).max()
    )
    if "deflection" in traces:
        values["compliance.deflection"] = 100 * float(traces["deflection"].max())
    feeding = done.when("insert", "check")
    if feeding.any():
        off = median(traces["sensed_x"], scenario.step) - axial
        values["force.sensed_error"] = float(np.abs(off[feeding]).max())
    if seated:
        first = int(np.flatnonzero(deep)[0])
        values["time_to_seated"] = float(moments[first]) - scenario.begin
        values["cycle_time"] = done.entered("seated")
    values["attempts"] = float(traces["attempts"][-1])
    values |= _searched(done, scenario)
    if began is not None:
        row = row_before(moments, began)
        values["decision.time"] = began - scenario.begin
        for name in ("lateral", "rotational"):
            values[f"decision.true_{name}_error"] = float(traces[f"{name}_error"][row])
            after = min(row + 2, len(moments) - 1)  # the row at which it shows
            values[f"decision.{name}_error"] = float(traces[f"measured_{name}"][after])
            values[f"decision.{name}_uncertainty"] = float(
                traces[f"measured_{name}_uncertainty"][after]
            )
    if (touch := touch_row(done)) is not None:
        values["touch.lateral_error"] = float(traces["lateral_error"][touch])
        values["touch.rotational_error"] = float(traces["rotational_error"][touch])
        found = onset_of(scenario.parts, depth[touch:], two_point(traces)[touch:])
        values["two_point.onset"] = found if math.isfinite(found) else None
    return values | _stopped(done, axial, scenario)


def _searched(done: CellInsertion, scenario: ResolvedInsertionScenario) -> dict[str, float | None]:
    """Return the time of the search by contact, and whether the last search led into the hole."""
    states = [name for name in SEARCHES if name in done.states]
    rows = np.flatnonzero(done.when(*states)) if states else np.zeros(0, dtype=np.intp)
    if not len(rows):
        return {"search.time": None, "search.found": None}
    deepest = float(done.traces["depth"][rows[-1] :].max())
    found = deepest >= scenario.parts.chamfer_height
    return {"search.time": len(rows) * scenario.step, "search.found": float(found)}


def _stopped(
    done: CellInsertion, axial: Array, scenario: ResolvedInsertionScenario
) -> dict[str, float | None]:
    """Return what held the peg of the last attempt that was stopped, by the truth.

    In the bore it was wedged if it stayed where it was without the push, and took a pull above
    ``insert.held_force`` to come out.
    """
    depth = done.traces["depth"]
    taken = np.flatnonzero(done.when("release", "back_off"))
    if not len(taken):
        return {"wedged": 0.0, "jammed": 0.0}
    starts = taken[np.concatenate([[True], np.diff(taken) > 1])]
    first = int(starts[-1])
    rows = taken[taken >= first]
    pull = max(0.0, float(-axial[rows].min()))
    free = rows[axial[rows] <= 0]
    came_out = float(depth[first] - depth[free[0]]) if len(free) else 0.0
    held = came_out < _SLIPS and pull > scenario.insert.held_force
    touched = axial[first] > _TOUCHING
    in_bore = touched and depth[first] > scenario.parts.chamfer_height
    return {
        "wedged": float(in_bore and held),
        "jammed": float(in_bore and not held),
        "pull_out.force": pull if touched else None,
    }


def ending(done: CellInsertion, scenario: ResolvedInsertionScenario) -> str:
    """Return how a run ended, in a few words."""
    metrics = insertion_metrics(done, scenario)
    depth = f"{1e3 * float(done.traces['depth'][-1]):.1f} mm deep"
    if done.state == "seated":
        return f"seated, {depth}" if metrics["seated"] else f"reported as seated, but {depth}"
    trouble = WORDS[int(done.traces["trouble"][-1])]
    if done.state == "gave_up":
        attempts = int(done.traces["attempts"][-1])
        return f"gave up after {attempts} attempt{'s' * (attempts != 1)}: {trouble}"
    if done.path and done.state in STOPPED:
        return f"stopped: {done.path[-1].label}"
    return f"not over after {done.traces['time'][-1]:.4g} s, in {done.state}"


def path_table(path: Sequence[TransitionRecord]) -> Table:
    """Return the columns of the transitions taken, as the chart's drawing wants them."""
    names = {
        name: np.array([getattr(one, name) for one in path], dtype=np.str_)
        for name in ("source", "target", "label")
    }
    return {"time": column([one.time for one in path]), "outcome": names["label"], **names}


def insertion_charts(scenario: ResolvedInsertionScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the task's chart; the compensator's are those of the alignment."""
    return (make_insertion_chart(task_params(scenario)),)


def errors_in_planes(traces: Table) -> dict[str, tuple[Array, Array]]:
    """Return lateral error, m, and tilt, rad, in the planes XY and XZ, with the theory's signs.

    Both are positive towards +Y or +Z, so that equal signs add.
    """
    return {
        "xy": (-traces["true_y"], traces["true_yaw"]),
        "xz": (-traces["true_z"], -traces["true_pitch"]),
    }


def errors_in_one_plane(traces: Table, row: int) -> tuple[float, float]:
    """Return lateral error, m, >= 0, and tilt, rad, at a row, as if they were in one plane.

    The tilt has the sign of its part in the plane of the lateral error.
    """
    planes = errors_in_planes(traces)
    (y, tilt_y), (z, tilt_z) = ((float(e[row]), float(t[row])) for e, t in planes.values())
    adds = y * tilt_y + z * tilt_z
    return math.hypot(y, z), math.copysign(math.hypot(tilt_y, tilt_z), adds)


_UNITS: Final = {
    "predicted.seated": "",
    "predicted.force.axial": "N",
    "predicted.two_point.onset": "m",
    "predicted.may_wedge": "",
    "touch.margin": "%",
}
_ASIDE: Final = 0.1  # share of an error that may be out of the plane of the theory
_HELD: Final = "the errors at the touch held, no friction in the joints, quasi-static"


def predict(scenario: ResolvedInsertionScenario, done: CellInsertion) -> dict[str, Metric]:
    """Return the theory's prediction for the last attempt, and the margin at its touch."""
    row = touch_row(done)
    if row is None or not (scenario.parts.is_round or _along_faces(done, row)):
        why = "square parts, and errors in no plane along faces: the theory is planar"
        why = "it never touches" if row is None else why
        return metrics_of({name: (None, unit, why) for name, unit in _UNITS.items()})
    lateral, tilt = errors_in_one_plane(done.traces, row)
    params = task_params(scenario)
    found = predict_feed(
        scenario.parts,
        scenario.support_at,
        lambda depth: np.full(np.shape(depth), scenario.insert.push),
        lateral,
        tilt,
        depth=params.target,
    )
    verdict = FeedVerdict(int(found.verdict))
    axial, touches = float(found.axial), float(found.onset)
    margin = 100 * params.region.margin(lateral, abs(tilt))
    said: dict[str, tuple[float | None, str]] = {
        "predicted.seated": (float(verdict is FeedVerdict.SAFE), _HELD),
        "predicted.force.axial": (axial, f"largest; {_HELD}"),
        "predicted.two_point.onset": (touches, f"l; {_HELD}"),
        "predicted.may_wedge": (float(found.may_wedge), "1: two points may hold it"),
        "touch.margin": (margin, "of the region free of wedging, the worst signs; < 0: outside"),
    }
    if verdict is FeedVerdict.MAY:
        said["predicted.seated"] = None, f"{_HELD}; it may wedge or sit on the edge"
    if not math.isfinite(axial):
        said["predicted.force.axial"] = None, "no push slides it"
    if not math.isfinite(touches):
        said["predicted.two_point.onset"] = None, "two points never touch"
    return metrics_of({name: (one, _UNITS[name], note) for name, (one, note) in said.items()})


def _along_faces(done: CellInsertion, row: int) -> bool:
    """Whether lateral error and tilt are in one of the planes along the faces of square parts."""
    planes = errors_in_planes(done.traces).values()
    one, other = (np.abs([float(e[row]), float(t[row])]) for e, t in planes)
    return bool((one <= _ASIDE * other).all() or (other <= _ASIDE * one).all())


_PUSHED: Final = 0.05  # N, the least push whose direction says something
_IN_BORE: Final = (ContactState.ONE_POINT, ContactState.TWO_POINT, ContactState.SEATED)


class PlanarLoads(NamedTuple):
    """Loads of the support on the peg in one plane, a row a moment."""

    depth: Array  # l, m
    force_ratio: Array  # F_x / F_z
    moment_ratio: Array  # M / (r F_z)
    level: Array  # in the diagram, 1 on its sides


def loads_in_planes(traces: Table, parts: PegAndHole, step: float) -> dict[str, PlanarLoads]:
    """Return the loads in the planes XY and XZ while the peg is pushed in the bore."""
    turning = {"xy": traces["moment_z"], "xz": -traces["moment_y"]}
    in_bore = np.isin(traces["contact_state"], _IN_BORE)
    found = {}
    for plane, (lateral, tilt) in errors_in_planes(traces).items():
        across = {"across": traces[f"force_{plane[1]}"], "turning": turning[plane]}
        run = {**traces, "lateral": lateral, "tilt": tilt, **across}
        l_of, down, *ratios = jamming_loads(parts, run, step)
        pushed = in_bore & (down > _PUSHED) & (l_of > 0)
        depth, force_ratio, moment_ratio = (one[pushed] for one in (l_of, *ratios))
        level = jamming_level(parts, force_ratio, moment_ratio, depth)
        found[plane] = PlanarLoads(depth, force_ratio, moment_ratio, level)
    return found
