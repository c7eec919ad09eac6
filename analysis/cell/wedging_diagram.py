"""Fig. 2 for the paper's parts: from which initial errors a peg goes in without wedging."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import metrics_of, prefixed
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
    REGION,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.fsm_work_cell import MEAN_ERROR, WORST_ERROR
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
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
    # of the paper's figure and its errors; not the support by the cell's arms
    centre_distances: tuple[float, ...] = (0.0, 0.03)  # m, L_g, more regions to draw; assumed
    published_mean: InitialErrors = InitialErrors(lateral=MEAN_ERROR[0], rotation=MEAN_ERROR[1])
    published_worst: InitialErrors = InitialErrors(lateral=WORST_ERROR[0], rotation=WORST_ERROR[1])
    wedging_prone: InitialErrors = InitialErrors(
        lateral=WORST_ERROR[0], rotation=0.05
    )  # in the box; assumed
    alignment: RepeatabilityScenario | None = field(
        default_factory=lambda: RepeatabilityScenario(trials=10)
    )  # whose final errors are drawn, with these parts, ten as in section 5; null: none
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

    def starts(self) -> dict[str, InitialErrors]:
        """Return the starts in the order of ``STARTS``."""
        return {name: getattr(self, name) for name in STARTS}


def _require_of(parts: ColouredParts, aligned: ColouredParts) -> None:
    """Refuse parts that are aligned and are not those of the diagram."""
    for one in fields(ColouredParts):
        own, value = getattr(parts, one.name), getattr(aligned, one.name)
        if value not in (own, getattr(ColouredParts, one.name)):
            raise ParameterError(f"alignment.parts.{one.name}", value, f"that of parts, {own!r}")


@dataclass(frozen=True, kw_only=True)
class ResolvedWedgingScenario(WedgingScenario):
    """The scenario with the alignments resolved, with the diagram's parts."""

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
    worst = replace(support, centre_distance=support.worst_centre_distance)
    at = f"at L_g = {worst.centre_distance:.4g} m"
    needed, for_limit = (
        float(chamfer_needed(parts, lateral))
        for lateral in (scenario.published_worst.lateral, parts.lateral_limit)
    )
    metrics = metrics_of(
        {
            "clearance_ratio": (parts.clearance_ratio, ""),
            "rotation_limit": (parts.rotation_limit, "rad"),
            "lateral_limit": (parts.lateral_limit, "m", "R + r"),
            "chamfer_limit": (parts.chamfer_limit, "m", "W assumed"),
            "wedging_depth": (parts.wedging_depth, "m", "2 mu r"),
            "tilt_per_error": (support.tilt_per_error, "rad/m", "slope of the region's sides"),
            "largest_tilt_per_error": (worst.tilt_per_error, "rad/m", at),
            "chamfer_needed": (needed, "m", "for the largest lateral error of the ten runs"),
            "chamfer_needed_for_limit": (for_limit, "m", "for the published lateral limit"),
        }
    )
    paths = []
    for i, (name, start) in enumerate(scenario.starts().items()):
        path = _insertion(scenario, start)
        paths.append({"start": np.full(len(path["depth"]), float(i)), **path})
        metrics |= prefixed(name, _measure(scenario, start, path))
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
        metrics=metrics, traces=_stacked(paths), simulated_seconds=simulated, tables=tables
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
    enters = float(simple.enters(parts, support, *errors))
    upright = "1: on the assumed chamfer, and upright enough for the mouth"
    least = "the least over L_g, at"
    return metrics_of(
        {
            "box_margin.lateral": (100 * float(box.lateral), "%"),
            "box_margin.rotation": (100 * float(box.rotation), "%"),
            "parallelogram_margin": (100 * simple_least, "%", f"{least} {simple_at:.3g} m"),
            "exact_margin": (100 * exact_least, "%", f"{least} {exact_at:.3g} m"),
            "margin": (100 * here, "%", f"exact, at L_g = {support.centre_distance:g} m"),
            "wedges": (float(wedges(parts, support, *errors)), "", "1: it may"),
            "enters": (enters, "", upright),
            "onset": (onset, "m", never),
            "onset_ratio": (onset / parts.wedging_depth, "", never or "lambda, above 1 no wedge"),
            "onset_simple": (simple_onset, "m", never or by_whitney),
            "peak_force": (None if stuck else float(force[peak]), "N", stuck or "in the bore"),
            "peak_force_depth": (depth, "m"),
            "peak_force_simple": (float(simple_peak), "N", by_whitney),
            "chamfer_force": (float(np.max(force, where=on_chamfer, initial=0.0)), "N"),
        }
    )


def _insertion(scenario: WedgingScenario, start: InitialErrors) -> dict[str, Array]:
    """Return the way down the chamfer, at negative depths, and into the bore.

    The force is NaN where no push slides the peg.
    """
    parts, errors = scenario.parts, (start.lateral, start.rotation)
    above = float(simple.chamfer_depth(parts, start.lateral)) + _REACH * parts.clearance
    on_chamfer = np.linspace(-above, 0.0, scenario.points, endpoint=False)
    depth = np.concatenate([on_chamfer, np.linspace(0.0, scenario.depth, scenario.points)])
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
    forms: tuple[Form, ...] = ("simple", "exact")
    tables = []
    for distance in (support.centre_distance, *scenario.centre_distances):
        there = replace(support, centre_distance=distance)
        table = {"centre_distance": np.full_like(lateral, distance), "lateral": lateral}
        for form in forms:
            table[f"{form}_lower"], table[f"{form}_upper"] = rotation_bounds(
                parts, there, lateral, form
            )
        tables.append(table)
    return _stacked(tables)


def _stacked(tables: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return tables of the same columns one below the other."""
    return {name: column(np.concatenate([of[name] for of in tables])) for name in tables[0]}


def _drawn(parts: PegHoleGeometry, points: int) -> Array:
    """Return the lateral errors of a boundary, m."""
    edge = _BEYOND * max(parts.lateral_limit, parts.chamfer_limit)
    corners = np.array([parts.clearance, parts.chamfer_limit, parts.lateral_limit])
    return np.unique(np.r_[np.linspace(-edge, edge, points), -corners, corners])


STARTS: Final[dict[str, tuple[str, Style]]] = {
    "published_mean": ("mean of the ten runs", {"color": "#1b7f5c", "marker": "o"}),
    "published_worst": ("largest of the ten runs", {"color": "#b00020", "marker": "s"}),
    "wedging_prone": ("wedging-prone start, assumed", {"color": "#444444", "marker": "X"}),
}
_EXACT: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.8}
_SIMPLE: Final[Style] = {"color": "#1b4f9c", "linestyle": (0, (4, 2)), "linewidth": 1.2}
_GUIDED: Final[Style] = {"color": "#bccde8", "linewidth": 0}
_WEDGE: Final[Style] = {"color": "#b00020", "alpha": 0.10, "linewidth": 0}
_OTHERS: Final = ("#e07b00", "#8f5bb5", "#7a7a7a", "#2a9d9d")
_ENDS: Final[Style] = {"color": "black", "marker": ".", "linestyle": "none", "markersize": 5}
_ARMS: Final[Style] = {"color": "black", "linewidth": 1.2, "linestyle": (0, (1, 1))}
_MM: Final = 1e3
_MRAD: Final = 1e3


def figures(scenario: WedgingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the diagram, its part with the published errors, and force over depth."""
    parts, ends = scenario.parts, outcome.tables.get("ends")
    starts = {name: (one.lateral, one.rotation) for name, one in scenario.starts().items()}
    points = [*starts.values()]
    if ends is not None:
        points += zip(ends["lateral_error"], ends["rotational_error"], strict=True)
    wedge = sum(bool(outcome.metrics[f"{name}.wedges"].value) for name in starts)
    says = f"{wedge or 'None'} of {len(starts)} starts can wedge"
    figure = new_figure(
        height=9.5,
        caption=f"{says}: the published errors and an assumed one in the wedging diagram (a, b), "
        "with the margin that each leaves, and the force of an insertion from each (c).",
    )
    mosaic = figure.subplot_mosaic("ww;nf", height_ratios=(1.3, 1))
    whole, near, force = (mosaic[name] for name in "wnf")
    table = outcome.tables["boundaries"]
    for axes in (whole, near):
        _region(axes, parts, table)
        for name, (lateral, rotation) in starts.items():
            label, style = STARTS[name]
            look: Style = {"linestyle": "none", "ms": 6, "label": label, "zorder": 4, **style}
            axes.plot(lateral * _MM, rotation * _MRAD, **look)
        if ends is not None:
            arms = outcome.tables["arms"]
            of = np.abs(arms["lateral"]) <= max(parts.lateral_limit, parts.chamfer_limit)
            sides = arms["exact_lower"][of], arms["exact_upper"][of]
            label = "exact sides, simulated arms"
            draw_sides(axes, arms["lateral"][of], sides, label, _ARMS)
            shown = ends["lateral_error"] * _MM, ends["rotational_error"] * _MRAD
            axes.plot(*shown, label="simulated alignments", zorder=3, **_ENDS)
    _margins(near, starts, outcome)
    limits = parts.lateral_limit, parts.rotation_limit
    right, top = limits[0] * _MM, limits[1] * _MRAD
    look = {"fill": False, "label": "published limits: the no-wedge box", **PUBLISHED}
    whole.add_patch(Rectangle((-right, -top), 2 * right, 2 * top, **look))
    near.axhline(parts.rotation_limit * _MRAD, **PUBLISHED)
    x, y = "initial lateral error / mm", "initial rotation / mrad"
    dress(whole, title=f"(a) {says} (shaded: free of wedging)", x=x, y=y)
    dress(near, title="(b) Margins to wedging", x=x, y=y)
    edge = 1.1 * max(parts.lateral_limit, parts.chamfer_limit) * _MM
    whole.set_xlim(-edge, edge)
    tallest = np.max(np.abs(table["exact_upper"]), where=_own(table), initial=0.0)
    whole.set_ylim(*(np.array([-1.0, 1.0]) * 1.05 * tallest * _MRAD))
    # The quadrant of the starts, and every simulated end.
    x_of, y_of = _MM * np.transpose(points)
    near.set_xlim(min(0.0, 1.1 * x_of.min()), max(1.5 * x_of.max(), 0.0))
    near.set_ylim(min(0.0, 1.1 * y_of.min()), 1.2 * max(y_of.max(), top))
    legend(whole, ncols=3)
    _force(force, parts, outcome)
    return {"wedging-diagram": figure}


def _own(table: Table) -> NDArray[np.bool_]:
    """Say which rows belong to the parts' own compliance centre, the first."""
    own: NDArray[np.bool_] = table["centre_distance"] == table["centre_distance"][0]
    return own


def draw_sides(
    axes: Axes, lateral: Array, sides: tuple[Array, Array], label: str, style: Style
) -> None:
    """Draw the lower and the upper side of a region, rad, over the lateral error, m."""
    for side, named in zip(sides, (None, label), strict=True):
        axes.plot(_MM * lateral, _MRAD * side, label=named, **style)


def draw_reach(axes: Axes, parts: PegHoleGeometry, label: str | None = None) -> None:
    """Draw how far off the chamfers still guide a peg into the hole."""
    for side, named in ((-1, None), (1, label)):
        axes.axvline(side * parts.chamfer_limit * _MM, label=named, **LIMIT)


def _region(axes: Axes, parts: PegHoleGeometry, table: Table) -> None:
    """Shade what is free of wedging, darker what the chamfer reaches, and draw its sides."""
    draw_reach(axes, parts, f"reach of chamfers of {parts.chamfer_width * _MM:g} mm, assumed")
    reached = np.abs(table["lateral"]) <= max(parts.lateral_limit, parts.chamfer_limit)
    own = _own(table)
    rows = own & reached
    x, lower, upper = (table[name][rows] for name in ("lateral", "exact_lower", "exact_upper"))
    bounds = x * _MM, lower * _MRAD, upper * _MRAD
    axes.fill_between(*bounds, **REGION)
    axes.fill_between(*bounds, where=np.abs(x) <= parts.chamfer_limit, **_GUIDED)
    _sides(axes, table, rows, "exact", _EXACT)
    _sides(axes, table, rows, "simple", _SIMPLE)
    for i, distance in enumerate(dict.fromkeys(table["centre_distance"][~own].tolist())):
        style: Style = {"color": _OTHERS[i % len(_OTHERS)], "linewidth": 1.0}
        other = (table["centre_distance"] == distance) & reached
        _sides(axes, table, other, "simple", style)


def _sides(axes: Axes, table: Table, rows: NDArray[np.bool_], form: str, style: Style) -> None:
    distance = table["centre_distance"][rows][0] * _MM
    sides = table[f"{form}_lower"][rows], table[f"{form}_upper"][rows]
    label = f"{form} sides, $L_g$ {distance:.4g} mm"
    draw_sides(axes, table["lateral"][rows], sides, label, style)


def _margins(axes: Axes, starts: Mapping[str, tuple[float, float]], outcome: Outcome) -> None:
    """Write the margins, away from the region's side that they are measured to."""
    for name, (lateral, rotation) in starts.items():
        margin = outcome.metrics[f"{name}.margin"].value
        if margin is not None:
            look: Style = {"textcoords": "offset points", "fontsize": 8}
            away = 5, -11 if margin * rotation >= 0 else 5
            there, colour = (lateral * _MM, rotation * _MRAD), STARTS[name][1]["color"]
            axes.annotate(f"{margin:.0f} %", there, away, color=colour, **look)


def _force(axes: Axes, parts: PegHoleGeometry, outcome: Outcome) -> None:
    traces = outcome.traces
    may = r"two points may wedge, $\lambda \leq 1$"
    axes.axvspan(0.0, parts.wedging_depth * _MM, label=may, **_WEDGE)
    for i, (label, style) in enumerate(STARTS.values()):
        of = traces["start"] == i
        depth, force = traces["depth"][of] * _MM, traces["force"][of]
        axes.plot(depth, force, color=style["color"], linewidth=1.6, label=label)
        for at in np.flatnonzero(traces["contact"][of] == Contact.TWO_POINT)[:1]:
            axes.plot(depth[at], force[at], linestyle="none", ms=6, **style)
    title = f"(c) Force peaks at {np.nanmax(traces['force']):.2g} N (marks: second contact point)"
    x = "depth of the tip in the bore / mm\n(negative: on the chamfer)"
    dress(axes, title=title, x=x, y="insertion force / N")
    axes.set_ylim(0.0, 1.08 * float(np.nanmax(traces["force"])))
    legend(axes)
