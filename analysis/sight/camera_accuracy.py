"""Section 4: how exactly the cameras see where the parts are."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import draw_intervals, metric_value
from chamfer.analysis.drawing.figure_style import PUBLISHED, Style, dress, legend_below, new_figure
from chamfer.analysis.published.fsm_work_cell import SIGNAL_ACCURACY
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.analysis.sight.detection_trials import (
    NEAR,
    STATUSES,
    UNITS,
    WIDE,
    Poses,
    PoseSpread,
    TrialCamera,
    draw_poses,
    kinds,
    measure,
)
from chamfer.analysis.sight.picture_conditions import PictureQuality
from chamfer.diagrams.cell.cell_vision import VIEWS, CellCameras
from chamfer.diagrams.cell.work_cell import WorkCellScenario
from chamfer.models.cameras.camera import View
from chamfer.models.peg.peg_and_hole import OF_CONTACT, ColouredParts
from chamfer.models.validation import ParameterError, require_not_negative, require_same
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.cameras.vtk_camera import missing_graphics
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts

Array = NDArray[np.float64]

_MOST_POSES: Final = 10_000
_EXAMPLE: Final = ("wide", "noisy")  # of which the first pose's frames are kept
_AROUND: Final = (104, 48)  # pixels of an example frame that are kept, to either side
_MARKS: Final = ("view", "part", "tip_u", "tip_v", "point_u", "point_v", "angle")
_PIXELS: Final = ("view", "u", "v", "red", "green", "blue")
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


ACCURACY: Final = AccuracyScenario()


class AccuracyCase(NamedTuple):
    """Which poses, and whether the cameras are rolled."""

    spread: str  # the scenario's field
    rolled: bool


CASES: Final[Mapping[str, AccuracyCase]] = {
    "wide": AccuracyCase("wide", True),
    "near": AccuracyCase("near", True),
    "near_straight": AccuracyCase("near", False),
}
_STREAMS: Final = ("wide", "near")  # the same poses and noise where the spread is the same


@cache
def _cameras(scenario: AccuracyScenario, rolled: bool) -> dict[View, TrialCamera]:
    """Return the cameras; a process makes them once."""
    cameras = scenario.cameras if rolled else replace(scenario.cameras, roll=0.0)
    # They look at the middle of the gap, the world's origin.
    return {
        view: TrialCamera(
            scenario.parts,
            cameras.placement(view, (0.0, 0.0, 0.0)).camera,
            cameras.renderer,
            cameras.blur,
        )
        for view in VIEWS
    }


def _trial(
    scenario: AccuracyScenario, seed: int, case: AccuracyCase, trial: int
) -> tuple[Poses, dict[View, dict[str, Image]]]:
    """Return random poses of the parts, and the images of each view by their kind."""
    random = np.random.default_rng([seed, _STREAMS.index(case.spread), trial])
    poses = draw_poses(scenario.gap, getattr(scenario, case.spread), random)
    cameras, noise = _cameras(scenario, case.rolled), scenario.cameras.noise
    return poses, {view: cameras[view].images(poses, noise, random) for view in VIEWS}


class AccuracyTask(NamedTuple):
    """One of the poses in one of the cases."""

    case: str
    trial: int


def _detect(scenario: AccuracyScenario, seed: int, task: AccuracyTask) -> Row:
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
    pixels, marks = [], []
    looks = appearances(scenario.parts, scenario.cameras.pixel_size, scenario.cameras.distance)
    for index, view in enumerate(VIEWS):
        image = images[view][kind]
        height, width = image.shape[:2]
        rows = slice(max(height // 2 - _AROUND[1], 0), height // 2 + _AROUND[1])
        columns = slice(max(width // 2 - _AROUND[0], 0), width // 2 + _AROUND[0])
        v, u = np.mgrid[rows, columns]
        colours = np.moveaxis(image[rows, columns], 2, 0)
        pixels.append([one.ravel() for one in (np.full_like(u, index), u, v, *colours)])
        for part, found in enumerate(detect_parts(image, *looks)):
            marks.append((index, part, *found.tip, *found.point, found.angle))
    return {
        "frames": dict(zip(_PIXELS, map(np.concatenate, zip(*pixels, strict=True)), strict=True)),
        "frame_detections": dict(zip(_MARKS, map(column, zip(*marks, strict=True)), strict=True)),
    }


def run(scenario: AccuracyScenario, seed: int, progress: Progress) -> Outcome:
    """Detect the parts in all kinds of images of the same poses, in each case."""
    tasks = [AccuracyTask(case, trial) for case in CASES for trial in range(scenario.poses)]
    finished = run_each(partial(_detect, scenario, seed), tasks, progress)
    finished.split(CASES, lambda task: task.case)  # none may be without
    traces = _rows(finished)
    return Outcome(
        metrics=_metrics(scenario, traces),
        traces=traces,
        simulated_seconds=0.0,
        tables=_example(scenario, seed),
    )


def _rows(finished: Trials[AccuracyTask]) -> Table:
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
    size = scenario.cameras.pixel_size
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
                metrics |= _spread(f"{case}.{kind}.{name}", traces[name][of], unit, size)
    return metrics


def _spread(name: str, values: Array, unit: str, pixel_size: float) -> dict[str, Metric]:
    """Return rms and largest of one error; the note of the rms says how much of it is bias."""
    known = values[np.isfinite(values)]
    missing = len(values) - len(known)
    lacks = [f"undefined in {missing} of {len(values)}"] if missing else []
    if not len(known):
        return metrics_of({f"{name}.{key}": (None, unit, lacks[0]) for key in _POOLED})
    rms = math.sqrt(float(np.mean(known**2)))
    largest = None if missing else float(np.abs(known).max())  # nobody knows that of the others
    rows = {}
    for key, value in zip(_POOLED, (rms, largest), strict=True):
        notes = []
        if unit == "px" and value is not None:
            notes = [f"{1e3 * pixel_size * value:.2g} mm at the parts"]
        notes += [f"mean {float(np.mean(known)):.2g} {unit}"] if key == "rms" else []
        rows[f"{name}.{key}"] = value, unit, ", ".join([*notes, *lacks])
    return metrics_of(rows)


def resolve_camera_accuracy(scenario: AccuracyScenario) -> AccuracyScenario:
    """Return the scenario with its open fields filled in, and checked."""
    if scenario.cameras.renderer == "vtk":
        reason = missing_graphics()
        if reason is not None:
            raise ParameterError("cameras.renderer", "vtk", f"software here: {reason}")
    return scenario


_VIEW_TITLES: Final = {"xz": "X-Z, seen along Y", "xy": "X-Y, seen from above"}

_PEG: Final[Style] = {"color": "#b00020", "marker": "o"}
_HOLE: Final[Style] = {"color": "#1b4f9c", "marker": "s"}
_BOTH: Final[Style] = {"color": "#555555", "marker": "D"}
_IN_IMAGE: Final[Mapping[str, tuple[str, Style]]] = {
    f"{view}.{target}": (f"{said}, {seen}", {**style, **filled})
    for target, said, style in (
        ("peg", "peg", _PEG),
        ("hole", "hole", _HOLE),
        ("scaled", "error signal, not calibrated", _BOTH),
    )
    for view, seen, filled in (("xz", "X-Z", {}), ("xy", "X-Y", {"markerfacecolor": "white"}))
}
_IN_SPACE: Final[Mapping[str, tuple[str, Style]]] = {
    "space.peg": ("peg", _PEG),
    "space.hole": ("hole", _HOLE),
    "space.relative": ("peg to hole, in space", {**_BOTH, "marker": "*", "markersize": 7}),
}
_AXIS: Final[Style] = {"color": "black", "linewidth": 1.0, "dashes": (6, 3)}
_TIP: Final[Style] = {"color": "white", "marker": "+", "markersize": 12, "markeredgewidth": 1.6}
_BEYOND: Final = 20  # pixels of the axis that are drawn beyond the tip
_ZOOM: Final = 10  # pixels to either side of the tip


def figures(scenario: AccuracyScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the example frames and, for every case and kind of image, rms and largest errors."""
    pixel_size = scenario.cameras.pixel_size
    names = kinds(scenario.cameras.renderer)
    poses = len(np.unique(outcome.traces["trial"]))
    sampled = " Sampled: a pixel shows one point of the scene, not its mean."
    figure = new_figure(
        height=11.5,
        caption=f"Errors of detection in {poses} poses each: rms (marker) and largest (end of the "
        f"line), in the image and in space.{sampled if 'sampled' in names else ''}",
    )
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=(0.25, 1.0))[:, 0]
    _frames(top, outcome.tables)
    panels = bottom.subplots(2, 2, sharey=True).ravel()
    lateral, axial, angle, space = panels
    rows = [i * (len(names) + 1) + j + 1 for i in range(len(CASES)) for j in range(len(names))]
    factors = {name: 1 / pixel_size if "scaled" in name else 1.0 for name in _IN_IMAGE}
    for axes, quantity, title in (
        (lateral, "lateral", "(a) Across the axis"),
        (axial, "axial", "(b) Along the axis"),
    ):
        _errors(axes, outcome, names, rows, _IN_IMAGE, quantity, factors)
        axes.axvline(SIGNAL_ACCURACY / pixel_size, label="published: sub-millimetre", **PUBLISHED)
        dress(axes, title=title, x="error / px", y="")
        above = axes.secondary_xaxis(
            "top",
            functions=(lambda x: 1e3 * pixel_size * x, lambda x: 1e-3 / pixel_size * x),
        )
        above.set_xlabel("at the parts / mm", fontsize=9)
        above.tick_params(labelsize=8)
    _errors(angle, outcome, names, rows, _IN_IMAGE, "angle", dict.fromkeys(_IN_IMAGE, 1e3))
    dress(angle, title="(c) Angle of the axis", x="error / mrad", y="")
    _errors(space, outcome, names, rows, _IN_SPACE, "tip", dict.fromkeys(_IN_SPACE, 1e3))
    space.axvline(1e3 * SIGNAL_ACCURACY, **PUBLISHED)
    dress(space, title="(d) Tips in space, by stereo", x="error / mm", y="")
    for axes in panels:
        axes.set_xscale("log")
        axes.grid(False, axis="y")
    ends = np.array([axes.get_xlim() for axes in (lateral, axial)])
    for axes in (lateral, axial):
        axes.set_xlim(ends[:, 0].min(), ends[:, 1].max())
    lateral.set_yticks(rows, names * len(CASES))
    lateral.set_ylim(max(rows) + 0.6, -0.6)  # of all panels
    for i, case in enumerate(CASES.values()):
        head = i * (len(names) + 1)
        if i:
            for axes in panels:
                axes.axhline(head - 0.5, color="#dddddd", linewidth=0.8)
        reach = getattr(scenario, case.spread).peg
        rolled = f"{scenario.cameras.roll:g} rad" if case.rolled else "0"
        text = f"within {1e3 * reach.distance:g} mm, {1e3 * reach.angle:g} mrad; roll {rolled}"
        for axes in (lateral, angle):
            place: Style = {"transform": axes.get_yaxis_transform(), "va": "center"}
            axes.text(0.02, head, text, fontsize=8, **place)
    legend_below(bottom, lateral, space)
    return {"camera-accuracy": figure}


def _errors(
    axes: Axes,
    outcome: Outcome,
    kinds: Sequence[str],
    rows: Sequence[int],
    series: Mapping[str, tuple[str, Style]],
    quantity: str,
    factors: Mapping[str, float],
) -> None:
    """Mark the rms of each series in each row, with a line to the largest error."""
    names = [f"{case}.{kind}" for case in CASES for kind in kinds]
    offsets = np.linspace(-0.33, 0.33, len(series))
    for offset, (name, (label, look)) in zip(offsets, series.items(), strict=True):
        rms, largest = (
            [
                metric_value(outcome.metrics, f"{one}.{name}.{quantity}.{key}", factors[name])
                for one in names
            ]
            for key in ("rms", "max")
        )
        style = {"markersize": 4.5, **look}
        draw_intervals(axes, np.array(rows) + offset, rms, rms, largest, style, label)


def _frames(figure: SubFigure, tables: Mapping[str, Table]) -> None:
    """Draw the pixels of both views, what was found in them, and the peg's tip enlarged."""
    marks = tables["frame_detections"]
    panels = figure.subplots(1, 4, width_ratios=(2.1, 1.0, 2.1, 1.0))
    for view, title in enumerate(_VIEW_TITLES.values()):
        frame, enlarged = panels[2 * view : 2 * view + 2]
        pixels, extent = _picture(tables["frames"], view)
        found = {name: values[marks["view"] == view] for name, values in marks.items()}
        for axes in (frame, enlarged):
            axes.imshow(pixels, extent=extent, interpolation="nearest")
            _mark(axes, found)
            axes.tick_params(labelsize=8)
            axes.set_xlabel("u / px", fontsize=9)
        frame.set_xlim(extent[:2])
        frame.set_ylim(extent[2:])
        frame.set_ylabel("v / px", fontsize=9)
        tip_u, tip_v = found["tip_u"][0], found["tip_v"][0]
        if np.isfinite([tip_u, tip_v]).all():
            enlarged.set_xlim(tip_u - _ZOOM, tip_u + _ZOOM)
            enlarged.set_ylim(tip_v + _ZOOM, tip_v - _ZOOM)
        for axes, text in ((frame, title), (enlarged, "tip of the peg")):
            axes.set_title(text, fontsize=9, loc="left", fontweight="bold")


def _mark(axes: Axes, found: Table) -> None:
    """Draw the axes that were found through the parts and beyond their tips, and the tips."""
    tips = np.column_stack([found["tip_u"], found["tip_v"]])
    points = np.column_stack([found["point_u"], found["point_v"]])
    for tip, point in zip(tips, points, strict=True):
        way = tip - point
        if np.isfinite(way).all():
            ends = np.array([point - way, tip + _BEYOND * way / np.linalg.norm(way)])
            axes.plot(*ends.T, scalex=False, scaley=False, **_AXIS)
            axes.plot(*tip, scalex=False, scaley=False, **_TIP)


def _picture(frames: Table, view: int) -> tuple[Array, tuple[float, float, float, float]]:
    """Return the pixels of a view, 0 to 1, shape (height, width, 3), and where their edges are."""
    of = frames["view"] == view
    u, v = frames["u"][of].astype(int), frames["v"][of].astype(int)
    left, top, right, bottom = u.min(), v.min(), u.max() + 1, v.max() + 1
    pixels = np.zeros((bottom - top, right - left, 3))
    for channel, colour in enumerate(("red", "green", "blue")):
        pixels[v - top, u - left, channel] = frames[colour][of] / 255
    return pixels, (left - 0.5, right - 0.5, bottom - 0.5, top - 0.5)
