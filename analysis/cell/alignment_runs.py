"""Runs of the two-arm work cell, measured against the truth that its cameras never see.

One, or many from different starts with different errors of the controllers' models.
"""

import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from typing import Any, ClassVar, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import (
    Quantity,
    bootstrap_interval,
    metrics_of,
    prefixed,
    trial_seed,
)
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Progress, Table
from chamfer.diagrams.cell.alignment import make_alignment_diagram, resolve_as
from chamfer.diagrams.cell.alignment_scenario import (
    KINDS,
    AlignmentScenario,
    ResolvedAlignmentScenario,
    require_in_view,
    require_start_apart,
)
from chamfer.diagrams.cell.controller_design import measurement_error, small_share
from chamfer.diagrams.cell.work_cell import ARMS, CellArmSettings, wedging_support
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import OpenSupport, Support
from chamfer.models.peg_theory.wedging import (
    box_margin,
    least_margin,
    require_stiff,
    rotation_margin,
    wedges,
)
from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.pose import POSE_NAMES
from chamfer.systems.servo.compensator_law import (
    CompensatorParams,
    make_axis_chart,
    make_compensator_chart,
)
from chamfer.systems.statechart.chart import Chart
from chamfer.systems.vision.cell_error import AXES

Array = NDArray[np.float64]
Traces = dict[str, Array]

# What :func:`arm_limits` measures.
ARM_LIMITS: Final = {"saturated": Quantity("%"), "joints.margin": Quantity("rad")}
# What :func:`alignment_metrics` measures; times count from the compensation's begin.
ALIGNMENT: Final = {
    "lateral_error": Quantity("m"),
    "rotational_error": Quantity("rad"),
    "uncompensated.lateral_error": Quantity("m"),
    "uncompensated.rotational_error": Quantity("rad"),
    "gap_error": Quantity("m"),
    "vision.lateral_error": Quantity("m"),
    "vision.rotational_error": Quantity("rad"),
    "settling_time": Quantity("s"),
    "lateral_overshoot": Quantity("m"),
    "rotational_overshoot": Quantity("rad"),
    "compensation.lateral": Quantity("m"),
    "compensation.rotational": Quantity("rad"),
    "compensation.late_lateral": Quantity("m"),
    "compensation.late_rotational": Quantity("rad"),
    "compensation.late_lateral_share": Quantity("%"),
    "compensation.late_rotational_share": Quantity("%"),
    **ARM_LIMITS,
    "detected": Quantity("%"),
    "blind": Quantity(""),
    "diverged": Quantity(""),
    "limited": Quantity(""),
    "growing": Quantity(""),
}
STOPPED: Final = ("blind", "diverged", "limited", "growing")  # what says that a loop went wrong
SETTLED: Final = (0.001, 0.01)  # m and rad: a run has settled from where it stays below
COURSE: Final = ("time", "lateral_errors", "rotational_errors")  # of a trial, in its row
# Across the hole's axis, and where they are in a compensation.
_ACROSS: Final = {
    "lateral": (("y", "z"), slice(0, 3)),
    "rotational": (("pitch", "yaw"), slice(3, 6)),
}
_HAND: Final = 1  # of the seed of what calibration has left of a camera in the hand
LATE: Final = 0.5  # s, at the end, over which the compensation should not change any more


def run_alignment(
    scenario: ResolvedAlignmentScenario, seed: int, progress: Progress | None = None
) -> Traces:
    """Simulate a resolved scenario and return its traces, a row per camera period.

    Columns: ``time`` s; of the truth ``lateral_error`` m (of the tip from the hole's axis),
    ``rotational_error`` rad (between the axes), ``gap`` m and, in the hole's axes, ``true_y`` and
    ``true_z`` m, ``true_pitch`` and ``true_yaw`` rad, what the peg lacks; the measured
    ``error_<axis>``, pixels and rad, ``valid``, ``age`` s, ``blind`` and ``diverged``;
    ``compensation_<axis>``, m and rad. Of each arm the commanded quaternion and position
    ``peg_qw``, ..., ``peg_x``, ..., the true ones ``peg_true_qw``, ..., the joints ``peg_q1``,
    ..., rad, the height by the encoders ``peg_tool_z`` and the desired one ``peg_desired_z``, m,
    and ``peg_saturated``, the number of joints at their torque limits. A fixture has no joints.
    """
    run = simulate(
        make_alignment_diagram(scenario),
        duration=scenario.duration,
        step=scenario.cameras.frames.period,
        seed=seed,
        progress=progress,
    )
    return alignment_traces(scenario, run.time, run.outputs)


def alignment_traces(
    scenario: AlignmentScenario, time: Array, outputs: Mapping[str, Array]
) -> Traces:
    """Return the columns of :func:`run_alignment` from a diagram's outputs."""
    true = true_errors(outputs["peg.true_pose"], outputs["hole.true_pose"])
    R_WH = scenario.hole_axes.matrix()
    way, turn = true.way @ R_WH, true.turn @ R_WH
    traces = {
        "time": time,
        "lateral_error": true.lateral,
        "rotational_error": true.rotational,
        "gap": true.gap,
        **{f"true_{axis}": way[:, i] for i, axis in ((1, "y"), (2, "z"))},
        **{f"true_{axis}": turn[:, i] for i, axis in ((1, "pitch"), (2, "yaw"))},
        **{name: outputs[name] for name in ("valid", "age", "blind", "diverged")},
    }
    for i, axis in enumerate(AXES):
        traces[f"error_{axis}"] = outputs["error"][:, i]
        traces[f"compensation_{axis}"] = outputs["compensation"][:, i]
    for arm in ARMS:
        for i, name in enumerate(POSE_NAMES):
            traces[f"{arm}_{name}"] = outputs[f"{arm}.command"][:, i]
            traces[f"{arm}_true_{name}"] = outputs[f"{arm}.true_pose"][:, i]
        traces[f"{arm}_tool_z"] = outputs[f"{arm}.tool_pose"][:, 6]
        traces[f"{arm}_desired_z"] = outputs[f"{arm}.desired_pose"][:, 6]
    for arm in scenario.arms:
        for i in range(getattr(scenario, arm).arm.num_joints):
            traces[f"{arm}_q{i + 1}"] = outputs[f"{arm}.encoders"][:, i]
        traces[f"{arm}_saturated"] = np.abs(outputs[f"{arm}.saturated"]).sum(axis=1)
    return traces


class TrueErrors(NamedTuple):
    """How parts stand to each other, a row a time; world axes."""

    gap: Array  # (n,), m, from the tip to the mouth along the hole's axis
    way: Array  # (n, 3), m, from the tip straight to the hole's axis
    turn: Array  # (n, 3), rad, that turns the peg's axis into the hole's

    @property
    def lateral(self) -> Array:
        """Distance of the tip from the hole's axis, m, shape (n,)."""
        return np.asarray(np.linalg.norm(self.way, axis=1))

    @property
    def rotational(self) -> Array:
        """Angle between the axes, rad, shape (n,)."""
        return np.asarray(np.linalg.norm(self.turn, axis=1))


def true_errors(peg: Array, hole: Array) -> TrueErrors:
    """Return the errors of tip and mouth frames at poses of shape (n, 7)."""
    peg_axis, hole_axis = (
        Rotation.from_quat(poses[:, :4], scalar_first=True).apply([1.0, 0.0, 0.0])
        for poses in (peg, hole)
    )
    between = hole[:, 4:] - peg[:, 4:]
    gap = np.sum(between * hole_axis, axis=1)
    normal = np.cross(peg_axis, hole_axis)
    sine = np.linalg.norm(normal, axis=1)
    angle = np.arctan2(sine, np.sum(peg_axis * hole_axis, axis=1))
    scale = np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)
    return TrueErrors(
        gap=gap, way=between - gap[:, np.newaxis] * hole_axis, turn=scale[:, np.newaxis] * normal
    )


def row_before(time: Array, begin: float) -> int:
    """Return the last row before a time, s, or the first row."""
    return max(int(np.searchsorted(time, begin - 1e-9)) - 1, 0)


def alignment_metrics(traces: Table, scenario: AlignmentScenario) -> dict[str, float | None]:
    """Measure a run, see :data:`ALIGNMENT`; a value is None where it is undefined."""
    time = traces["time"]
    before = row_before(time, scenario.begin)
    total = np.column_stack([traces[f"compensation_{axis}"] for axis in AXES])
    late = total[time >= time[-1] - LATE - 1e-9]
    changed = late.max(axis=0) - late.min(axis=0)
    values: dict[str, float | None] = dict.fromkeys(ALIGNMENT)
    for name, (across, axes) in _ACROSS.items():
        error = traces[f"{name}_error"]
        values[f"{name}_error"] = float(error[-1])
        values[f"uncompensated.{name}_error"] = float(error[before])
        lacks = np.column_stack([traces[f"true_{axis}"] for axis in across])
        values[f"{name}_overshoot"] = _overshoot(lacks[before:])
        values[f"compensation.{name}"] = float(np.abs(total[-1, axes]).max())
        values[f"compensation.late_{name}"] = float(changed[axes].max())
        if largest := float(np.abs(total[:, axes]).max()):
            share = 100 * float(changed[axes].max()) / largest
            values[f"compensation.late_{name}_share"] = share
    values["gap_error"] = float(traces["gap"][-1]) - scenario.gap
    out = (traces["lateral_error"] > SETTLED[0]) | (traces["rotational_error"] > SETTLED[1])
    if not out[-1]:
        last = int(np.flatnonzero(out).max(initial=-1)) + 1
        values["settling_time"] = max(float(time[last]) - scenario.begin, 0.0)
    values |= arm_limits(traces, scenario)
    values["detected"] = detected_share(traces, scenario)
    pixel = scenario.cameras.pixel_size
    return values | vision_errors(traces, -1, pixel) | stopped_values(traces, scenario)


def arm_limits(traces: Table, scenario: AlignmentScenario) -> dict[str, float]:
    """Return how near the arms come to their limits.

    ``saturated`` is the share of the time in which a joint is at its torque limit, %, and
    ``joints.margin`` the least way to an end of a joint's travel, rad.
    """
    busy = [traces[f"{arm}_saturated"] > 0 for arm in scenario.arms]
    margins = []
    for name in scenario.arms:
        arm = getattr(scenario, name).arm
        q = np.column_stack([traces[f"{name}_q{i + 1}"] for i in range(arm.num_joints)])
        margins.append(np.minimum(q - arm.lower_limits, arm.upper_limits - q).min())
    return {
        "saturated": 100 * float(np.mean(np.any(busy, axis=0))),
        "joints.margin": float(min(margins)),
    }


def vision_errors(traces: Table, row: int, pixel_size: float) -> dict[str, float | None]:
    """Return the measured minus the true errors at a row, m and rad; None if not measured."""
    values: dict[str, float | None] = {}
    for name, (across, _) in _ACROSS.items():
        scale = pixel_size if name == "lateral" else 1.0
        off = [
            scale * traces[f"error_{axis}"][row] - traces[f"true_{axis}"][row] for axis in across
        ]
        values[f"vision.{name}_error"] = float(np.hypot(*off)) if traces["valid"][row] else None
    return values


def _overshoot(lacks: Array) -> float:
    """Return how far a vector goes beyond zero, against its first direction, shape (n, 2)."""
    size = float(np.linalg.norm(lacks[0]))
    return max(0.0, float((-lacks @ lacks[0]).max()) / size) if size > 0 else 0.0


def stopped_values(traces: Table, scenario: AlignmentScenario) -> dict[str, float | None]:
    """Return 1 for each of :data:`STOPPED` that a run did, else 0.

    The parts were lost; the compensation was stopped since the measured error had grown; it
    reached a limit; the true error is larger at the end than where it began, and still grows.
    """
    time = traces["time"]
    rows = [row_before(time, scenario.begin), row_before(time, time[-1] - LATE), -1]
    axes = scenario.compensator.axes if scenario.controller.kind == "fsm" else scenario.pid.axes
    total = np.column_stack([traces[f"compensation_{axis}"] for axis in AXES])
    growing = False
    for name, settled in zip(("lateral_error", "rotational_error"), SETTLED, strict=True):
        begin, late, end = traces[name][rows]
        growing |= bool(end > max(begin, late, settled))
    return {
        "blind": float(traces["blind"].max()),
        "diverged": float(traces["diverged"].max()),
        "limited": float((np.abs(total) >= [axis.limit for axis in axes]).any()),
        "growing": float(growing),
    }


# Of each what is warned of, and what a share of trials is of.
_LOST: Final = "the cameras lost the parts"
_STOPS: Final = {
    "blind": (_LOST, f"{_LOST}, what approached stopped"),
    "diverged": (
        "it diverged: the measured error grew by half, the compensation stopped",
        "stopped, as the measured error had grown by half",
    ),
    "limited": ("the compensation reached a limit",) * 2,
    "growing": ("the true error is larger at the end than at the begin, and grows",) * 2,
}


def warn_of_stops(rows: Mapping[str, Array]) -> None:
    """Say which runs went wrong: of each what :data:`STOPPED` says, shape (n,)."""
    for name, (text, _) in _STOPS.items():
        if found := int(np.sum(rows[name] > 0)):
            n = len(rows[name])
            where = f"in {found} of {n} trials " if n > 1 else ""
            warnings.warn(where + text, stacklevel=3)


def stopped_metrics(rows: Mapping[str, Array]) -> dict[str, Metric]:
    """Return the share of trials in which the loop failed, and warn of it."""
    warn_of_stops(rows)
    shares = {name: 100 * float(rows[name].mean()) for name in _STOPS}
    of = f"of {len(rows['diverged'])} trials"
    return metrics_of({name: (shares[name], "%", f"{of}, {_STOPS[name][1]}") for name in _STOPS})


def settling_metrics(scenario: ResolvedAlignmentScenario) -> dict[str, Metric]:
    """Return the share of the settling theorem's bound that the state machine uses.

    More than all of it is warned of. The PID has none.
    """
    if scenario.controller.kind != "fsm":
        return {}
    shares = {kind: small_share(scenario, kind) for kind in KINDS}
    kind = max(shares, key=lambda one: shares[one])
    nu = f"{measurement_error(scenario, kind):g} {'pixels' if kind == 'lateral' else 'rad'}"
    if shares[kind] > 1:
        warnings.warn(
            f"the {kind} increments are {shares[kind]:.3g} times what surely settles in their "
            f"dead zone, for a measurement error of {nu}",
            stacklevel=2,
        )
    note = f"of the theorem's bound, {kind}, for a measurement error of {nu}"
    share: float | None = shares[kind]
    if math.isinf(shares[kind]):
        share, note = None, f"{note}: the dead zone is within it"
    return metrics_of({"settling.small_share": (share, "", note)})


def detected_share(traces: Table, scenario: AlignmentScenario) -> float:
    """Return in which share of the frames since the begin both parts were seen, %."""
    frames = traces["valid"][row_before(traces["time"], scenario.begin) + 1 :]
    return 100 * float(frames.mean())


def detected_metric(detected: Array) -> Metric:
    """Return the mean of :func:`detected_share` over runs, shape (n,); warn if one never saw."""
    unseen, n = int(np.sum(detected == 0)), len(detected)
    note = "frames in which both cameras saw both parts"
    if n > 1:
        note += f", mean of {n} trials, {detected.min():.4g} to {detected.max():.4g}"
    if unseen:
        never = "the cameras never saw both parts, nothing was compensated"
        if n > 1:
            never = f"in {unseen} of {n} trials {never}"
        warnings.warn(never, stacklevel=2)
        note += f"; {never}"
    return Metric(value=float(detected.mean()), unit="%", note=note)


def alignment_charts(scenario: AlignmentScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the compensator's state charts; none for the PID."""
    if scenario.controller.kind != "fsm":
        return ()
    settings = scenario.compensator
    params = CompensatorParams(axes=settings.axes, period=scenario.cameras.frames.period)
    return make_compensator_chart(params), make_axis_chart(settings.lateral.closed)


_MOST: Final = 10_000  # trials


@dataclass(frozen=True, kw_only=True)
class Spread:
    """By how much trials differ: each value is uniform within plus and minus its range."""

    lateral: float = 0.01  # m, initial error of the peg's command along Y and Z; assumed
    rotational: float = 0.1  # rad, initial error of the peg's command about Y and Z; assumed
    payload: float = 0.5  # relative, of each arm's payload error; assumed
    link_mass: float = 0.02  # relative, of each arm's links; assumed
    joint_friction: float = 0.5  # relative, of each arm's; assumed

    def __post_init__(self) -> None:
        require_not_negative(self, "lateral", "rotational", "link_mass")
        require_shares(self, "payload", "joint_friction", "link_mass")


def require_shares(params: object, *names: str) -> None:
    """Refuse a relative error that may take all of a value."""
    for name in names:
        if not 0 <= (value := getattr(params, name)) < 1:
            raise ParameterError(name, value, "from 0 to less than 1")


DrawnT = TypeVar("DrawnT", bound=AlignmentScenario)
ArmT = TypeVar("ArmT", bound=CellArmSettings)


def wrong_arm(arm: ArmT, payload_error: float, mass: float, friction: float) -> ArmT:
    """Return an arm with errors of its model, kg and relative."""
    return replace(
        arm.with_friction(1 + friction),
        payload_error=payload_error,
        mass_scale=arm.mass_scale * (1 + mass),
    )


class TrialErrors(NamedTuple):
    """The random values of a trial."""

    error: tuple[float, ...]  # of the peg's command, m and rad, in AXES' order
    arms: tuple[tuple[float, float, float], ...]
    # of each arm, relative: of payload error, links' masses, and joint friction


def draw_errors(
    middle: Sequence[float],
    spread: Spread,
    arms: int,
    seed: int,
    trial: int,
    repeatability: float = 0.0,
) -> TrialErrors:
    """Return initial errors about their middle, and model errors of arms, of a seed's trial.

    The arm's repeatability, m, adds to the errors across.
    """
    generator = np.random.default_rng([seed, trial])
    error = generator.uniform(-1.0, 1.0, 6)
    error *= [0.0, spread.lateral, spread.lateral, 0.0, spread.rotational, spread.rotational]
    error += middle
    reach = np.array([spread.payload, spread.link_mass, spread.joint_friction])
    wrong = reach * generator.uniform(-1.0, 1.0, (arms, 3))
    error[1:3] += repeatability * generator.uniform(-1.0, 1.0, 2)
    return TrialErrors(tuple(error.tolist()), tuple(map(tuple, wrong.tolist())))


def drawn(scenario: DrawnT, spread: Spread, seed: int, trial: int) -> DrawnT:
    """Return the scenario with initial and model errors of one of a seed's trials."""
    middle, arm_error = scenario.initial_error, scenario.repeatability
    found = draw_errors(middle, spread, len(scenario.arms), seed, trial, arm_error)
    arms: dict[str, Any] = {}
    for name, (payload, mass, friction) in zip(scenario.arms, found.arms, strict=True):
        settings = getattr(scenario, name)
        payload_error = settings.payload_error * (1 + payload)
        arms[name] = wrong_arm(settings, payload_error, mass, friction)
    if (cameras := scenario.cameras).kind == "hand":
        generator = np.random.default_rng([seed, trial, _HAND])
        arms["cameras"] = replace(cameras, hand=cameras.hand.drawn(generator))
    return replace(scenario, initial_error=found.error, **arms)


@dataclass(frozen=True, kw_only=True)
class AlignmentTrialsScenario(AlignmentScenario):
    """The alignment with many starts and many model errors (section 5)."""

    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the middle of the starts
    spread: Spread = field(default_factory=Spread)
    trials: int = 20  # ten in the paper

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.trials <= _MOST:
            raise ParameterError("trials", self.trials, f"1 to {_MOST}")


@dataclass(frozen=True, kw_only=True)
class ResolvedAlignmentTrialsScenario(ResolvedAlignmentScenario, AlignmentTrialsScenario):
    """The scenario with no field left open."""


TrialsT = TypeVar("TrialsT", bound=ResolvedAlignmentTrialsScenario)


def resolve_trials(kind: type[TrialsT], scenario: AlignmentTrialsScenario) -> TrialsT:
    """Return a scenario resolved, once it is sure that every trial has something to see.

    All trials have the controllers that are designed for its middle.
    """
    resolved = resolve_as(kind, scenario)
    require_starts(resolved, resolved.spread)
    return resolved


def require_starts(scenario: AlignmentScenario, spread: Spread) -> None:
    """Refuse a spread of which a start has nothing to see, or parts in each other."""
    far = spread.lateral
    for y, z in product((-far, far), repeat=2):
        error = np.add(scenario.initial_error, (0.0, y, z, 0.0, 0.0, 0.0))
        start = replace(scenario, initial_error=tuple(error.tolist()))
        try:
            if scenario.cameras.kind == "pair":
                require_in_view(start)
            require_start_apart(start)
        except ParameterError as refused:
            raise ParameterError("spread.lateral", far, refused.allowed) from refused


@dataclass(frozen=True, kw_only=True)
class RepeatabilityScenario(AlignmentTrialsScenario):
    """The trials, with the support whose wedging diagram judges the errors."""

    support: OpenSupport = field(default_factory=OpenSupport)
    # for the margins; open fields: derived from the arms, where two points may begin to wedge

    UNUSED_OF_PARTS: ClassVar[tuple[str, ...]] = ("bore_depth",)

    def held(self) -> Support:
        """Return the support that the margins are of."""
        return self.support.over(wedging_support(self))


@dataclass(frozen=True, kw_only=True)
class ResolvedRepeatabilityScenario(ResolvedAlignmentTrialsScenario, RepeatabilityScenario):
    """The scenario with no field left open."""


REPEATABILITY: Final = RepeatabilityScenario()


def resolve_repeatability(scenario: RepeatabilityScenario) -> ResolvedRepeatabilityScenario:
    """Fill in the support too."""
    held = scenario.held()
    require_stiff(scenario.parts, held)
    known = OpenSupport(**{one.name: getattr(held, one.name) for one in fields(held)})
    return resolve_trials(ResolvedRepeatabilityScenario, replace(scenario, support=known))


def align(scenario: ResolvedAlignmentTrialsScenario, seed: int, trial: int) -> Row:
    """Run one of a seed's trials; it depends on its arguments alone, but for how long it takes.

    The row has what ``ALIGNMENT`` names, the true errors over ``time``, and ``wall_seconds``.
    """
    started = time.perf_counter()
    one = drawn(scenario, scenario.spread, seed, trial)
    traces = run_alignment(one, trial_seed(seed, trial))
    return {
        **alignment_metrics(traces, one),
        "time": traces["time"],
        "lateral_errors": traces["lateral_error"],
        "rotational_errors": traces["rotational_error"],
        "wall_seconds": time.perf_counter() - started,
    }


def align_all(
    scenario: ResolvedAlignmentTrialsScenario, seed: int, progress: Progress
) -> Trials[int]:
    """Run the scenario's number of trials; a task is a trial's number."""
    return run_each(partial(align, scenario, seed), range(scenario.trials), progress)


def courses(
    rows: Sequence[Row], names: Sequence[str], **labels: Sequence[float]
) -> dict[str, Array]:
    """Return columns of the rows' courses, one below the other, each with its row's labels."""
    counts = [len(row[names[0]]) for row in rows]
    repeated = {label: np.repeat(values, counts) for label, values in labels.items()}
    return repeated | {
        name.removesuffix("s"): np.concatenate([row[name] for row in rows]) for name in names
    }


def statistics(finished: Trials[Any], name: str, unit: str) -> dict[str, Metric]:
    """Return mean, 95 % interval of the mean, and maximum of a metric that is never negative."""
    of = finished.column(name)
    n = len(of)
    low, high = bootstrap_interval(of)
    note = "one trial has no interval"
    if n > 1:
        note = f"95 % interval of the mean of {n} trials, by bootstrap (BCa)"
    found = {
        "mean": (float(np.mean(of)), unit, f"{n} trials"),
        "mean_low": (low, unit, note),
        "mean_high": (high, unit, note),
        "max": (float(np.max(of)), unit, f"{n} trials"),
    }
    return prefixed(name, metrics_of(found))


def mean_over(finished: Trials[Any], name: str, unit: str, never: str) -> Metric:
    """Return the mean of a metric over the trials that have it, and ``never`` if none has."""
    known = finished.column(name)
    known = known[np.isfinite(known)]
    if not len(known):
        return Metric(value=None, unit=unit, note=never)
    note = f"mean of {len(known)} trials, {known.min():.4g} to {known.max():.4g}"
    return Metric(value=float(known.mean()), unit=unit, note=note)


def settled_trials(finished: Trials[Any], note: str) -> dict[str, Metric]:
    """Return the mean time of the trials that settle, and their share."""
    of = finished.column("settling_time")
    found = of[np.isfinite(of)]
    mean = float(found.mean()) if len(found) else None
    share = 100 * len(found) / len(of)
    return metrics_of({"settling_time": (mean, "s", note), "settled": (share, "%")})


def margins(finished: Trials[Any], parts: PegHoleGeometry, support: Support) -> dict[str, Metric]:
    """Return the worst trial's margins to the wedging diagram's box and to its sides.

    As the signs of the two errors in the plane of insertion are not known from their sizes, the
    worse one is taken; of the least over all compliance centres the same sign, which is.
    """
    lateral, rotational = map(finished.column, ("lateral_error", "rotational_error"))
    box = [box_margin(parts, x, angle) for x, angle in zip(lateral, rotational, strict=True)]
    sloped = [
        least_margin(parts, support, x, angle)[0]
        for x, angle in zip(lateral.tolist(), rotational.tolist(), strict=True)
    ]
    signs = np.array([[1.0], [-1.0]])
    here = rotation_margin(parts, support, lateral, signs * rotational)
    wedged = wedges(parts, support, lateral, signs * rotational).any(axis=0)
    at = f"L_g = {1e3 * support.centre_distance:.3g} mm, K_x = {support.lateral_stiffness:.4g} N/m"
    worst = {name: min(float(getattr(one, name)) for one in box) for name in box[0]._fields}
    guided = 1 - float(np.max(lateral)) / parts.chamfer_limit
    reach = "of the lateral error that the chamfers still guide, of all trials"
    shares = {
        "box_margin.lateral": (worst["lateral"], "of all trials"),
        "box_margin.rotation": (worst["rotation"], "of all trials"),
        "chamfer_margin": (guided, reach),
        "parallelogram_margin": (min(sloped), "exact sides, the least over L_g and trials"),
        "margin": (float(here.min()), f"exact sides, at {at}, of all trials"),
        "wedging": (float(np.mean(wedged)), "trials that may wedge"),
    }
    return metrics_of({name: (100 * share, "%", note) for name, (share, note) in shares.items()})
