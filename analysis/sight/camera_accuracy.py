"""Section 4: how exactly the cameras see where the parts are."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.scenario.experiment import (
    Metric,
    Outcome,
    Progress,
    Table,
    column,
)
from chamfer.analysis.sight.camera_accuracy_figures import plot_accuracy
from chamfer.analysis.sight.detection_trials import (
    NEAR,
    STATUSES,
    UNITS,
    WIDE,
    Poses,
    PoseSpread,
    Reach,
    TrialCamera,
    draw_poses,
    kinds,
    measure,
    trial_camera,
)
from chamfer.analysis.sight.picture_conditions import PictureQuality
from chamfer.diagrams.cell.cell_vision import VIEWS, CellCameras
from chamfer.diagrams.cell.work_cell import WorkCellScenario
from chamfer.models.cameras.camera import View
from chamfer.models.peg.peg_and_hole import OF_CONTACT, ColouredParts
from chamfer.models.validation import ParameterError, require_not_negative, require_same
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import Status, detect_parts

Array = NDArray[np.float64]

_MOST_POSES: Final = 10_000
_EXAMPLE: Final = ("wide", "noisy")  # of which the first pose's frames are kept
_AROUND: Final = (104, 48)  # pixels of an example frame that are kept, to either side
_MARKS: Final = ("view", "part", "tip_u", "tip_v", "point_u", "point_v", "angle")
_MEASURED: Final = (*STATUSES, *UNITS)
_POOLED: Final = ("rms", "max")


@dataclass(frozen=True, kw_only=True)
class AccuracyCameras(CellCameras, PictureQuality):
    """The cameras and their pictures; in the case near_straight the roll is 0."""

    def __post_init__(self) -> None:
        CellCameras.__post_init__(self)
        PictureQuality.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class AccuracyScenario:
    """The cameras of the work cell, and poses of the parts at and away from alignment.

    The paper prints the size of the images; all else is assumed.
    """

    poses: int = 200  # of each case
    parts: ColouredParts = field(default_factory=ColouredParts)
    cameras: AccuracyCameras = field(default_factory=AccuracyCameras)
    gap: float = WorkCellScenario.gap  # m, nominal, from the peg's tip to the hole's mouth
    wide: PoseSpread = WIDE  # as at the start of an alignment
    near: PoseSpread = NEAR  # as at its end

    def __post_init__(self) -> None:
        require_not_negative(self, "gap")
        require_same(self.parts, ColouredParts, "parts", *OF_CONTACT, why="the parts don't touch")
        if not 1 <= self.poses <= _MOST_POSES:
            raise ParameterError("poses", self.poses, f"1 to {_MOST_POSES}")


class Case(NamedTuple):
    """Which poses, and whether the cameras are rolled."""

    spread: str  # the scenario's field
    rolled: bool


CASES: Final[Mapping[str, Case]] = {
    "wide": Case("wide", True),
    "near": Case("near", True),
    "near_straight": Case("near", False),
}
_STREAMS: Final = ("wide", "near")  # the same poses and noise where the spread is the same


@cache
def _cameras(scenario: AccuracyScenario, rolled: bool) -> dict[View, TrialCamera]:
    """Return the cameras; a process makes them once."""
    cameras = scenario.cameras if rolled else replace(scenario.cameras, roll=0.0)
    # They look at the middle of the gap, the world's origin.
    placements = {view: cameras.placement(view, (0.0, 0.0, 0.0)) for view in VIEWS}
    return {
        view: trial_camera(scenario.parts, placement.camera, cameras.renderer, cameras.blur)
        for view, placement in placements.items()
    }


def _trial(
    scenario: AccuracyScenario, seed: int, case: Case, trial: int
) -> tuple[Poses, dict[View, dict[str, Image]]]:
    """Return random poses of the parts, and the images of each view by their kind."""
    random = np.random.default_rng([seed, _STREAMS.index(case.spread), trial])
    poses = draw_poses(scenario.gap, getattr(scenario, case.spread), random)
    cameras, noise = _cameras(scenario, case.rolled), scenario.cameras.noise
    return poses, {view: cameras[view].images(poses, noise, random) for view in VIEWS}


class Task(NamedTuple):
    """One of the poses in one of the cases."""

    case: str
    trial: int


def _detect(scenario: AccuracyScenario, seed: int, task: Task) -> Row:
    """Return what was measured in a pose's images, ``errors``, shape (kinds, measured)."""
    case = CASES[task.case]
    cameras = {view: one.camera for view, one in _cameras(scenario, case.rolled).items()}
    poses, images = _trial(scenario, seed, case, task.trial)
    errors = []
    for kind in kinds(scenario.cameras.renderer):
        frames = {view: images[view][kind] for view in VIEWS}
        measured = measure(
            scenario.parts, cameras, frames, poses, pixel_size=scenario.cameras.pixel_size
        )
        errors.append([measured[name] for name in _MEASURED])
    return {"errors": np.array(errors)}


def _example(scenario: AccuracyScenario, seed: int) -> dict[str, Table]:
    """Return the middle of a pose's frames, a row a pixel, and what is detected in them."""
    name, kind = _EXAMPLE
    _, images = _trial(scenario, seed, CASES[name], 0)
    pixels: dict[str, list[Array]] = {}
    marks: dict[str, list[float]] = {}
    looks = appearances(scenario.parts, scenario.cameras.pixel_size, scenario.cameras.distance)
    for index, view in enumerate(VIEWS):
        image = images[view][kind]
        height, width = image.shape[:2]
        rows = slice(max(height // 2 - _AROUND[1], 0), height // 2 + _AROUND[1])
        columns = slice(max(width // 2 - _AROUND[0], 0), width // 2 + _AROUND[0])
        v, u = np.mgrid[rows, columns]
        red, green, blue = np.moveaxis(image[rows, columns], 2, 0)
        values = {"u": u, "v": v, "red": red, "green": green, "blue": blue}
        for key, of in {"view": np.full_like(u, index), **values}.items():
            pixels.setdefault(key, []).append(of.ravel())
        for part, found in enumerate(detect_parts(image, *looks)):
            values_of = (index, part, *found.tip, *found.point, found.angle)
            for key, value in zip(_MARKS, values_of, strict=True):
                marks.setdefault(key, []).append(value)
    return {
        "frames": {key: np.concatenate(of) for key, of in pixels.items()},
        "frame_detections": {key: column(of) for key, of in marks.items()},
    }


def run(scenario: AccuracyScenario, seed: int, progress: Progress) -> Outcome:
    """Detect the parts in all kinds of images of the same poses, in each case."""
    tasks = [Task(case, trial) for case in CASES for trial in range(scenario.poses)]
    finished = run_each(partial(_detect, scenario, seed), tasks, progress)
    finished.split(CASES, lambda task: task.case)  # none may be without
    traces = _rows(finished)
    return Outcome(
        metrics=_metrics(scenario, traces),
        traces=traces,
        simulated_seconds=0.0,
        tables=_example(scenario, seed),
    )


def _rows(finished: Trials[Task]) -> Table:
    """Return a row for each pose and kind of images."""
    errors = np.concatenate([row["errors"] for row in finished.rows])
    count = len(errors) // len(finished)
    cases = [tuple(CASES).index(task.case) for task in finished.tasks]
    return {
        "case": column(np.repeat(cases, count)),
        "images": column(np.tile(np.arange(count), len(finished))),
        "trial": column(np.repeat([task.trial for task in finished.tasks], count)),
        **{name: column(errors[:, i]) for i, name in enumerate(_MEASURED)},
    }


def _metrics(scenario: AccuracyScenario, traces: Table) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for i, case in enumerate(CASES):
        for j, kind in enumerate(kinds(scenario.cameras.renderer)):
            of = (traces["case"] == i) & (traces["images"] == j)
            valid = [traces[name][of] == Status.VALID for name in STATUSES]
            metrics[f"{case}.{kind}.valid"] = Metric(
                value=100 * float(np.mean(np.all(valid, axis=0))),
                unit="%",
                note=f"of {scenario.poses} poses with both parts found in both views",
            )
            for name, unit in UNITS.items():
                metrics |= _spread(
                    f"{case}.{kind}.{name}", traces[name][of], unit, scenario.cameras.pixel_size
                )
    return metrics


def _spread(name: str, values: Array, unit: str, pixel_size: float) -> dict[str, Metric]:
    """Return rms and largest of one error; the note of the rms says how much of it is bias."""
    known = values[np.isfinite(values)]
    missing = len(values) - len(known)
    lacks = f"undefined in {missing} of {len(values)}" if missing else ""
    if not len(known):
        return {f"{name}.{key}": Metric(value=None, unit=unit, note=lacks) for key in _POOLED}
    rms, largest = math.sqrt(float(np.mean(known**2))), float(np.abs(known).max())
    metrics = {}
    for key, value in zip(_POOLED, (rms, largest), strict=True):
        notes = [f"{1e3 * pixel_size * value:.2g} mm at the parts"] if unit == "px" else []
        notes += [f"mean {float(np.mean(known)):.2g} {unit}"] if key == "rms" else []
        notes += [lacks] if lacks else []
        metrics[f"{name}.{key}"] = Metric(value=value, unit=unit, note=", ".join(notes))
    return metrics


def resolve_camera_accuracy(scenario: AccuracyScenario) -> AccuracyScenario:
    """Return the scenario with what it leaves open filled in, and checked."""
    if scenario.cameras.renderer == "vtk":
        reason = missing_graphics()
        if reason is not None:
            raise ParameterError("cameras.renderer", "vtk", f"software here: {reason}")
    return scenario


def _said(scenario: AccuracyScenario, case: Case) -> str:
    reach: Reach = getattr(scenario, case.spread).peg
    rolled = f"{scenario.cameras.roll:g} rad" if case.rolled else "0"
    return f"within {1e3 * reach.distance:g} mm, {1e3 * reach.angle:g} mrad; roll {rolled}"


def figures(scenario: AccuracyScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    figure = plot_accuracy(
        outcome,
        cases={name: _said(scenario, case) for name, case in CASES.items()},
        kinds=kinds(scenario.cameras.renderer),
        pixel_size=scenario.cameras.pixel_size,
    )
    return {"camera-accuracy": figure}
