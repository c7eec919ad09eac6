"""What errors of the cameras do to the alignment: each alone, and all of them at once."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.cell.alignment_runs import (
    AlignmentTrialsScenario,
    ResolvedAlignmentTrialsScenario,
    resolve_trials,
)
from chamfer.analysis.cell.camera_error_runs import (
    BY_NAME,
    DRAWN,
    ERRORS,
    LEFT,
    MOMENTS,
    NONE,
    NOT_DRAWN,
    CameraError,
    ErrorAtRest,
    ErrorRun,
    Study,
    at_rest,
    reached,
    run_once,
)
from chamfer.analysis.cell.camera_errors_figures import answer, plot_drawn, plot_errors
from chamfer.analysis.published.work_cell import MEAN_ERROR
from chamfer.analysis.scenario.experiment import (
    Metric,
    Outcome,
    Progress,
    Table,
    column,
)
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    ControllerChoice,
    ControllerKind,
)
from chamfer.diagrams.cell.cell_vision import CameraSettings, Measured
from chamfer.models.validation import ParameterError, require_not_negative, require_positive

Array = NDArray[np.float64]

# What of the paper's accuracy an error is to reach.
PUBLISHED: Final = {
    "lateral_error": MEAN_ERROR[0],
    "rotational_error": MEAN_ERROR[1],
    "behind_error": MEAN_ERROR[0],
}


@dataclass(frozen=True, kw_only=True)
class CameraErrorsScenario(AlignmentTrialsScenario):
    """The alignment with errors of its cameras; its controllers know nothing of them.

    Parts at rest tell where an error alone makes the cameras take them to be aligned, without
    noise and dead zones, at many sizes. Runs of the loop tell what is left in the end at one.
    """

    initial_error: tuple[float, ...] = AlignmentScenario.initial_error
    trials: int = 4  # runs with drawn errors and starts, each with and without the errors
    compensation_time: float = 6.0  # s, the end: what is left then is bias, the rest was slow
    soon: float = 2.5  # s, of the compensation, after which is looked too; section 5
    behind: float = 0.1  # m, from the tip, where the peg's axis is looked at too
    off_axis: float = 0.02  # m, from the optical axes to parts that are off them; assumed
    points: int = 3  # sizes of an error of parts at rest, up to the largest; 0: none at rest
    largest: float = 1.0  # of the sizes that an error may well have: the largest that is tried
    drawn: float = 0.5  # of them: drawn errors are at most as large
    errors: tuple[str, ...] = ()  # names of those to be tried alone; none: all
    controllers: tuple[ControllerKind, ...] = ("fsm",)  # of the loop: fsm, pid
    measurements: tuple[Measured, ...] = ("image",)  # image, metric

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "soon", "behind", "largest")
        require_not_negative(self, "off_axis", "drawn")
        if not self.soon <= self.compensation_time:
            allowed = f"at most compensation_time, {self.compensation_time:g} s"
            raise ParameterError("soon", self.soon, allowed)
        if not 0 <= self.points <= 100:
            raise ParameterError("points", self.points, "0 to 100")
        for name in self.errors:
            if name not in BY_NAME:
                raise ParameterError("errors", name, ", ".join(BY_NAME))
        for field in ("controllers", "measurements"):
            if not getattr(self, field):
                raise ParameterError(field, (), "one or more")

    @property
    def alone(self) -> tuple[CameraError, ...]:
        """The errors that are tried alone."""
        return tuple(one for one in ERRORS if not self.errors or one.name in self.errors)


@dataclass(frozen=True, kw_only=True)
class ResolvedCameraErrorsScenario(ResolvedAlignmentTrialsScenario, CameraErrorsScenario):
    """The same with nothing left open."""


CAMERA_ERRORS: Final = CameraErrorsScenario()


def resolve(scenario: CameraErrorsScenario) -> ResolvedCameraErrorsScenario:
    """Refuse what the study sets itself."""
    if scenario.controller != ControllerChoice():
        raise ParameterError("controller.kind", scenario.controller.kind, "fsm; see controllers")
    if scenario.cameras.measured != CameraSettings().measured:
        allowed = "image; see measurements"
        raise ParameterError("cameras.measured", scenario.cameras.measured, allowed)
    if scenario.cameras.renderer != "software":
        raise ParameterError("cameras.renderer", scenario.cameras.renderer, "software")
    if scenario.compensated == "none":
        raise ParameterError("compensated", "none", "peg, hole, both")
    if scenario.moves:
        # What a motion makes the cameras expect is as late as their images truly are.
        allowed = "0, 0, 0: the errors of time are known on the way"
        raise ParameterError("start_offset", scenario.start_offset, allowed)
    return resolve_trials(ResolvedCameraErrorsScenario, scenario)


def run(scenario: ResolvedCameraErrorsScenario, seed: int, progress: Progress) -> Outcome:
    """Look at parts at rest, and run the loop."""
    study = Study(scenario, scenario.behind, scenario.off_axis, scenario.soon)
    still = _still(scenario, study, partial(_part, progress, 0.0, 0.2))
    tasks = [
        *_alone(scenario),
        *(
            ErrorRun(name, size, controller, measured, trial)
            for trial in range(scenario.trials)
            for controller in scenario.controllers
            for measured in scenario.measurements
            for name, size in ((NONE, 0.0), (DRAWN, scenario.drawn))
        ),
    ]
    finished = run_each(partial(run_once, study, seed), tasks, partial(_part, progress, 0.2, 1.0))
    traces = _rows(finished)
    metrics = _metrics(scenario, still, traces)
    return Outcome(
        metrics={"answer": answer(scenario.alone, still, traces), **metrics},
        traces=traces,
        simulated_seconds=len(finished) * scenario.duration,
        tables={"still": still},
    )


def _part(progress: Progress, begin: float, end: float, fraction: float, doing: str = "") -> None:
    progress(begin + (end - begin) * fraction, doing)


def _still(scenario: CameraErrorsScenario, study: Study, progress: Progress) -> Table:
    """Return a row for each error at each size, as either measurement sees parts at rest."""
    shares = scenario.largest * np.linspace(0.0, 1.0, scenario.points + 1)[1:]
    tasks = [
        ErrorAtRest(error.name, tuple((shares * error.most).tolist()), measured)
        for measured in scenario.measurements
        for error in scenario.alone
        if not error.moving and scenario.points
    ]
    columns = ("size", *LEFT, "gap_error")
    if not tasks:
        names = {name: np.array([], np.str_) for name in ("error", "measured")}
        return {**names, **{name: np.array([]) for name in columns}}
    found = run_each(partial(at_rest, study), tasks, progress)
    count = [len(row["size"]) for row in found.rows]
    return {
        "error": np.repeat([task.error for task in found.tasks], count),
        "measured": np.repeat([task.measured for task in found.tasks], count),
        **{name: np.concatenate([row[name] for row in found.rows]) for name in columns},
    }


def _alone(scenario: CameraErrorsScenario) -> list[ErrorRun]:
    """Return the runs with one error, and without any, from the scenario's own start."""
    sizes = [
        (one.name, sign * scenario.largest * one.most)
        for one in scenario.alone
        if one.change
        # A dead zone, and the joints' friction, hide a bias to one side.
        for sign in ((1, -1) if one.off_axis else (1,))
    ]
    return [
        ErrorRun(name, size, controller, measured)
        for controller in scenario.controllers
        for measured in scenario.measurements
        for name, size in [(NONE, 0.0), *sizes]
    ]


def _rows(finished: Trials[ErrorRun]) -> Table:
    """Return a row a run."""
    tasks = finished.tasks
    trial = [math.nan if task.trial is None else task.trial for task in tasks]
    names = [name for name in finished.rows[0] if name not in ("seen", "diverged")]
    return {
        "error": np.array([task.error for task in tasks]),
        "size": column([task.size for task in tasks]),
        "controller": np.array([task.controller for task in tasks]),
        "measured": np.array([task.measured for task in tasks]),
        "trial": column(trial),
        **{name: finished.column(name) for name in ("seen", "diverged", *names)},
    }


def _metrics(scenario: CameraErrorsScenario, still: Table, runs: Table) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for measured in scenario.measurements:
        for error in scenario.alone:
            of = (still["error"] == error.name) & (still["measured"] == measured)
            if of.any():
                rows = {name: values[of] for name, values in still.items()}
                found = _at_rest_metrics(error, rows)
                metrics |= {f"{error.name}.{measured}.{k}": v for k, v in found.items()}
        for controller in scenario.controllers:
            of = (runs["controller"] == controller) & (runs["measured"] == measured)
            found = _loop_metrics(scenario, {name: values[of] for name, values in runs.items()})
            metrics |= {
                name.replace("*", f"{controller}.{measured}"): one for name, one in found.items()
            }
    return metrics


def _at_rest_metrics(error: CameraError, rows: Table) -> dict[str, Metric]:
    """Return what an error alone does where nothing moves: bias, sensitivity, and how much."""
    size = np.abs(rows["size"])
    seen = np.isfinite(rows["rotational_error"])
    metrics = {}
    for name, unit in LEFT.items():
        left = rows[name]
        note = f"at {size[seen][-1]:.3g} {error.unit}".rstrip() if seen.any() else "never seen"
        metrics[f"rest.{name}"] = Metric(
            value=float(left[seen][-1]) if seen.any() else None, unit=unit, note=note
        )
        metrics[f"rest.{name}.per_unit"] = Metric(
            value=float(left[seen][0] / size[seen][0]) if seen.any() else None,
            unit=_per(unit, error.unit),
            note=f"at {size[0]:.3g} {error.unit}".rstrip(),
        )
        reach = reached(size[seen], left[seen], PUBLISHED[name])
        most = f"not up to {size[seen][-1]:.3g} {error.unit}".rstrip() if seen.any() else ""
        metrics[f"rest.{name}.published_at"] = Metric(
            value=reach, unit=error.unit, note="" if reach is not None else most or "never seen"
        )
    lost = size[~seen]
    metrics["rest.lost_at"] = Metric(
        value=float(lost[0]) if len(lost) else None,
        unit=error.unit,
        note="a part is not found" if len(lost) else "parts are found at all sizes",
    )
    return metrics


def _per(unit: str, of: str) -> str:
    """Return the unit of a quotient."""
    if unit == of:
        return ""
    return f"{unit}/{of.removesuffix('s')}" if of else unit


def _loop_metrics(scenario: CameraErrorsScenario, runs: Table) -> dict[str, Metric]:
    """Return what is left in runs of one controller with one measurement, by ``*`` for both."""
    metrics = {}
    alone = np.isnan(runs["trial"])
    times = {"soon": scenario.soon, "late": scenario.compensation_time}
    for name in dict.fromkeys(runs["error"][alone].tolist()):
        rows = np.flatnonzero(alone & (runs["error"] == name))
        row = int(rows[np.argmax(np.nan_to_num(runs["late.rotational_error"][rows]))])
        seen = bool(runs["seen"][row])
        for moment in MOMENTS:
            note = (
                f"after {times[moment]:g} s" if seen else "blind: that of the start, or of no run"
            )
            for kind, unit in LEFT.items():
                value = float(runs[f"{moment}.{kind}"][row])
                metrics[f"{name}.*.{moment}.{kind}"] = Metric(
                    value=value if math.isfinite(value) else None, unit=unit, note=note
                )
        for kind, unit in (("lateral_error", "m"), ("rotational_error", "rad")):
            value = float(runs[f"late.vision.{kind}"][row])
            metrics[f"{name}.*.late.vision.{kind}"] = Metric(
                value=value if math.isfinite(value) else None, unit=unit, note="true less measured"
            )
        metrics[f"{name}.*.blind"] = Metric(value=float(not seen), unit="")
    for name in (NONE, DRAWN):
        drawn = ~alone & (runs["error"] == name)
        if drawn.any():
            metrics |= _drawn_metrics(name, {key: of[drawn] for key, of in runs.items()})
    return metrics


def _drawn_metrics(name: str, runs: Table) -> dict[str, Metric]:
    """Return means and maxima over drawn starts, and errors if there are any."""
    metrics = {}
    seen = runs["seen"] > 0
    label = f"drawn.{'errors' if name == DRAWN else NONE}.*"
    n = int(seen.sum())
    without = f", without {', '.join(one.says for one in NOT_DRAWN)}" if name == DRAWN else ""
    for moment in MOMENTS:
        for kind, unit in LEFT.items():
            left = runs[f"{moment}.{kind}"][seen]
            for of, value in (("mean", np.mean), ("max", np.max)):
                metrics[f"{label}.{moment}.{kind}.{of}"] = Metric(
                    value=float(value(left)) if n else None,
                    unit=unit,
                    note=f"of {n} runs of {len(seen)} in which the parts are seen{without}",
                )
    metrics[f"{label}.blind"] = Metric(
        value=100 * float(np.mean(~seen)), unit="%", note=f"of {len(seen)} runs"
    )
    metrics[f"{label}.diverged"] = Metric(
        value=100 * float(np.mean(runs["diverged"] > 0)), unit="%", note=f"of {len(seen)} runs"
    )
    return metrics


def figures(scenario: CameraErrorsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {
        "camera-errors": plot_errors(scenario, outcome),
        "camera-errors-drawn": plot_drawn(scenario, outcome),
    }
