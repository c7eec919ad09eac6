"""Shares of randomised charging cycles that keep each limit, without and with remedies.

Cycles are drawn once and run with each remedy, so that remedies are compared on the same ones.
Shares for conclusions want ``trials=50``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import rate, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.charging.charging_runs import LIMITS, limits_in, run_charging
from chamfer.analysis.charging.crucible_charging import measure, worst
from chamfer.analysis.drawing.figure_kit import draw_intervals, metric_value, name_rows
from chamfer.analysis.drawing.figure_style import LIMIT, dress, legend_below, new_figure
from chamfer.analysis.published.hybrid_force_position_charging import CHARGING
from chamfer.analysis.report.checks import Published
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.charging.charging_scenario import (
    BelievedMasses,
    CrucibleChargingScenario,
    resolve_charging,
)
from chamfer.diagrams.charging.wrist_control import BaseCompensationParams
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.charging.packing import PlanItem
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError, require_between, require_not_negative, within

_MOST_TRIALS: Final = 1000
_CYCLE: Final = CrucibleChargingScenario(
    plan=(
        PlanItem(kind="wall", mass=0.085, azimuth=0.3),
        PlanItem(kind="crown", mass=0.140, azimuth=0.3),
        PlanItem(kind="bulk", mass=0.4),
    ),
    sensing="realistic",
    step=2e-4,  # half the work of 0.1 ms; forces on the wall were within 0.13 N of those
)


@dataclass(frozen=True, kw_only=True)
class SpreadParams:
    """Spread of the random scenarios: sizes of the nuggets, and errors of the beliefs.

    Half-widths, all uniform.
    """

    joint_friction: float = 0.5  # of each joint's dry friction, relative; assumed
    surface_friction: float = 0.15  # of the coefficients of wall and layer; assumed
    slip_friction: float = 0.3  # of the friction below the lower nugget; assumed
    bias: float = 1.0  # N, of the force sensor, like a data sheet's; assumed
    normal: float = 0.01  # rad, of the wall's lean and of the layer's tilt; assumed
    believed_mass: float = 0.25  # of the believed masses of links and items, relative
    size: float = 0.05  # of the scanned size of a nugget, relative; assumed
    place: float = 0.002  # m, of the crucible's axis along x and y; assumed
    lying_tilt: float = 0.4  # rad, of each nugget that lies in the crucible already; assumed
    aside: float = 0.3  # of its reach, offset of such a nugget along the wall; assumed
    masses: tuple[float, ...] = (0.014, 0.028, 0.085, 0.140, 0.185)
    # kg, of which all nuggets of a cycle have one; appendix C; empty: as planned

    def __post_init__(self) -> None:
        relative = "joint_friction", "surface_friction", "slip_friction", "size"
        require_between(self, 0.0, 1.0, *relative)
        require_between(self, 0.0, 0.5, "believed_mass")
        require_not_negative(self, "bias", "normal", "place", "lying_tilt", "aside")
        if not all(0 < one < math.inf for one in self.masses):
            raise ParameterError("masses", self.masses, "finite numbers > 0")


@dataclass(frozen=True, kw_only=True)
class RemedyMeans:
    """Equipment of the remedies."""

    compensation: BaseCompensationParams = BaseCompensationParams()
    soft_gripper: GripperCompliance = GripperCompliance(stiffness=300.0, damping=5.0)


@dataclass(frozen=True, kw_only=True)
class ChargingCampaignScenario:
    """Randomised cycles, each with every remedy."""

    cycle: CrucibleChargingScenario = field(default_factory=lambda: _CYCLE)
    spread: SpreadParams = SpreadParams()
    means: RemedyMeans = RemedyMeans()
    remedies: tuple[str, ...] = ("none", "compensation")
    # of none, decoupling, compensation, soft_gripper and all
    trials: int = 1  # randomised cycles, each of which is run with each remedy

    def __post_init__(self) -> None:
        if not self.remedies or not set(self.remedies) <= set(REMEDIES):
            raise ParameterError("remedies", self.remedies, f"some of {', '.join(REMEDIES)}")
        if len(set(self.remedies)) < len(self.remedies):
            raise ParameterError("remedies", self.remedies, "each once")
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")


REMEDIES: Final = ("none", "decoupling", "compensation", "soft_gripper", "all", "no_observer")
CHARGING_CAMPAIGN: Final = ChargingCampaignScenario()
# What of a randomised cycle is told in its row.
DRAWN: Final = (
    *("mass", "bias", "lean", "tilt", "wall_friction", "slip_friction", "quill_friction"),
    "size_error",
)
SLIDES: Final = ("wall.slide_force_min", "wall.slide_force")  # N, drawn over the friction
NORMALS: Final = ("wall.normal_error", "crown.normal_error")  # rad


def with_remedy(
    cycle: CrucibleChargingScenario, remedy: str, means: RemedyMeans
) -> CrucibleChargingScenario:
    """Return a cycle with the changes of a remedy, one of :data:`REMEDIES`."""
    if remedy in ("decoupling", "all"):
        cycle = replace(cycle, sensor=replace(cycle.sensor, decoupling=True))
    if remedy in ("compensation", "all"):
        cycle = replace(cycle, friction_compensation=means.compensation)
    if remedy == "no_observer":
        cycle = replace(cycle, observer=None)
    if remedy in ("soft_gripper", "all"):
        cycle = replace(cycle, gripper=means.soft_gripper)
    return cycle


def limits_of(cycle: CrucibleChargingScenario) -> tuple[Published, ...]:
    """Return the specified limits of the modes that a cycle's plan has."""
    return tuple(one for one in CHARGING if one.metric in limits_in(cycle.plan))


class RemedyTrial(NamedTuple):
    """A randomised cycle with a remedy."""

    remedy: str
    trial: int


def drawn(
    cycle: CrucibleChargingScenario, spread: SpreadParams, seed: int
) -> CrucibleChargingScenario:
    """Return a cycle whose true values differ from its beliefs, which stay."""
    rng = np.random.default_rng(seed)

    def off(half_width: float) -> float:
        return float(rng.uniform(-half_width, half_width))

    friction = cycle.arm.joint_friction
    dry = tuple(one * (1 + off(spread.joint_friction)) for one in friction.coulomb)
    wall, layer, station = cycle.wall, cycle.layer, cycle.station
    rubs = off(spread.surface_friction)
    mass = float(rng.choice(spread.masses)) if spread.masses else None
    links = tuple(1 + off(spread.believed_mass) for _ in dry)
    x, y = station.true.crucible_centre

    def weighed(item: PlanItem) -> PlanItem:
        return item if mass is None or item.kind == "bulk" else replace(item, mass=mass)

    def lying(item: PlanItem) -> PlanItem:
        item = weighed(item)
        way = item.true_nugget.reach / station.true.crucible_radius
        return replace(
            item,
            azimuth=item.azimuth + way * off(spread.aside),
            tilt=off(spread.lying_tilt),
            tilt_azimuth=off(math.pi),
        )

    return replace(
        cycle,
        believed_masses=BelievedMasses(links=links, items=1 + off(spread.believed_mass)),
        arm=replace(cycle.arm, joint_friction=replace(friction, coulomb=dry)),
        wall=replace(wall, friction=_rougher(wall.friction, rubs), lean=off(spread.normal)),
        layer=replace(
            layer,
            friction=_rougher(layer.friction, rubs),
            tilt=off(spread.normal),
            slip_friction=max(0.0, layer.slip_friction + off(spread.slip_friction)),
            mass=mass or layer.mass,
        ),
        sensor=replace(cycle.sensor, bias=off(spread.bias)),
        station=replace(
            station,
            true=replace(
                station.true, crucible_centre=(x + off(spread.place), y + off(spread.place))
            ),
        ),
        plan=tuple(
            replace(weighed(item), scanned_size=item.size * (1 + off(spread.size)))
            for item in cycle.plan
        ),
        laid=tuple(map(lying, cycle.laid)),
    )


def _rougher(friction: SurfaceFriction, by: float) -> SurfaceFriction:
    return replace(friction, coefficient=max(0.0, friction.coefficient + by))


def run_campaign(scenario: ChargingCampaignScenario, seed: int, progress: Progress) -> Outcome:
    """Run every randomised cycle with every remedy."""
    # In the order of the draws, and none told how many there are: more go on where few ended.
    tasks = [
        RemedyTrial(remedy, trial)
        for trial in range(scenario.trials)
        for remedy in scenario.remedies
    ]
    function = partial(_run_task, scenario.cycle, scenario.spread, scenario.means, seed)
    finished = run_each(function, tasks, progress)
    traces = {
        "remedy": column([scenario.remedies.index(task.remedy) for task in finished.tasks]),
        "trial": column([task.trial for task in finished.tasks]),
        **{
            name: finished.column(name)
            for name in ("finished", "time", *DRAWN, *_told(scenario.cycle))
        },
    }
    return Outcome(
        metrics=_metrics(scenario, finished),
        traces=traces,
        simulated_seconds=float(traces["time"].sum()),
    )


def _told(cycle: CrucibleChargingScenario) -> tuple[str, ...]:
    """Return those of a cycle's measurements that its row has."""
    limits = [one.metric for one in limits_of(cycle)]
    return (*limits, *(one for one in (*SLIDES, *NORMALS) if one not in limits))


def _run_task(
    planned: CrucibleChargingScenario,
    spread: SpreadParams,
    means: RemedyMeans,
    seed: int,
    task: RemedyTrial,
) -> Row:
    cycle = drawn(planned, spread, trial_seed(seed, task.trial))
    cycle = resolve_charging(with_remedy(cycle, task.remedy, means))
    run = run_charging(cycle, trial_seed(seed, task.trial))
    found = worst(cycle.plan, measure(cycle, run))
    scanned = [one.scanned_size or one.size for one in cycle.plan]
    return {
        "finished": float("done" in run.transitions["target"]),
        "reason": run.reason,
        "time": float(run.traces["time"][-1]),
        "mass": cycle.plan[0].mass,
        "bias": cycle.sensor.bias,
        "lean": cycle.wall.lean,
        "tilt": cycle.layer.tilt,
        "wall_friction": cycle.wall.friction.coefficient,
        "slip_friction": cycle.layer.slip_friction,
        "quill_friction": cycle.arm.joint_friction.coulomb[2],
        "size_error": max(
            abs(size / one.size - 1) for size, one in zip(scanned, cycle.plan, strict=True)
        ),
        **{name: found[name].value if name in found else None for name in _told(cycle)},
    }


def _metrics(
    scenario: ChargingCampaignScenario, finished: Trials[RemedyTrial]
) -> dict[str, Metric]:
    """Return the share of cycles within each limit.

    A mode that is not reached is not within its limits, and neither is a run that failed.
    """
    metrics: dict[str, Metric] = {}
    limits, count = limits_of(scenario.cycle), scenario.trials
    for remedy in scenario.remedies:
        rows = [
            row
            for task, row in zip(finished.tasks, finished.rows, strict=True)
            if task.remedy == remedy
        ]
        done = sum(row["finished"] > 0 for row in rows)
        said = f"{done} of {count}"
        if len(rows) < count:
            said += f"; {count - len(rows)} failed in the simulation"
        stopped = sorted({row["reason"] for row in rows if row["reason"]})
        if stopped:
            said += f"; stopped: {', '.join(stopped)}"
        metrics |= rate(f"{remedy}.cycle.finished", done, count, said)
        kept = [all(one.holds(row[one.metric]) for one in limits) for row in rows]
        metrics |= rate(f"{remedy}.cycle.all_limits", sum(kept), count, "of section 1.1.2")
        for one in limits:
            good = sum(one.holds(row[one.metric]) for row in rows)
            known = [row[one.metric] for row in rows if row[one.metric] is not None]
            note = f"{good} of {count}"
            if known:
                note += f"; {min(known):.3g} to {max(known):.3g} {LIMITS[one.metric][0]}"
            metrics |= rate(f"{remedy}.{one.metric}", good, count, note)
        for name in (one for one in NORMALS if one in limits_in(scenario.cycle.plan)):
            errors = [row[name] for row in rows if row[name] is not None]
            middle = float(np.median(errors)) if errors else None
            note = f"median; {min(errors):.3g} to {max(errors):.3g} rad" if errors else "none"
            metrics[f"{remedy}.{name}"] = Metric(value=middle, unit="rad", note=note)
    return metrics


def resolve_campaign(scenario: ChargingCampaignScenario) -> ChargingCampaignScenario:
    """Return the scenario with its open fields filled in, and checked."""
    with within("cycle"):
        for remedy in scenario.remedies:
            resolve_charging(with_remedy(scenario.cycle, remedy, scenario.means))
    return scenario


_LABELS: Final = {
    "none": ("no remedy", "#555555"),
    "decoupling": ("sensor decoupled", "#1b4f9c"),
    "compensation": ("friction compensated by a base sensor", "#2e8b57"),
    "soft_gripper": ("softer gripper", "#e07b00"),
    "all": ("all three", "#7a0060"),
    "no_observer": ("without the observer", "#b00020"),
}
_SHARES: Final = ("cycle.finished", "cycle.all_limits")
_MOST: Final = 2.0  # N, while sliding; section 1.1.2
_APART: Final = 0.2  # N of the quill's friction, between remedies of the same cycle


def figures(scenario: ChargingCampaignScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the share of cycles within each limit, and the force on the wall, by remedy.

    The force only where cycles come to slide.
    """
    names = (*_SHARES, *(one.metric for one in limits_of(scenario.cycle)))
    slides = bool(np.isfinite(outcome.traces["wall.slide_force"]).any())
    done = {
        _LABELS[one][0]: metric_value(outcome.metrics, f"{one}.{_SHARES[-1]}")
        for one in scenario.remedies
    }
    known = ", ".join(f"{share:.3g} % ({name})" for name, share in done.items() if share >= 0)
    heights = [0.34 * len(names) + 1.4, *([3.2] if slides else [])]
    figure = new_figure(
        height=sum(heights),
        caption=f"Cycles that keep all limits: {known or 'unknown'}. Share of the "
        "randomised cycles within each limit, with 95 % intervals.",
    )
    columns = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    _shares(columns[0], scenario.remedies, names, scenario.trials, outcome)
    if slides:
        _slides(columns[1], scenario.remedies, outcome)
    legend_below(figure, columns[0])
    return {"charging-campaign": figure}


def _shares(
    axes: Axes, remedies: Sequence[str], names: Sequence[str], trials: int, outcome: Outcome
) -> None:
    rows = np.arange(len(names))
    offsets = np.linspace(-0.3, 0.3, len(remedies)) if len(remedies) > 1 else [0.0]
    for remedy, offset in zip(remedies, offsets, strict=True):
        label, color = _LABELS[remedy]
        share, low, high = (
            [metric_value(outcome.metrics, f"{remedy}.{name}{end}") for name in names]
            for end in ("", ".low", ".high")
        )
        look = {"color": color, "markersize": 4}
        draw_intervals(axes, rows + offset, share, low, high, look, label)
    title = f"Share of {trials} randomised cycle{'s' * (trials != 1)} within each limit"
    dress(axes, title=title, x="share / %", y="")
    name_rows(axes, names)
    axes.set_xlim(-2, 102)
    axes.axhline(len(_SHARES) - 0.5, color="#bbbbbb", linewidth=0.8)


def _slides(axes: Axes, remedies: Sequence[str], outcome: Outcome) -> None:
    """Draw the range of each cycle's force on the wall over the quill's drawn dry friction."""
    traces = outcome.traces
    lost = traces["wall.losses"] > 0
    axes.axhline(_MOST, **LIMIT)
    offsets = _APART * (np.arange(len(remedies)) - (len(remedies) - 1) / 2)
    for index, offset in enumerate(offsets):
        _, color = _LABELS[remedies[index]]
        mine = (traces["remedy"] == index) & np.isfinite(traces["wall.slide_force"])
        friction = traces["quill_friction"] + offset
        least, most = traces["wall.slide_force_min"], traces["wall.slide_force"]
        axes.vlines(friction[mine], least[mine], most[mine], color=color, linewidth=1.8)
        axes.plot(friction[mine], most[mine], "_", color=color, markersize=6)
        axes.plot(friction[mine], least[mine], "_", color=color, markersize=6)
        gone = friction[mine & lost]
        axes.plot(gone, np.zeros(len(gone)), "x", color=color, markersize=7)
    dress(
        axes,
        title="Range of the force on the wall while sliding (limit: 2 N; x: contact lost)",
        x="dry friction of the quill / N",
        y="force / N",
    )
    axes.set_ylim(bottom=-0.1)
