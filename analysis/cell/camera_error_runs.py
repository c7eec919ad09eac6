"""Alignments by cameras with errors: where parts at rest are taken to be aligned, and runs."""

import math
from dataclasses import replace
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import (
    LATE,
    Traces,
    row_before,
    run_alignment,
    true_errors,
)
from chamfer.analysis.cell.alignment_trials import AlignmentTrialsScenario, drawn
from chamfer.analysis.cell.camera_error_kinds import ERRORS, beside, with_error
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    ControllerChoice,
    ControllerKind,
)
from chamfer.diagrams.cell.cell_cameras import Measured
from chamfer.diagrams.cell.in_view import require_in_view
from chamfer.diagrams.cell.start_apart import require_start_apart
from chamfer.diagrams.cell.still_vision import StillVision
from chamfer.models.validation import ParameterError
from chamfer.systems.pose import POSE_NAMES, pose_vector

Array = NDArray[np.float64]
ScenarioT = TypeVar("ScenarioT", bound=AlignmentScenario)

NONE: Final = "none"  # no error
DRAWN: Final = "drawn"  # all of them at once
BY_NAME: Final = {error.name: error for error in ERRORS}
DRAWN_ERRORS: Final = tuple(error for error in ERRORS if error.change is not None)
NOT_DRAWN: Final = tuple(error for error in ERRORS if error.change is None)  # at rest alone
# What is left, by name: of the tip, of the axes, and of the peg's axis some way behind the tip.
LEFT: Final = {"lateral_error": "m", "rotational_error": "rad", "behind_error": "m"}
MOMENTS: Final = ("soon", "late")


class Study(NamedTuple):
    """What all runs of a study have in common; resolved."""

    scenario: AlignmentTrialsScenario
    behind: float  # m, from the tip
    off_axis: float  # m
    soon: float  # s, since the compensation's begin


class Still(NamedTuple):
    """One error at some sizes, of parts at rest."""

    error: str
    sizes: tuple[float, ...]
    measured: Measured


class Run(NamedTuple):
    """One run of the loop, with an error or with drawn ones."""

    error: str  # or NONE, or DRAWN
    size: float  # of the drawn ones: of each a share
    controller: ControllerKind
    measured: Measured
    trial: int | None = None  # by which its start is drawn too; None: the scenario's own start


def left(study: Study, pose: Array, hole: Array) -> dict[str, Array]:
    """Return what :data:`LEFT` names, shape (n,), of poses of peg and hole, shape (n, 7)."""
    found = true_errors(pose, hole)
    back = Rotation.from_quat(pose[:, :4], scalar_first=True).apply([-study.behind, 0.0, 0.0])
    moved = pose.copy()
    moved[:, 4:] += back
    behind = true_errors(moved, hole).lateral
    return {
        "lateral_error": found.lateral,
        "rotational_error": found.rotational,
        "behind_error": behind,
    }


def at_rest(study: Study, task: Still) -> Row:
    """Return where the parts are taken to be aligned, shape (n,); NaN where one is not seen."""
    error = BY_NAME[task.error]
    values: dict[str, list[float]] = {name: [] for name in (*LEFT, "gap_error")}
    for size in task.sizes:
        scenario = with_error(_of(study, task.measured), error, size, study.off_axis)
        picture = None if error.picture is None else error.picture(size)
        X_WT = StillVision(scenario, picture).aligned()
        if X_WT is None:
            found = dict.fromkeys(values, math.nan)
        else:
            pose, hole = (
                pose_vector(X)[np.newaxis] for X in (X_WT, scenario.nominal_pose("hole"))
            )
            found = {name: float(of[0]) for name, of in left(study, pose, hole).items()}
            found["gap_error"] = float(true_errors(pose, hole).gap[0]) - scenario.gap
        for name, value in found.items():
            values[name].append(value)
    return {"size": np.array(task.sizes), **{name: np.array(of) for name, of in values.items()}}


def reached(size: Array, left: Array, wanted: float) -> float | None:
    """Return the size at which an error is as large as wanted, None if it never is.

    Straight between sizes, and from nothing to the first one.
    """
    size, left = np.concatenate([[0.0], size]), np.concatenate([[0.0], left])
    beyond = np.flatnonzero(left >= wanted)
    if not len(beyond):
        return None
    k = int(beyond[0])
    share = (wanted - left[k - 1]) / (left[k] - left[k - 1])
    return float(size[k - 1] + share * (size[k] - size[k - 1]))


def run_once(study: Study, seed: int, task: Run) -> Row:
    """Run the loop, and return what is left soon and late; it depends on its arguments alone.

    ``seen`` is 0 where nothing was measured in the end: what is left then is of the start, or of
    where the parts were lost. No run is made where they are not in view to begin with.
    """
    scenario, trial = _of(study, task.measured, task.controller), task.trial or 0
    if task.trial is not None:
        middle = replace(scenario, initial_error=(0.0,) * len(scenario.initial_error))
        scenario = drawn(middle, scenario.spread, seed, trial)
    if task.error == DRAWN:
        scenario = with_drawn_errors(scenario, seed, trial, task.size, study.off_axis)
    elif task.error != NONE:
        scenario = with_error(scenario, BY_NAME[task.error], task.size, study.off_axis)
    try:
        require_in_view(scenario)
        require_start_apart(scenario)
    except ParameterError:
        return {"seen": 0.0, "diverged": 0.0, **dict.fromkeys(_names(), None)}
    traces = run_alignment(scenario, trial_seed(seed, trial))
    return {
        "seen": float(
            traces["valid"][row_before(traces["time"], traces["time"][-1] - LATE) :].any()
        ),
        "diverged": float(traces["diverged"].max()),
        **_measured(study, traces),
    }


def with_drawn_errors(
    scenario: ScenarioT, seed: int, trial: int, share: float, off_axis: float
) -> ScenarioT:
    """Return a resolved scenario whose cameras have errors, each up to a share of its most.

    Those are all that cameras of the loop can have. Each camera has its own; how far the parts
    are off the optical axes, m, up to the same share of ``off_axis``, is drawn too.
    """
    generator = np.random.default_rng([seed, trial, len(ERRORS)])  # no start is drawn of it
    scenario = beside(scenario, share * off_axis * float(generator.uniform(-1.0, 1.0)))
    for error in DRAWN_ERRORS:
        for view in error.views:
            size = float(generator.uniform(-1.0 if error.signed else 0.0, 1.0)) * error.most
            alone = error._replace(views=(view,), off_axis=False)
            scenario = with_error(scenario, alone, share * size, 0.0)
    return scenario


def _names() -> list[str]:
    seen = ("vision.lateral_error", "vision.rotational_error")
    return [f"{moment}.{name}" for moment in MOMENTS for name in (*LEFT, *seen)]


def _measured(study: Study, traces: Traces) -> dict[str, float | None]:
    """Return what is left, and what the cameras are off, soon and late."""
    scenario = study.scenario
    poses = [
        np.column_stack([traces[f"{arm}_true_{name}"] for name in POSE_NAMES])
        for arm in ("peg", "hole")
    ]
    found = left(study, *poses)
    rows = {"soon": row_before(traces["time"], scenario.begin + study.soon) + 1, "late": -1}
    values: dict[str, float | None] = {}
    pixel = scenario.cameras.pixel_size
    for moment, row in rows.items():
        row = min(row, len(traces["time"]) - 1)
        values |= {f"{moment}.{name}": float(of[row]) for name, of in found.items()}
        off = [
            scale * traces[f"error_{axis}"][row] - traces[f"true_{axis}"][row]
            for axis, scale in (("y", pixel), ("z", pixel), ("pitch", 1.0), ("yaw", 1.0))
        ]
        seen = bool(traces["valid"][row])
        values[f"{moment}.vision.lateral_error"] = float(np.hypot(*off[:2])) if seen else None
        values[f"{moment}.vision.rotational_error"] = float(np.hypot(*off[2:])) if seen else None
    return values


def _of(
    study: Study, measured: Measured, controller: ControllerKind = "fsm"
) -> AlignmentTrialsScenario:
    scenario = study.scenario
    return replace(
        scenario,
        controller=ControllerChoice(kind=controller),
        cameras=replace(scenario.cameras, measured=measured),
    )
