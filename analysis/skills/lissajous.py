"""Fig. 2: the area that two dithers with the frequency ratio (N + 1) / N cover."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_style import FSM, Style, dress, legend, new_figure
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.skills.dither_loops import make_search_diagram
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.primitives.trajectory_primitives import Dither, lissajous

Array = NDArray[np.float64]

_SAMPLES = 1600  # of a cycle: held velocities move the centre by pi A over it
_GRID = 201  # points to a side, at which the distance to the pattern is measured
_PATTERN: Final[Style] = {"color": "#1b4f9c", "linewidth": 0.9}
_SHOWN: Final = 4  # patterns


@dataclass(frozen=True, kw_only=True)
class LissajousScenario:
    """A search along x and y; the paper prints neither amplitudes nor frequencies."""

    amplitude: float = 0.002  # m, of both dithers; assumed
    frequency: float = 1.0  # Hz, of the slower one; assumed
    repeats: tuple[int, ...] = (2, 4, 8, 16)  # N, cycles until the pattern repeats; assumed

    def __post_init__(self) -> None:
        if not self.repeats or not all(1 <= n <= 64 for n in self.repeats):
            raise ParameterError("repeats", self.repeats, "one or more whole numbers, 1 to 64")
        if len(set(self.repeats)) != len(self.repeats):
            raise ParameterError("repeats", self.repeats, "different numbers")
        require_positive(self, "amplitude", "frequency")


LISSAJOUS: Final = LissajousScenario()


def run(scenario: LissajousScenario, seed: int, progress: Progress) -> Outcome:
    """Integrate the velocities for every N and measure the covered area."""
    amplitude = scenario.amplitude
    finished = run_each(partial(_search, scenario), scenario.repeats, progress)
    rows = {n: its.rows[0] for n, its in finished.split(scenario.repeats, lambda n: n).items()}
    metrics: dict[str, Metric] = {}
    for n, row in rows.items():
        position, radius = row["position"], row["covering_radius"]
        metrics |= {
            f"covering_radius.n{n}": Metric(value=radius, unit="m"),
            f"covering_ratio.n{n}": Metric(
                value=radius * n / amplitude, unit="", note="radius N / amplitude"
            ),
            f"theory.covering_radius.n{n}": Metric(
                value=theory(n, amplitude), unit="m", note="for large N"
            ),
            f"centre_offset.n{n}": Metric(
                value=round(float(np.abs(position.mean(axis=0)).max()), 9), unit="m"
            ),
            f"duration.n{n}": Metric(value=row["duration"], unit="s"),
        }
    each = [row["position"] for row in rows.values()]
    apart = max(row["apart"] for row in rows.values())
    metrics["repeats_after"] = Metric(value=round(apart, 12), unit="m")
    metrics["sine_start.offset"] = Metric(
        value=amplitude, unit="m", note="of the centre, if the velocity began as a sine"
    )
    first, second = np.concatenate(each).T
    traces = {
        "repeats": np.repeat(column(list(rows)), [len(position) for position in each]),
        "time": np.concatenate([row["time"] for row in rows.values()]),
        "first": first.copy(),
        "second": second.copy(),
    }
    simulated = sum(row["duration"] for row in rows.values())
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=simulated)


def _search(scenario: LissajousScenario, repeats: int) -> Row:
    """Return a search's ``position`` m, shape (n, 2), at ``time`` s, and its coverage.

    It runs twice in a row: ``apart``, m, is the distance of the second pattern from the first.
    """
    slow = Dither(axis="x", amplitude=scenario.amplitude, frequency=scenario.frequency)
    dithers = lissajous(first=slow, axis="y", repeats=repeats)
    duration = dithers[0].duration
    step = 1 / (_SAMPLES * dithers[1].frequency)
    twice = [replace(dither, cycles=2 * dither.cycles) for dither in dithers]
    found = simulate(
        make_search_diagram(twice, step=step), duration=2 * duration + step / 2, step=step
    )
    both = found.outputs["displacement"][:, [dither.index for dither in dithers]]
    end = round(duration / step)
    position = both[: end + 1]
    return {
        "time": found.time[: end + 1],
        "position": position,
        "apart": float(np.abs(both[end : 2 * end + 1] - position).max()),
        "duration": duration,
        "covering_radius": covering_radius(position, scenario.amplitude),
    }


def covering_radius(position: Array, amplitude: float) -> float:
    """Return the largest distance of a point of the searched square to the pattern, m.

    The tool's ``position`` is dense, m, shape (n, 2); ``amplitude`` is half the square's side, m.
    """
    side = np.linspace(-amplitude, amplitude, _GRID)
    x, y = np.meshgrid(side, side)
    distance, _ = cKDTree(position).query(np.column_stack([x.ravel(), y.ravel()]))
    return float(np.max(distance))


def theory(repeats: int, amplitude: float) -> float:
    """Return a covering radius for large N, m.

    In the middle of the square the pattern's lines have the slopes +-1 in phase; neighbours are
    ``pi A / N`` apart along an axis, and a cell between them, a square on its tip, has that as its
    diagonal: half of a side is ``pi A / (2 sqrt(2) N)``.
    """
    return math.pi * amplitude / (2 * math.sqrt(2) * repeats)


def figures(scenario: LissajousScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw the first patterns and the covering radius over N."""
    repeats, amplitude = scenario.repeats, scenario.amplitude
    shown = list(repeats)[:_SHOWN]
    caption = (
        "Lissajous patterns with N cycles, and the largest distance of a point of the square from "
        "a pattern, measured and by theory. Denser patterns take longer."
    )
    figure = new_figure(8.0, 5.4, caption=caption)
    grid = figure.add_gridspec(2, 4, height_ratios=(1.0, 1.4))
    traces = outcome.traces
    for i, n in enumerate(shown):
        axes = figure.add_subplot(grid[0, i])
        of = traces["repeats"] == n
        axes.plot(1e3 * traces["first"][of], 1e3 * traces["second"][of], **_PATTERN)
        corner = -1e3 * amplitude
        axes.add_patch(Rectangle((corner, corner), -2 * corner, -2 * corner, fill=False, lw=0.6))
        axes.set_aspect("equal")
        title = f"({'abcd'[i]}) N = {n}"
        dress(axes, title=title, x="slower axis / mm", y="y / mm" if i == 0 else "")
    axes = figure.add_subplot(grid[1, :])
    radii, expected = (
        np.array([outcome.metrics[f"{name}.n{n}"].value for n in repeats], dtype=np.float64)
        for name in ("covering_radius", "theory.covering_radius")
    )
    axes.loglog(repeats, 1e3 * radii, marker="o", label="measured", **FSM)
    axes.loglog(
        repeats,
        1e3 * expected,
        color="black",
        linestyle=":",
        label=r"$\pi A / (2 \sqrt{2} N)$, for large N",
    )
    axes.set_xticks(list(repeats), [str(n) for n in repeats])
    ticks = [0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
    axes.set_yticks(ticks, [f"{one:g}" for one in ticks])
    axes.minorticks_off()
    axes.set_ylim(0.8e3 * float(np.nanmin(radii)), 1.25e3 * float(np.nanmax(expected)))
    title = (
        f"({'abcde'[len(shown)]}) The covering radius falls from {1e3 * radii[0]:.2g} to "
        f"{1e3 * radii[-1]:.2g} mm"
    )
    dress(axes, title=title, x="N, cycles until the pattern repeats", y="covering radius / mm")
    legend(axes)
    return {"lissajous": figure}
