"""The figure of a sweep: lines over one field, maps over two, a panel for each of several."""

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import Normalize
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import mean_interval
from chamfer.analysis.drawing.figure_kit import colour_bar
from chamfer.analysis.drawing.figure_style import LOOPS, Style, dress, new_figure
from chamfer.analysis.sweep.sweep import INTERVAL, OK, SweepResult, as_column
from chamfer.analysis.sweep.sweep_design import Drawn, VariedField
from chamfer.analysis.sweep.sweep_effects import (
    MOST_LEVELS,
    Effects,
    intervals,
    ranked,
    sweep_effects,
)

Array = NDArray[np.float64]

_MOST_PANELS: Final = 6
_COLUMNS: Final = 3  # of panels, where each field has one
_MOST_ROWS: Final = 4
_WIDTH: Final = 8.0  # inches
_LARGE: Final = 0.1  # share of a metric's largest effect, from which a title names a field
_MOST_LINES: Final = 8  # in a panel
_MOST_MARKERS: Final = 60  # on a line, before they hide it
_MOST_SHAPES: Final = 1000  # that are drawn as such, and not as a picture of them
_FEW: Final = 6  # places along an axis that get a tick each
_FAR: Final = 50.0  # ratio of values from which an axis is logarithmic
_MAP: Final = "viridis"
_REFUSED: Final[Style] = {"facecolor": "#ffffff", "edgecolor": "#b00020", "hatch": "xxx"}
_UNDEFINED: Final[Style] = {"facecolor": "#ffffff", "edgecolor": "#999999", "hatch": "///"}
_CONTOUR: Final[Style] = {"levels": 5, "colors": "black", "linewidths": 0.8}
_GONE: Final[Style] = {"color": "#b00020", "marker": "x", "linestyle": "", "markersize": 5}
_COLORS: Final = (
    *("#1b4f9c", "#e07b00", "#2e7d32", "#7a0060"),
    *("#0097a7", "#8d6e00", "#d81b60", "#555555"),
)
_MARKERS: Final = "osD^vP*X"
# For lines on any colour.
_HALO: Final[list[AbstractPathEffect]] = [withStroke(linewidth=2.5, foreground="#ffffffb0")]


@dataclass(frozen=True, kw_only=True)
class _FieldAxis:
    """A varied field along an axis."""

    path: str
    label: str
    at: Array  # where each point is
    ticks: tuple[str, ...] = ()  # for values that are no numbers, at 0, 1, ...
    logarithmic: bool = False

    @property
    def places(self) -> Array:
        """The places that points are at, in order."""
        return np.unique(self.at)

    def scaled(self, places: Array) -> Array:
        return np.log(places) if self.logarithmic else places

    def unscaled(self, scaled: Array) -> Array:
        return np.exp(scaled) if self.logarithmic else scaled

    def dress(self, axis: XAxis | YAxis) -> None:
        """Scale an axis, with ticks at the places where they are few."""
        if self.logarithmic:
            axis.axes.set(**{f"{axis.axis_name}scale": "log"})
        if self.ticks:
            axis.set_ticks(self.places, labels=list(self.ticks))
            axis.axes.set(**{f"{axis.axis_name}lim": (-0.5, len(self.ticks) - 0.5)})
        elif len(self.places) <= _FEW:
            axis.set_ticks(self.places, labels=[f"{place:.4g}" for place in self.places])
            axis.set_ticks([], minor=True)

    def edges(self) -> Array:
        """Return the ends of the cells around the places, shape (places + 1,)."""
        places = self.scaled(self.places)
        inner = (places[1:] + places[:-1]) / 2
        first, last = 2 * places[0] - inner[0], 2 * places[-1] - inner[-1]
        return self.unscaled(np.array([first, *inner, last]))


def _field_axis(result: SweepResult, field: VariedField) -> _FieldAxis:
    values = result.table[field.path]
    label = _labelled(field.path, field.unit)
    if values.dtype == object or not np.isfinite(np.ptp(values.astype(np.float64))):
        assert not isinstance(field.spec, Drawn)
        texts = list(map(str, values))
        names = tuple(name for name in map(str, as_column(field.spec)) if name in texts)
        at = np.array([names.index(text) for text in texts], dtype=np.float64)
        return _FieldAxis(path=field.path, label=label, at=at, ticks=names)
    at = values.astype(np.float64)
    far = at.min() > 0 and at.max() > _FAR * at.min() and not isinstance(field.spec, Drawn)
    return _FieldAxis(path=field.path, label=label, at=at, logarithmic=bool(far))


def _labelled(text: str, unit: str) -> str:
    divisor = f"({unit})" if "/" in unit or " " in unit else unit
    return f"{text} / {divisor}" if unit else text


@dataclass(frozen=True, kw_only=True)
class Shown:
    """The metrics that a sweep shows first."""

    fields: list[_FieldAxis]  # that take several values
    metrics: list[str]  # those asked for, or those that depend on a field, by effect
    effects: Effects
    chosen: bool  # by name
    beyond: str  # what an effect has to be beyond

    def claim(self, name: str) -> str:
        """Return how a metric depends on the fields."""
        real = {path: one for path, one in self.effects[name].items() if one.real}
        if not real:
            return f"{name}: no effect beyond {self.beyond}"
        least = _LARGE * max(one.size for one in real.values())
        words: dict[str, list[str]] = {}
        for field in self.fields:
            if field.path in real and real[field.path].size >= least:
                word = "varies" if field.ticks else real[field.path].word
                words.setdefault(word, []).append(field.path.rpartition(".")[2])
        return f"{name} " + ", ".join(f"{w} with {' and '.join(of)}" for w, of in words.items())

    def left_out(self, drawn: int) -> str:
        """Return how many metrics there are beside those drawn, and why they are not."""
        several = len(self.metrics)
        if self.chosen:
            return f"{drawn} of {several} metrics asked for" if drawn < several else ""
        real = any(one.real for of in self.effects.values() for one in of.values())
        which = "depend on a varied field" if real else "change, none beyond scatter"
        text = f"{drawn} of {several} metrics that {which}, largest effects first"
        if rest := len(self.effects) - several:
            text += f"; {rest} others do not beyond {self.beyond if real else 'rounding'}"
        return text


def shown_metrics(result: SweepResult) -> Shown:
    """Return what a sweep's figure and table show first."""
    fields = [_field_axis(result, varied) for varied in result.plan.varied]
    fields = [field for field in fields if len(field.places) > 1]
    effects = sweep_effects(result, {field.path: field.at for field in fields})
    chosen = result.plan.metrics is not None
    every = [name for name in result.metrics.values() if np.isfinite(result.table[name]).any()]
    metrics = every if chosen else ranked(effects)
    exact = result.plan.trials == 1 and (result.plan.design == "grid" or len(fields) == 1)
    return Shown(
        fields=fields,
        metrics=metrics,
        effects=effects,
        chosen=chosen,
        beyond="rounding" if exact else "scatter or rounding",
    )


def plot_sweep(result: SweepResult) -> Figure | None:
    """Draw the metrics over the fields that take several values; None if nothing can be drawn.

    The metrics are those asked for, or those with the largest effects.
    """
    shown = shown_metrics(result)
    fields = shown.fields
    if not fields or not shown.metrics:
        return None
    if len(fields) == 1:
        return _lines(result, fields[0], _panels_of_metrics(result, shown.metrics), shown)
    if len(fields) == 2 and not any(field.ticks for field in fields):
        return _maps(result, fields[0], fields[1], shown)
    if len(fields) == 2:
        over, by = sorted(fields, key=lambda field: bool(field.ticks))
        return _lines(result, over, _panels_of_values(result, by, shown.metrics), shown, by.path)
    return _grid(result, shown)


def _wrapped(title: str) -> str:
    return textwrap.fill(title, 40, break_long_words=False)


def _known(values: Array) -> Array:
    return values[np.isfinite(values)]


def _changes(values: Array) -> bool:
    known = _known(values)
    return len(known) > 1 and float(np.ptp(known)) > 1e-9 * float(np.max(np.abs(known)))


class _Line(NamedTuple):
    metric: str
    points: NDArray[np.intp]
    label: str
    style: Style


def _panels_of_metrics(result: SweepResult, shown: Sequence[str]) -> list[list[_Line]]:
    """Return metrics of the same name and unit as lines of one panel, as of several loops."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in shown:
        groups.setdefault((name.rpartition(".")[2], result.table.units[name]), []).append(name)
    panels = [names[:_MOST_LINES] for names in groups.values()][:_MOST_PANELS]
    owners = list(dict.fromkeys(name.rpartition(".")[0] for names in panels for name in names))
    every = np.arange(len(result.plan.points))

    def line(name: str) -> _Line:
        owner, _, last = name.rpartition(".")
        k = owners.index(owner) % len(_COLORS)
        label, style = LOOPS.get(owner, (owner or last, {"color": _COLORS[k]}))
        return _Line(name, every, label, {**style, "marker": _MARKERS[k]})

    return [list(map(line, names)) for names in panels]


def _panels_of_values(
    result: SweepResult, by: _FieldAxis, shown: Sequence[str]
) -> list[list[_Line]]:
    """Return each metric as a panel, with a line for each value of a field that is no number."""
    styles = [
        LOOPS.get(label, ("", {"color": color}))[1]
        for label, color in zip(by.ticks, _COLORS, strict=False)
    ]
    looks = list(zip(by.ticks, styles, _MARKERS, strict=False))
    return [
        [
            _Line(name, np.flatnonzero(by.at == i), label, {**style, "marker": marker})
            for i, (label, style, marker) in enumerate(looks)
        ]
        for name in shown[:_MOST_PANELS]
    ]


def _lines(
    result: SweepResult,
    over: _FieldAxis,
    panels: Sequence[Sequence[_Line]],
    shown: Shown,
    by: str = "",
) -> Figure:
    figure, each = _subplots(len(panels))
    labels: dict[str, Line2D] = {}
    for axes, lines in zip(each, panels, strict=True):
        labels |= {line.label: _draw(axes, result, over, line) for line in lines}
        name = lines[0].metric
        claim = shown.claim(name) if by or len(lines) == 1 else _most(result, lines)
        dress(axes, title=_wrapped(claim), x=over.label, y=_measured(result, name))
        over.dress(axes.xaxis)
        _mark_missing(axes, result, over)
    handles: list[Line2D | Patch] = []
    if len(labels) > 1:
        own = f"{by.rpartition('.')[2]} = " if by else ""
        for label, line in labels.items():
            style: Style = {"marker": line.get_marker(), "ms": 4, "label": own + label}
            handles.append(
                Line2D([], [], color=line.get_color(), linestyle=line.get_linestyle(), **style)
            )
    if result.plan.trials > 1:
        text = f"mean of {result.plan.trials} seeds"
        handles.append(Line2D([], [], color="#333333", marker="o", markersize=4, label=text))
        handles.append(Patch(facecolor="#333333", alpha=0.2, label="its 95 % interval"))
    handles += _missing(result, Line2D([], [], **_GONE))
    count = len({line.metric for lines in panels for line in lines})
    return _finish(figure, result, shown, count, handles)


def _most(result: SweepResult, lines: Sequence[_Line]) -> str:
    """Return which of several metrics of the same name changes most."""
    ranges = {line.label: float(np.ptp(_known(result.table[line.metric]))) for line in lines}
    name = lines[0].metric.rpartition(".")[2].replace("_", " ")
    return f"{name} changes most for {max(ranges, key=lambda label: ranges[label])}"


def _draw(axes: Axes, result: SweepResult, field: _FieldAxis, line: _Line) -> Line2D:
    order = line.points[np.argsort(field.at[line.points], kind="stable")]
    x, y = field.at[order], result.table[line.metric][order]
    style = {**line.style, "markersize": 4}
    if field.ticks:
        style["linestyle"] = ""
    elif len(order) > _MOST_MARKERS:
        style["marker"] = ""
    (drawn,) = axes.plot(x, y, label=line.label, **style)
    if result.plan.trials == 1:
        return drawn
    half, color = result.table[f"{line.metric}{INTERVAL}"][order], drawn.get_color()
    if field.ticks:
        axes.errorbar(x, y, half, color=color, linestyle="", capsize=4)
    else:
        axes.fill_between(x, y - half, y + half, color=color, alpha=0.2, linewidth=0)
    return drawn


def _measured(result: SweepResult, name: str) -> str:
    words = name.rpartition(".")[2].replace("_", " ")
    return _labelled(words, result.table.units[name])


def _mark_missing(axes: Axes, result: SweepResult, field: _FieldAxis) -> None:
    """Mark at the lower edge where points have no result."""
    places = np.unique(field.at[result.table["status"] != OK])
    if len(places):
        transform = axes.get_xaxis_transform()
        axes.plot(places, np.full(len(places), 0.02), transform=transform, clip_on=False, **_GONE)


def _missing(result: SweepResult, handle: Line2D | Patch) -> list[Line2D | Patch]:
    """Return what the legend says of points without a result, if there are any."""
    some = "a trial is refused or fails" if result.plan.trials > 1 else "refused or failed"
    handle.set_label(f"{some} (see status)")
    return [handle] if (result.table["status"] != OK).any() else []


def _finish(
    figure: Figure,
    result: SweepResult,
    shown: Shown,
    count: int,
    handles: Sequence[Line2D | Patch],
) -> Figure:
    """Write the title, which says how many of the metrics there are, and the legend."""
    title = f"Sweep of {result.plan.job.entry.name}"
    paths = " and ".join(field.path for field in shown.fields)
    left_out = shown.left_out(count)
    figure.set_label(f"{title} over {paths}{': ' if left_out else ''}{left_out}.")
    chooses = "" if shown.chosen else " (--metric chooses)"
    figure.suptitle(textwrap.fill(f"{title}: {left_out}{chooses}".rstrip(": "), 105), fontsize=9)
    if handles:
        place: Style = {"loc": "outside lower center", "fontsize": 8, "frameon": False}
        figure.legend(handles=list(handles), ncols=3, **place)
    return figure


def _maps(result: SweepResult, x: _FieldAxis, y: _FieldAxis, shown: Shown) -> Figure:
    """Draw each metric as a map, with contours."""
    drawn = shown.metrics[:_MOST_PANELS]
    figure, each = _subplots(len(drawn))
    cells = result.plan.design == "grid"
    for axes, name in zip(each, drawn, strict=True):
        (_cells if cells else _scattered)(axes, result, x, y, name)
        dress(axes, title=_wrapped(shown.claim(name)), x=x.label, y=y.label)
        axes.grid(False)
        x.dress(axes.xaxis)
        y.dress(axes.yaxis)
    handles: list[Line2D | Patch] = []
    if not cells:
        handles.append(Line2D([], [], ls="", marker="o", ms=4, color="#333333", label="a point"))
    if result.plan.trials > 1:
        text = f"colours and contours: mean of {result.plan.trials} seeds"
        handles.append(Line2D([], [], color="black", linewidth=0.8, label=text))
    handles += _missing(result, Patch(**_REFUSED) if cells else Line2D([], [], **_GONE))
    empty = np.isnan([result.table[name] for name in drawn])
    if cells and (empty & (result.table["status"] == OK)).any():
        handles.append(Patch(label="undefined", **_UNDEFINED))
    return _finish(figure, result, shown, len(drawn), handles)


def _cells(axes: Axes, result: SweepResult, x: _FieldAxis, y: _FieldAxis, name: str) -> None:
    """Draw a cell for each point of a grid."""
    index = np.searchsorted(x.places, x.at), np.searchsorted(y.places, y.at)
    values = np.full((len(x.places), len(y.places)), math.nan)
    values[index] = result.table[name]
    gone = np.zeros(values.shape, dtype=bool)
    gone[index] = result.table["status"] != OK
    mesh = axes.pcolormesh(x.edges(), y.edges(), values.T, cmap=_MAP, rasterized=True)
    colour_bar(axes, mesh, _measured(result, name), shrink=1.0)
    for i, j in zip(*np.nonzero(np.isnan(values)), strict=True):
        left, right = x.edges()[i : i + 2]
        low, high = y.edges()[j : j + 2]
        style = _REFUSED if gone[i, j] else _UNDEFINED
        axes.fill([left, right, right, left], [low, low, high, high], linewidth=0, **style)
    if min(values.shape) > 2 and _changes(values.ravel()):
        masked = np.ma.masked_invalid(values.T)
        _name(axes, axes.contour(x.places, y.places, masked, **_CONTOUR))


def _name(axes: Axes, contours: ContourSet) -> None:
    contours.set(path_effects=_HALO)
    for text in axes.clabel(contours, fontsize=8, fmt="%.3g"):
        text.set_path_effects(_HALO)


def _scattered(axes: Axes, result: SweepResult, x: _FieldAxis, y: _FieldAxis, name: str) -> None:
    """Draw drawn points, and contours between them where there are enough."""
    values = result.table[name]
    known = np.isfinite(values)
    norm = Normalize(float(values[known].min()), float(values[known].max()))
    if known.sum() > 8 and _changes(values):
        # Triangles are chosen as the axes show them.
        scaled = [one.scaled(one.at)[known] for one in (x, y)]
        corners = [(one - one.min()) / np.ptp(one) for one in scaled]
        triangles = Triangulation(*corners).triangles
        surface = Triangulation(x.at[known], y.at[known], triangles)
        axes.tricontourf(surface, values[known], levels=12, cmap=_MAP, norm=norm)
        _name(axes, axes.tricontour(surface, values[known], **_CONTOUR))
    dots: Style = {"s": 16, "edgecolors": "white", "linewidths": 0.5, "zorder": 3}
    colours: Style = {"c": values[known], "cmap": _MAP, "norm": norm}
    many = len(values) > _MOST_SHAPES
    points = axes.scatter(x.at[known], y.at[known], rasterized=many, **colours, **dots)
    colour_bar(axes, points, _measured(result, name), shrink=1.0)
    gone = result.table["status"] != OK
    axes.plot(x.at[gone], y.at[gone], **_GONE)


def _grid(result: SweepResult, shown: Shown) -> Figure:
    """Draw each metric over each field, with the points of all values of the others."""
    fields = sorted(shown.fields, key=lambda field: -_largest(shown, field))[:_MOST_PANELS]
    fields = [field for field in shown.fields if field in fields]
    rows = math.ceil(len(fields) / _COLUMNS)
    drawn = shown.metrics[: max(_MOST_ROWS // rows, len(fields))]
    columns = min(len(fields), _COLUMNS)
    figure = new_figure(_WIDTH, 1.2 + 2.3 * rows * len(drawn))
    dots: Style = {"color": "#1b4f9c", "alpha": 0.35, "markersize": 5}
    blocks = figure.subfigures(len(drawn), 1, squeeze=False).ravel()
    for block, name in zip(blocks, drawn, strict=True):
        values = result.table[name]
        many = len(values) > _MOST_SHAPES
        block.suptitle(shown.claim(name), fontsize=10, fontweight="bold", x=0.02, ha="left")
        grid = block.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        for axes in grid[len(fields) :]:
            axes.set_axis_off()
        for i, (axes, field) in enumerate(zip(grid, fields, strict=False)):
            axes.plot(field.at, values, ".", rasterized=many, **dots)
            x, y, half = zip(*_means(field, values), strict=True)
            style = {"marker": "_", "linestyle": ""} if field.ticks else {}
            axes.errorbar(x, y, half, color="#e07b00", linewidth=1.6, capsize=3, **style)
            label = "" if i % columns else _measured(result, name)
            dress(axes, title="", x=field.label, y=label)
            field.dress(axes.xaxis)
            _mark_missing(axes, result, field)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color="#1b4f9c", alpha=0.5, marker=".", ls="", label="a point"),
        Line2D([], [], color="#e07b00", label="mean over the other fields, 95 % interval"),
        *_missing(result, Line2D([], [], **_GONE)),
    ]
    return _finish(figure, result, shown, len(drawn), handles)


def _largest(shown: Shown, field: _FieldAxis) -> float:
    return max(of[field.path].size for of in shown.effects.values())


def _means(field: _FieldAxis, values: Array) -> Iterator[tuple[float, float, float]]:
    """Yield places along a field, the points' mean there and half of its interval."""
    if len(field.places) <= MOST_LEVELS:
        places, of = np.unique(field.at, return_inverse=True)
    else:
        edges, of = intervals(field.scaled(field.at))
        places = field.unscaled((edges[1:] + edges[:-1]) / 2)
    for k, place in enumerate(places.tolist()):
        known = values[(of == k) & np.isfinite(values)]
        yield place, *(mean_interval(known) if len(known) else (math.nan, math.nan))


def _subplots(count: int) -> tuple[Figure, Sequence[Axes]]:
    columns = min(count, 2)
    rows = math.ceil(count / columns)
    figure = new_figure(_WIDTH if count > 1 else 5.5, 1.0 + 2.8 * rows)
    each = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in each[count:]:
        unused.set_axis_off()
    return figure, list(each[:count])
