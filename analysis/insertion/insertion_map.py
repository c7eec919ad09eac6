"""What becomes of blind feeds from a grid of errors, beside what the planar theory says."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import product
from typing import Final, TypeVar, get_args

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import rate
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.insertion.blind_feed_runs import FeedOutcome, feed_blind, measured
from chamfer.analysis.insertion.insertion_map_figures import plot_map
from chamfer.analysis.scenario.experiment import (
    Metric,
    Outcome,
    Progress,
    Table,
    column,
)
from chamfer.diagrams.cell.work_cell import ArmSettings, axial_stiffness
from chamfer.diagrams.insertion.blind_feed import (
    BlindFeedScenario,
    FedCellScenario,
    Plane,
    resolve_fed_cell,
)
from chamfer.models.peg_theory.fed_insertion import FeedPrediction, Verdict, limits, predict_feed
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)

Array = NDArray[np.float64]

ArmT = TypeVar("ArmT", bound=ArmSettings)

_MOST: Final = 101  # points along an axis
_RASTER: Final = 161  # points along an axis of the drawn region
_BEYOND: Final = 1.1  # of the errors, drawn


@dataclass(frozen=True, kw_only=True)
class ModelErrors:
    """What a controller does not know of its arm, drawn for each trial and arm."""

    payload: float = 0.0865  # kg, from 0 to this; the cell's own error is the largest
    link_mass: float = 0.02  # relative, within plus and minus this; assumed
    joint_friction: float = 0.5  # relative, of the cell's, likewise; assumed

    def __post_init__(self) -> None:
        require_not_negative(self, "payload")
        for name in ("link_mass", "joint_friction"):
            value = getattr(self, name)
            if not 0 <= value < 1:
                raise ParameterError(name, value, "from 0 to less than 1")

    def drawn(self, arm: ArmT, generator: np.random.Generator) -> ArmT:
        """Return an arm with errors of its model."""
        payload = float(generator.uniform(0.0, 1.0))
        mass, friction = generator.uniform(-1.0, 1.0, 2).tolist()
        return replace(
            arm,
            payload_error=arm.payload_error + self.payload * payload,
            mass_scale=arm.mass_scale * (1 + self.link_mass * mass),
            joint_friction=tuple(
                one * (1 + self.joint_friction * friction) for one in arm.arm.dry_friction
            ),
        )


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
    mapped = run_each(feed, cells, partial(_part, progress, 0.0, share))
    varied = run_each(feed, drawn, partial(_part, progress, share, 1.0)) if drawn else None
    traces = _cells(scenario, mapped)
    metrics = confusion(traces)
    metrics |= _differences(traces)
    tables = {"region": _region(scenario)}
    simulated = float(mapped.column("simulated_seconds").sum())
    if scenario.drawn is not None and varied is not None:
        tables["probability"] = _probability(scenario, scenario.drawn, varied)
        metrics |= _overall(tables["probability"])
        simulated += float(varied.column("simulated_seconds").sum())
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=simulated,
        tables=tables,
    )


def _part(progress: Progress, begin: float, end: float, fraction: float, doing: str = "") -> None:
    progress(begin + (end - begin) * fraction, doing)


def _cells(scenario: InsertionMapScenario, found: Trials[BlindFeedScenario]) -> Table:
    """Return a row a cell: its errors, what became of it, and what theory says of its touch."""
    traces = {
        "plane": np.array([float(get_args(Plane).index(one.plane)) for one in found.tasks]),
        "lateral": np.array([one.lateral for one in found.tasks]),
        "tilt": np.array([one.tilt for one in found.tasks]),
        **{
            name.replace(".", "_"): found.column(name)
            for name in found.rows[0]
            if name != "simulated_seconds"
        },
    }
    for name, start in (("touch_lateral_error", "lateral"), ("touch_rotational_error", "tilt")):
        never = np.isnan(traces[name])
        traces[name] = np.where(never, traces[start], traces[name])
    said = {name: np.full(len(found), np.nan) for name in _PREDICTED}
    for index, plane in enumerate(get_args(Plane)):
        of = traces["plane"] == index
        if not of.any():
            continue
        prediction = _predict(
            scenario,
            plane,
            traces["touch_lateral_error"][of],
            traces["touch_rotational_error"][of],
        )
        for name, values in (
            ("verdict", prediction.verdict),
            ("force_axial", prediction.axial),
            ("two_point_onset", prediction.onset),
            ("may_sit_on_edge", prediction.limits.on_edge),
            ("inside", prediction.limits.inside),
        ):
            said[name][of] = values
    said["force_axial"][np.isinf(said["force_axial"])] = np.nan
    traces |= {f"predicted_{name}": values for name, values in said.items()}
    return {name: column(values) for name, values in traces.items()}


_PREDICTED: Final = ("verdict", "force_axial", "two_point_onset", "may_sit_on_edge", "inside")


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
    rows: dict[str, list[Array]] = {"plane": [], "lateral": [], "tilt": [], "verdict": []}
    for plane in scenario.planes:
        support = partial(cell.support_at, plane=plane)
        found = limits(cell.parts, support, lateral[None, :], tilt[:, None])
        rows["plane"].append(np.full(_RASTER**2, float(get_args(Plane).index(plane))))
        rows["lateral"].append(np.tile(lateral, _RASTER))
        rows["tilt"].append(np.repeat(tilt, _RASTER))
        rows["verdict"].append(found.verdict.ravel().astype(np.float64))
    return {name: column(np.concatenate(of)) for name, of in rows.items()}


def confusion(traces: Table) -> dict[str, Metric]:
    """Return how often each outcome was each verdict's, and what follows."""
    verdict, outcome = traces["predicted_verdict"], traces["outcome"]
    seated = outcome == FeedOutcome.SEATED
    metrics = {}
    for said in Verdict:
        for became in FeedOutcome:
            metrics[f"confusion.{said.name.lower()}.{became.name.lower()}"] = Metric(
                value=float(np.sum((verdict == said) & (outcome == became))), unit="", note="cells"
            )
    safe, sure = verdict == Verdict.SAFE, verdict != Verdict.MAY
    right = np.where(safe, seated, ~seated)[sure]
    edge = (traces["predicted_may_sit_on_edge"] > 0) & (traces["predicted_inside"] > 0)
    metrics |= {
        "cells": Metric(value=float(len(verdict)), unit=""),
        "seated": Metric(value=float(seated.sum()), unit="", note="cells"),
        "predicted_safe.cells": Metric(
            value=float(safe.sum()), unit="", note="by the errors at touch"
        ),
        "predicted_safe.failed": Metric(
            value=float(np.sum(safe & ~seated)), unit="", note="of them not seated"
        ),
        "predicted_may.share": Metric(
            value=100 * float(np.mean(~sure)), unit="%", note="cells of which theory is not sure"
        ),
        "predicted_edge.cells": Metric(
            value=float(edge.sum()), unit="", note="inside, but the rim may sit on the bore's edge"
        ),
        "predicted_edge.failed": Metric(
            value=float(np.sum(edge & ~seated)), unit="", note="of them not seated"
        ),
    }
    if not len(right):
        return metrics | {"agreement": Metric(value=None, unit="%", note="theory is never sure")}
    note = f"of {len(right)} cells where theory is sure: safe and seated, or stopped and not"
    return metrics | rate("agreement", int(right.sum()), len(right), note)


def _differences(traces: Table) -> dict[str, Metric]:
    """Return how far forces and onsets are from theory's where a safe cell is seated."""
    chosen = (traces["predicted_verdict"] == Verdict.SAFE) & (
        traces["outcome"] == FeedOutcome.SEATED
    )
    force = traces["force_axial"] - traces["predicted_force_axial"]
    onset = traces["two_point_onset"] - traces["predicted_two_point_onset"]
    return {
        "force.excess": _median(force[chosen], "N", "simulated less predicted push"),
        "force.largest": Metric(
            value=float(traces["force_axial"][chosen].max()) if chosen.any() else None,
            unit="N",
            note="of the seated safe cells" if chosen.any() else "there are none",
        ),
        "two_point.onset_difference": _median(
            onset[chosen], "m", "simulated less predicted depth"
        ),
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
    """Return a row a drawn cell: the share of draws that is seated, and its interval."""
    rows: dict[str, list[float]] = {name: [] for name in _PROBABILITY}
    for start in scenario.starts(drawn.plane, drawn.points):
        of = found.select(partial(_same_cell, start))
        if not len(of):
            continue
        seated = int(np.sum(of.column("outcome") == FeedOutcome.SEATED))
        share = [one.value for one in rate("", seated, len(of), "").values()]
        values = [start.lateral, start.tilt, float(seated), float(len(of)), *share]
        for name, value in zip(_PROBABILITY, values, strict=True):
            rows[name].append(math.nan if value is None else value)
    table = {name: column(values) for name, values in rows.items()}
    said = _predict(scenario, drawn.plane, table["lateral"], table["tilt"])
    return {**table, "predicted_verdict": column(said.verdict)}


_PROBABILITY: Final = ("lateral", "tilt", "seated", "draws", "rate", "low", "high")


def _same_cell(start: BlindFeedScenario, other: BlindFeedScenario) -> bool:
    return (other.lateral, other.tilt) == (start.lateral, start.tilt)


def _overall(table: Mapping[str, Array]) -> dict[str, Metric]:
    """Return success over the drawn cells of each verdict, with its interval."""
    metrics: dict[str, Metric] = {}
    for said in Verdict:
        of = table["predicted_verdict"] == said
        draws, seated = int(table["draws"][of].sum()), int(table["seated"][of].sum())
        if draws:
            note = f"{seated} of {draws} draws, cells by their errors at the start"
            metrics |= rate(f"drawn.{said.name.lower()}.success_rate", seated, draws, note)
    return metrics


def figures(scenario: InsertionMapScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"insertion-map": plot_map(scenario.planes, outcome)}
