"""State machine or PID for your own plant and camera, designed alike and compared."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import (
    bootstrap_interval,
    mean_interval,
    metrics_of,
    prefixed,
    rate,
    trial_seed,
)
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_intervals,
    draw_lines,
    metric_value,
    name_rows,
    trial_curves,
)
from chamfer.analysis.drawing.figure_style import LOOPS, dress, legend_below, new_figure
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.linear.to_control import to_control
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column, measured
from chamfer.analysis.servo.loop_margins import loop_margins
from chamfer.diagrams.servo.comparison_loop import (
    ComparedLoopScenario,
    ControllerKind,
    ResolvedComparedLoopScenario,
    make_compared_diagram,
    sampled_response,
    what_is_open,
)
from chamfer.models.plants.servo_plant import ServoPlantParams, transfer_function
from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.servo.settling import guarantee

Array = NDArray[np.float64]

CONTROLLERS: Final[tuple[ControllerKind, ...]] = ("fsm", "pid")
CONDITIONS: Final = {
    "nominal": "no disturbance",
    "noise": "more noise",
    "friction": "dry friction",
    "lost": "lost frames",
    "plant": "another plant",
    "all": "all of it",
}
_MOST: Final = 10_000  # trials
_SAMPLES: Final = 8  # of a trace, between two frames
_LATE: Final = 2 / 3  # of a run, after which it should be at rest
_NOISE: Final = 3.0  # times the camera's largest error
_FRICTION: Final = 2.0  # tolerances


_DRAWN: Final = 10  # trials
_SAYS: Final = {"fsm": "the state machine", "pid": "the PID"}
_MATTERS: Final = {"settling_time": 0.05, "error": 0.05, "overshoot": 1.0, "travel": 0.05}
# from which on a difference is one: of the settling time, the tolerance, %, the tolerance


# What controllers are compared by, less is better: the unit, and what it is called.
CRITERIA: Final = {
    "settling_time": ("s", "settling time"),
    "error": ("m", "error at rest"),
    "overshoot": ("%", "overshoot"),
    "travel": ("m", "travel of the command"),
}


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """Disturbances that controllers are not designed for, one at a time and all together."""

    noise: float | None = None
    # m, half-width of the camera's noise instead of its own; None: three times its largest error
    friction: float | None = None
    # m of the command, largest lead of the command over the plant, either way; None: twice the
    # tolerance
    lost: float = 0.3  # share of frames without a measurement
    plant: float = 0.3  # relative error of gain and all times of the plant, either way

    def __post_init__(self) -> None:
        require_not_negative(self, "noise", "friction")
        for name in ("lost", "plant"):
            value = getattr(self, name)
            if not 0 <= value < 1:
                raise ParameterError(name, value, "0 <= share < 1")


@dataclass(frozen=True, kw_only=True)
class StepSpread:
    """The variation of trials, in addition to their noise."""

    step: float = 0.25  # relative spread of the step's height, uniform within plus and minus this

    def __post_init__(self) -> None:
        if not 0 <= self.step < 1:
            raise ParameterError("step", self.step, "0 <= share < 1")


@dataclass(frozen=True, kw_only=True)
class ServoComparisonScenario(ComparedLoopScenario):
    """Many steps, with each controller under each disturbance."""

    disturbance: Disturbances = field(default_factory=Disturbances)
    spread: StepSpread = field(default_factory=StepSpread)
    trials: int = 20  # steps, each with every controller under every disturbance

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.trials <= _MOST:
            raise ParameterError("trials", self.trials, f"1 to {_MOST}")


COMPARISON: Final = ServoComparisonScenario()


@dataclass(frozen=True, kw_only=True)
class ResolvedDisturbances(Disturbances):
    """Disturbances of the controllers, with nothing left open."""

    noise: float = field()
    friction: float = field()


@dataclass(frozen=True, kw_only=True)
class ResolvedServoComparisonScenario(ResolvedComparedLoopScenario, ServoComparisonScenario):
    """Many steps, with both controllers designed; it is its own loop without disturbance."""

    disturbance: ResolvedDisturbances = field()


def resolve_comparison(scenario: ServoComparisonScenario) -> ResolvedServoComparisonScenario:
    """Return the scenario with both controllers and the disturbances."""
    found, disturbance = what_is_open(scenario), scenario.disturbance
    tolerance, bound = found["tolerance"], scenario.camera.measurement.bound
    noise, friction = disturbance.noise, disturbance.friction
    if noise is None:
        noise = _NOISE * (bound or tolerance / 10)
    if friction is None:
        friction = _FRICTION * tolerance
    met = ResolvedDisturbances(**vars(disturbance) | {"noise": noise, "friction": friction})
    return ResolvedServoComparisonScenario(**vars(scenario) | found | {"disturbance": met})


def drawn(
    scenario: ResolvedServoComparisonScenario, seed: int, trial: int
) -> dict[str, ResolvedServoComparisonScenario]:
    """Return the loops of a trial, by :data:`CONDITIONS`.

    A plant that was identified is another one in every trial, one that may as well be behind the
    measurement. The controllers stay those that are designed for the scenario's own plant.
    """
    generator = np.random.default_rng([seed, trial])
    height, gain, time = generator.uniform(-1.0, 1.0, 3).tolist()
    plant = scenario.plant
    if plant.identified is not None:
        plant = replace(plant, identified=plant.identified.drawn(generator))
    amplitude = scenario.desired.amplitude * (1 + scenario.spread.step * height)
    desired = replace(scenario.desired, amplitude=amplitude)
    nominal = replace(scenario, plant=plant, desired=desired)
    off = scenario.disturbance
    model = transfer_function(plant).scaled(
        gain=1 + math.copysign(off.plant, gain), time=1 + math.copysign(off.plant, time)
    )
    another = ServoPlantParams(**model._asdict())
    noisy = replace(scenario.camera, noise=off.noise)
    blind = replace(scenario.camera, lost=off.lost)
    return {
        "nominal": nominal,
        "noise": replace(nominal, camera=noisy),
        "friction": replace(nominal, friction=off.friction),
        "lost": replace(nominal, camera=blind),
        "plant": replace(nominal, plant=another),
        "all": replace(
            nominal, plant=another, friction=off.friction, camera=replace(noisy, lost=off.lost)
        ),
    }


def _compare(scenario: ResolvedServoComparisonScenario, seed: int, trial: int) -> Row:
    row: dict[str, float | None] = {}
    courses: list[dict[str, Array]] = []
    for i, (condition, world) in enumerate(drawn(scenario, seed, trial).items()):
        for j, controller in enumerate(CONTROLLERS):
            run = simulate(
                make_compared_diagram(world, controller),
                duration=world.duration,
                step=world.camera.period / _SAMPLES,
                seed=trial_seed(seed, trial),
            )
            height, command = world.desired.amplitude, run.outputs["command"]
            error = height - run.outputs["position"]
            measured = measure(run.time, error, command, height=height, tolerance=world.tolerance)
            row |= {f"{condition}.{controller}.{name}": one for name, one in measured.items()}
            time = run.time[::_SAMPLES]
            which = {"condition": np.full_like(time, i), "controller": np.full_like(time, j)}
            courses.append({**which, "time": time, "error": error[::_SAMPLES]})
    table = {name: np.concatenate([one[name] for one in courses]) for name in courses[0]}
    return with_table(row, table)


def measure(
    time: Array, error: Array, command: Array, *, height: float, tolerance: float
) -> Mapping[str, float | None]:
    """Return the criteria of a run.

    ``error``, m, is desired minus actual position; ``height`` that of the step, and a smaller
    error than the tolerance is settled.

    Returns:
        ``settling_time`` s, None where the error is outside in the last third of the run;
        ``error`` m, root mean square in that third; ``overshoot`` %, beyond the step;
        ``travel`` m, which the command goes in that third.
    """
    late = time >= _LATE * time[-1]
    outside = np.flatnonzero(np.abs(error) > tolerance)
    last = int(outside[-1]) if len(outside) else -1
    settled = not late[max(last, 0)]
    return {
        "settling_time": float(time[last + 1]) if settled else None,
        "error": float(np.sqrt(np.mean(error[late] ** 2))),
        "overshoot": 100.0 * max(0.0, float((-error / height).max())),
        "travel": float(np.abs(np.diff(command[late])).sum()),
    }


class Difference(NamedTuple):
    """Which controller is better by a criterion under a condition."""

    criterion: str
    condition: str
    better: str  # "" for neither
    fsm: float  # mean
    pid: float  # mean


def run(scenario: ResolvedServoComparisonScenario, seed: int, progress: Progress) -> Outcome:
    """Undo many steps with both controllers under every disturbance."""
    trials = run_each(partial(_compare, scenario, seed), range(scenario.trials), progress)
    found = differences(scenario, trials)
    notes = answer(scenario, found, len(trials)), f"of {len(found)} differences, as fsm.better"
    metrics = {}
    for better, note in zip(CONTROLLERS, notes, strict=True):
        count = sum(one.better == better for one in found)
        metrics[f"{better}.better"] = Metric(value=count, unit="", note=note)
    metrics |= design_metrics(scenario)
    for condition in CONDITIONS:
        for controller in CONTROLLERS:
            name = f"{condition}.{controller}"
            metrics |= prefixed(name, _statistics(trials, name))
    first = trials.rows[0]
    single = [name for name in first if not isinstance(first[name], np.ndarray)]
    return Outcome(
        metrics=metrics,
        traces={"trial": column(trials.tasks)} | {name: trials.column(name) for name in single},
        tables={"courses": _courses(trials)},
        simulated_seconds=len(trials) * len(CONDITIONS) * len(CONTROLLERS) * scenario.duration,
    )


def design_metrics(scenario: ResolvedServoComparisonScenario) -> dict[str, Metric]:
    """Return the metrics of both designs, and their theoretical margins."""
    axis, gains, tolerance = scenario.fsm, scenario.pid, scenario.tolerance
    bound = scenario.camera.measurement.bound
    note = (
        f"{100 * tolerance / scenario.desired.amplitude:.3g} % of the step; "
        f"the camera errs by up to {1e3 * bound:.3g} mm"
    )
    metrics = metrics_of(
        {
            "tolerance": (tolerance, "m", note),
            "fsm.dead_zone": (axis.dead_zone, "m"),
            "fsm.increment": (axis.increment, "m"),
            "fsm.divider": (axis.divider, ""),
            "fsm.large_error": (axis.large_error, "m"),
            "pid.proportional": (gains.proportional, ""),
            "pid.integral": (gains.integral, "1/s"),
        }
    )
    metrics |= _guaranteed(scenario, bound)
    exact = replace(scenario, camera=replace(scenario.camera, resolution=0.0, noise=0.0))
    loop = to_control(
        make_compared_diagram(exact, "pid"),
        input="controller PID::error",
        at=scenario.duration,
        period=scenario.camera.period,
    )
    metrics |= loop_margins(loop).as_metrics("pid")
    if (found := scenario.plant.identified) is not None:
        units = {"gain": "", "lag": "s", "ratio": "", "dead_time": "s"}
        for (name, unit), deviation in zip(units.items(), found.deviations, strict=True):
            note = f"standard deviation {deviation:.2g}, by least squares"
            metrics[f"identified.{name}"] = Metric(
                value=getattr(found, name), unit=unit, note=note
            )
    return metrics


def _guaranteed(scenario: ResolvedServoComparisonScenario, bound: float) -> dict[str, Metric]:
    """Return what the settling theorem says of the state machine."""
    if not scenario.fsm.dead_zone > bound:
        missing = f"the dead zone is within the camera's error, {1e3 * bound:.3g} mm"
        units = {"fsm.share_of_theorem": "", "fsm.delay_margin": "s"}
        return metrics_of({name: (None, unit, missing) for name, unit in units.items()})
    response = sampled_response(transfer_function(scenario.plant), scenario.camera)
    said = guarantee(scenario.fsm, response, bound)
    if said.everywhere:
        certain = "settles from any error, and never reverses"
    elif said.small_band:
        certain = "never reverses on a small error; from a large one it is not guaranteed"
    else:
        certain = "not guaranteed to settle: more than 1"
    margin, note = None, "its condition on small errors does not hold"
    if said.small_band:
        margin = said.more_delay * scenario.camera.period
        note = "of more latency, with which small errors still can't reverse: sufficient"
    return metrics_of(
        {
            "fsm.share_of_theorem": (said.small_share, "", certain),
            "fsm.delay_margin": (margin, "s", note),
        }
    )


def _statistics(trials: Trials[int], name: str) -> dict[str, Metric]:
    metrics = {}
    for criterion, (unit, _) in CRITERIA.items():
        values = trials.column(f"{name}.{criterion}")
        values = values[np.isfinite(values)]
        if not len(values):
            metrics[criterion] = Metric(value=None, unit=unit, note="in no trial")
            continue
        span = f"mean of {len(values)} trials, {values.min():.3g} to {values.max():.3g}"
        metrics[criterion] = Metric(value=float(values.mean()), unit=unit, note=span)
        note = "95 % interval of the mean, bootstrap"
        for end, value in zip(("low", "high"), bootstrap_interval(values), strict=True):
            metrics[f"{criterion}.{end}"] = measured(value, unit, note=note, missing=note)
    settled = np.isfinite(trials.column(f"{name}.settling_time"))
    return metrics | rate(
        "settled", int(settled.sum()), len(trials), f"within the tolerance, of {len(trials)}"
    )


def differences(
    scenario: ResolvedServoComparisonScenario, trials: Trials[int]
) -> tuple[Difference, ...]:
    """Return where controllers differ, by every criterion under every condition.

    A difference counts if the 95 % interval of its mean over the pairs of trials does not hold 0,
    and if it is large enough to matter. A step that does not settle takes the whole run.
    """
    tolerance, duration = scenario.tolerance, scenario.duration
    unit = {"settling_time": scenario.settling_time, "overshoot": 1.0}
    found = []
    for criterion in CRITERIA:
        for condition in CONDITIONS:
            fsm, pid = (
                np.nan_to_num(trials.column(f"{condition}.{name}.{criterion}"), nan=duration)
                for name in CONTROLLERS
            )
            mean, half = mean_interval(fsm - pid)
            least = _MATTERS[criterion] * unit.get(criterion, tolerance)
            better = ""
            if abs(mean) > max(half, least):  # False for one trial, whose half is NaN
                better = "fsm" if mean < 0 else "pid"
            found.append(
                Difference(criterion, condition, better, float(fsm.mean()), float(pid.mean()))
            )
    return tuple(found)


def answer(
    scenario: ResolvedServoComparisonScenario, found: tuple[Difference, ...], trials: int
) -> str:
    """Return which controller is better in which respect, in a sentence."""
    task = (
        f"{1e3 * scenario.desired.amplitude:.3g} mm to within "
        f"{1e3 * scenario.tolerance:.3g} mm in {scenario.settling_time:.3g} s"
    )
    parts = []
    for controller in CONTROLLERS:
        said = [text for name in CRITERIA if (text := _better(found, name, controller))]
        if said:
            parts.append(f"{_SAYS[controller]} is better in {'; '.join(said)}")
    if not parts:
        parts = ["neither controller is better in anything"]
    alike = [
        CRITERIA[name][1]
        for name in CRITERIA
        if not any(one.better for one in found if one.criterion == name)
    ]
    if alike and len(alike) < len(CRITERIA):
        parts.append(f"they are alike in {' and '.join(alike)}")
    return f"Over {trials} steps of {task}, " + ", ".join(parts) + "."


def _better(found: tuple[Difference, ...], criterion: str, controller: str) -> str:
    """Return a criterion and the conditions in which a controller is better, with its best one."""
    won = [one for one in found if one.criterion == criterion and one.better == controller]
    if not won:
        return ""
    where = [CONDITIONS[one.condition] for one in won]
    best = max(won, key=lambda one: abs(one.fsm - one.pid))
    mine, others = (best.fsm, best.pid) if controller == "fsm" else (best.pid, best.fsm)
    unit, says = CRITERIA[criterion]
    factor, unit = (1e3, "mm") if unit == "m" else (1.0, unit)
    places = "everywhere" if len(won) == len(CONDITIONS) else f"with {', '.join(where)}"
    most = f"{factor * mine:.2g} against {factor * others:.2g} {unit}"
    return f"{says} {places} ({most} with {CONDITIONS[best.condition]})"


def _courses(trials: Trials[int]) -> Table:
    tables = [table_of(row) for row in trials.rows]
    counts = [len(table["time"]) for table in tables]
    return {
        "trial": np.repeat(column(trials.tasks), counts),
        **{name: np.concatenate([table[name] for table in tables]) for name in tables[0]},
    }


def make_diagram(scenario: ResolvedServoComparisonScenario) -> Diagram:
    """Return the wiring, for the block diagram."""
    return make_compared_diagram(scenario, "fsm")


def make_loops(scenario: ResolvedServoComparisonScenario) -> tuple[Diagram, ...]:
    """Return the loops of both controllers."""
    return tuple(make_compared_diagram(scenario, controller) for controller in CONTROLLERS)


def figures(scenario: ResolvedServoComparisonScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    better = [metric_value(outcome.metrics, f"{one}.better") for one in CONTROLLERS]
    figure = new_figure(
        height=9.5,
        caption=f"Of {len(CRITERIA) * len(CONDITIONS)} comparisons the FSM is better in "
        f"{better[0]:.0f} and the PID in {better[1]:.0f}, the others are even. Errors over time "
        "under each condition (a to f), and the criteria with 95 % intervals of the means.",
    )
    parts: Any = figure.subfigures(2, 1, height_ratios=[1.6, 1.0])
    courses, criteria = parts
    panels = courses.subplots(2, 3, sharex=True, sharey=True)
    for i, axes in enumerate(panels.flat):
        _draw_courses(axes, scenario, outcome, i)
    legend_below(courses, panels[0, 0], columns=4)
    below = criteria.subplots(1, len(CRITERIA), sharey=True)
    for axes, criterion in zip(below, CRITERIA, strict=True):
        _draw_criterion(axes, outcome, criterion)
    name_rows(below[0], list(CONDITIONS.values()))
    legend_below(criteria, below[0])
    criteria.suptitle("Means with 95 % intervals", fontsize=9)
    return {"servo-comparison": figure}


def _draw_courses(
    axes: Axes, scenario: ResolvedServoComparisonScenario, outcome: Outcome, condition: int
) -> None:
    """Draw the error over time under one of the conditions."""
    table, (key, says) = outcome.tables["courses"], list(CONDITIONS.items())[condition]
    settled = (
        f"{LOOPS[one][0]} {metric_value(outcome.metrics, f'{key}.{one}.settled'):.3g} %"
        for one in CONTROLLERS
    )
    lines: list[Curve] = []
    for j, controller in enumerate(CONTROLLERS):
        name, style = LOOPS[controller]
        mine = (table["condition"] == condition) & (table["controller"] == j)
        mine &= table["trial"] <= np.unique(table["trial"])[:_DRAWN][-1]
        course = table["time"][mine], 1e3 * table["error"][mine], table["trial"][mine]
        lines += trial_curves(*course, {**style, "linewidth": 0.9}, name)
    tolerance = 1e3 * scenario.tolerance
    asked = {"color": "#999999", "linewidth": 0.8, "linestyle": ":"}
    draw_lines(
        axes,
        (),
        lines,
        title=f"({'abcdef'[condition]}) {says}, settled: {', '.join(settled)}",
        y="error / mm",
        bands=[FilledBand(-tolerance, tolerance, "tolerance")],
        levels=[
            ReferenceLine(scenario.settling_time, "time allowed to settle", asked, upright=True)
        ],
    )


def _draw_criterion(axes: Axes, outcome: Outcome, criterion: str) -> None:
    unit, says = CRITERIA[criterion]
    factor, unit = (1e3, "mm") if unit == "m" else (1.0, unit)
    for j, controller in enumerate(CONTROLLERS):
        label, style = LOOPS[controller]
        names = [f"{condition}.{controller}.{criterion}" for condition in CONDITIONS]
        middle, low, high = (
            [metric_value(outcome.metrics, f"{name}{end}", factor) for name in names]
            for end in ("", ".low", ".high")
        )
        rows = np.arange(len(names)) + (0.14 if j else -0.14)
        look = {"color": style["color"], "marker": "os"[j], "markersize": 4}
        draw_intervals(axes, rows, middle, low, high, look, label)
    dress(axes, title=says, x=f"{says.split()[0]} / {unit}", y="")
    axes.set_xlim(left=0.0)
