"""Feeds without cameras from a grid of errors, compared with the planar theory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from functools import partial
from itertools import product
from typing import Final, NamedTuple, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of, rate
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import ArmT, require_shares, wrong_arm
from chamfer.analysis.drawing.figure_kit import draw_counts
from chamfer.analysis.drawing.figure_style import Style, dress, legend, new_figure
from chamfer.analysis.insertion.insertion_runs import median, onset_of
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column, part_of
from chamfer.diagrams.cell.work_cell import axial_stiffness
from chamfer.diagrams.insertion.blind_feed import (
    BlindFeedScenario,
    FedCellScenario,
    Plane,
    make_blind_feed_diagram,
    resolve_fed_cell,
)
from chamfer.models.peg_theory.fed_insertion import (
    FeedPrediction,
    FeedVerdict,
    limits,
    predict_feed,
)
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, ContactState
from chamfer.systems.pose import pose_from_vector

Array = NDArray[np.float64]

_MOVED: Final = 2e-4  # m, by which a peg that is held comes out at most as the push goes
_FREE: Final = 0.05  # N, of the hole along the axis: the push is gone
_IN_BORE: Final = (ContactState.ONE_POINT, ContactState.TWO_POINT)
_TOUCHING: Final = 0.01  # N
_CHAMFER, _FACE, _BOTTOM = (FEATURES.index(name) for name in ("chamfer", "face", "bottom"))


class FeedOutcome(IntEnum):
    """The outcome of a peg that was fed."""

    SEATED = 0  # as deep as it has to be, or on the bottom
    WEDGED = 1  # in the bore, held when the push is taken away
    JAMMED = 2  # in the bore, held by the push alone
    ON_EDGE = 3  # stuck on the chamfers or on the bore's edge
    MISSED = 4  # beside the mouth


class PlaneErrors(NamedTuple):
    """How the peg is off in a plane of insertion."""

    lateral: float  # m, of the tip, to +y or +z of the mouth's frame
    tilt: float  # rad, of the same sign if they add


class BlindFeed(NamedTuple):
    """A finished run; one row per step."""

    time: Array  # s, shape (n,)
    depth: Array  # m, of the tip below the mouth
    state: Array  # of ContactState
    wrench: Array  # N m above N, of the hole on the peg, shape (n, 6)
    normal: Array  # N, by feature, shape (n, 5)
    touch: dict[Plane, PlaneErrors] | None  # as the parts touch first; None: they never do


def feed_blind(scenario: BlindFeedScenario) -> BlindFeed:
    """Feed the peg to its largest depth, or remove the push.

    It is fed to the end, as its tip may slip off the face; then, beside the mouth, it is left.
    """
    diagram = make_blind_feed_diagram(scenario)
    depth, state, normal = (
        diagram.GetOutputPort(f"contact.{name}") for name in ("depth", "state", "normal_forces")
    )

    def ended(root: Context) -> bool:
        context = diagram.GetMyContextFromRoot(root)
        pressed = normal.Eval(context)[_BOTTOM] > _TOUCHING
        if depth.Eval(context)[0] >= scenario.depth or pressed:
            return True
        beside = state.Eval(context)[0] in (ContactState.NONE, ContactState.FACE)
        return bool(beside and context.get_time() > scenario.released)

    run = simulate(diagram, duration=scenario.duration, step=scenario.step, ended=ended)
    found = run.outputs
    touch = None
    if (touching := np.flatnonzero(found["contact.state"] != ContactState.NONE)).size:
        touch = errors_in(*(found[f"{arm}.true_pose"][touching[0]] for arm in ("peg", "hole")))
    return BlindFeed(
        time=run.time,
        depth=found["contact.depth"],
        state=found["contact.state"],
        wrench=found["contact.wrench"],
        normal=found["contact.normal_forces"],
        touch=touch,
    )


def errors_in(peg: Array, hole: Array) -> dict[Plane, PlaneErrors]:
    """Return the errors of a tip's pose and a mouth's, shape (7,) each, in both planes."""
    X_MT = pose_from_vector(hole).inverse() @ pose_from_vector(peg)
    axis, tip = X_MT.rotation().matrix()[:, 0], X_MT.translation()
    planes: tuple[Plane, ...] = ("xy", "xz")
    return {
        plane: PlaneErrors(float(tip[k]), -math.atan2(axis[k], axis[0]))
        for k, plane in enumerate(planes, start=1)
    }


def outcome(scenario: BlindFeedScenario, run: BlindFeed) -> FeedOutcome:
    """Return the outcome of the peg."""
    fed = run.time <= scenario.released + scenario.step / 2
    if (run.state[fed] == ContactState.SEATED).any():
        return FeedOutcome.SEATED
    end = int(np.flatnonzero(fed)[-1])  # of the feed, or of the run
    if run.state[end] in _IN_BORE:
        return FeedOutcome.WEDGED if _held(run, end) else FeedOutcome.JAMMED
    on_edge = run.normal[end, _CHAMFER] > run.normal[end, _FACE]
    return FeedOutcome.ON_EDGE if on_edge else FeedOutcome.MISSED


def _held(run: BlindFeed, end: int) -> bool:
    """Whether a peg stays where it is until the push is gone."""
    axial = -run.wrench[end:, 3]
    free = np.flatnonzero(axial <= _FREE)
    return bool(free.size and run.depth[end] - run.depth[end + free[0]] < _MOVED)


def measured(scenario: BlindFeedScenario, run: BlindFeed) -> dict[str, float | None]:
    """Return the results of a run, m, N and rad; None where undefined.

    Forces are the largest medians of 10 ms until the peg is seated; pressing on the bottom is none
    of them.
    """
    fed = run.time <= scenario.released + scenario.step / 2
    fed &= np.logical_and.accumulate(run.normal[:, _BOTTOM] <= _TOUCHING)
    axial = median(-run.wrench[:, 3], scenario.step)[fed]
    across = np.hypot(*(median(one, scenario.step) for one in run.wrench[:, 4:].T))[fed]
    two = run.state[fed] == ContactState.TWO_POINT
    touch = None if run.touch is None else run.touch[scenario.plane]
    return {
        "outcome": float(outcome(scenario, run)),
        "depth": float(run.depth[fed].max()),
        "force.axial": float(axial.max()),
        "force.lateral": float(across.max()),
        "force.raw_peak": float(-run.wrench[fed, 3].min()),
        "two_point.onset": onset_of(scenario.parts, run.depth[fed], two),
        "touch.lateral_error": None if touch is None else touch.lateral,
        "touch.rotational_error": None if touch is None else touch.tilt,
        "simulated_seconds": float(run.time[-1]),
    }


_MOST: Final = 101  # points along an axis
_RASTER: Final = 161  # points along an axis of the drawn region
_BEYOND: Final = 1.1  # of the errors, drawn


@dataclass(frozen=True, kw_only=True)
class ModelErrors:
    """The unknown errors of an arm's model, drawn for each trial and arm."""

    payload: float = 0.0865  # kg, from 0 to this; the cell's own error is the largest
    link_mass: float = 0.02  # relative, within plus and minus this; assumed
    joint_friction: float = 0.5  # relative, of the cell's, likewise; assumed

    def __post_init__(self) -> None:
        require_not_negative(self, "payload")
        require_shares(self, "link_mass", "joint_friction")

    def drawn(self, arm: ArmT, generator: np.random.Generator) -> ArmT:
        """Return an arm with errors of its model."""
        payload_error = arm.payload_error + self.payload * float(generator.uniform(0.0, 1.0))
        mass, friction = generator.uniform(-1.0, 1.0, 2).tolist()
        return wrong_arm(arm, payload_error, self.link_mass * mass, self.joint_friction * friction)


@dataclass(frozen=True, kw_only=True)
class DrawnCells:
    """A coarser map, each of whose cells is tried with several arms."""

    plane: Plane = "xy"
    points: int = 3  # along each axis; 9 for the probability's map
    draws: int = 3  # of each cell; 20 for the probability's map
    errors: ModelErrors = field(default_factory=ModelErrors)

    def __post_init__(self) -> None:
        require_one_of(self, "plane", get_args(Plane))
        _require_count(self, "points", _MOST)
        _require_count(self, "draws", 10_000)


@dataclass(frozen=True, kw_only=True)
class InsertionMapScenario:
    """The fed cell, and from which errors it starts: a square grid in each plane."""

    cell: FedCellScenario = field(default_factory=FedCellScenario)
    planes: tuple[Plane, ...] = ("xy", "xz")  # in which errors and axis are
    largest_lateral: float = 0.005  # m, of the tip, to both sides
    largest_tilt: float = 0.1  # rad, of the peg, to both sides
    points: int = 7  # along each axis; 21 for the full map
    drawn: DrawnCells | None = field(default_factory=DrawnCells)  # null: none

    def __post_init__(self) -> None:
        require_positive(self, "largest_lateral")
        if not 0 < self.largest_tilt < math.pi / 4:
            raise ParameterError("largest_tilt", self.largest_tilt, "between 0 and pi/4")
        _require_count(self, "points", _MOST)
        self.starts("xy", 2)  # of the largest errors, which check themselves
        if not self.planes or len(set(self.planes)) != len(self.planes):
            raise ParameterError("planes", self.planes, "one of each at most, at least one")
        for plane in self.planes:
            if plane not in get_args(Plane):
                raise ParameterError("planes", self.planes, f"of {', '.join(get_args(Plane))}")

    def starts(self, plane: Plane, points: int) -> list[BlindFeedScenario]:
        """Return the feeds of a plane, the lateral error changing last."""
        cell = {one.name: getattr(self.cell, one.name) for one in fields(FedCellScenario)}
        return [
            BlindFeedScenario(**cell, plane=plane, lateral=lateral, tilt=tilt)
            for tilt, lateral in product(
                _grid(self.largest_tilt, points), _grid(self.largest_lateral, points)
            )
        ]


def _require_count(scenario: object, name: str, most: int) -> None:
    value = getattr(scenario, name)
    if not 1 <= value <= most:
        raise ParameterError(name, value, f"1 to {most}")


def _grid(largest: float, points: int) -> list[float]:
    """Return numbers from minus the largest on, 0 alone if there is but one."""
    return np.linspace(-largest, largest, points).tolist() if points > 1 else [0.0]


INSERTION_MAP: Final = InsertionMapScenario()


def resolve(scenario: InsertionMapScenario) -> InsertionMapScenario:
    """Resolve the cell."""
    return replace(scenario, cell=resolve_fed_cell(scenario.cell))


def push_at(cell: FedCellScenario, depth: Array) -> Array:
    """Return how hard the feed pushes in the end at depths of the tip, N."""
    push: Array = axial_stiffness(cell) * (cell.feed - cell.gap - depth)
    return push


def feed(scenario: BlindFeedScenario) -> Row:
    """Run one feed; it depends on its scenario alone."""
    return measured(scenario, feed_blind(scenario))


def drawn_cells(scenario: InsertionMapScenario, seed: int) -> list[BlindFeedScenario]:
    """Return the feeds of the drawn arms, the draws of a cell one after the other."""
    drawn = scenario.drawn
    if drawn is None:
        return []
    found = []
    for cell, start in enumerate(scenario.starts(drawn.plane, drawn.points)):
        for draw in range(drawn.draws):
            generator = np.random.default_rng([seed, cell, draw])
            arms = {
                name: drawn.errors.drawn(getattr(start, name), generator) for name in start.arms
            }
            found.append(replace(start, **arms))
    return found


def run(scenario: InsertionMapScenario, seed: int, progress: Progress) -> Outcome:
    """Run every cell, and the drawn ones."""
    cells = [one for plane in scenario.planes for one in scenario.starts(plane, scenario.points)]
    drawn = drawn_cells(scenario, seed)
    share = len(cells) / (len(cells) + len(drawn))
    mapped = run_each(feed, cells, part_of(progress, 0.0, share))
    varied = run_each(feed, drawn, part_of(progress, share, 1.0)) if drawn else None
    traces = _cells(scenario, mapped)
    metrics = confusion(traces) | _differences(traces)
    tables = {"region": _region(scenario)}
    simulated = float(mapped.column("simulated_seconds").sum())
    if scenario.drawn is not None and varied is not None:
        tables["probability"] = _probability(scenario, scenario.drawn, varied)
        metrics |= _overall(tables["probability"])
        simulated += float(varied.column("simulated_seconds").sum())
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=simulated, tables=tables)


def _cells(scenario: InsertionMapScenario, found: Trials[BlindFeedScenario]) -> Table:
    """Return a row a cell: its errors, what became of it, and what theory says of its touch."""
    names = [name for name in found.rows[0] if name != "simulated_seconds"]
    traces = {
        "plane": np.array([float(get_args(Plane).index(one.plane)) for one in found.tasks]),
        "lateral": np.array([one.lateral for one in found.tasks]),
        "tilt": np.array([one.tilt for one in found.tasks]),
        **{name.replace(".", "_"): found.column(name) for name in names},
    }
    for name, start in (("touch_lateral_error", "lateral"), ("touch_rotational_error", "tilt")):
        never = np.isnan(traces[name])
        traces[name] = np.where(never, traces[start], traces[name])
    said: dict[str, Array] = {}
    for index, plane in enumerate(get_args(Plane)):
        of = traces["plane"] == index
        if not of.any():
            continue
        errors = (traces[f"touch_{name}_error"][of] for name in ("lateral", "rotational"))
        prediction = _predict(scenario, plane, *errors)
        for name, values in (
            ("verdict", prediction.verdict),
            ("force_axial", np.where(np.isinf(prediction.axial), np.nan, prediction.axial)),
            ("two_point_onset", prediction.onset),
            ("may_sit_on_edge", prediction.limits.on_edge),
            ("inside", prediction.limits.inside),
        ):
            said.setdefault(f"predicted_{name}", np.full(len(found), np.nan))[of] = values
    return {name: column(values) for name, values in (traces | said).items()}


def _predict(
    scenario: InsertionMapScenario, plane: Plane, lateral: Array, tilt: Array
) -> FeedPrediction:
    cell = scenario.cell
    return predict_feed(
        cell.parts,
        partial(cell.support_at, plane=plane),
        partial(push_at, cell),
        lateral,
        tilt,
        depth=cell.deepest,
    )


def _region(scenario: InsertionMapScenario) -> Table:
    """Return what the limits say on a fine grid of each plane."""
    cell = scenario.cell
    lateral = _BEYOND * scenario.largest_lateral * np.linspace(-1, 1, _RASTER)
    tilt = _BEYOND * scenario.largest_tilt * np.linspace(-1, 1, _RASTER)
    verdicts = [
        limits(cell.parts, partial(cell.support_at, plane=plane), lateral[None, :], tilt[:, None])
        for plane in scenario.planes
    ]
    planes = [float(get_args(Plane).index(plane)) for plane in scenario.planes]
    n = len(planes)
    return {
        "plane": np.repeat(planes, _RASTER**2),
        "lateral": np.tile(lateral, _RASTER * n),
        "tilt": np.tile(np.repeat(tilt, _RASTER), n),
        "verdict": column(np.concatenate([one.verdict.ravel() for one in verdicts])),
    }


def confusion(traces: Table) -> dict[str, Metric]:
    """Return the confusion of outcomes and verdicts, and its metrics."""
    verdict, outcome = traces["predicted_verdict"], traces["outcome"]
    seated = outcome == FeedOutcome.SEATED
    counts = {
        f"confusion.{said.name.lower()}.{became.name.lower()}": (
            (verdict == said) & (outcome == became),
            "cells",
        )
        for said, became in product(FeedVerdict, FeedOutcome)
    }
    safe, sure = verdict == FeedVerdict.SAFE, verdict != FeedVerdict.MAY
    right = np.where(safe, seated, ~seated)[sure]
    edge = (traces["predicted_may_sit_on_edge"] > 0) & (traces["predicted_inside"] > 0)
    counts |= {
        "cells": (np.ones_like(verdict), ""),
        "seated": (seated, "cells"),
        "predicted_safe.cells": (safe, "by the errors at touch"),
        "predicted_safe.failed": (safe & ~seated, "of them not seated"),
        "predicted_may.share": (~sure, ""),
        "predicted_edge.cells": (edge, "inside, but the rim may sit on the bore's edge"),
        "predicted_edge.failed": (edge & ~seated, "of them not seated"),
    }
    metrics = metrics_of(
        {name: (float(of.sum()), "", note) for name, (of, note) in counts.items()}
    )
    unsure = 100 * float(np.mean(~sure)), "%", "cells of which theory is not sure"
    metrics |= metrics_of({"predicted_may.share": unsure})
    if not safe.any():
        note = "no cell is predicted safe"
        metrics["predicted_safe.failed"] = Metric(value=None, unit="", note=note)
    if not len(right):
        return metrics | {"agreement": Metric(value=None, unit="%", note="theory is never sure")}
    note = f"of {len(right)} cells where theory is sure: safe and seated, or stopped and not"
    return metrics | rate("agreement", int(right.sum()), len(right), note)


def _differences(traces: Table) -> dict[str, Metric]:
    """Return how far forces and onsets are from theory's where a safe cell is seated."""
    chosen = (traces["predicted_verdict"] == FeedVerdict.SAFE) & (
        traces["outcome"] == FeedOutcome.SEATED
    )
    force = traces["force_axial"] - traces["predicted_force_axial"]
    onset = traces["two_point_onset"] - traces["predicted_two_point_onset"]
    depths = _median(onset[chosen], "m", "simulated less predicted depth")
    largest: tuple[float | None, str, str] = (None, "N", "there are none")
    if chosen.any():
        largest = float(traces["force_axial"][chosen].max()), "N", "of the seated safe cells"
    return {
        "force.excess": _median(force[chosen], "N", "simulated less predicted push"),
        **metrics_of({"force.largest": largest}),
        "two_point.onset_difference": depths,
    }


def _median(values: Array, unit: str, note: str) -> Metric:
    known = values[np.isfinite(values)]
    if not known.size:
        return Metric(value=None, unit=unit, note="no cell has both")
    note = f"median over {known.size} seated safe cells, {note}"
    return Metric(value=float(np.median(known)), unit=unit, note=note)


def _probability(
    scenario: InsertionMapScenario, drawn: DrawnCells, found: Trials[BlindFeedScenario]
) -> dict[str, Array]:
    """Return a row a randomised cell: the share of draws that is seated, and its interval."""
    rows = []
    for start in scenario.starts(drawn.plane, drawn.points):
        of = found.select(partial(_same_cell, start))
        if len(of):
            seated = int(np.sum(of.column("outcome") == FeedOutcome.SEATED))
            share = [one.value for one in rate("", seated, len(of), "").values()]
            rows.append((start.lateral, start.tilt, seated, len(of), *share))
    names = ("lateral", "tilt", "seated", "draws", "rate", "low", "high")
    table = dict(zip(names, map(column, zip(*rows, strict=True)), strict=True))
    said = _predict(scenario, drawn.plane, table["lateral"], table["tilt"])
    return {**table, "predicted_verdict": column(said.verdict)}


def _same_cell(start: BlindFeedScenario, other: BlindFeedScenario) -> bool:
    return (other.lateral, other.tilt) == (start.lateral, start.tilt)


def _overall(table: Mapping[str, Array]) -> dict[str, Metric]:
    """Return success over the randomised cells of each verdict, with its interval."""
    metrics: dict[str, Metric] = {}
    for said in FeedVerdict:
        of = table["predicted_verdict"] == said
        draws, seated = int(table["draws"][of].sum()), int(table["seated"][of].sum())
        if draws:
            note = f"{seated} of {draws} draws, cells by their errors at the start"
            metrics |= rate(f"drawn.{said.name.lower()}.success_rate", seated, draws, note)
    return metrics


_REGION: Final = {
    FeedVerdict.SAFE: ("#c9e7cf", "theory: goes in"),
    FeedVerdict.MAY: ("#fbeebc", "theory: may wedge, or sit on the edge"),
    FeedVerdict.STOPPED: ("#e3e3e3", "theory: stopped, or beside the mouth"),
}
_OUTCOMES: Final[dict[FeedOutcome, Style]] = {
    FeedOutcome.SEATED: {"marker": "o", "color": "#14733a", "label": "seated"},
    FeedOutcome.WEDGED: {"marker": "X", "color": "#b00020", "label": "wedged"},
    FeedOutcome.JAMMED: {"marker": "D", "color": "#e07b00", "label": "jammed"},
    FeedOutcome.ON_EDGE: {"marker": "^", "color": "#7a0060", "label": "stuck on the edge"},
    FeedOutcome.MISSED: {"marker": "x", "color": "#333333", "label": "missed"},
}
_WRONG: Final[Style] = {"marker": "o", "facecolors": "none", "edgecolors": "#000000"}
_MM, _MRAD = 1e3, 1e3


def figures(scenario: InsertionMapScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the map of each plane, the force by theory and simulation, and probabilities."""
    planes, drawn = scenario.planes, outcome.tables.get("probability")
    safe = outcome.traces["predicted_verdict"] == FeedVerdict.SAFE
    failed = int(np.sum(safe & (outcome.traces["outcome"] != FeedOutcome.SEATED)))
    rows = [1.25, 1.0] + ([] if drawn is None else [1.0])
    figure = new_figure(
        height=4.2 * sum(rows),
        caption=f"Of {int(safe.sum())} cells that theory calls safe {failed} failed. "
        "Simulated outcome over the errors at touch (top), and what theory said of it.",
    )
    parts = figure.subfigures(len(rows), 1, height_ratios=rows, squeeze=False)
    above, lower, *last = parts[:, 0]
    maps = above.subplots(1, len(planes), squeeze=False)[0]
    for axes, plane in zip(maps, planes, strict=True):
        _draw_map(axes, plane, outcome)
    above.legend(handles=_handles(), loc="outside lower center", ncols=3, fontsize=8)
    below = lower.subplots(1, 2)
    _draw_table(below[0], outcome.traces)
    _draw_force(below[1], outcome.traces)
    if drawn is not None:
        _draw_probability(last[0].subplots(), drawn)
    return {"insertion-map": figure}


def _handles() -> list[Patch | Line2D]:
    regions = [Patch(color=colour, label=label) for colour, label in _REGION.values()]
    bare: Style = {"linestyle": "none"}
    symbols = [Line2D([], [], markersize=6, **bare, **style) for style in _OUTCOMES.values()]
    ring: Style = {"marker": "o", "markersize": 11, "markerfacecolor": "none"}
    label = "theory is sure, and wrong"
    wrong = Line2D([], [], markeredgecolor="black", label=label, **bare, **ring)
    return [*regions, wrong, *symbols]


def _draw_map(axes: Axes, plane: Plane, outcome: Outcome) -> None:
    """Draw what became of each cell, at its errors at touch, over the limits' region."""
    index = get_args(Plane).index(plane)
    region = outcome.tables["region"]
    _shade(axes, {name: values[region["plane"] == index] for name, values in region.items()})
    traces = outcome.traces
    cells = {name: values[traces["plane"] == index] for name, values in traces.items()}
    lateral = _MM * cells["touch_lateral_error"]
    tilt = _MRAD * cells["touch_rotational_error"]
    size = float(np.clip(1500 / len(lateral) ** 0.75, 12.0, 60.0))
    for became, style in _OUTCOMES.items():
        of = cells["outcome"] == became
        axes.scatter(lateral[of], tilt[of], s=size, zorder=3, **style)
    off = wrong(cells)
    axes.scatter(lateral[off], tilt[off], s=5 * size, zorder=4, linewidths=1.8, **_WRONG)
    safe = cells["predicted_verdict"] == FeedVerdict.SAFE
    failed = int(np.sum(safe & (cells["outcome"] != FeedOutcome.SEATED)))
    title = (
        f"Plane {plane.upper()}: {failed} of {int(safe.sum())} cells failed that theory calls safe"
    )
    x, y = "lateral error at touch / mm", "tilt at touch (equal signs add) / mrad"
    dress(axes, title=title, x=x, y=y)


def _shade(axes: Axes, region: Table) -> None:
    lateral, tilt = np.unique(region["lateral"]), np.unique(region["tilt"])
    verdict = region["verdict"].reshape(len(tilt), len(lateral))
    colours = ListedColormap([colour for colour, _ in _REGION.values()])
    axes.pcolormesh(
        _MM * lateral, _MRAD * tilt, verdict, cmap=colours, vmin=-0.5, vmax=2.5, rasterized=True
    )


def wrong(cells: Table) -> np.ndarray:
    """Return where theory is certain and the opposite happens."""
    seated = cells["outcome"] == FeedOutcome.SEATED
    said = cells["predicted_verdict"]
    return np.asarray(said == np.where(seated, FeedVerdict.STOPPED, FeedVerdict.SAFE))


def _draw_table(axes: Axes, traces: Table) -> None:
    """Write how often each outcome was each verdict's."""
    verdict, became = traces["predicted_verdict"], traces["outcome"]
    counts = np.array(
        [[np.sum((verdict == said) & (became == one)) for one in _OUTCOMES] for said in _REGION]
    )
    dress(axes, title="Cells by theory's verdict and outcome", x="", y="")
    happened = [style["label"].replace(" ", "\n", 1) for style in _OUTCOMES.values()]
    draw_counts(axes, counts, ["theory:\ngoes in", "theory:\nmay", "theory:\nstopped"], happened)


def _draw_force(axes: Axes, traces: Table) -> None:
    """Draw the simulated push over the predicted one."""
    seated = traces["outcome"] == FeedOutcome.SEATED
    largest = 1.0
    for said, label in ((FeedVerdict.SAFE, "goes in"), (FeedVerdict.MAY, "may")):
        of = seated & (traces["predicted_verdict"] == said)
        force = traces["predicted_force_axial"][of], traces["force_axial"][of]
        if of.any():
            largest = max(largest, *(float(np.nanmax(one, initial=0.0)) for one in force))
        colour = "#14733a" if said == FeedVerdict.SAFE else "#c79a00"
        axes.plot(*force, "o", markersize=3.5, color=colour, alpha=0.8, label=f"theory: {label}")
    axes.plot([0, largest], [0, largest], color="#555555", linewidth=1.0, label="equal")
    x, y = "exact statics without joint friction / N", "simulated, 10 ms median / N"
    dress(axes, title="Largest push of the seated cells", x=x, y=y)
    legend(axes, ncols=3)


def _draw_probability(axes: Axes, table: Table) -> None:
    """Draw the share of draws that is seated in each cell, with its interval."""
    lateral, tilt = np.unique(table["lateral"]), np.unique(table["tilt"])
    share = np.full((len(tilt), len(lateral)), np.nan)
    at = np.searchsorted(tilt, table["tilt"]), np.searchsorted(lateral, table["lateral"])
    share[at] = table["rate"]
    axes.pcolormesh(
        _MM * lateral, _MRAD * tilt, share, cmap="RdYlGn", vmin=0.0, vmax=100.0, alpha=0.75
    )
    small = len(lateral) > 5
    names = ("lateral", "tilt", "rate", "low", "high")
    for x, y, rate_, low, high in zip(*(table[name] for name in names), strict=True):
        text = f"{rate_:.0f}" if small else f"{rate_:.0f} %\n{low:.0f} to {high:.0f}"
        axes.text(_MM * x, _MRAD * y, text, ha="center", va="center", fontsize=8)
    draws = int(table["draws"].max())
    interval = "" if small else ", with 95 % interval"
    title = f"Seated of {draws} draws of model errors, %{interval}"
    dress(axes, title=title, x="lateral error at the start / mm", y="tilt at the start / mrad")
    axes.grid(False)
