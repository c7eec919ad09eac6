"""Fig. 2 for the paper's parts: from which initial errors a peg goes in without wedging."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import prefixed
from chamfer.analysis.cell.alignment_runs import (
    RepeatabilityScenario,
    ResolvedRepeatabilityScenario,
    align_all,
    detected_metric,
    margins,
    resolve_repeatability,
)
from chamfer.analysis.drawing.figure_style import (
    LIMIT,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.work_cell import MEAN_ERROR, WORST_ERROR
from chamfer.analysis.scenario.experiment import (
    Metric,
    Outcome,
    Progress,
    Table,
    column,
)
from chamfer.models.peg.peg_and_hole import ColouredParts, PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory import insertion_statics as simple
from chamfer.models.peg_theory.planar_statics import Contact, equilibrium
from chamfer.models.peg_theory.wedging import (
    Form,
    box_margin,
    chamfer_needed,
    least_margin,
    require_stiff,
    rotation_bounds,
    rotation_margin,
    two_point_onset,
    wedges,
)
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_positive,
    require_same,
    within,
)

Array = NDArray[np.float64]

_MOST_POINTS = 100_000
_UNUSED = ("bore_depth",)  # of the parts
_BEYOND = 1.15  # of the limits, drawn
_REACH = 2.0  # clearances above the chamfer, where a tilted peg touches it first


@dataclass(frozen=True, kw_only=True)
class InitialErrors:
    """Initial errors; of one sign they add."""

    lateral: float  # m, eps0, across the axis
    rotation: float  # rad, theta0, of the axes

    def __post_init__(self) -> None:
        require_finite(self, "lateral", "rotation")


@dataclass(frozen=True, kw_only=True)
class WedgingScenario:
    """The parts, their support, further compliance centres, and three starts to follow.

    The paper prints the size of the ten runs' errors, not their signs: the same sign is assumed
    for both, the worst case.
    """

    parts: ColouredParts = field(default_factory=ColouredParts)
    support: Support = field(default_factory=Support)
    # of the paper's figure and its errors, and not what the cell's arms are to the peg
    centre_distances: tuple[float, ...] = (0.0, 0.03)  # m, L_g, more regions to draw; assumed
    published_mean: InitialErrors = InitialErrors(lateral=MEAN_ERROR[0], rotation=MEAN_ERROR[1])
    published_worst: InitialErrors = InitialErrors(lateral=WORST_ERROR[0], rotation=WORST_ERROR[1])
    wedging_prone: InitialErrors = InitialErrors(
        lateral=WORST_ERROR[0], rotation=0.05
    )  # in the box; assumed
    alignment: RepeatabilityScenario | None = field(
        default_factory=lambda: RepeatabilityScenario(trials=10)
    )  # whose trials' ends are drawn in, with these parts, ten as in section 5; null: none
    depth: float = 0.06  # m, of the bore; assumed
    points: int = 401  # of every curve

    def __post_init__(self) -> None:
        require_stiff(self.parts, self.support)
        require_same(self.parts, ColouredParts, "parts", *_UNUSED, why="the parts don't touch")
        if self.alignment is None:
            # A wide chamfer asks for a wide part.
            of_theory = {*(one.name for one in fields(PegHoleGeometry)), "outer_radius"}
            seen = [one.name for one in fields(ColouredParts) if one.name not in of_theory]
            require_same(self.parts, ColouredParts, "parts", *seen, why="nobody sees the parts")
        else:
            _require_of(self.parts, self.alignment.parts)
        require_positive(self, "depth")
        if not all(0 <= distance < math.inf for distance in self.centre_distances):
            raise ParameterError(
                "centre_distances", self.centre_distances, "finite numbers >= 0, or none"
            )
        if not 2 <= self.points <= _MOST_POINTS:
            raise ParameterError("points", self.points, f"2 to {_MOST_POINTS}")

    def starts(self) -> tuple[InitialErrors, ...]:
        """Return the starts in the order of ``STARTS``."""
        return tuple(getattr(self, name) for name in STARTS)


def _require_of(parts: ColouredParts, aligned: ColouredParts) -> None:
    """Refuse parts that are aligned and are not those of the diagram."""
    for one in fields(ColouredParts):
        own, value = getattr(parts, one.name), getattr(aligned, one.name)
        if value not in (own, getattr(ColouredParts, one.name)):
            raise ParameterError(f"alignment.parts.{one.name}", value, f"that of parts, {own!r}")


@dataclass(frozen=True, kw_only=True)
class ResolvedWedgingScenario(WedgingScenario):
    """The same with the alignments resolved, of the diagram's parts."""

    alignment: ResolvedRepeatabilityScenario | None


WEDGING: Final = WedgingScenario()


def resolve(scenario: WedgingScenario) -> ResolvedWedgingScenario:
    """Resolve the alignments, of the diagram's parts."""
    alignment = None
    if scenario.alignment is not None:
        with within("alignment"):
            alignment = resolve_repeatability(replace(scenario.alignment, parts=scenario.parts))
    return ResolvedWedgingScenario(**vars(scenario) | {"alignment": alignment})


def run(scenario: ResolvedWedgingScenario, seed: int, progress: Progress) -> Outcome:
    """Measure the region, the margins of the starts, and their way into the hole."""
    parts, support = scenario.parts, scenario.support
    metrics = {
        "clearance_ratio": Metric(value=parts.clearance_ratio, unit=""),
        "rotation_limit": Metric(value=parts.rotation_limit, unit="rad"),
        "lateral_limit": Metric(value=parts.lateral_limit, unit="m", note="R + r"),
        "chamfer_limit": Metric(value=parts.chamfer_limit, unit="m", note="W assumed"),
        "wedging_depth": Metric(value=parts.wedging_depth, unit="m", note="2 mu r"),
        "tilt_per_error": Metric(
            value=support.tilt_per_error, unit="rad/m", note="slope of the region's sides"
        ),
        "largest_tilt_per_error": Metric(
            value=_at_centre(support, support.worst_centre_distance).tilt_per_error,
            unit="rad/m",
            note=f"at L_g = {support.worst_centre_distance:.4g} m",
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
        path = _insertion(scenario, start)
        for key, values in {"start": np.full(len(path["depth"]), float(i)), **path}.items():
            rows.setdefault(key, []).append(values)
        metrics |= {
            f"{name}.{key}": value for key, value in _measure(scenario, start, path).items()
        }
    tables = {"boundaries": _boundaries(scenario)}
    simulated = 0.0
    if scenario.alignment is not None:
        finished = align_all(scenario.alignment, seed, progress)
        simulated = len(finished) * scenario.alignment.duration
        tables["ends"] = {
            name: finished.column(name) for name in ("lateral_error", "rotational_error")
        }
        held = scenario.alignment.held()
        metrics |= prefixed("aligned", margins(finished, parts, held))
        lateral = _drawn(parts, scenario.points)
        lower, upper = rotation_bounds(parts, held, lateral)
        tables["arms"] = {"lateral": lateral, "exact_lower": lower, "exact_upper": upper}
        metrics["aligned.detected"] = detected_metric(finished.column("detected"))
    return Outcome(
        metrics=metrics,
        traces={name: column(np.concatenate(parts_of)) for name, parts_of in rows.items()},
        simulated_seconds=simulated,
        tables=tables,
    )


def _measure(scenario: WedgingScenario, start: InitialErrors, path: Table) -> dict[str, Metric]:
    parts, support = scenario.parts, scenario.support
    errors = start.lateral, start.rotation
    box = box_margin(parts, *errors)
    simple_least, simple_at = least_margin(parts, support, *errors, "simple")
    exact_least, exact_at = least_margin(parts, support, *errors, "exact")
    here = float(rotation_margin(parts, support, *errors))
    onset = float(two_point_onset(parts, support, *errors))
    simple_onset = float(simple.two_point_onset(parts, support, *errors))
    on_chamfer = path["contact"] == Contact.CHAMFER
    force = np.where(path["contact"] == Contact.STUCK, np.inf, path["force"])
    peak = int(np.argmax(np.where(on_chamfer, -np.inf, force)))
    depth = float(path["depth"][peak])
    stuck = "" if math.isfinite(force[peak]) else f"no push slides it at {1e3 * depth:.3g} mm"
    never = "" if math.isfinite(onset) else "two points never touch"
    by_whitney = "Whitney's simple form"
    in_bore = path["depth"][path["depth"] >= 0]
    simple_peak = simple.bore_contact(parts, support, *errors, in_bore).insertion_force.max()
    return {
        "box_margin.lateral": Metric(value=100 * float(box.lateral), unit="%"),
        "box_margin.rotation": Metric(value=100 * float(box.rotation), unit="%"),
        "parallelogram_margin": Metric(
            value=100 * simple_least, unit="%", note=f"the least over L_g, at {simple_at:.3g} m"
        ),
        "exact_margin": Metric(
            value=100 * exact_least, unit="%", note=f"the least over L_g, at {exact_at:.3g} m"
        ),
        "margin": Metric(
            value=100 * here, unit="%", note=f"exact, at L_g = {support.centre_distance:g} m"
        ),
        "wedges": Metric(value=float(wedges(parts, support, *errors)), unit="", note="1: it may"),
        "enters": Metric(
            value=float(simple.enters(parts, support, *errors)),
            unit="",
            note="1: on the assumed chamfer, and upright enough for the mouth",
        ),
        "onset": Metric(value=onset, unit="m", note=never),
        "onset_ratio": Metric(
            value=onset / parts.wedging_depth, unit="", note=never or "lambda, above 1 no wedge"
        ),
        "onset_simple": Metric(value=simple_onset, unit="m", note=never or by_whitney),
        "peak_force": Metric(
            value=None if stuck else float(force[peak]), unit="N", note=stuck or "in the bore"
        ),
        "peak_force_depth": Metric(value=depth, unit="m"),
        "peak_force_simple": Metric(value=float(simple_peak), unit="N", note=by_whitney),
        "chamfer_force": Metric(
            value=float(np.max(force, where=on_chamfer, initial=0.0)), unit="N"
        ),
    }


def _insertion(scenario: WedgingScenario, start: InitialErrors) -> dict[str, Array]:
    """Return the way down the chamfer, at negative depths, and into the bore.

    The force is NaN where no push slides the peg.
    """
    parts, errors = scenario.parts, (start.lateral, start.rotation)
    above = float(simple.chamfer_depth(parts, start.lateral)) + _REACH * parts.clearance
    depth = np.concatenate(
        [
            np.linspace(-above, 0.0, scenario.points, endpoint=False),
            np.linspace(0.0, scenario.depth, scenario.points),
        ]
    )
    found = equilibrium(parts, scenario.support, *errors, depth)
    return {
        "depth": depth,
        "force": np.where(np.isinf(found.insertion_force), np.nan, found.insertion_force),
        "tilt": found.tilt,
        "contact": found.contact.astype(float),
    }


def _boundaries(scenario: WedgingScenario) -> dict[str, Array]:
    """Return both forms of the sides for every compliance centre, that of the parts first."""
    parts, support = scenario.parts, scenario.support
    lateral = _drawn(parts, scenario.points)
    rows: dict[str, list[Array]] = {}
    for distance in (support.centre_distance, *scenario.centre_distances):
        there = _at_centre(support, distance)
        forms: tuple[Form, ...] = ("simple", "exact")
        bounds = {form: rotation_bounds(parts, there, lateral, form) for form in forms}
        values = {"centre_distance": np.full_like(lateral, distance), "lateral": lateral}
        for form, (lower, upper) in bounds.items():
            values |= {f"{form}_lower": lower, f"{form}_upper": upper}
        for key, of in values.items():
            rows.setdefault(key, []).append(of)
    return {name: column(np.concatenate(of)) for name, of in rows.items()}


def _drawn(parts: PegHoleGeometry, points: int) -> Array:
    """Return the lateral errors of a boundary, m."""
    edge = _BEYOND * max(parts.lateral_limit, parts.chamfer_limit)
    corners = np.array([parts.clearance, parts.chamfer_limit, parts.lateral_limit])
    return np.unique(np.r_[np.linspace(-edge, edge, points), -corners, corners])


def _at_centre(support: Support, distance: float) -> Support:
    return replace(support, centre_distance=distance)


def figures(scenario: WedgingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    starts = {
        name: (start.lateral, start.rotation)
        for name, start in zip(STARTS, scenario.starts(), strict=True)
    }
    ends = None
    if (table := outcome.tables.get("ends")) is not None:
        ends = table["lateral_error"], table["rotational_error"]
    return {"wedging-diagram": plot_wedging(scenario.parts, starts, outcome, ends)}


Points = tuple[Array, Array]  # lateral error, m, and rotation, rad

STARTS: Final[dict[str, tuple[str, Style]]] = {
    "published_mean": ("mean of the ten runs", {"color": "#1b7f5c", "marker": "o"}),
    "published_worst": ("largest of the ten runs", {"color": "#b00020", "marker": "s"}),
    "wedging_prone": ("wedging-prone start, assumed", {"color": "#444444", "marker": "X"}),
}
_EXACT: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.8}
_SIMPLE: Final[Style] = {"color": "#1b4f9c", "linestyle": (0, (4, 2)), "linewidth": 1.2}
_REGION: Final[Style] = {"color": "#dfe7f2", "linewidth": 0}
_GUIDED: Final[Style] = {"color": "#bccde8", "linewidth": 0}
_WEDGE: Final[Style] = {"color": "#b00020", "alpha": 0.10, "linewidth": 0}
_OTHERS: Final = ("#e07b00", "#8f5bb5", "#7a7a7a", "#2a9d9d")
_ENDS: Final[Style] = {"color": "black", "marker": ".", "linestyle": "none", "markersize": 5}
_ARMS: Final[Style] = {"color": "black", "linewidth": 1.2, "linestyle": (0, (1, 1))}
_BELOW: Final[Style] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2)}
_MM: Final = 1e3
_MRAD: Final = 1e3


def plot_wedging(
    parts: PegHoleGeometry,
    starts: Mapping[str, tuple[float, float]],
    outcome: Outcome,
    ends: Points | None = None,
) -> Figure:
    """Draw the diagram, its part with the published errors, and force over depth.

    Args:
        parts: Peg, hole and support.
        starts: Lateral error, m, and rotation, rad, of each of ``STARTS``.
        outcome: With the table of boundaries and a trace of every start.
        ends: Where simulated alignments ended, drawn too if given.
    """
    figure = new_figure(12.0, 6.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
    whole = figure.add_subplot(grid[:, 0])
    near = figure.add_subplot(grid[0, 1])
    force = figure.add_subplot(grid[1, 1])
    table = outcome.tables["boundaries"]
    for axes in (whole, near):
        _region(axes, parts, table)
        _starts(axes, starts)
        if ends is not None:
            _arms(axes, parts, outcome.tables["arms"])
            _points(axes, ends)
    _margins(near, starts, outcome)
    limits = parts.lateral_limit, parts.rotation_limit
    box = Rectangle(
        (-limits[0] * _MM, -limits[1] * _MRAD),
        2 * limits[0] * _MM,
        2 * limits[1] * _MRAD,
        fill=False,
        label="published limits: the no-wedge box",
        **PUBLISHED,
    )
    whole.add_patch(box)
    near.axhline(parts.rotation_limit * _MRAD, **PUBLISHED)
    x, y = "initial lateral error / mm", "initial rotation / mrad"
    dress(whole, title="(a) Free of wedging: shaded", x=x, y=y)
    dress(near, title="(b) Near the published errors, with the margins left", x=x, y=y)
    edge = 1.1 * max(parts.lateral_limit, parts.chamfer_limit) * _MM
    whole.set_xlim(-edge, edge)
    tallest = np.max(np.abs(table["exact_upper"]), where=_own(table), initial=0.0)
    whole.set_ylim(*(np.array([-1.0, 1.0]) * 1.05 * tallest * _MRAD))
    _focus(near, parts, starts, ends)
    legend(whole, ncols=2, **_BELOW | {"bbox_to_anchor": (0.5, -0.09)})
    _force(force, parts, outcome)
    return figure


def _own(table: Table) -> NDArray[np.bool_]:
    """Say which rows belong to the parts' own compliance centre, the first."""
    own: NDArray[np.bool_] = table["centre_distance"] == table["centre_distance"][0]
    return own


def _region(axes: Axes, parts: PegHoleGeometry, table: Table) -> None:
    """Shade what is free of wedging, darker what the chamfer reaches, and draw its sides."""
    chamfer = parts.chamfer_limit * _MM
    axes.axvline(-chamfer, **LIMIT)
    axes.axvline(
        chamfer, label=f"reach of chamfers of {parts.chamfer_width * _MM:g} mm, assumed", **LIMIT
    )
    reached = np.abs(table["lateral"]) <= max(parts.lateral_limit, parts.chamfer_limit)
    own = _own(table)
    x, lower, upper = (
        table[name][own & reached] * scale
        for name, scale in (("lateral", _MM), ("exact_lower", _MRAD), ("exact_upper", _MRAD))
    )
    axes.fill_between(x, lower, upper, **_REGION)
    axes.fill_between(x, lower, upper, where=np.abs(x) <= chamfer, **_GUIDED)
    _sides(axes, table, own & reached, "exact", _EXACT)
    _sides(axes, table, own & reached, "simple", _SIMPLE)
    for i, distance in enumerate(dict.fromkeys(table["centre_distance"][~own].tolist())):
        style: Style = {"color": _OTHERS[i % len(_OTHERS)], "linewidth": 1.0}
        other = (table["centre_distance"] == distance) & reached
        _sides(axes, table, other, "simple", style)


def _sides(axes: Axes, table: Table, rows: NDArray[np.bool_], form: str, style: Style) -> None:
    distance = table["centre_distance"][rows][0] * _MM
    x = table["lateral"][rows] * _MM
    label = f"{form} sides, $L_g$ {distance:.4g} mm"
    axes.plot(x, table[f"{form}_upper"][rows] * _MRAD, label=label, **style)
    axes.plot(x, table[f"{form}_lower"][rows] * _MRAD, **style)


def _starts(axes: Axes, starts: Mapping[str, tuple[float, float]]) -> None:
    for name, (lateral, rotation) in starts.items():
        label, style = STARTS[name]
        axes.plot(
            lateral * _MM, rotation * _MRAD, linestyle="none", ms=6, label=label, zorder=4, **style
        )


def _margins(axes: Axes, starts: Mapping[str, tuple[float, float]], outcome: Outcome) -> None:
    """Write the margins, away from the region's side that they are measured to."""
    for name, (lateral, rotation) in starts.items():
        margin = outcome.metrics[f"{name}.margin"].value
        if margin is not None:
            axes.annotate(
                f"{margin:.0f} %",
                (lateral * _MM, rotation * _MRAD),
                (5, -11 if margin * rotation >= 0 else 5),
                textcoords="offset points",
                fontsize=8,
                color=STARTS[name][1]["color"],
            )


def _arms(axes: Axes, parts: PegHoleGeometry, table: Table) -> None:
    """Draw the sides for the support that the arms are where the simulated ends belong."""
    reached = np.abs(table["lateral"]) <= max(parts.lateral_limit, parts.chamfer_limit)
    x, lower, upper = (
        table[name][reached] * scale
        for name, scale in (("lateral", _MM), ("exact_lower", _MRAD), ("exact_upper", _MRAD))
    )
    axes.plot(x, upper, label="exact sides, the arms of the simulation", **_ARMS)
    axes.plot(x, lower, **_ARMS)


def _points(axes: Axes, ends: Points) -> None:
    lateral, rotation = ends
    axes.plot(lateral * _MM, rotation * _MRAD, label="simulated alignments", zorder=3, **_ENDS)


def _focus(
    axes: Axes,
    parts: PegHoleGeometry,
    starts: Mapping[str, tuple[float, float]],
    ends: Points | None,
) -> None:
    """Show the quadrant of the starts, and every simulated end."""
    lateral, rotation = (np.array(values) for values in zip(*starts.values(), strict=True))
    if ends is not None:
        lateral, rotation = np.append(lateral, ends[0]), np.append(rotation, ends[1])
    right = max(1.5 * float(lateral.max()), 0.0)
    top = max(1.2 * float(rotation.max()), 1.2 * parts.rotation_limit)
    axes.set_xlim(min(0.0, 1.1 * float(lateral.min())) * _MM, right * _MM)
    axes.set_ylim(min(0.0, 1.1 * float(rotation.min())) * _MRAD, top * _MRAD)


def _force(axes: Axes, parts: PegHoleGeometry, outcome: Outcome) -> None:
    traces = outcome.traces
    axes.axvspan(
        0.0, parts.wedging_depth * _MM, label=r"two points may wedge, $\lambda \leq 1$", **_WEDGE
    )
    for i, (label, style) in enumerate(STARTS.values()):
        of = traces["start"] == i
        depth, force = traces["depth"][of] * _MM, traces["force"][of]
        axes.plot(depth, force, color=style["color"], linewidth=1.6, label=label)
        two = np.flatnonzero(traces["contact"][of] == Contact.TWO_POINT)
        if two.size:
            at = two[0]
            axes.plot(depth[at], force[at], linestyle="none", ms=6, **style)
    dress(
        axes,
        title="(c) Force down, if it slides on; marks: two points touch",
        x="depth of the tip in the bore / mm (negative: on the chamfer)",
        y="insertion force / N",
    )
    axes.set_ylim(0.0, 1.08 * float(np.nanmax(traces["force"])))
    legend(axes, ncols=2, **_BELOW)
