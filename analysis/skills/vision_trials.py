"""Section 3.1: vision primitives settle with wrongly calibrated cameras, trial by trial."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import rate, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import Curve, ReferenceLine, draw_lines, trial_curves
from chamfer.analysis.drawing.figure_style import DESIRED, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.diagrams.skills.vision_servo import (
    NAMES,
    PARTS,
    STATIC,
    CameraBelief,
    VisionPrimitive,
    VisionServoScenario,
    VisionServoSetup,
    event_of,
    make_vision_servo_diagram,
    view_of,
)
from chamfer.models.arms.wrist import tip_pose
from chamfer.models.validation import ParameterError, require_between, require_positive
from chamfer.systems.primitives.primitive import EVENTS, TICK
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisGrasp,
    VisRotation,
    VisTranslation,
)
from chamfer.systems.primitives.visual_servoing import half_turn, slowest_root
from chamfer.systems.vision.cross_section import cross_section
from chamfer.systems.vision.part_detection import detect

Array = NDArray[np.float64]

_RIGHT: Final = CameraBelief()


@dataclass(frozen=True, kw_only=True)
class VisionTrial:
    """The result of one primitive's trial."""

    event: str | None  # None: the time was over, or the primitive refused its beliefs
    time: float  # s, when it ended
    times: Array  # s, shape (n,)
    errors: Array  # m and rad, of true_errors, shape (n, 2)
    seen: float | None  # pixels, in the end; None: undefined
    slowest_root: float  # of the theory; below 1 the loop settles


def calibration(angle: float, focal_factor: float, random: np.random.Generator) -> CameraBelief:
    """Return a belief with a given size of the orientation's error, rad, about a random axis."""
    axis = random.normal(size=3)
    x, y, z = (angle * axis / np.linalg.norm(axis)).tolist()
    return CameraBelief(focal_factor=focal_factor, turn=(x, y, z))


def draw(
    loop: VisionServoSetup,
    name: VisionPrimitive,
    *,
    focal_error: float,
    orientation_error: float,
    trial: int,
    random: np.random.Generator,
) -> VisionServoScenario:
    """Return a trial of a primitive with a random start and errors in every camera.

    Its number cycles through the signs of the focal lengths' relative error; orientations have
    errors about random axes, rad.
    """
    signs = [1 if trial >> k & 1 else -1 for k in range(3)]
    beliefs = [
        calibration(orientation_error, 1 + sign * focal_error, random) for sign in signs[:2]
    ]
    start, target = np.zeros(6), np.zeros(6)
    start[3:] = random.uniform((-0.02, -0.02, 0.005), (0.02, 0.02, 0.03))
    target[3:] = random.uniform((-0.008, -0.008, -0.02), (0.008, 0.008, -0.012))
    angle = loop.angle
    if name == "rotation":
        start[:2], target[:2] = random.uniform(-0.25, 0.25, 2), random.uniform(-0.1, 0.1, 2)
        start[3:5] /= 2
    elif name == "fixed_point":
        start[3:] -= loop.lever
        angle *= random.uniform(0.5, 1.0) * random.choice((-1.0, 1.0))
    elif name == "grasp":
        start[2], start[5] = random.uniform(-0.5, 0.5), 0.0
        target[2], target[5] = random.uniform(-0.2, 0.2), 0.0
    return VisionServoScenario(
        **vars(loop) | {"angle": angle},
        primitive=name,
        start=tuple(start.tolist()),
        target=tuple(target.tolist()),
        believed_lever=1 + signs[2] * focal_error,
        xz=beliefs[0],
        yz=beliefs[1],
        hand=beliefs[0],
    )


def true_errors(scenario: VisionServoScenario, displacement: Array) -> tuple[float, float]:
    """Return the true distance from a primitive's goal, m and rad; NaN: it has no such goal."""
    X_WE = tip_pose(displacement)
    X_WT = X_WE @ scenario.held_at
    target = tip_pose(np.array(scenario.target))
    tip, mouth = X_WT.translation(), target.translation()
    if scenario.primitive == "translation":
        return float(np.linalg.norm(tip - mouth - [0.0, 0.0, scenario.gap])), math.nan
    if scenario.primitive == "rotation":
        axes = [X.rotation().matrix()[:, 2] for X in (X_WT, target)]
        sine = float(np.linalg.norm(np.cross(*axes)))
        return math.nan, math.asin(min(1.0, sine))
    if scenario.primitive == "fixed_point":
        first = (tip_pose(np.array(scenario.start)) @ scenario.held_at).translation()
        turned = float(displacement[1]) - scenario.start[1]
        return float(np.linalg.norm((tip - first)[[0, 2]])), abs(turned - scenario.angle)
    away = (X_WE.inverse() @ mouth)[:2]
    return float(np.linalg.norm(away)), abs(half_turn(float(displacement[2]) - scenario.target[2]))


def seen_error(scenario: VisionServoScenario, displacement: Array) -> float | None:
    """Return the error in images without noise, pixels, the largest of a primitive's features.

    For the translation it is the part that is believed to be reducible. None: it has no such
    error.
    """
    primitive = scenario.parameters
    if isinstance(primitive, VisGrasp):
        section = cross_section(view_of(scenario, "hand", displacement))
        return float(np.abs(np.subtract(section.centroid, scenario.hand_camera.centre)).max())
    if isinstance(primitive, VisTranslation):
        found = [
            [detect(view_of(scenario, view, displacement), part).tip for part in PARTS]
            for view in STATIC
        ]
        tips, mouths = np.swapaxes(np.array(found), 0, 1)
        J, servoing = primitive.jacobian([*tips]), primitive.servoing
        u = servoing.solve(J, primitive.deviation([*tips], [*mouths]))
        return float(np.abs(servoing.reducible(J, u)).max())
    if isinstance(primitive, FixedPointRotation):
        first, last = (
            detect(view_of(scenario, "xz", one), PARTS[0]).tip
            for one in (np.array(scenario.start), displacement)
        )
        return float(np.abs(np.subtract(last, first)).max())
    return None


def shares(scenario: VisionServoScenario) -> NDArray[np.complex128]:
    """Return the shares of its errors that the loop truly removes in a frame, complex, (n,).

    The eigenvalues of ``gain pinv(J_believed) J_true`` in the middle of the images.
    """
    believed, true = (
        _jacobian(one) for one in (scenario, replace(scenario, xz=_RIGHT, yz=_RIGHT, hand=_RIGHT))
    )
    eigenvalues = np.linalg.eigvals(scenario.servoing.gain * np.linalg.pinv(believed) @ true)
    return eigenvalues.astype(np.complex128)


def _jacobian(scenario: VisionServoScenario) -> Array:
    primitive = scenario.parameters
    middle = np.array(scenario.hand_camera.centre)
    if isinstance(primitive, VisTranslation):
        return primitive.jacobian([middle, middle])
    if isinstance(primitive, VisRotation):
        return primitive.jacobian
    assert isinstance(primitive, FixedPointRotation | VisGrasp)
    return primitive.jacobian(middle)


def run_trial(scenario: VisionServoScenario, *, seed: int, most: float) -> VisionTrial:
    """Run a primitive until it has an event, or its time, s, is up; the seed is the images'."""
    start = np.array(scenario.start)
    try:
        root = max(
            slowest_root(one, delay=scenario.frames.latency) for one in shares(scenario).tolist()
        )
    except ParameterError:
        return VisionTrial(
            event=None,
            time=0.0,
            times=np.zeros(1),
            errors=np.array([true_errors(scenario, start)]),
            seen=None,
            slowest_root=math.inf,
        )
    diagram = make_vision_servo_diagram(scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    output = diagram.GetOutputPort("displacement")
    times, displacements = [0.0], [start]
    event = None
    # Half a tick later than the ticks, so that rounding cannot change what is seen.
    for k in range(1, math.ceil(most / scenario.frames.period) + 1):
        time = (round(k * scenario.frames.period / TICK) + 0.5) * TICK
        simulator.AdvanceTo(time)
        times.append(time)
        displacements.append(np.array(output.Eval(context)))
        event = event_of(diagram, context)
        if event is not None:
            break
    return VisionTrial(
        event=event,
        time=times[-1],
        times=np.array(times),
        errors=np.array([true_errors(scenario, one) for one in displacements]),
        seen=seen_error(scenario, displacements[-1]) if event == "done" else None,
        slowest_root=root,
    )


_MOST: Final = 10_000  # trials
_STREAMS: Final = {name: k for k, name in enumerate((*NAMES, "map"))}


@dataclass(frozen=True, kw_only=True)
class VisionPrimitivesScenario:
    """Random starts with camera errors, and a map of tolerable errors; all of it is assumed.

    Starts, targets and the beliefs about the cameras are drawn.
    """

    loop: VisionServoSetup = VisionServoSetup()  # of every trial
    trials: int = 25  # of each primitive
    focal_error: float = 0.2  # of the believed focal lengths, relative, either sign
    orientation_error: float = math.radians(10)  # rad, of each camera, about a random axis
    duration: float = 3.5  # s, of a primitive at most
    map_focal: tuple[float, ...] = (0.15, 0.25, 0.4, 1.0, 2.0)
    # believed to true focal lengths of both cameras, of the cells of the translation's map
    map_angle: tuple[float, ...] = tuple(math.radians(one) for one in (0, 20, 40, 60, 90))
    # rad, orientation errors of these cells
    map_trials: int = 1  # of each cell
    map_gap: float = 0.025  # m, goal above the socket: room to overshoot without covering it

    def __post_init__(self) -> None:
        require_positive(self, "duration", "map_gap")
        require_between(self, 1, _MOST, "trials", "map_trials")
        require_between(self, 0, math.pi, "orientation_error")
        if not 0 <= self.focal_error < 1:
            raise ParameterError("focal_error", self.focal_error, "a number >= 0 and < 1")
        for name, low, needed in (("map_focal", 0.01, 1.0), ("map_angle", 0.0, 0.0)):
            values = getattr(self, name)
            if not all(low <= one <= 100 for one in values) or needed not in values:
                allowed = f"numbers from {low:g} to 100, {needed:g} among them"
                raise ParameterError(name, values, allowed)
            if list(values) != sorted(set(values)):
                raise ParameterError(name, values, "rising numbers")


VISION_PRIMITIVES: Final = VisionPrimitivesScenario()


class VisionTask(NamedTuple):
    """One trial; those of the map have their own focal factor and orientation error."""

    name: VisionPrimitive
    trial: int
    cell: tuple[float, float] | None = None


def tasks(scenario: VisionPrimitivesScenario) -> list[VisionTask]:
    """Return all trials: those of each primitive, then those of the map."""
    each = [VisionTask(name, trial) for name in NAMES for trial in range(scenario.trials)]
    cells = [(focal, angle) for focal in scenario.map_focal for angle in scenario.map_angle]
    return each + [
        VisionTask("translation", trial, cell)
        for cell in cells
        for trial in range(scenario.map_trials)
    ]


def trial_of(
    scenario: VisionPrimitivesScenario, seed: int, task: VisionTask
) -> VisionServoScenario:
    """Return the scenario of a trial."""
    place = [_STREAMS[task.name]]
    if task.cell is not None:
        focal, angle = task.cell
        place = [_STREAMS["map"], scenario.map_focal.index(focal), scenario.map_angle.index(angle)]
    random = np.random.default_rng([seed, *place, task.trial])
    one = draw(
        scenario.loop,
        task.name,
        focal_error=scenario.focal_error,
        orientation_error=scenario.orientation_error,
        trial=task.trial,
        random=random,
    )
    if task.cell is None:
        return one
    focal, angle = task.cell
    xz, yz = (calibration(angle, focal, random) for _ in range(2))
    return replace(one, gap=scenario.map_gap, xz=xz, yz=yz)


def _run_task(scenario: VisionPrimitivesScenario, seed: int, task: VisionTask) -> Row:
    one = trial_of(scenario, seed, task)
    return vars(run_trial(one, seed=trial_seed(seed, task.trial), most=scenario.duration))


def _trials(finished: Trials[VisionTask]) -> list[VisionTrial]:
    return [VisionTrial(**row) for row in finished.rows]


def run(scenario: VisionPrimitivesScenario, seed: int, progress: Progress) -> Outcome:
    """Run every trial of every primitive, and the map."""
    finished = run_each(partial(_run_task, scenario, seed), tasks(scenario), progress)
    each = finished.select(lambda task: task.cell is None)
    of_map = finished.select(lambda task: task.cell is not None)
    metrics: dict[str, Metric] = {}
    for name, own in each.split(NAMES, lambda task: task.name).items():
        metrics |= {f"{name}.{key}": one for key, one in trial_metrics(_trials(own)).items()}
        if name == "fixed_point":
            metrics |= _held(scenario, seed, own)
    cells = _cells(of_map)
    metrics |= map_metrics(cells)
    return Outcome(
        metrics=metrics,
        traces=_rows(each),
        simulated_seconds=float(sum(finished.column("time"))),
        tables={"courses": _courses(each), "map": cells},
    )


def trial_metrics(trials: Sequence[VisionTrial]) -> dict[str, Metric]:
    """Return how many trials of a primitive settled, their time and their final errors."""
    settled = [trial for trial in trials if trial.event == "done"]
    n = len(trials)
    note = f"{len(settled)} of {n}"
    metrics = rate("converged", len(settled), n, note) | {
        "theory.largest_root": Metric(
            value=max(trial.slowest_root for trial in trials),
            unit="",
            note="of all trials; below 1 they settle",
        ),
    }
    ends: dict[str, tuple[str, list[float | None]]] = {
        "settling_time": ("s", [trial.time for trial in settled]),
        "error_px": ("px", [trial.seen for trial in settled]),
        "error_m": ("m", [float(trial.errors[-1, 0]) for trial in settled]),
        "error_rad": ("rad", [float(trial.errors[-1, 1]) for trial in settled]),
    }
    for name, (unit, values) in ends.items():
        known = [one for one in values if one is not None and math.isfinite(one)]
        if not known and settled:
            continue  # the primitive has no such error
        for pooled, function in (("mean", np.mean), ("max", np.max)):
            value = float(function(known)) if known else None
            lacks = "" if known else "no trial settled"
            metrics[f"{name}.{pooled}"] = Metric(value=value, unit=unit, note=lacks)
    return metrics


def _held(
    scenario: VisionPrimitivesScenario, seed: int, finished: Trials[VisionTask]
) -> dict[str, Metric]:
    """Return the displacement of the fixed point on the way, and that of the turn alone."""
    away = max(float(trial.errors[:, 0].max()) for trial in _trials(finished))
    lever = math.hypot(scenario.loop.lever[0], scenario.loop.lever[2])
    alone = max(
        2 * lever * math.sin(abs(trial_of(scenario, seed, task).angle) / 2)
        for task in finished.tasks
    )
    return {
        "fixed_point.excursion.max": Metric(value=away, unit="m", note="on the way"),
        "fixed_point.unheld.max": Metric(
            value=alone, unit="m", note="displacement by the turn alone"
        ),
    }


def _rows(finished: Trials[VisionTask]) -> Table:
    trials = _trials(finished)
    return {
        "primitive": column([NAMES.index(task.name) for task in finished.tasks]),
        "trial": column([task.trial for task in finished.tasks]),
        "event": column(
            [0 if one.event is None else 1 + EVENTS.index(one.event) for one in trials]
        ),
        "time": column([trial.time for trial in trials]),
        "error_px": column([math.nan if one.seen is None else one.seen for one in trials]),
        "error_m": column([trial.errors[-1, 0] for trial in trials]),
        "error_rad": column([trial.errors[-1, 1] for trial in trials]),
        "theory_root": column([trial.slowest_root for trial in trials]),
    }


def _courses(finished: Trials[VisionTask]) -> Table:
    trials = _trials(finished)
    counts = [len(trial.times) for trial in trials]
    errors = np.concatenate([trial.errors for trial in trials])
    names = column([NAMES.index(task.name) for task in finished.tasks])
    return {
        "primitive": np.repeat(names, counts),
        "trial": np.repeat(column([task.trial for task in finished.tasks]), counts),
        "time": np.concatenate([trial.times for trial in trials]),
        "error_m": errors[:, 0].copy(),
        "error_rad": errors[:, 1].copy(),
    }


def _cells(finished: Trials[VisionTask]) -> Table:
    cells = [task.cell for task in finished.tasks if task.cell is not None]
    trials = _trials(finished)
    return {
        "focal_factor": column([focal for focal, _ in cells]),
        "angle": column([angle for _, angle in cells]),
        "converged": column([float(trial.event == "done") for trial in trials]),
        "theory_root": column([trial.slowest_root for trial in trials]),
    }


def map_metrics(cells: Table) -> dict[str, Metric]:
    """Return the tolerable camera errors along both axes of the map, and whether theory agrees."""
    found = {"": cells["converged"] > 0, "theory.": cells["theory_root"] < 1}
    metrics = {
        "map.agreement": Metric(
            value=100 * float(np.mean(found[""] == found["theory."])),
            unit="%",
            note=f"of {len(cells['converged'])} trials agree with the theory",
        )
    }
    straight, exact = cells["angle"] == 0, cells["focal_factor"] == 1
    shorter = straight & (cells["focal_factor"] <= 1)
    for prefix, good in found.items():
        low = _farthest(cells["focal_factor"][shorter], good[shorter], reverse=True)
        angle = _farthest(cells["angle"][exact], good[exact])
        metrics[f"{prefix}margin.focal_factor"] = Metric(
            value=low, unit="", note="smallest that settles, with the right orientation"
        )
        metrics[f"{prefix}margin.orientation"] = Metric(
            value=angle, unit="rad", note="largest that settles, with the right focal length"
        )
    return metrics


def _farthest(places: Array, good: NDArray[np.bool_], *, reverse: bool = False) -> float | None:
    """Return the last place, in order, up to which all trials settle; None: there is none."""
    last = None
    for place in sorted(set(places.tolist()), reverse=reverse):
        if not good[places == place].all():
            break
        last = place
    return last


def make_diagram(scenario: VisionPrimitivesScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_vision_servo_diagram(trial_of(scenario, 0, VisionTask("translation", 0)))


def make_loops(scenario: VisionPrimitivesScenario) -> tuple[Diagram, ...]:
    """Return no loops, because the beliefs about the cameras are drawn for each trial."""
    return ()


_COURSE: Final[Style] = {"color": "#1b4f9c", "linewidth": 0.7, "alpha": 0.6}
_SHADES: Final = ListedColormap(["#f3d3c8", "#f5ead0", "#d4e3f3"])  # none, some, all settle
_LEAST: Final = 1e-2  # mm or mrad, below which the panels show nothing


class _Panel(NamedTuple):
    name: VisionPrimitive
    title: str
    column: str
    label: str


_PANELS: Final = (
    _Panel("translation", "Translation", "error_m", "tip to goal / mm"),
    _Panel("rotation", "Rotation by lines", "error_rad", "axis to axis / mrad"),
    _Panel("fixed_point", "Rotation about a point", "error_rad", "turn left / mrad"),
    _Panel("grasp", "Visual grasp", "error_m", "centre to centre / mm"),
)


def figures(scenario: VisionPrimitivesScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the errors of all trials over time, the held point, and the map of calibration."""
    wrong = (
        f"focal lengths wrong by {100 * scenario.focal_error:.3g} %, "
        f"orientations by {math.degrees(scenario.orientation_error):.3g} degrees"
    )
    caption = (
        f"True errors over time of all trials of four visual primitives, with {wrong}, and a map "
        "of how far calibration may be off."
    )
    figure = new_figure(8.0, 9.6, caption=caption)
    figure.suptitle(f"True errors of all trials; {wrong}", fontsize=10)
    grid = figure.add_gridspec(3, 8, height_ratios=(1.0, 1.0, 1.2))
    for i, panel in enumerate(_PANELS):
        row, k = divmod(i, 2)
        axes = figure.add_subplot(grid[row, 4 * k : 4 * k + 4])
        courses = _curves(outcome, panel.name, panel.column)
        share = outcome.metrics[f"{panel.name}.converged"]
        title = f"({'abcd'[i]}) {panel.title}: {share.note} settle"
        draw_lines(axes, (), courses, title=title, y=panel.label)
        axes.set_yscale("log")
        axes.set_ylim(bottom=_LEAST)
    axes = figure.add_subplot(grid[2, :3])
    alone = outcome.metrics["fixed_point.unheld.max"].value
    levels = []
    if alone is not None:
        label = "largest, if the point was not held"
        levels = [ReferenceLine(1e3 * alone, label, DESIRED)]
    draw_lines(
        axes,
        (),
        _curves(outcome, "fixed_point", "error_m"),
        title="(e) Drift of the fixed point",
        y="point from start / mm",
        levels=levels,
    )
    axes.set_ylim(bottom=0.0)
    if levels:
        legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.2))
    _draw_map(figure.add_subplot(grid[2, 3:]), outcome)
    return {"vision-primitives": figure}


def _curves(outcome: Outcome, primitive: VisionPrimitive, error: str) -> list[Curve]:
    table = outcome.tables["courses"]
    of = table["primitive"] == NAMES.index(primitive)
    columns = table["time"][of], 1e3 * table[error][of], table["trial"][of]
    return trial_curves(*columns, _COURSE)


def _draw_map(axes: Axes, outcome: Outcome) -> None:
    cells = outcome.tables["map"]
    focal, angle = np.unique(cells["focal_factor"]), np.unique(cells["angle"])
    share = np.empty((len(angle), len(focal)))
    for i, one in enumerate(angle):
        for j, other in enumerate(focal):
            of = (cells["angle"] == one) & (cells["focal_factor"] == other)
            share[i, j] = np.mean(cells["converged"][of])
            roots = cells["theory_root"][of]
            # Beside each other, a mark for each trial.
            for k, root in enumerate(roots):
                x = j + 0.5 * ((k + 0.5) / len(roots) - 0.5)
                marker = "o" if root < 1 else "x"
                axes.plot(x, i, marker, color="#555555", mfc="none", ms=5)
    shades = np.where(share == 0, 0, np.where(share < 1, 1, 2))
    axes.pcolormesh(
        range(len(focal)),
        range(len(angle)),
        shades,
        cmap=_SHADES,
        vmin=0,
        vmax=2,
        edgecolors="white",
        linewidth=1.0,
    )
    axes.set_xticks(range(len(focal)), [f"{one:g}" for one in focal])
    axes.set_yticks(range(len(angle)), [f"{np.degrees(one):.0f}" for one in angle])
    for style, label in (("o", "theory: settles"), ("x", "theory: does not")):
        axes.plot([], [], style, color="#555555", mfc="none", ms=5, label=label)
    for i, label in enumerate(("none", "some", "all")):
        axes.plot([], [], "s", color=_SHADES(i), ms=9, label=f"{label} settle")
    legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3)
    title = f"(f) All translations settle in {(share == 1).sum()} of {share.size} cells"
    dress(axes, title=title, x="believed focal length / true one", y="orientation error / degrees")
