"""Fig. 2 for the paper's parts: from which initial errors a peg goes in without wedging."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.cell.alignment_runs import detected_metric
from analysis.cell.alignment_trials import (
    AlignmentTrialsScenario,
    align_all,
    margins,
    resolve_trials,
)
from analysis.cell.wedging_diagram_figures import STARTS, plot_wedging
from analysis.published.work_cell import MEAN_ERROR, WORST_ERROR
from analysis.run.experiment import Experiment, Metric, Outcome, Progress, Table, column
from analysis.run.trial_metrics import prefixed
from models.insertion import (
    bore_contact,
    chamfer_depth,
    cross_chamfer,
    enters,
    two_point_onset,
)
from models.validation import ParameterError, require_finite, require_positive
from models.wedging import (
    Form,
    PartsAndSupport,
    box_margin,
    chamfer_needed,
    least_margin,
    rotation_bounds,
    rotation_margin,
    wedges,
)

Array = NDArray[np.float64]

_MOST_POINTS = 100_000
_BEYOND = 1.15  # of the limits, drawn


@dataclass(frozen=True, kw_only=True)
class Start:
    """Initial errors; of one sign they add."""

    lateral: float  # m, eps0, across the axis
    rotation: float  # rad, theta0, of the axes

    def __post_init__(self) -> None:
        require_finite(self, "lateral", "rotation")


@dataclass(frozen=True, kw_only=True)
class WedgingScenario:
    """The parts, further compliance centres, and three starts to follow into the hole.

    The paper prints the size of the ten runs' errors, not their signs: the same sign is assumed
    for both, the worst case.
    """

    parts: PartsAndSupport = field(default_factory=PartsAndSupport)
    centre_distances: tuple[float, ...] = (0.0, 0.03)  # m, L_g, more regions to draw; assumed
    published_mean: Start = Start(lateral=MEAN_ERROR[0], rotation=MEAN_ERROR[1])
    published_worst: Start = Start(lateral=WORST_ERROR[0], rotation=WORST_ERROR[1])
    wedging_prone: Start = Start(lateral=WORST_ERROR[0], rotation=0.05)  # in the box; assumed
    alignment: AlignmentTrialsScenario | None = field(
        default_factory=lambda: AlignmentTrialsScenario(trials=10)
    )  # whose trials' ends are drawn in; null: none
    depth: float = 0.06  # m, of the bore; assumed
    points: int = 401  # of every curve

    RENAMED: ClassVar[Mapping[str, str]] = {"alignment.parts": "parts"}

    def __post_init__(self) -> None:
        require_positive(self, "depth")
        if not all(0 <= distance < math.inf for distance in self.centre_distances):
            raise ParameterError(
                "centre_distances", self.centre_distances, "finite numbers >= 0, or none"
            )
        if not 2 <= self.points <= _MOST_POINTS:
            raise ParameterError("points", self.points, f"2 to {_MOST_POINTS}")

    def starts(self) -> tuple[Start, ...]:
        """Return the starts in the order of ``STARTS``."""
        return tuple(getattr(self, name) for name in STARTS)


def resolve(scenario: WedgingScenario) -> WedgingScenario:
    """Resolve the alignments."""
    if scenario.alignment is None:
        return scenario
    try:
        return replace(scenario, alignment=resolve_trials(scenario.alignment))
    except ParameterError as error:
        raise ParameterError(f"alignment.{error.name}", error.value, error.allowed) from error


def run(scenario: WedgingScenario, seed: int, progress: Progress) -> Outcome:
    """Measure the region, the margins of the starts, and their way into the hole."""
    parts = scenario.parts
    metrics = {
        "clearance_ratio": Metric(value=parts.clearance_ratio, unit=""),
        "rotation_limit": Metric(value=parts.rotation_limit, unit="rad"),
        "lateral_limit": Metric(value=parts.lateral_limit, unit="m", note="R + r"),
        "chamfer_limit": Metric(value=parts.chamfer_limit, unit="m", note="W assumed"),
        "wedging_depth": Metric(value=parts.wedging_depth, unit="m", note="2 mu r"),
        "tilt_per_error": Metric(
            value=parts.tilt_per_error, unit="rad/m", note="slope of the region's sides"
        ),
        "largest_tilt_per_error": Metric(
            value=_at_centre(parts, parts.worst_centre_distance).tilt_per_error,
            unit="rad/m",
            note=f"at L_g = {parts.worst_centre_distance:.4g} m",
        ),
        "chamfer_needed": Metric(
            value=float(chamfer_needed(parts, scenario.published_worst.lateral)),
            unit="m",
            note="for the largest lateral error of the ten runs",
        ),
        "chamfer_needed_for_limit": Metric(
            value=float(chamfer_needed(parts, parts.lateral_limit)),
            unit="m",
            note="for the published lateral limit",
        ),
    }
    rows: dict[str, list[Array]] = {}
    for i, (name, start) in enumerate(zip(STARTS, scenario.starts(), strict=True)):
        path = _insertion(parts, start, scenario)
        for key, values in {"start": np.full(len(path["depth"]), float(i)), **path}.items():
            rows.setdefault(key, []).append(values)
        metrics |= {f"{name}.{key}": value for key, value in _measure(parts, start, path).items()}
    tables = {"boundaries": _boundaries(scenario)}
    simulated = 0.0
    if scenario.alignment is not None:
        finished = align_all(scenario.alignment, seed, progress)
        simulated = len(finished) * scenario.alignment.duration
        tables["ends"] = {
            name: finished.column(name) for name in ("lateral_error", "rotational_error")
        }
        metrics |= prefixed("aligned", margins(finished, parts))
        metrics["aligned.detected"] = detected_metric(finished.column("detected"))
    return Outcome(
        metrics=metrics,
        traces={name: column(np.concatenate(parts_of)) for name, parts_of in rows.items()},
        simulated_seconds=simulated,
        tables=tables,
    )


def _measure(parts: PartsAndSupport, start: Start, path: Table) -> dict[str, Metric]:
    box = box_margin(parts, start.lateral, start.rotation)
    simple, simple_at = least_margin(parts, start.lateral, start.rotation, "simple")
    exact, exact_at = least_margin(parts, start.lateral, start.rotation, "exact")
    here = float(rotation_margin(parts, start.lateral, start.rotation))
    onset = float(two_point_onset(parts, start.lateral, start.rotation))
    in_bore = path["depth"] >= 0
    force = np.where(in_bore, path["force"], -np.inf)
    peak = int(np.argmax(force))
    never = "" if math.isfinite(onset) else "two points never touch"
    return {
        "box_margin.lateral": Metric(value=100 * float(box.lateral), unit="%"),
        "box_margin.rotation": Metric(value=100 * float(box.rotation), unit="%"),
        "parallelogram_margin": Metric(
            value=100 * simple, unit="%", note=f"the least over L_g, at {simple_at:.3g} m"
        ),
        "exact_margin": Metric(
            value=100 * exact, unit="%", note=f"the least over L_g, at {exact_at:.3g} m"
        ),
        "margin": Metric(
            value=100 * here, unit="%", note=f"exact, at L_g = {parts.centre_distance:g} m"
        ),
        "wedges": Metric(
            value=float(wedges(parts, start.lateral, start.rotation)), unit="", note="1: it may"
        ),
        "enters": Metric(
            value=float(enters(parts, start.lateral, start.rotation)),
            unit="",
            note="1: on the assumed chamfer, and upright enough for the mouth",
        ),
        "onset": Metric(value=onset, unit="m", note=never),
        "onset_ratio": Metric(
            value=onset / parts.wedging_depth, unit="", note=never or "lambda, above 1 no wedge"
        ),
        "peak_force": Metric(value=float(force[peak]), unit="N", note="in the bore"),
        "peak_force_depth": Metric(value=float(path["depth"][peak]), unit="m"),
        "chamfer_force": Metric(
            value=float(np.max(path["force"], where=~in_bore, initial=0.0)), unit="N"
        ),
    }


def _insertion(
    parts: PartsAndSupport, start: Start, scenario: WedgingScenario
) -> dict[str, Array]:
    """Return the way down the chamfer, at negative depths, and into the bore."""
    down = float(chamfer_depth(parts, start.lateral))
    descent = np.linspace(0.0, down, scenario.points) if down > 0 else np.empty(0)
    chamfer = cross_chamfer(parts, start.lateral, start.rotation, descent)
    depth = np.linspace(0.0, scenario.depth, scenario.points)
    bore = bore_contact(parts, start.lateral, start.rotation, depth)
    return {
        "depth": np.concatenate([descent - down - 1e-12, depth]),  # the mouth belongs to both
        "force": np.concatenate([chamfer.insertion_force, bore.insertion_force]),
        "tilt": np.concatenate([chamfer.tilt, bore.tilt]),
        "contact": np.concatenate([np.full(len(descent), -1.0), bore.contact.astype(float)]),
    }


def _boundaries(scenario: WedgingScenario) -> dict[str, Array]:
    """Return both forms of the sides for every compliance centre, that of the parts first."""
    parts = scenario.parts
    edge = _BEYOND * max(parts.lateral_limit, parts.chamfer_limit)
    corners = np.array([parts.clearance, parts.chamfer_limit, parts.lateral_limit])
    lateral = np.unique(np.r_[np.linspace(-edge, edge, scenario.points), -corners, corners])
    rows: dict[str, list[Array]] = {}
    for distance in (parts.centre_distance, *scenario.centre_distances):
        there = _at_centre(parts, distance)
        forms: tuple[Form, ...] = ("simple", "exact")
        bounds = {form: rotation_bounds(there, lateral, form) for form in forms}
        values = {"centre_distance": np.full_like(lateral, distance), "lateral": lateral}
        for form, (lower, upper) in bounds.items():
            values |= {f"{form}_lower": lower, f"{form}_upper": upper}
        for key, of in values.items():
            rows.setdefault(key, []).append(of)
    return {name: column(np.concatenate(of)) for name, of in rows.items()}


def _at_centre(parts: PartsAndSupport, distance: float) -> PartsAndSupport:
    return replace(parts, centre_distance=distance)


def _plot(scenario: WedgingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    starts = {
        name: (start.lateral, start.rotation)
        for name, start in zip(STARTS, scenario.starts(), strict=True)
    }
    ends = None
    if (table := outcome.tables.get("ends")) is not None:
        ends = table["lateral_error"], table["rotational_error"]
    return {"wedging-diagram": plot_wedging(scenario.parts, starts, outcome, ends)}


WEDGING_DIAGRAM = Experiment(
    name="wedging-diagram",
    paper="fsm-visual-servoing",
    figure="Fig. 2",
    summary="from which initial errors the peg goes in without wedging, and with what force",
    scenario=WedgingScenario,
    resolve=resolve,
    run=run,
    plot=_plot,
    reduced=(
        "alignment.trials=2",
        "alignment.begin=0.2",
        "alignment.compensation_time=0.6",
        "points=41",
    ),
)
