"""The kinds of panel that most figures consist of: each one call on arrays.

Lines over time with states or losses behind them, distributions, intervals in rows, shares
as stacked bars and tables of counts. Colours are those of ``figure_style``.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from numpy.typing import ArrayLike, NDArray

from chamfer.analysis.drawing.figure_style import (
    ABOVE,
    BAND,
    BESIDE,
    FORCE,
    NOTE,
    Style,
    dress,
    legend,
)

Array = NDArray[np.float64]
Visit = tuple[float, float, str]  # begin and end, s, and what is said of it

PLACES: Final[dict[str, Style]] = {"below": {}, "beside": BESIDE, "above": ABOVE}  # of legends
VISITS: Final = ("#ffffff", "#eceff4")  # behind curves, in turns
_STRIP: Final = ("#cfe0f5", "#f9dcb8")
_BAD: Final = "#f3b6b6"
_WRONG: Final = ("jammed", "tilted", "timed out", "failed")  # ends of a visit's name
_APART: Final = 0.018  # of the width, of two names
_BARS: Final = 40  # of a distribution
_LEAST_SHARE: Final = 8.0  # %, of a bar that is labelled


class HasValue(Protocol):
    """A metric."""

    @property
    def value(self) -> float | None:
        """The number, None where it is undefined."""


def metric_value(metrics: Mapping[str, HasValue], name: str, scale: float = 1.0) -> float:
    """Return a metric's value times ``scale``, NaN where it is undefined or was not measured."""
    value = metrics[name].value if name in metrics else None
    return math.nan if value is None else scale * value


@dataclass(frozen=True)
class Curve:
    """A curve over the panel's abscissa."""

    values: ArrayLike
    label: str | None
    style: Style
    over: ArrayLike | None = None  # its own abscissa


@dataclass(frozen=True)
class ReferenceLine:
    """A horizontal line; upright if it is at an abscissa."""

    at: float
    label: str | None
    style: Style
    upright: bool = False


@dataclass(frozen=True)
class FilledBand:
    """The room between two curves, or between two levels over the whole width."""

    low: ArrayLike
    high: ArrayLike
    label: str | None
    style: Style | None = None  # that of a band


def draw_lines(
    axes: Axes,
    x: ArrayLike,
    lines: Sequence[Curve],
    *,
    title: str,
    y: str,
    over: str = "time / s",
    bands: Sequence[FilledBand] = (),
    levels: Sequence[ReferenceLine] = (),
    log: bool = False,
    key: str | None = None,
    columns: int = 1,
) -> None:
    """Draw bands, lines and levels, one in front of the other, over an abscissa.

    ``y`` and ``over`` are the axes' labels; with ``log`` both are logarithmic. The legend has its
    place ``below``, ``beside`` or ``above`` the axes by its ``key``, None: there is none.
    """
    for band in bands:
        look = {"label": band.label, **(band.style or BAND)}
        if np.ndim(band.low) or np.ndim(band.high):
            axes.fill_between(np.asarray(x), band.low, band.high, **look)
        else:
            axes.axhspan(np.asarray(band.low).item(), np.asarray(band.high).item(), **look)
    for line in lines:
        places = x if line.over is None else line.over
        axes.plot(places, line.values, label=line.label, **line.style)
    for level in levels:
        draw = axes.axvline if level.upright else axes.axhline
        draw(level.at, label=level.label, **level.style)
    if log:
        axes.set(xscale="log", yscale="log")
    dress(axes, title=title, x=over, y=y)
    if key is not None:
        legend(axes, ncols=columns, **PLACES.get(key, {"loc": key}))


def trial_curves(
    time: Array, values: Array, trials: Array, style: Style, label: str | None = None
) -> list[Curve]:
    """Return each trial's curve over its own time; one label is for all of them."""
    curves: list[Curve] = []
    for trial in np.unique(trials):
        of = trials == trial
        curves.append(Curve(values[of], None if curves else label, style, time[of]))
    return curves


def time_axes(
    figure: Figure | SubFigure,
    time: Array,
    heights: Sequence[float],
    *,
    visits: Sequence[Visit] = (),
    strip: float = 0.0,
) -> list[Axes]:
    """Return axes below one another over one time, s, with the visits to states behind.

    A strip of that height on top names the states; its axes are not returned.
    """
    rows = [*([strip] if strip else []), *heights]
    grid = figure.subplots(len(rows), 1, sharex=True, height_ratios=rows, squeeze=False)
    drawn: list[Axes] = list(grid[:, 0])
    axes = drawn[-len(heights) :]
    for one in axes:
        for i, (begin, end, _) in enumerate(visits):
            one.axvspan(begin, end, color=VISITS[i % 2], linewidth=0, zorder=0)
    if strip:
        draw_strip(drawn[0], visits, float(time[-1]))
    axes[-1].set_xlim(float(time[0]), float(time[-1]))
    return axes


def state_visits(time: Array, states: ArrayLike, names: Sequence[str]) -> list[Visit]:
    """Return the visits to states from their numbers at every time."""
    numbers = np.asarray(states).astype(int)
    begins = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
    ends = [*begins[1:], len(numbers) - 1]
    return [
        (float(time[begin]), float(time[end]), names[numbers[begin]])
        for begin, end in zip(begins, ends, strict=True)
    ]


def draw_strip(axes: Axes, visits: Sequence[Visit], duration: float) -> None:
    """Draw a strip of states; names stand above theirs, or beside if it is too narrow."""
    axes.set_ylim(0.0, 1.0)
    places = spaced(np.array([(begin + end) / 2 for begin, end, _ in visits]) / duration)
    for i, ((begin, end, name), place) in enumerate(zip(visits, places, strict=True)):
        wrong = name.endswith(_WRONG)
        axes.axvspan(begin, end, ymax=0.12, color=_BAD if wrong else _STRIP[i % 2], linewidth=0)
        x = place * duration
        stem: Style = {"color": "#888888", "linewidth": 0.6, "clip_on": False}
        axes.plot([(begin + end) / 2, x], [0.13, 0.24], **stem)
        weight = "bold" if wrong else "normal"
        text: Style = {"rotation": 90, "ha": "center", "va": "bottom", "fontsize": 8}
        axes.text(x, 0.27, name, weight=weight, **text)
    axes.set_axis_off()


def spaced(places: Array) -> Array:
    """Return ascending places, as shares of a width, far enough from each other to be named."""
    moved = places.copy()
    for i in range(1, len(moved)):
        moved[i] = max(moved[i], moved[i - 1] + _APART)
    last = 1.0 - _APART * np.arange(len(moved))[::-1]
    return np.asarray(np.minimum(moved, last))


def shade(axes: Axes, time: Array, where: ArrayLike, label: str, style: Style) -> None:
    """Shade the times at which something holds over the whole height, if there are any.

    It holds from a sample to the next one: what is so at one sample alone is seen too.
    """
    holds = np.array(where, dtype=bool)
    holds[1:] |= holds[:-1].copy()
    if np.any(holds):
        across = {"transform": axes.get_xaxis_transform(), "label": label, **style}
        axes.fill_between(time, 0, 1, where=holds.tolist(), **across)


def colour_bar(axes: Axes, drawn: ScalarMappable, label: str, **options: Any) -> None:
    """Draw the scale of the colours beside axes."""
    bar = axes.figure.colorbar(drawn, ax=axes, **{"shrink": 0.85, **options})
    bar.set_label(label, fontsize=8)
    bar.minorticks_off()
    bar.ax.tick_params(labelsize=8)


def draw_distribution(axes: Axes, values: Array, *, least: float = 0.0) -> None:
    """Draw bars of equal width from zero to the largest value, or to ``least``."""
    known = values[np.isfinite(values)]
    if not len(known):
        axes.text(0.5, 0.5, "no run came to its end", transform=axes.transAxes, **NOTE)
        return
    edges = np.linspace(0.0, 1.05 * max(least, float(known.max())), _BARS + 1)
    look = {"color": FORCE["color"], "edgecolor": "white", "linewidth": 0.5}
    axes.hist(known, bins=edges.tolist(), **look)
    axes.set_xlim(0.0, edges[-1])


def draw_cumulative(axes: Axes, values: Array, style: Style, label: str | None = None) -> None:
    """Draw which share, %, of values >= 0 is up to each of them; what is not finite never is."""
    known = np.sort(values[np.isfinite(values)])
    share = 100 * np.arange(len(known) + 1) / max(len(values), 1)
    axes.step([0.0, *known], share, where="post", label=label, **style)


def draw_means(
    axes: Axes,
    values: Array,
    rows: Array,
    colour: str,
    *,
    offset: float = 0.0,
    height: float = 0.8,
    label: str | None = None,
) -> None:
    """Draw the mean of the values in each row as a bar, and a dot for each; NaN is left out."""
    known = np.isfinite(values)
    if not known.any():
        return
    present = np.unique(rows[known])
    means = [float(values[known & (rows == row)].mean()) for row in present]
    bars: Style = {"height": height, "color": colour, "alpha": 0.55, "label": label}
    axes.barh(present + offset, means, **bars)
    axes.plot(values[known], rows[known] + offset, ".", color=colour, ms=4)


def draw_intervals(
    axes: Axes,
    rows: ArrayLike,
    middle: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    style: Style,
    label: str | None = None,
) -> None:
    """Draw a value in each row, with a line from its lower to its upper end; NaN is left out."""
    axes.hlines(rows, low, high, color=style["color"], linewidth=2.0, alpha=0.45)
    axes.plot(middle, rows, label=label, **{"linestyle": "none", "marker": "o", **style})


def name_rows(axes: Axes, names: Sequence[str], *, apart: Iterable[Axes] = ()) -> None:
    """Write a name beside each row, the first one on top.

    In the axes ``apart``, which share the rows, lines between them take the place of the grid.
    """
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    for one in apart:
        one.grid(False, axis="y")
        for row in range(1, len(names)):
            one.axhline(row - 0.5, color="#dddddd", linewidth=0.8)


def draw_shares(
    axes: Axes,
    rows: Sequence[Mapping[str, float]],
    colours: Mapping[str, str],
    texts: Sequence[Mapping[str, str]] = (),
) -> None:
    """Draw shares, %, as stacked bars, a row of them each.

    A share is written on its bar where it is large enough; ``texts`` have what to write instead,
    however small it is. ``colours`` are in their order from the left.
    """
    for row, shares in enumerate(rows):
        left, own = 0.0, texts[row] if texts else {}
        for name, colour in colours.items():
            share = shares[name]
            axes.barh(row, share, left=left, color=colour, height=0.86)
            if share >= _LEAST_SHARE or (share and name in own):
                dark = 255 * np.dot(to_rgb(colour), (0.3, 0.6, 0.1)) < 128
                ink = "white" if dark else "black"
                middle: Style = {"ha": "center", "va": "center", "fontsize": 8, "color": ink}
                axes.text(left + share / 2, row, own.get(name, f"{share:.0f}"), **middle)
            left += share
    axes.set_xlim(0, 100)
    axes.tick_params(labelsize=8, left=False)
    axes.spines[["top", "right", "left"]].set_visible(False)


def draw_counts(
    axes: Axes, counts: NDArray[np.int_], rows: Sequence[str], columns: Sequence[str]
) -> None:
    """Draw a table of counts (what was said, in rows, against what happened), darker for more."""
    axes.imshow(counts / max(int(counts.sum()), 1), cmap="Blues", vmin=0.0, vmax=1.0)
    for (i, j), count in np.ndenumerate(counts):
        axes.text(j, i, str(count), ha="center", va="center", fontsize=9)
    axes.set_xticks(range(len(columns)), columns, fontsize=8)
    axes.set_yticks(range(len(rows)), rows, fontsize=8)
    axes.tick_params(length=0)


def colour_legend(figure: Figure | SubFigure, colours: Mapping[str, str]) -> None:
    """Draw a legend of colours below the figure."""
    patches = [Patch(color=colour) for colour in colours.values()]
    options: Style = {"loc": "outside lower center", "fontsize": 8, "edgecolor": "none"}
    figure.legend(patches, list(colours), ncols=len(colours), **options)
