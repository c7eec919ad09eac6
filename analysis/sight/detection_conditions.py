"""Section 4: in which conditions the parts are found, refused, or found where they are not."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, NamedTuple

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import colour_legend, draw_shares, name_rows
from chamfer.analysis.drawing.figure_style import new_figure
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.analysis.sight.detection_trials import (
    PARTS,
    WIDE,
    PoseSpread,
    detection_error,
    draw_poses,
)
from chamfer.analysis.sight.picture_conditions import (
    CONDITIONS,
    Condition,
    PictureQuality,
    Scene,
    installed,
    require_photographs,
)
from chamfer.diagrams.cell.cell_vision import VIEWS
from chamfer.diagrams.cell.work_cell import WorkCellScenario
from chamfer.models.cameras.camera import Camera, CameraStand
from chamfer.models.peg.peg_and_hole import OF_CONTACT, ColouredParts
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
    require_same,
)
from chamfer.systems.cameras.camera_image import Image, add_noise
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import Appearance, appearances
from chamfer.systems.vision.part_detection import detect_parts

Array = NDArray[np.float64]

SEVERITIES: Final = ("mild", "middle", "severe")

_MOST_PICTURES: Final = 10_000
_PHOTOGRAPHS: Final = "clutter"  # the condition that needs them
_SHOWN: Final = (160, 80)  # pixels of the examples that are kept


@dataclass(frozen=True, kw_only=True)
class ConditionsCameras(CameraStand, PictureQuality):
    """The cameras and their pictures."""

    def __post_init__(self) -> None:
        CameraStand.__post_init__(self)
        PictureQuality.__post_init__(self)


@dataclass(frozen=True, kw_only=True)
class ConditionsScenario:
    """Pictures of the parts in each condition, at each severity, in both views in turn."""

    pictures: int = 24  # of each condition at each severity
    parts: ColouredParts = field(default_factory=ColouredParts)
    cameras: ConditionsCameras = field(default_factory=ConditionsCameras)
    gap: float = WorkCellScenario.gap  # m, nominal, from the peg's tip to the hole's mouth
    spread: PoseSpread = WIDE  # of the parts
    most_off: float = 1.0  # pixels, of a tip; more is wrong
    most_turned: float = 0.005  # rad, of an axis; more is wrong
    photographs: bool | None = None  # behind the parts; None: if scikit-image is installed

    def __post_init__(self) -> None:
        require_not_negative(self, "gap")
        require_positive(self, "most_off", "most_turned")
        require_same(self.parts, ColouredParts, "parts", *OF_CONTACT, why="the parts don't touch")
        if not 1 <= self.pictures <= _MOST_PICTURES:
            raise ParameterError("pictures", self.pictures, f"1 to {_MOST_PICTURES}")


@dataclass(frozen=True, kw_only=True)
class ResolvedConditionsScenario(ConditionsScenario):
    """The scenario with the choice of photographs behind the parts filled in."""

    photographs: bool

    @property
    def conditions(self) -> tuple[str, ...]:
        """Names of the conditions that are tried."""
        return tuple(name for name in CONDITIONS if name != _PHOTOGRAPHS or self.photographs)


STUDY: Final = ConditionsScenario()


class ConditionTask(NamedTuple):
    """One picture."""

    condition: str
    severity: str
    trial: int


def picture(
    scenario: ResolvedConditionsScenario, seed: int, task: ConditionTask
) -> tuple[Image, tuple[Appearance, Appearance], tuple[Detection, ...]]:
    """Return a picture, the appearance of its parts, and their true poses."""
    condition = CONDITIONS[task.condition]
    level = condition.levels[SEVERITIES.index(task.severity)]
    # Of the same trial the poses are the same in all conditions.
    poses = draw_poses(scenario.gap, scenario.spread, np.random.default_rng([seed, task.trial]))
    which = tuple(CONDITIONS).index(task.condition), SEVERITIES.index(task.severity)
    random = np.random.default_rng([seed, task.trial, *which])
    camera, pixel_size = _camera(scenario, condition, level, task.trial)
    scene = Scene(
        parts=scenario.parts,
        camera=camera,
        pixel_size=pixel_size,
        pixel=scenario.cameras.pixel_size / pixel_size,
        poses=poses,
        blur=scenario.cameras.blur,
        random=random,
    )
    light = condition.draw(scene, level)
    image = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    image = add_noise(image, level if condition.noise else scenario.cameras.noise, random)
    if condition.change is not None:
        image = condition.change(image, level, random)
    peg, hole = appearances(scenario.parts, pixel_size)
    if condition.hue:
        hole = replace(hole, hue=(peg.hue + int(level)) % 256)
    return image, (peg, hole), scene.truths


def _camera(
    scenario: ResolvedConditionsScenario, condition: Condition, level: float, trial: int
) -> tuple[Camera, float]:
    """Return a camera that sees as much whatever its pixels, and what these cover, m."""
    stand = scenario.cameras
    share = level / stand.width if condition.width else 1.0
    placement = replace(
        stand.placement(VIEWS[trial % len(VIEWS)], (0.0, 0.0, 0.0)),
        pixel_size=stand.pixel_size / share,
        width=round(share * stand.width),
        height=round(share * stand.height),
    )
    return placement.camera, placement.pixel_size


def _detect(scenario: ResolvedConditionsScenario, seed: int, task: ConditionTask) -> Row:
    """Return what was found of both parts, and how far off it is, each of shape (2,)."""
    image, looks, truths = picture(scenario, seed, task)
    found = detect_parts(image, *looks)
    errors = np.array([detection_error(*pair) for pair in zip(found, truths, strict=True)])
    statuses = np.array([one.status for one in found], float)
    return {"status": statuses, **{name: errors[:, i] for i, name in enumerate(_ERRORS)}}


_ERRORS: Final[Mapping[str, str]] = {"axial": "px", "lateral": "px", "angle": "rad"}


def run(scenario: ResolvedConditionsScenario, seed: int, progress: Progress) -> Outcome:
    """Detect the parts in all pictures."""
    tasks = [
        ConditionTask(condition, severity, trial)
        for condition in scenario.conditions
        for severity in SEVERITIES
        for trial in range(scenario.pictures)
    ]
    finished = run_each(partial(_detect, scenario, seed), tasks, progress)
    finished.split(scenario.conditions, lambda task: task.condition)  # none may be without
    traces = _rows(scenario, finished)
    return Outcome(
        metrics=_metrics(scenario, traces),
        traces=traces,
        simulated_seconds=0.0,
        tables={"pictures": _examples(scenario, seed)},
    )


def _rows(scenario: ResolvedConditionsScenario, finished: Trials[ConditionTask]) -> Table:
    """Return a row for each picture; what is ``found``, ``refused`` and ``wrong`` is 1, else 0."""
    values = {
        name: np.array([row[name] for row in finished.rows]) for name in ("status", *_ERRORS)
    }
    off = np.hypot(np.nan_to_num(values["axial"]), values["lateral"]) > scenario.most_off
    wrong = (off | (np.abs(values["angle"]) > scenario.most_turned)).any(axis=1)
    valid = (values["status"] == Status.VALID).all(axis=1)
    names, tasks = tuple(CONDITIONS), finished.tasks
    return {
        "condition": column([names.index(task.condition) for task in tasks]),
        "severity": column([SEVERITIES.index(task.severity) for task in tasks]),
        "trial": column([task.trial for task in tasks]),
        "found": column(valid & ~wrong),
        "refused": column(~valid & ~wrong),
        "wrong": column(wrong),
        **{
            f"{part}_{name}": column(values[name][:, k])
            for k, part in enumerate(PARTS)
            for name in values
        },
    }


def _metrics(scenario: ResolvedConditionsScenario, traces: Table) -> dict[str, Metric]:
    rows: dict[str, tuple[float | None, str, str]] = {}
    middle: dict[str, float] = {}
    for condition in scenario.conditions:
        for k, severity in enumerate(SEVERITIES):
            which = traces["condition"] == tuple(CONDITIONS).index(condition)
            which &= traces["severity"] == k
            of = {name: values[which] for name, values in traces.items()}
            name = f"{condition}.{severity}"
            for outcome in ("found", "refused", "wrong"):
                share = 100 * float(np.mean(of[outcome]))
                why = _reasons(of) if outcome == "refused" and share else ""
                rows[f"{name}.{outcome}"] = share, "%", why
            if severity == "middle" and CONDITIONS[condition].asked == "found":
                middle[condition] = 100 * float(np.mean(of["found"]))
            for error, unit in _ERRORS.items():
                values = np.concatenate([of[f"{part}_{error}"] for part in PARTS])
                known = values[np.isfinite(values)]
                rms = math.sqrt(float(np.mean(known**2))) if len(known) else None
                note = "" if len(known) else "nothing was found"
                rows[f"{name}.{error}.rms"] = rms, unit, note
    least = min(middle, key=middle.__getitem__)
    wrong = (
        f"a tip more than {scenario.most_off:g} px off or an axis more than "
        f"{1e3 * scenario.most_turned:g} mrad, and not refused"
    )
    said = f"{least}, at the middle severity, of what is to be found"
    return metrics_of(
        {
            **rows,
            "pictures": (float(len(traces["wrong"])), "", ""),
            "wrong": (float(np.sum(traces["wrong"])), "", wrong),
            "middle.found.least": (middle[least], "%", said),
        }
    )


def _reasons(of: Table) -> str:
    """Return why parts were refused, the most frequent reason first."""
    said = []
    for part in PARTS:
        statuses = of[f"{part}_status"][of["refused"] > 0]
        counted = Counter(Status(int(one)) for one in statuses if one != Status.VALID)
        said += [f"{part} {status.name} {number}" for status, number in counted.most_common()]
    return ", ".join(said)


def _examples(scenario: ResolvedConditionsScenario, seed: int) -> Table:
    """Return a small picture of each condition at its middle severity, a row a pixel."""
    width, height = _SHOWN
    pixels: dict[str, list[NDArray[np.uint8]]] = {}
    for condition in scenario.conditions:
        image, _, _ = picture(scenario, seed, ConditionTask(condition, "middle", 0))
        rows, columns = image.shape[:2]
        share = min(rows / height, columns / width)
        h, w = round(share * height), round(share * width)
        top, left = (rows - h) // 2, (columns - w) // 2
        middle = image[top : top + h, left : left + w]
        small = cv2.resize(middle, (width, height), interpolation=cv2.INTER_AREA)
        for channel, name in enumerate(("red", "green", "blue")):
            pixels.setdefault(name, []).append(small[..., channel].ravel().astype(np.uint8))
    names = [tuple(CONDITIONS).index(condition) for condition in scenario.conditions]
    return {
        "condition": np.repeat(names, width * height),
        **{name: np.concatenate(of) for name, of in pixels.items()},
    }


def resolve_detection_conditions(scenario: ConditionsScenario) -> ResolvedConditionsScenario:
    """Return the scenario with its open fields filled in, and checked."""
    photographs = installed() if scenario.photographs is None else scenario.photographs
    if scenario.photographs:
        require_photographs()
    return ResolvedConditionsScenario(**{**vars(scenario), "photographs": photographs})


_COLOURS: Final = {"found": "#8fc79a", "refused": "#d9d9d9", "wrong": "#b00020"}
_SAID: Final = {"found": "found", "refused": "refused", "wrong": "valid but wrong"}
_EXPLAINED: Final = 55  # %, refused, from which on it is said why
_COLUMNS: Final = 4  # of pictures


def figures(scenario: ResolvedConditionsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw which share of the pictures ended how, and a picture of each condition."""
    return {
        "detection-conditions": _plot_conditions(scenario, outcome),
        "detection-conditions-pictures": _plot_pictures(scenario, outcome),
    }


def _plot_conditions(scenario: ResolvedConditionsScenario, outcome: Outcome) -> Figure:
    count, wrong = (outcome.metrics[name].value or 0.0 for name in ("pictures", "wrong"))
    says = f"{wrong:.0f} of {count:.0f} pictures are valid but wrong"
    figure = new_figure(
        height=1.8 + 0.27 * len(scenario.conditions),
        caption=f"{says}. Share of pictures in which both parts were found, by condition and "
        "severity; the number right of a bar is the level of the condition.",
    )
    panels: list[Axes] = list(figure.subplots(1, len(SEVERITIES), sharey=True, squeeze=False)[0])
    for k, (axes, severity) in enumerate(zip(panels, SEVERITIES, strict=True)):
        rows, texts = [], []
        for row, condition in enumerate(scenario.conditions):
            found = {one: outcome.metrics[f"{condition}.{severity}.{one}"] for one in _COLOURS}
            shares = {one: metric.value or 0.0 for one, metric in found.items()}
            own = {"wrong": f"{shares['wrong']:.0f}"}  # however small
            if shares["refused"] > _EXPLAINED:
                # The most frequent reason, as of 'peg NOT_STRAIGHT 12, hole ...'.
                part, status, _ = found["refused"].note.split(", ")[0].split(" ")
                why = status.lower().replace("_", " ")
                own["refused"] = f"{shares['refused']:.0f} {part}: {why}"
            rows.append(shares)
            texts.append(own)
            level = f"{CONDITIONS[condition].levels[k]:g}"
            axes.text(101, row, level, va="center", fontsize=8, color="#555555")
        draw_shares(axes, rows, _COLOURS, texts)
        axes.set_title(severity, fontsize=10, loc="left", fontweight="bold")
        axes.set_xlabel("pictures / %", fontsize=9)
    said = [CONDITIONS[condition].said for condition in scenario.conditions]
    name_rows(panels[0], [text.split(", ")[0] for text in said])
    figure.suptitle(f"{says} (right of each bar: level)", fontsize=9)
    colour_legend(figure, {_SAID[ending]: colour for ending, colour in _COLOURS.items()})
    return figure


def _plot_pictures(scenario: ResolvedConditionsScenario, outcome: Outcome) -> Figure:
    table = outcome.tables["pictures"]
    rows = math.ceil(len(scenario.conditions) / _COLUMNS)
    figure = new_figure(
        height=1.25 * rows,
        caption=f"A picture of the parts under each of {len(scenario.conditions)} conditions, at "
        "middle severity.",
    )
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    width, height = _SHOWN
    for axes, name in zip(panels, scenario.conditions, strict=False):
        of = table["condition"] == tuple(CONDITIONS).index(name)
        pixels = np.column_stack([table[colour][of] for colour in ("red", "green", "blue")])
        axes.imshow(pixels.reshape(height, width, 3), interpolation="nearest")
        condition = CONDITIONS[name]
        axes.set_title(condition.said.format(condition.levels[1]), fontsize=8, loc="left")
    return figure
