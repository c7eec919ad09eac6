"""How exactly a camera in the hand sees the mouth of a hole, and in which pictures it refuses."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import colour_legend, draw_shares, metric_value, name_rows
from chamfer.analysis.drawing.figure_style import new_figure
from chamfer.analysis.scenario.experiment import Outcome, Progress, column
from chamfer.analysis.sight.mouth_conditions import CONDITIONS, MouthScene, mouth_picture
from chamfer.models.peg.peg_and_hole import OF_CONTACT, PRESETS, ColouredParts
from chamfer.models.validation import ParameterError, require_positive, require_same
from chamfer.systems.cameras.hand_camera import HandMount
from chamfer.systems.vision.mouth_detector import MouthParams, MouthStatus, detect_mouth
from chamfer.systems.vision.mouth_pose import rims

Array = NDArray[np.float64]

SEVERITIES: Final = ("mild", "middle", "severe")
_MOST_PICTURES: Final = 10_000
_MANY: Final = 4.0  # standard deviations, of what is wrong though claimed to be sure


@dataclass(frozen=True, kw_only=True)
class HandCameraScenario:
    """Pictures by a camera in the hand in each condition, at each severity."""

    pictures: int = 12  # of each condition at each severity
    parts: ColouredParts = field(
        default_factory=lambda: ColouredParts(
            **{**PRESETS["factory-8mm"], "friction": ColouredParts.friction}  # type: ignore[arg-type]
        )
    )
    camera: HandMount = HandMount()
    gap: float = 0.03  # m, from the peg's tip to the hole's mouth
    lateral: float = 0.002  # m, half-width of the hole's position, along each axis
    rotational: float = 0.035  # rad, half-width of the hole's angle, about each axis

    def __post_init__(self) -> None:
        require_positive(self, "gap", "lateral", "rotational")
        require_same(self.parts, ColouredParts, "parts", *OF_CONTACT, why="the parts don't touch")
        if not self.parts.is_round:
            raise ParameterError("parts.section", self.parts.section, "round")
        if not 1 <= self.pictures <= _MOST_PICTURES:
            raise ParameterError("pictures", self.pictures, f"1 to {_MOST_PICTURES}")


@dataclass(frozen=True, kw_only=True)
class ResolvedHandCameraScenario(HandCameraScenario):
    """The scenario with a camera that has no field left open."""


STUDY: Final = HandCameraScenario()


def resolve_hand_camera(scenario: HandCameraScenario) -> ResolvedHandCameraScenario:
    """Return the scenario with its camera filled in, which has to see the mouth."""
    camera = scenario.camera.of(scenario.parts, scenario.gap)
    return ResolvedHandCameraScenario(**{**vars(scenario), "camera": camera})


class MouthTask(NamedTuple):
    """One picture."""

    condition: str
    severity: int
    trial: int


def _look(scenario: ResolvedHandCameraScenario, seed: int, task: MouthTask) -> Row:
    """Return what was found, how far off it is, m and rad, and in standard deviations."""
    random = np.random.default_rng([seed, task.trial])
    turn = random.uniform(-scenario.rotational, scenario.rotational, 3)
    moved = random.uniform(-scenario.lateral, scenario.lateral, 3)
    expected, camera = RigidTransform([scenario.gap, 0, 0]), scenario.camera.camera(scenario.gap)
    R = RotationMatrix(Rotation.from_rotvec(turn).as_matrix())
    X_WM = expected @ RigidTransform(R, moved)
    which = tuple(CONDITIONS).index(task.condition), task.severity
    scene = MouthScene(
        parts=scenario.parts,
        camera=camera,
        X_WT=RigidTransform(),
        X_WM=X_WM,
        noise=scenario.camera.frames.noise,
        random=np.random.default_rng([seed, task.trial, *which]),
    )
    image = mouth_picture(scene, task.condition, CONDITIONS[task.condition].levels[task.severity])
    params = MouthParams(reach=1.5 * scenario.camera.reach)
    mouth = detect_mouth(image, camera, expected, rims(scenario.parts.hole), params)
    off = sizes = np.full(5, math.nan)
    if mouth.pose is not None:
        lean = np.cross(R.matrix()[:, 0], mouth.pose.X_WM.rotation().matrix()[:, 0])
        off = np.array([*(mouth.pose.X_WM.translation() - X_WM.translation()), *lean[1:]])
        sizes = np.sqrt(np.diag(mouth.pose.covariance))
    return {"status": np.array(float(mouth.status)), "off": off, "sizes": sizes}


def run(scenario: ResolvedHandCameraScenario, seed: int, progress: Progress) -> Outcome:
    """Detect the mouth in all pictures."""
    tasks = [
        MouthTask(condition, severity, trial)
        for condition in CONDITIONS
        for severity in range(len(SEVERITIES))
        for trial in range(scenario.pictures)
    ]
    finished = run_each(partial(_look, scenario, seed), tasks, progress)
    rows, tasks = finished.rows, list(finished.tasks)
    status = np.array([float(row["status"]) for row in rows])
    off, sizes = (np.array([row[name] for row in rows]) for name in ("off", "sizes"))
    found = status == MouthStatus.FOUND
    many = np.nan_to_num(np.abs(off / sizes)).max(axis=1)
    no_mouth = np.array([CONDITIONS[task.condition].asked == "none" for task in tasks])
    wrong = found & (no_mouth | (many > _MANY))
    names = tuple(CONDITIONS)
    which = np.array([names.index(task.condition) for task in tasks])
    severity = np.array([task.severity for task in tasks])
    metrics: dict[str, tuple[float | None, str, str]] = {}
    for k, condition in enumerate(names):
        for s, said in enumerate(SEVERITIES):
            of = (which == k) & (severity == s)
            for ending, share in (("found", found & ~wrong), ("wrong", wrong)):
                metrics[f"{condition}.{said}.{ending}"] = 100 * float(np.mean(share[of])), "%", ""
    good = found & ~no_mouth
    plain = good & (which == 0)
    for name, chosen in (("all", good), ("plain", plain)):
        across = np.hypot(off[chosen, 1], off[chosen, 2])
        leaning = np.hypot(off[chosen, 3], off[chosen, 4])
        for label, values, unit in (("lateral", across, "m"), ("rotational", leaning, "rad")):
            worst = float(np.quantile(values, 0.95)) if len(values) else None
            metrics[f"{name}.{label}_error.95"] = worst, unit, "" if len(values) else "none found"
    largest = float(many[good].max()) if good.any() else None
    metrics["deviations.most"] = largest, "", "error over its claimed standard deviation"
    metrics["wrong"] = float(wrong.sum()), "", "no mouth, or beyond 4 deviations, and not refused"
    metrics["pictures"] = float(len(tasks)), "", ""
    traces = {
        "condition": column(which),
        "severity": column(severity),
        "status": column(status),
        "wrong": column(wrong),
        **{f"off_{i}": column(off[:, i]) for i in range(5)},
        **{f"deviation_{i}": column(sizes[:, i]) for i in range(5)},
    }
    return Outcome(metrics=metrics_of(metrics), traces=traces, simulated_seconds=0.0)


_COLOURS: Final = {"found": "#8fc79a", "refused": "#d9d9d9", "wrong": "#b00020"}


def figures(scenario: ResolvedHandCameraScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the shares of outcomes, and the errors over the claimed standard deviations."""
    count, wrong = (outcome.metrics[name].value or 0.0 for name in ("pictures", "wrong"))
    lateral = 1e6 * metric_value(outcome.metrics, "plain.lateral_error.95")
    says = f"{wrong:.0f} of {count:.0f} pictures are valid but wrong"
    within = f" 95 % of the plain ones are within {lateral:.0f} µm." if lateral >= 0 else ""
    figure = new_figure(
        height=2.0 + 0.27 * len(CONDITIONS),
        caption=f"{says}.{within} Share of pictures found by condition and severity (right of a "
        "bar: level), and errors over claimed deviations.",
    )
    panels = list(figure.subplots(1, len(SEVERITIES) + 1, squeeze=False)[0])
    for k, severity in enumerate(SEVERITIES):
        axes, rows = panels[k], []
        for row, (name, condition) in enumerate(CONDITIONS.items()):
            found, wrong = (
                outcome.metrics[f"{name}.{severity}.{ending}"].value or 0.0
                for ending in ("found", "wrong")
            )
            rows.append({"found": found, "refused": 100 - found - wrong, "wrong": wrong})
            level = f"{condition.levels[k]:g}"
            axes.text(101, row, level, va="center", fontsize=8, color="#555555")
        draw_shares(axes, rows, _COLOURS)
        axes.set_title(severity, fontsize=10, loc="left", fontweight="bold")
        axes.set_xlabel("pictures / %", fontsize=9)
        if k:
            axes.sharey(panels[0])
            axes.tick_params(labelleft=False)
    name_rows(panels[0], [condition.said for condition in CONDITIONS.values()])
    axes, traces = panels[-1], outcome.traces
    sure = np.column_stack([traces[f"off_{i}"] / traces[f"deviation_{i}"] for i in range(5)])
    known = sure[np.isfinite(sure).all(axis=1)]
    share = np.full(known.size, 100 / max(known.size, 1))
    bins = np.linspace(-5, 5, 41).tolist()
    axes.hist(known.ravel(), bins=bins, weights=share, color="#7a9cc6")
    axes.set_ylabel("errors / %", fontsize=9)
    for side in (-_MANY, _MANY):
        axes.axvline(side, color=_COLOURS["wrong"], linewidth=1)
    axes.set_title("errors", fontsize=10, loc="left", fontweight="bold")
    axes.set_xlabel("error / deviation", fontsize=9)
    axes.tick_params(labelsize=8)
    figure.suptitle(f"{says} (right of each bar: level)", fontsize=9)
    colours = {name.replace("wrong", "valid but wrong"): of for name, of in _COLOURS.items()}
    colour_legend(figure, colours)
    return {"hand-camera": figure}
