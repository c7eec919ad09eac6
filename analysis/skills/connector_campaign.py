"""Many insertions in randomised scenarios: success rates of skills, searches and primitives.

The skill's beliefs are the scenario itself; the truth differs from trial to trial.
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from operator import mul
from typing import Any, Final, Literal, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import prefixed, rate, trial_seed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.drawing.figure_kit import (
    colour_bar,
    draw_cumulative,
    draw_distribution,
    draw_intervals,
    metric_value,
    name_rows,
)
from chamfer.analysis.drawing.figure_style import (
    FORCE,
    LIMIT,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.analysis.skills.ablation import CHANGES, SkillChange, whole
from chamfer.analysis.skills.connector_insertion import plot_failure
from chamfer.analysis.skills.insertion_metrics import (
    INSERTION,
    InsertionVerdict,
    failure,
    failure_columns,
    insertion_metrics,
    peak,
    verdict,
)
from chamfer.analysis.skills.skill_run import AXES, run_skill
from chamfer.diagrams.skills.connector_scenario import (
    BncConnectorScenario,
    ConnectorScenario,
    DConnectorScenario,
    PegScenario,
    ResolvedConnectorScenario,
    ResolvedStrategyScenario,
    Rj45ConnectorScenario,
    StandardConnector,
    StrategyScenario,
    resolved_fields,
)
from chamfer.diagrams.skills.connector_sight import ResolvedSightSettings, SightSettings
from chamfer.diagrams.skills.vision_servo import CameraBelief
from chamfer.models.connectors.mesh_connector import MeshConnector
from chamfer.models.validation import ParameterError, known, require_between, require_not_negative
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_law import make_skill_chart
from chamfer.systems.sensing.force_sensor import WrenchSensorParams
from chamfer.systems.strategies.peg_in_hole import PegInHoleSkillParams, Search

_MOST: Final = 10_000  # trials
_LEAST: Final = 0.0003  # m, depth of an obstacle that is in a socket, not before it


@dataclass(frozen=True, kw_only=True)
class ScenarioSpread:
    """Differences between truth and belief in the trials; all of them are assumed.

    Draws are uniform within plus and minus a range unless the field says otherwise.
    """

    lateral: float = 0.002  # m, of the plug over the socket along x and y
    rotational: float = math.radians(3)  # rad, of the plug in the gripper about x, y and z
    force_bias: float = 1.0  # N, of the sensor along each axis
    torque_bias: float = 0.03  # N m, of the sensor about each axis
    friction: float = 0.5  # share, of the believed friction of the connector
    wrist_stiffness: float = 0.3  # share, of the believed stiffness of the wrist, all axes
    wrist_centre: float = 0.002  # m, of the wrist's springs along the tool
    sensor_origin: float = 0.002  # m, of the origin of the sensor's moments, along each axis
    mating_force: float = 2.0  # factor of the connector's own, either way, log-uniform
    tight: float = 0.5  # share of trials whose connector has the tightest fit allowed
    focal: float = 0.1  # share, of each camera's focal length, with cameras
    camera_turn: float = math.radians(5)
    # rad, of each camera about each of its axes, with cameras
    obstacles: float = 0.1  # share of trials in which something is in the socket
    obstacle_short: float = 0.0005  # m, by which an obstacle is short of the mated depth at least

    def __post_init__(self) -> None:
        names = [one.name for one in fields(self) if one.name != "mating_force"]
        require_not_negative(self, *names)
        for name in ("friction", "wrist_stiffness", "focal"):
            if not (value := getattr(self, name)) < 1:
                raise ParameterError(name, value, "0 <= share < 1")
        for name in ("tight", "obstacles"):
            if not (value := getattr(self, name)) <= 1:
                raise ParameterError(name, value, "0 to 1")
        if not 1 <= self.mating_force < math.inf:
            raise ParameterError("mating_force", self.mating_force, "a finite factor >= 1")


@dataclass(frozen=True, kw_only=True)
class CampaignScenario(ConnectorScenario):
    """The fields that campaigns add to those of one insertion."""

    spread: ScenarioSpread = ScenarioSpread()
    trials: int = 50  # insertions, each in its own randomised scenario

    def __post_init__(self) -> None:
        require_between(self, 1, _MOST, "trials")
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class DConnectorCampaignScenario(DConnectorScenario, CampaignScenario):
    """Many insertions of a D connector."""


@dataclass(frozen=True, kw_only=True)
class BncConnectorCampaignScenario(BncConnectorScenario, CampaignScenario):
    """Many insertions of a BNC connector."""


@dataclass(frozen=True, kw_only=True)
class Rj45ConnectorCampaignScenario(Rj45ConnectorScenario, CampaignScenario):
    """Many insertions of an RJ45 plug."""


@dataclass(frozen=True, kw_only=True)
class PegCampaignScenario(PegScenario, CampaignScenario):
    """Many insertions of a round peg, and the same scenarios with other searches."""

    compared: tuple[Search, ...] = ("spiral", "tilt")  # searches to compare with that of the skill


@dataclass(frozen=True, kw_only=True)
class ResolvedTrialsScenario(ResolvedConnectorScenario, CampaignScenario):
    """Many insertions of any part; nothing is open."""

    connector: StandardConnector | MeshConnector


@dataclass(frozen=True, kw_only=True)
class ResolvedCampaignScenario(ResolvedStrategyScenario, ResolvedTrialsScenario):
    """Many insertions of a part by its built-in strategy; nothing is open."""


@dataclass(frozen=True, kw_only=True)
class ResolvedSkillScenario(ResolvedTrialsScenario):
    """Many insertions of any part by your own skill; nothing is open."""

    skill: Skill

    def make_skill(self) -> Skill:
        """Return the skill."""
        return self.skill


@dataclass(frozen=True, kw_only=True)
class ResolvedPegCampaignScenario(ResolvedCampaignScenario):
    """Many insertions of a round peg, by several searches; nothing is open."""

    skill: PegInHoleSkillParams
    compared: tuple[Search, ...]


_CAMPAIGN: Final[dict[str, Any]] = {
    # Cameras are believed to be as they are, but for what a trial draws.
    "sight": SightSettings(xz=CameraBelief(), yz=CameraBelief()),
    "sensing": "realistic",
    "sensor": WrenchSensorParams(),
    "step": 0.002,  # s; peak forces differ by less than 1 % from those at 1 ms
    "duration": 240.0,  # s, after which a run has made all its retries
}
D_CONNECTOR: Final = DConnectorCampaignScenario(**_CAMPAIGN)
BNC_CONNECTOR: Final = BncConnectorCampaignScenario(
    # The middle of the errors; the slots are that far from the studs.
    initial_error=(0.0, 0.0, 0.6, 0.0, 0.0, 0.0),
    **_CAMPAIGN,
)
RJ45_CONNECTOR: Final = Rj45ConnectorCampaignScenario(**_CAMPAIGN)
ROUND_PEG: Final = PegCampaignScenario(**_CAMPAIGN)
D_ABLATION: Final = replace(D_CONNECTOR, trials=20)  # by each of the skills
BNC_ABLATION: Final = replace(BNC_CONNECTOR, trials=20)

S = TypeVar("S", bound=ResolvedTrialsScenario)


def resolve_campaign(scenario: StrategyScenario) -> ResolvedCampaignScenario:
    """Return the resolved campaign of a part, before the draws of its trials."""
    return ResolvedCampaignScenario(**resolved_fields(scenario))


def resolve_peg_campaign(scenario: PegCampaignScenario) -> ResolvedPegCampaignScenario:
    """Return the campaign of the peg, likewise."""
    return ResolvedPegCampaignScenario(**resolved_fields(scenario))


def randomised(scenario: S, seed: int, trial: int) -> S:
    """Return the randomised scenario of one of a seed's trials.

    Every trial takes the same draws in the same order, so that one spread does not change
    another's. An obstacle that does not fit into the socket is refused.
    """
    random, spread = np.random.default_rng([seed, trial]), scenario.spread

    def off(*ranges: float) -> list[float]:
        return list(map(mul, ranges, random.uniform(-1.0, 1.0, len(ranges)).tolist()))

    error = off(*[spread.rotational] * 3, *[spread.lateral] * 2, 0.0)
    bias = off(*[spread.force_bias] * 3, *[spread.torque_bias] * 3)
    friction, stiffness, force = off(
        spread.friction, spread.wrist_stiffness, math.log(spread.mating_force)
    )
    focal, turns = off(*[spread.focal] * 2), [off(*[spread.camera_turn] * 3) for _ in range(2)]
    tight, blocked, place = random.uniform(size=3).tolist()
    own = scenario.connector
    material = replace(own.material, friction=(1 + friction) * own.material.friction)
    tolerance = "worst" if tight < spread.tight else own.tolerance
    connector = replace(own, material=material, tolerance=tolerance).with_mating_force(
        math.exp(force) * own.mating_force
    )
    deepest = connector.mated_depth - spread.obstacle_short
    if not deepest > _LEAST:
        allowed = f"less than {connector.mated_depth - _LEAST:.3g} m"
        raise ParameterError("spread.obstacle_short", spread.obstacle_short, allowed)
    centre, *origin = off(spread.wrist_centre, *[spread.sensor_origin] * 3)
    wrist = replace(
        scenario.wrist,
        stiffness=tuple((1 + stiffness) * k for k in scenario.wrist.stiffness),
        centre=scenario.wrist.centre + centre,
    )
    origin = np.add(known("sensor.origin", scenario.sensor.origin), origin).tolist()
    changes: dict[str, Any] = {
        "initial_error": tuple(np.add(scenario.initial_error, error).tolist()),
        "sensor": replace(scenario.sensor, bias=tuple(bias), origin=tuple(origin)),
        "connector": connector,
        "wrist": wrist,
    }
    if scenario.sight is not None:
        changes["sight"] = _miscalibrated(scenario.sight, focal, turns)
    if blocked < spread.obstacles:
        changes["obstacle"] = _LEAST + place * (deepest - _LEAST)
    return replace(scenario, **changes)


def _miscalibrated(
    sight: ResolvedSightSettings, focal: list[float], turns: list[list[float]]
) -> ResolvedSightSettings:
    """Return the cameras with errors in their believed parameters."""
    xz, yz = (
        replace(
            one,
            focal_factor=one.focal_factor * (1 + factor),
            turn=tuple(np.add(one.turn, turn).tolist()),
        )
        for one, factor, turn in zip((sight.xz, sight.yz), focal, turns, strict=True)
    )
    return replace(sight, xz=xz, yz=yz)


# Of a trial: errors, rad and m; the true connector's friction and mating force, N, 1 if
# it has the tightest fit, and depth of an obstacle, m; of the true wrist the stiffness along z,
# N/m, and how high its centre is, m.
DRAWN: Final = (
    *(f"initial_{axis}" for axis in AXES),
    "friction",
    "mating_force",
    "tight",
    "wrist_stiffness",
    "wrist_centre",
    "obstacle",
)
_WHY: Final = ("reason.depth", "reason.force", "reason.tilt", "reason.time")
_PEAK: Final = ("peak.depth", "peak.tilt")
_COURSE: Final = ("time", "depth", "true_wrench_z", "tilt", "state")  # of a failed trial
# What does not depend on the machine.
MEASURED: Final = tuple(name for name in INSERTION if name != "real_time_factor")


def attempt(
    scenario: ResolvedTrialsScenario, seed: int, trial: int, change: SkillChange = whole
) -> Row:
    """Run one of a seed's trials; it depends on its arguments alone, except for its speed.

    The row has the draws, the metrics of the run, the truth, the reason of a failure (``reason``,
    empty without one), and the place of the largest force; a failed trial also has a table of its
    course.
    """
    one = randomised(scenario, seed, trial)
    skill = change(one.make_skill())
    done = run_skill(skill, one, seed=trial_seed(seed, trial))
    truth, why = verdict(done, one.connector, skill), failure(done, one.connector)
    course = {name: done.traces[name].astype(np.float32) for name in _COURSE if why}
    row = {
        **_draws(one),
        **insertion_metrics(done, one.connector),
        **{name: float(value) for name, value in truth._asdict().items()},
        **failure_columns(why),
        **{f"peak.{name}": value for name, value in peak(done).items()},
    }
    return with_table(row, course)


def _draws(one: ResolvedTrialsScenario) -> dict[str, float | None]:
    """Return the draws of a trial."""
    own, wrist, tight = one.connector, one.wrist, one.connector.tolerance == "worst"
    part = (own.material.friction, own.mating_force, float(tight))
    drawn = (*one.initial_error, *part, wrist.stiffness[-1], wrist.centre, one.obstacle)
    return dict(zip(DRAWN, drawn, strict=True))


def run_success(scenario: ResolvedTrialsScenario, seed: int, progress: Progress) -> Outcome:
    """Grasp and insert the connector many times."""
    attempts = run_each(partial(attempt, scenario, seed), range(scenario.trials), progress)
    metrics, tables = annotated(success_metrics(attempts)), dict[str, Table]()
    if (i := median_failure(attempts.rows)) is not None:
        trial, row = attempts.tasks[i], attempts.rows[i]
        nearest = f"trial {trial}, the failure nearest to the median time"
        note = f"{nearest}: {row['reason.text']}"
        metrics["answer"] = Metric(value=None, unit="", note=note)
        course = table_of(row)
        tables["failure"] = {"trial": np.full(len(course["time"]), trial), **course}
    return Outcome(
        metrics=metrics,
        traces=attempt_rows(attempts),
        simulated_seconds=math.fsum(attempts.column("duration")),
        tables=tables,
    )


def median_failure(rows: Sequence[Row]) -> int | None:
    """Return the failed trial whose time is nearest to their median time, if any fails.

    Trials with a free socket come first, because those with an obstacle are expected to fail.
    """
    failed = [i for i, row in enumerate(rows) if row["reason"]]
    failed = [i for i in failed if rows[i]["obstacle"] is None] or failed
    median = np.median([rows[i]["reason.time"] for i in failed]) if failed else 0.0
    return min(failed, key=lambda i: abs(rows[i]["reason.time"] - median), default=None)


def success_figures(scenario: ResolvedTrialsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    figures = {"success": plot_success(outcome, middle=scenario.initial_error)}
    if course := outcome.tables.get("failure"):
        (row,) = np.flatnonzero(outcome.traces["trial"] == course["trial"][0])
        figures["failure"] = plot_failure(
            course,
            {name: values[row] for name, values in outcome.traces.items()},
            title=outcome.metrics["answer"].note,
            states=make_skill_chart(scenario.make_skill()).state_names,
            mated=scenario.connector.mated_depth,
        )
    return figures


# A search or what a skill lacks, and the number of a trial.
VariantTask = tuple[str, int]
# What the searches are compared by, and the skills of an ablation.
_RATES: Final = ("success_rate", "success_rate.low", "success_rate.high")
_COMPARED: Final = (*_RATES, "duration", "force.peak_mean", "retries")
_SHOWN: Final = (*_RATES, "false_done", "duration", "force.peak_share", "torque.peak")
WITHOUT_SIGHT: Final = "without_sight"


def attempt_each(
    run: Callable[[VariantTask], Row], names: Sequence[str], trials: int, progress: Progress
) -> dict[str, Trials[int]]:
    """Run the same trials of every variant; return them by its name."""
    tasks = [(name, trial) for name in names for trial in range(trials)]
    found = run_each(run, tasks, progress).split(names, lambda task: task[0])
    return {
        name: Trials(tasks=tuple(trial for _, trial in its.tasks), rows=its.rows)
        for name, its in found.items()
    }


def _by_search(scenario: ResolvedPegCampaignScenario, seed: int, task: VariantTask) -> Row:
    search, trial = task
    skill = replace(scenario.skill, search=search)  # type: ignore[arg-type]
    return attempt(replace(scenario, skill=skill), seed, trial)


def run_searches(scenario: ResolvedPegCampaignScenario, seed: int, progress: Progress) -> Outcome:
    """Grasp and insert the peg many times with each search; targets are for the skill's own."""
    own = scenario.skill.search
    searches = list(dict.fromkeys((own, *scenario.compared)))
    attempts = attempt_each(
        partial(_by_search, scenario, seed), searches, scenario.trials, progress
    )
    found = {search: success_metrics(its) for search, its in attempts.items()}
    metrics = annotated(found[own])
    for search, its in found.items():
        metrics |= prefixed(search, {name: its[name] for name in _COMPARED})
    traces = _stacked("search", attempts)
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=math.fsum(traces["duration"]))


def search_figures(scenario: ResolvedPegCampaignScenario, outcome: Outcome) -> dict[str, Figure]:
    """Return the figures by file name."""
    rows = outcome.traces
    own = rows["search"] == scenario.skill.search
    of_own = replace(outcome, traces={name: values[own] for name, values in rows.items()})
    figures = {"success": plot_success(of_own, middle=scenario.initial_error)}
    if not own.all():
        figures["searches"] = plot_searches(rows)
    return figures


def ablated_skills(scenario: ResolvedTrialsScenario) -> tuple[str, ...]:
    """Return the names of the compared skills: the whole one, and those that lack a primitive."""
    own = scenario.make_skill()
    blind = replace(scenario, sight=None).make_skill()
    changed = [name for name, change in CHANGES.items() if name == "whole" or change(own) != own]
    return (*changed, WITHOUT_SIGHT) if own != blind else tuple(changed)


def _by_skill(scenario: ResolvedTrialsScenario, seed: int, task: VariantTask) -> Row:
    name, trial = task
    if name == WITHOUT_SIGHT:
        return attempt(replace(scenario, sight=None), seed, trial)
    return attempt(scenario, seed, trial, CHANGES[name])


def run_ablation(
    scenario: ResolvedTrialsScenario,
    seed: int,
    progress: Progress,
    skills: Sequence[str] | None = None,
) -> Outcome:
    """Insert the connector by skills, by default all, in the same randomised scenarios."""
    names = skills or ablated_skills(scenario)
    attempts = attempt_each(partial(_by_skill, scenario, seed), names, scenario.trials, progress)
    metrics: dict[str, Metric] = {}
    for name, its in attempts.items():
        found = success_metrics(its)
        metrics |= prefixed(name, {key: found[key] for key in _SHOWN})
    kept = ("trial", "success", "false_done", "duration", "force.peak_share", "obstacle", "reason")
    rows = _stacked("skill", attempts)
    traces = {name: rows[name] for name in ("skill", *kept)}
    return Outcome(
        metrics=metrics, traces=traces, simulated_seconds=float(traces["duration"].sum())
    )


def ablation_figures(scenario: ResolvedTrialsScenario, outcome: Outcome) -> dict[str, Figure]:
    """Return the figures by file name."""
    skills = dict.fromkeys(outcome.traces["skill"].tolist())
    return {"ablation": plot_ablation(outcome, tuple(skills))}


def _stacked(variant: str, attempts: Mapping[str, Trials[int]]) -> Table:
    """Return the rows of all variants, with the name of each in a column."""
    names = np.repeat(np.array(list(attempts)), [len(its) for its in attempts.values()])
    tables = [attempt_rows(its) for its in attempts.values()]
    each = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {variant: names, **each}


def annotated(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return metrics with a note on the machine that the speed was measured on."""
    speed = metrics["real_time_factor"]
    note = f"one core each, of this machine; {speed.note}"
    return {**metrics, "real_time_factor": replace(speed, note=note)}


def success_metrics(attempts: Trials[int]) -> dict[str, Metric]:
    """Return the success rate with its exact 95 % interval, and the mean effort of a success.

    Successes count in the trials with a free socket. All trials compare the skill's report with
    the truth.
    """
    n = len(attempts)
    free = np.isnan(attempts.column("obstacle"))
    reasons = [row["reason"] for row in attempts.rows]
    bad = Counter(why for why, way in zip(reasons, free, strict=True) if why and way)
    count = int(free.sum())
    good = count - bad.total()
    note = f"{good} of {count}" + (f", {n - count} more with an obstacle" if count < n else "")
    if bad:
        listed = ", ".join(f"{reason} ({times})" for reason, times in sorted(bad.items()))
        note += f"; failed: {listed}"
    metrics = _rate("success_rate", good, count, note)
    failed = sum(map(bool, reasons))
    for name, of, what in (
        ("false_done", n, "runs"),
        ("false_hindered", int(attempts.column("hindered").sum()), "detected obstructions"),
        ("false_reason", failed, "runs that failed"),
    ):
        wrong = int(attempts.column(name).sum())
        metrics |= _rate(name, wrong, of, f"{wrong} of {of} {what}")
    for name in ("force.peak", "force.peak_share", "force.share", "torque.peak", "torque.share"):
        metrics[name] = _pooled(attempts, name, "largest")
    for name in ("force.peak", "force.peak_share"):
        metrics[f"{name}_mean"] = _pooled(attempts, name, "mean")
    shares = attempts.column("force.peak_share")[free]
    metrics["force.free_share"] = Metric(
        value=float(shares.max()) if count else None,
        unit=INSERTION["force.peak_share"].unit,
        note=f"force.peak_share of the {count} trials with a free socket, the largest",
    )
    for name in ("duration", "retries", "real_time_factor"):
        metrics[name] = _pooled(attempts, name, "mean")
    return metrics


def _rate(name: str, good: int, count: int, note: str) -> dict[str, Metric]:
    """Return a share as ``trial_metrics.rate`` does; none of none."""
    if count:
        return rate(name, good, count, note)
    ends = (name, f"{name}.low", f"{name}.high")
    return {end: Metric(value=None, unit="%", note=note) for end in ends}


def _pooled(attempts: Trials[int], name: str, pooled: Literal["largest", "mean"]) -> Metric:
    values = attempts.column(name).tolist()
    note = f"{pooled} of {len(values)} trials, {min(values):.4g} to {max(values):.4g}"
    value = max(values) if pooled == "largest" else math.fsum(values) / len(values)
    return Metric(value=value, unit=INSERTION[name].unit, note=note, trials=tuple(values))


def attempt_rows(attempts: Trials[int]) -> Table:
    """Return a row for each trial: draws, metrics, truth, and the reason of a failure.

    ``reason`` is "<state>: <outcome>"; its depth, m, force, N, and tilt, rad, are true, its time
    in s. ``peak`` is the place of the largest true force along the insertion, likewise.
    """
    names = (*DRAWN, *MEASURED, *InsertionVerdict._fields, *_WHY, *_PEAK)
    return {
        "trial": column(attempts.tasks),
        **{name: attempts.column(name) for name in names},
        **{
            name: np.array([row[name] for row in attempts.rows], dtype=np.str_)
            for name in ("reason", "reason.text", "peak.state")
        },
    }


AIM: Final = 1.5  # of the mating force
_GOOD: Final[Style] = {"marker": "o", "s": 36, "edgecolor": "white", "linewidth": 0.6}
_FAILED: Final[Style] = {"marker": "x", "s": 60, "color": "#b00020", "linewidth": 2.0}
_LISTED: Final = 6  # reasons in the figure
_BELOW: Final[Style] = {"loc": "upper left", "bbox_to_anchor": (0.0, -0.16), "ncols": 2}
_STYLES: Final[tuple[Style, ...]] = (  # of searches
    {"color": "#8d6e00", "linestyle": "-", "linewidth": 1.8},
    {"color": "#0097a7", "linestyle": "--", "linewidth": 1.8},
    {"color": "#2e7d32", "linestyle": ":", "linewidth": 1.8},
)
_TRIAL: Final[Style] = {"s": 26, "edgecolor": "white", "linewidth": 0.6}


def plot_success(outcome: Outcome, *, middle: Sequence[float]) -> Figure:
    """Draw the trials over their initial errors, rad above m, and peak forces and durations."""
    rows = outcome.traces
    caption = (
        "Initial errors of the plug, with a cross for each failed run, and the largest force "
        "and the duration of each run."
    )
    figure = new_figure(8.0, 7.6, caption=caption)
    (lateral, angular), (force, duration) = figure.subplots(2, 2)
    free = np.isnan(rows["obstacle"])
    good, failed = free & (rows["success"] > 0), free & ~(rows["success"] > 0)
    others = "" if free.all() else f"; {(~free).sum()} more with an obstacle"
    figure.suptitle(
        f"{good.sum()} of {free.sum()} insertions succeed{_interval(outcome)}{others}",
        fontsize=10,
        fontweight="bold",
    )
    _errors(
        lateral,
        [1e3 * rows[f"initial_{axis}"] for axis in "xy"],
        good,
        failed,
        shade=rows["retries"],
        shaded="retries",
    )
    dress(lateral, title=f"(a) Lateral errors: {_failures(failed)}", x="x / mm", y="y / mm")
    degrees = [np.rad2deg(rows[f"initial_r{axis}"] - middle[i]) for i, axis in enumerate("xyz")]
    about = f" beyond {math.degrees(middle[2]):.0f}°" if middle[2] else ""
    _errors(angular, degrees[:2], good, failed, shade=degrees[2], shaded=f"about z{about} / deg")
    dress(angular, title="(b) Angular errors", x="about x / deg", y="about y / deg")
    reasons = Counter(sorted(reason for reason in rows["reason"][free].tolist() if reason))
    for text, count in reasons.most_common(_LISTED):
        lateral.scatter([], [], label=f"{text} ({count})", **_FAILED)
    if failed.any():
        figure.legend(loc="outside lower left", ncols=2, fontsize=8, frameon=False)
    draw_distribution(force, rows["force.peak_share"], least=AIM)
    force.axvline(1.0, label="mating force", **LIMIT)
    force.axvline(AIM, label=f"target, {AIM:g} times that", **PUBLISHED)
    above = 100 * float(np.mean(rows["force.peak_share"] > AIM))
    title = f"(c) {above:.3g} % of the runs exceed the target"
    dress(force, title=title, x="largest push / mating force", y="runs")
    legend(force, **_BELOW)
    draw_distribution(duration, rows["duration"])
    title = f"(d) Half of the runs take {np.nanmedian(rows['duration']):.3g} s or less"
    dress(duration, title=title, x="time / s", y="runs")
    return figure


def _failures(failed: NDArray[np.bool_]) -> str:
    count = int(failed.sum())
    return f"{count} failure{'' if count == 1 else 's'}" if count else "none fails"


def _interval(outcome: Outcome) -> str:
    """Return the rate of success with its interval; nothing if there is none."""
    ends = [metric_value(outcome.metrics, name) for name in _RATES]
    known = not np.isnan(ends).any()
    return ": {:.0f} %, 95 % interval {:.1f} to {:.1f} %".format(*ends) if known else ""


def _errors(
    axes: Axes,
    errors: Sequence[NDArray[np.float64]],
    good: NDArray[np.bool_],
    failed: NDArray[np.bool_],
    *,
    shade: NDArray[np.float64],
    shaded: str,
) -> None:
    x, y = errors
    dots = axes.scatter(x[good], y[good], c=shade[good], cmap="viridis", **_GOOD)
    axes.scatter(x[failed], y[failed], zorder=3, **_FAILED)
    axes.set_aspect("equal", adjustable="datalim")
    if good.any():
        colour_bar(axes, dots, shaded, ticks=MaxNLocator(integer=True))


def plot_searches(rows: Table) -> Figure:
    """Draw the share of the trials that is done over time, and times against the first search's.

    Trials with an obstacle are left out.
    """
    free = np.isnan(rows["obstacle"])
    caption = (
        "Share of the insertions done over time with each search, and times of the same trials "
        "with two searches. Trials with an obstacle are left out."
    )
    figure = new_figure(8.0, 4.2, caption=caption)
    share, pairs = figure.subplots(1, 2)
    times = {}
    for search, style in zip(dict.fromkeys(rows["search"].tolist()), _STYLES, strict=False):
        its = free & (rows["search"] == search)
        done = np.where(rows["success"][its] > 0, rows["duration"][its], np.inf)
        times[search] = dict(zip(rows["trial"][its].tolist(), done.tolist(), strict=True))
        draw_cumulative(share, done, style, search)
    share.set_ylim(0.0, 102.0)
    share.set_xlim(0.0, None)
    dress(
        share,
        title=f"(a) {_fastest(times)}",
        x="time / s",
        y="trials that are done / %",
    )
    (first, its), *rest = times.items()
    ends = [math.inf, 0.0]
    for (search, others), style in zip(rest, _STYLES[1:], strict=False):
        both = np.array([(its[trial], others[trial]) for trial in its if trial in others])
        both = both[np.isfinite(both).all(axis=1)]
        if len(both):
            pairs.scatter(*both.T, label=search, color=style["color"], **_TRIAL)
            ends = [min(ends[0], both.min()), max(ends[1], both.max())]
    if ends[1]:
        line = [0.95 * ends[0], 1.05 * ends[1]]
        pairs.plot(line, line, label="the same time", **LIMIT)
    pairs.set_aspect("equal", adjustable="datalim")
    dress(
        pairs,
        title="(b) The same trials",
        x=f"time with {first} / s",
        y="time with another search / s",
    )
    for axes in (share, pairs):
        if axes.get_legend_handles_labels()[0]:
            legend(axes, **_BELOW)
    return figure


def _fastest(times: Mapping[str, Mapping[int, float]]) -> str:
    """Return which search has half of its trials done first."""
    medians = {search: float(np.median(list(of.values()))) for search, of in times.items()}
    best = min(medians, key=lambda search: medians[search])
    if math.isinf(medians[best]):
        return "No search completes half of the trials"
    return f"Fastest: {best}, half are done after {medians[best]:.3g} s"


def plot_ablation(outcome: Outcome, skills: Sequence[str]) -> Figure:
    """Draw the rate of success, the duration and the peak force of every skill."""
    caption = (
        "Rate of success with its 95 % interval, duration and largest push of each variant of the "
        "skill. Each dash is a run, each dot the mean."
    )
    figure = new_figure(8.0, 1.6 + 0.45 * len(skills), caption=caption)
    rate, duration, force = figure.subplots(1, 3, sharey=True)
    middle, low, high = (
        [metric_value(outcome.metrics, f"{name}.success_rate{end}") for name in skills]
        for end in ("", ".low", ".high")
    )
    draw_intervals(rate, np.arange(len(skills)), middle, low, high, {"color": FORCE["color"]})
    for place, name in enumerate(skills):
        own = outcome.traces["skill"] == name
        for axes, measured in ((duration, "duration"), (force, "force.peak_share")):
            values = outcome.traces[measured][own]
            axes.plot(values, np.full(len(values), place), "|", color=FORCE["color"])
            axes.plot([values.mean()], [place], "o", color=FORCE["color"])
    name_rows(rate, [name.replace("_", " ") for name in skills])
    rate.set_xlim(-3, 103)
    force.axvline(1.0, **LIMIT)
    for axes in (duration, force):
        axes.set_xlim(left=0.0)
    least = int(np.argmin(middle))
    worst = skills[least].replace("_", " ")
    said = f"The fewest runs succeed with the skill {worst}: {middle[least]:.3g} %"
    figure.suptitle(said, fontsize=10, fontweight="bold")
    dress(rate, title="(a) Success", x="runs with a free path / %", y="")
    dress(duration, title="(b) Duration", x="time / s", y="")
    dress(force, title="(c) Largest push", x="push / mating force", y="")
    return figure
