"""The jamming diagram over depth, with the loads of simulated insertions in it and outside."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import courses
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.drawing.figure_style import LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.insertion.insertion_runs import (
    WINDOW,
    Insertion,
    insert,
    is_seated,
    jamming_loads,
    median,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.insertion.peg_insertion import (
    FeedScenario,
    FeedSupport,
    PegInsertionScenario,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg_theory.wedging import jamming_level, jamming_vertices
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_MOVING: Final = 0.1  # of the feed's speed, below it the peg is stopped
_PUSHED: Final = 0.99  # of the cap, which a peg that is stopped is pushed with
_SETTLED: Final = 2 * WINDOW  # s, after which two points that touch share the load
# Of the level: closer to a side than that is on it, where the theory is not sure.
_ON_SIDES: Final = 0.07


@dataclass(frozen=True, kw_only=True)
class JammingScenario:
    """An insertion with several starts: some slide in, some are stopped by the cap.

    The centre of compliance is far from the tip, so that the moment of the push jams pegs too
    that are too deep to wedge.
    """

    insertion: FeedScenario = field(
        default_factory=lambda: FeedScenario(
            support=FeedSupport(centre_distance=0.3), depth=0.03, gap=0.002, speed=0.04
        )
    )  # the starts are below
    tilts: tuple[float, ...] = (0.02, 0.03, 0.04, 0.05, 0.06)  # rad, of the starts
    laterals: tuple[float, ...] = (0.0, 0.001)  # m, of the starts, each with each tilt
    depth_ratios: tuple[float, ...] = (0.9, 1.2, 1.6, 2.2)  # lambda, of the drawn parallelograms

    def __post_init__(self) -> None:
        for name in ("tilts", "laterals"):
            values = getattr(self, name)
            if not values or not all(map(math.isfinite, values)):
                raise ParameterError(name, values, "finite numbers, at least one")
        if not all(0 < ratio < math.inf for ratio in self.depth_ratios):
            raise ParameterError("depth_ratios", self.depth_ratios, "finite numbers > 0, or none")
        self.starts()  # each checks itself

    def starts(self) -> list[PegInsertionScenario]:
        """Return the insertions."""
        feed = {one.name: getattr(self.insertion, one.name) for one in fields(self.insertion)}
        return [
            PegInsertionScenario(**feed, lateral=lateral, tilt=tilt)
            for lateral in self.laterals
            for tilt in self.tilts
        ]


JAMMING: Final = JammingScenario()


def resolve(scenario: JammingScenario) -> JammingScenario:
    """Resolve the insertion."""
    return replace(scenario, insertion=resolve_peg_insertion(scenario.insertion))


def loads(scenario: PegInsertionScenario) -> Row:
    """Run an insertion, and return the loads while it touches at two points, a row a sample.

    ``depth`` l in m, ``force_ratio`` F_x / F_z, ``moment_ratio`` M / (r F_z), ``level`` in the
    diagram, 1 on its sides, ``moving`` or else stopped; and whether the peg is ``seated``.
    """
    run = insert(scenario, withdraw=False)
    depth, force_ratio, moment_ratio = load_ratios(scenario, run)
    speed = median(np.gradient(run.depth, run.time), scenario.step)
    moving = speed > _MOVING * scenario.speed
    stopped = ~moving & (run.push > _PUSHED * scenario.force_cap)
    two = _settled(run.two_point, scenario.step) & (depth > 0)
    of = two & (moving | stopped)
    l_of, across, turning = (one[of] for one in (depth, force_ratio, moment_ratio))
    return {
        "depth": l_of,
        "force_ratio": across,
        "moment_ratio": turning,
        "moving": moving[of],
        "level": jamming_level(scenario.parts, across, turning, l_of),
        "seated": is_seated(scenario, run),
    }


def load_ratios(scenario: PegInsertionScenario, run: Insertion) -> tuple[Array, Array, Array]:
    """Return l, F_x / F_z and M / (r F_z) of the support's load on the peg, at every step."""
    L_g = scenario.support.centre_distance
    columns = {
        "depth": run.depth,
        "lateral": run.joints[:, 1] - L_g * np.sin(run.tilt),
        "tilt": run.tilt,
        **{name: run.wrench[:, k] for k, name in ((2, "turning"), (3, "force_x"), (4, "across"))},
    }
    depth, _, *ratios = jamming_loads(scenario.parts, columns, scenario.step)
    return depth, ratios[0], ratios[1]


def _settled(touching: NDArray[np.bool_], step: float) -> NDArray[np.bool_]:
    """Say where something has been so for a while."""
    count = np.arange(len(touching))
    since = count - np.maximum.accumulate(np.where(touching, -1, count))
    return np.asarray(touching & (since * step > _SETTLED))


def run(scenario: JammingScenario, seed: int, progress: Progress) -> Outcome:
    """Run every start; nothing is random."""
    starts = scenario.starts()
    found = run_each(loads, starts, progress)
    parts = scenario.insertion.parts
    names = ("depth", "force_ratio", "moment_ratio", "level", "moving")
    traces = courses(found.rows, names, start=[float(starts.index(one)) for one in found.tasks])
    traces["depth_ratio"] = traces["depth"] / parts.wedging_depth
    moving, jammed = traces["moving"] > 0, traces["level"] >= 1
    on_sides = np.abs(traces["level"] - 1) <= _ON_SIDES
    off = f"more than {100 * _ON_SIDES:g} % off the sides"
    metrics = {
        "agreement": _mean(
            (jammed != moving)[~on_sides], f"of the loads {off}: inside and moving, or stopped"
        ),
        "moving.on_sides": _mean(
            on_sides[moving], f"of the loads of pegs that move: within {100 * _ON_SIDES:g} %"
        ),
        "stopped.outside": _mean(jammed[~moving], "of the loads of pegs that the cap stops"),
        "moving.level": _mean(traces["level"][moving], "mean; 1: on the sides"),
        "stopped.level": _mean(traces["level"][~moving], "mean; 1: on the sides"),
        "seated": Metric(
            value=float(found.column("seated").sum()), unit="", note=f"of {len(found)} starts"
        ),
    }
    return Outcome(
        metrics=metrics,
        traces={name: column(values) for name, values in traces.items()},
        simulated_seconds=sum(one.released for one in found.tasks),
    )


def _mean(values: NDArray[Any], note: str) -> Metric:
    """Return a mean, of what is true or not as a share in %."""
    share = values.dtype == bool
    unit = "%" if share else ""
    if not values.size:
        return Metric(value=None, unit=unit, note="there are no such loads")
    return Metric(value=(100 if share else 1) * float(np.mean(values)), unit=unit, note=note)


DEPTH_SCALE: Final = LogNorm(0.4, 5.0)  # of depth ratios lambda
DEPTH_COLOURS: Final = ScalarMappable(DEPTH_SCALE, "viridis")
_NEAR: Final = 0.04  # of a depth ratio, loads that are drawn into its parallelogram
_MOVES: Final[Style] = {"marker": "o", "linestyle": "none", "markersize": 3}
_STOPPED: Final[Style] = {"marker": "x", "linestyle": "none", "markersize": 5}
_FEW: Final = 60  # loads of a kind that are drawn


def _colour(ratio: float) -> Any:
    return DEPTH_COLOURS.to_rgba(np.array([ratio]))[0]


def draw_parallelogram(axes: Axes, parts: PegHoleGeometry, ratio: float) -> None:
    """Draw the loads that slide at a depth ratio lambda."""
    corners = jamming_vertices(parts, ratio * parts.wedging_depth)
    closed = np.vstack([corners, corners[:1]])
    axes.plot(*closed.T, color=_colour(ratio), label=rf"slides at $\lambda$ = {ratio:g}")


def figures(scenario: JammingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the loads at several depths, and the level of all loads over the depth."""
    traces, parts = outcome.traces, scenario.insertion.parts
    moving = traces["moving"] > 0
    agree = metric_value(outcome.metrics, "agreement")
    figure = new_figure(
        height=4.8,
        caption=f"Theory and simulation agree for {agree:.3g} % of the loads away from the sides "
        "whether the peg slides or jams; inside the line of its depth ratio \u03bb a load slides.",
    )
    diagram, levels = figure.subplots(1, 2)
    for ratio in scenario.depth_ratios:
        colour = _colour(ratio)
        draw_parallelogram(diagram, parts, ratio)
        near = np.abs(traces["depth_ratio"] / ratio - 1) < _NEAR
        for of, style in ((near & moving, _MOVES), (near & ~moving, _STOPPED)):
            rows = np.flatnonzero(of)
            rows = rows[:: max(1, len(rows) // _FEW)]
            diagram.plot(
                traces["force_ratio"][rows], traces["moment_ratio"][rows], color=colour, **style
            )
    title = "(a) Simulated loads: dots move, crosses are stopped"
    dress(diagram, title=title, x="$F_x / F_z$", y="$M / (r F_z)$")
    legend(diagram, ncols=2)
    for of, style, label, ink in (
        (moving, _MOVES, "moves", "#1b4f9c"),
        (~moving, _STOPPED, "stopped by the cap", "#b00020"),
    ):
        of_kind = traces["depth_ratio"][of], traces["level"][of]
        levels.plot(*of_kind, color=ink, label=label, **style)
    levels.axhline(1.0, label="sides of the parallelogram", **LIMIT)
    title = "(b) Level of each load: theory lets it slide below 1"
    dress(levels, title=title, x=r"$\lambda = l / (2 r \mu)$", y="level")
    levels.set_ylim(0.0, None)
    legend(levels, ncols=2)
    return {"jamming-diagram": figure}
