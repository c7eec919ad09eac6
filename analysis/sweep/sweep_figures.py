"""The figure of a sweep: lines over one field, maps over two, a panel for each of several."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
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
from chamfer.analysis.drawing.figure_style import LOOPS, Style, dress, legend, new_figure
from chamfer.analysis.sweep.sweep import INTERVAL, OK, SweepResult
from chamfer.analysis.sweep.sweep_axis import FieldAxis, divisor, field_axis, scale

_MOST_PANELS: Final = 6
_MOST_ROWS: Final = 4  # of panels, where each field has one
_MOST_LINES: Final = 8  # in a panel
_MOST_MARKERS: Final = 60  # on a line, before they hide it
_MOST_SHAPES: Final = 1000  # that are drawn as such, and not as a picture of them
_BINS: Final = 8  # of a drawn field's interval, for means
_IN_A_BIN: Final = 8  # points, at least
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


def plot_sweep(result: SweepResult) -> Figure | None:
    """Draw the metrics over the fields that take several values; None if nothing can be drawn."""
    fields = [
        one
        for one in (field_axis(result, varied) for varied in result.plan.varied)
        if len(one.places()) > 1
    ]
    shown = _shown(result)
    if not fields or not shown:
        return None
    if len(fields) == 1:
        return _lines(result, fields[0], shown)
    if len(fields) == 2 and not any(field.ticks for field in fields):
        return _maps(result, fields[0], fields[1], shown)
    if len(fields) == 2:
        over, by = sorted(fields, key=lambda field: bool(field.ticks))
        return _lines_by(result, over, by, shown)
    return _panels(result, fields, shown)


def _shown(result: SweepResult) -> list[str]:
    """Return the metrics' columns that may be drawn: those asked for, or those that change."""
    found = list(result.metrics.values())
    if result.plan.metrics is not None:
        return [name for name in found if np.isfinite(result.table[name]).any()]
    return [name for name in found if _changes(result.table[name])]


def _changes(values: NDArray[np.float64]) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and float(np.ptp(known)) > 1e-9 * float(np.max(np.abs(known)))


def _title(result: SweepResult, count: int, shown: int) -> str:
    title = f"Sweep of {result.plan.job.entry.name}"
    if shown < count:
        title += f": {shown} of the {count} metrics that change (--metric chooses)"
    return title


def _lines(result: SweepResult, field: FieldAxis, shown: Sequence[str]) -> Figure:
    """Draw metrics of the same name and unit in one panel, as of several controllers."""
    panels: dict[tuple[str, str], list[str]] = {}
    for name in shown:
        panels.setdefault((name.rpartition(".")[2], result.table.units[name]), []).append(name)
    drawn = list(panels.items())[:_MOST_PANELS]
    drawn = [(key, names[:_MOST_LINES]) for key, names in drawn]
    figure, each = _subplots(len(drawn))
    order = np.argsort(field.at, kind="stable")
    owners = list(dict.fromkeys(_owner(name) for _, names in drawn for name in names))
    for axes, ((last, unit), names) in zip(each, drawn, strict=True):
        for name in names:
            owner = _owner(name)
            k = owners.index(owner)
            label, style = LOOPS.get(owner, (owner or last, {"color": _COLORS[k % len(_COLORS)]}))
            style = {**style, "marker": _MARKERS[k % len(_MARKERS)], "markersize": 4}
            _line(axes, result, field, order, name, label, style)
        dress(axes, title=names[0] if len(names) == 1 else last, x=field.label, y=_y(last, unit))
        scale(axes, field)
        if len(names) > 1:
            legend(axes)
    _mark_missing(each, result, field)
    count = sum(map(len, (names for _, names in drawn)))
    figure.suptitle(_title(result, len(shown), count), fontsize=11)
    _line_legend(figure, result)
    return figure


def _lines_by(result: SweepResult, over: FieldAxis, by: FieldAxis, shown: Sequence[str]) -> Figure:
    """Draw a line over one field for each value of another, which is no number."""
    drawn = shown[:_MOST_PANELS]
    figure, each = _subplots(len(drawn))
    for axes, name in zip(each, drawn, strict=True):
        for i, label in enumerate(by.ticks[:_MOST_LINES]):
            order = np.flatnonzero(by.at == i)
            order = order[np.argsort(over.at[order], kind="stable")]
            style = {"color": _COLORS[i], "marker": _MARKERS[i], "markersize": 4}
            _line(axes, result, over, order, name, label, style)
        unit = result.table.units[name]
        dress(axes, title=name, x=over.label, y=_y(name.rpartition(".")[2], unit))
        scale(axes, over)
        legend(axes, title=by.path, title_fontsize=8)
    _mark_missing(each, result, over)
    figure.suptitle(_title(result, len(shown), len(drawn)), fontsize=11)
    _line_legend(figure, result)
    return figure


def _owner(name: str) -> str:
    return name.rpartition(".")[0]


def _line(
    axes: Axes,
    result: SweepResult,
    field: FieldAxis,
    order: NDArray[np.intp],
    name: str,
    label: str,
    style: Mapping[str, Any],
) -> None:
    x, y = field.at[order], result.table[name][order]
    if field.ticks:
        style = {**style, "linestyle": ""}
    elif len(order) > _MOST_MARKERS:
        style = {**style, "marker": ""}
    (line,) = axes.plot(x, y, label=label, **style)
    if result.plan.trials == 1:
        return
    half = result.table[f"{name}{INTERVAL}"][order]
    if field.ticks:
        axes.errorbar(x, y, half, color=line.get_color(), linestyle="", capsize=4)
    else:
        axes.fill_between(x, y - half, y + half, color=line.get_color(), alpha=0.2, linewidth=0)


def _y(name: str, unit: str) -> str:
    words = name.replace("_", " ")
    return f"{words} / {divisor(unit)}" if unit else words


def _mark_missing(each: Sequence[Axes], result: SweepResult, field: FieldAxis) -> None:
    """Mark at the lower edge where points have no result."""
    places = np.unique(field.at[result.table["status"] != OK])
    for axes in each if len(places) else ():
        transform = axes.get_xaxis_transform()
        axes.plot(places, np.full(len(places), 0.02), transform=transform, clip_on=False, **_GONE)


def _line_legend(figure: Figure, result: SweepResult) -> None:
    handles: list[Line2D | Patch] = []
    if result.plan.trials > 1:
        text = f"mean of {result.plan.trials} seeds"
        handles.append(Line2D([], [], color="#333333", marker="o", markersize=4, label=text))
        handles.append(Patch(facecolor="#333333", alpha=0.2, label="its 95 % interval"))
    if (result.table["status"] != OK).any():
        handles.append(Line2D([], [], label=_without(result), **_GONE))
    _figure_legend(figure, handles)


def _without(result: SweepResult) -> str:
    some = "a trial is refused or fails" if result.plan.trials > 1 else "refused or failed"
    return f"{some} (see status)"


def _figure_legend(figure: Figure, handles: Sequence[Line2D | Patch]) -> None:
    if handles:
        figure.legend(
            handles=list(handles), loc="outside lower center", ncols=4, fontsize=8, frameon=False
        )


def _maps(result: SweepResult, x: FieldAxis, y: FieldAxis, shown: Sequence[str]) -> Figure:
    """Draw each metric as a map, with contours."""
    drawn = shown[:_MOST_PANELS]
    figure, each = _subplots(len(drawn), width=4.6, height=3.7)
    places = (len(x.places()), len(y.places()))
    cells = result.plan.design == "grid"
    for axes, name in zip(each, drawn, strict=True):
        if cells:
            _cells(axes, result, x, y, name, places)
        else:
            _scattered(axes, result, x, y, name)
        dress(axes, title=name, x=x.label, y=y.label)
        axes.grid(False)
        scale(axes, x, y)
    figure.suptitle(_title(result, len(shown), len(drawn)), fontsize=11)
    handles: list[Line2D | Patch] = []
    if not cells:
        handles.append(Line2D([], [], ls="", marker="o", ms=4, color="#333333", label="a point"))
    if result.plan.trials > 1:
        text = f"colours and contours: mean of {result.plan.trials} seeds"
        handles.append(Line2D([], [], color="black", linewidth=0.8, label=text))
    empty = np.isnan([result.table[name] for name in drawn])
    gone = result.table["status"] != OK
    if cells and (empty & gone).any():
        handles.append(Patch(label=_without(result), **_REFUSED))
    if not cells and gone.any():
        handles.append(Line2D([], [], label=_without(result), **_GONE))
    if cells and (empty & ~gone).any():
        handles.append(Patch(label="undefined", **_UNDEFINED))
    _figure_legend(figure, handles)
    return figure


def _cells(
    axes: Axes,
    result: SweepResult,
    x: FieldAxis,
    y: FieldAxis,
    name: str,
    places: tuple[int, int],
) -> None:
    """Draw a cell for each point of a grid."""
    index = np.searchsorted(x.places(), x.at), np.searchsorted(y.places(), y.at)
    values = np.full(places, math.nan)
    values[index] = result.table[name]
    gone = np.zeros(places, dtype=bool)
    gone[index] = result.table["status"] != OK
    mesh = axes.pcolormesh(x.edges(), y.edges(), values.T, cmap=_MAP, rasterized=True)
    _color_bar(axes, mesh, name, result.table.units[name])
    for i, j in zip(*np.nonzero(np.isnan(values)), strict=True):
        left, right = x.edges()[i : i + 2]
        low, high = y.edges()[j : j + 2]
        style = _REFUSED if gone[i, j] else _UNDEFINED
        axes.fill([left, right, right, left], [low, low, high, high], linewidth=0, **style)
    if min(places) > 2 and _changes(values.ravel()):
        masked = np.ma.masked_invalid(values.T)
        _contours(axes, axes.contour(x.places(), y.places(), masked, **_CONTOUR))


def _contours(axes: Axes, lines: ContourSet) -> None:
    lines.set(path_effects=_HALO)
    for text in axes.clabel(lines, fontsize=7, fmt="%.3g"):
        text.set_path_effects(_HALO)


def _scattered(axes: Axes, result: SweepResult, x: FieldAxis, y: FieldAxis, name: str) -> None:
    """Draw drawn points, and contours between them where there are enough."""
    values = result.table[name]
    known = np.isfinite(values)
    norm = Normalize(float(values[known].min()), float(values[known].max()))
    if known.sum() > 8 and _changes(values):
        # Triangles are chosen as the axes show them.
        scaled = [(np.log(one.at) if one.logarithmic else one.at)[known] for one in (x, y)]
        corners = [(one - one.min()) / np.ptp(one) for one in scaled]
        triangles = Triangulation(*corners).triangles
        surface = Triangulation(x.at[known], y.at[known], triangles)
        axes.tricontourf(surface, values[known], levels=12, cmap=_MAP, norm=norm)
        _contours(axes, axes.tricontour(surface, values[known], **_CONTOUR))
    dots = axes.scatter(
        x.at[known],
        y.at[known],
        c=values[known],
        cmap=_MAP,
        norm=norm,
        s=16,
        edgecolors="white",
        linewidths=0.5,
        zorder=3,
        rasterized=len(values) > _MOST_SHAPES,
    )
    _color_bar(axes, dots, name, result.table.units[name])
    gone = result.table["status"] != OK
    axes.plot(x.at[gone], y.at[gone], **_GONE)


def _color_bar(axes: Axes, drawn: ScalarMappable, name: str, unit: str) -> None:
    colour_bar(axes, drawn, _y(name.rpartition(".")[2], unit), shrink=1.0)


def _panels(result: SweepResult, fields: Sequence[FieldAxis], shown: Sequence[str]) -> Figure:
    """Draw each metric over each field, all others being what they are."""
    drawn = shown[:_MOST_ROWS]
    fields = fields[:_MOST_PANELS]
    figure = new_figure(1.0 + 3.0 * len(fields), 1.3 + 2.5 * len(drawn))
    grid = figure.subplots(len(drawn), len(fields), squeeze=False, sharey="row")
    for row, name in zip(grid, drawn, strict=True):
        for axes, field in zip(row, fields, strict=True):
            values = result.table[name]
            dots = {"color": "#1b4f9c", "alpha": 0.35, "markersize": 5}
            axes.plot(field.at, values, ".", rasterized=len(values) > _MOST_SHAPES, **dots)
            x, y, half = zip(*_means(field, values), strict=True)
            style = {"marker": "_", "linestyle": ""} if field.ticks else {}
            axes.errorbar(x, y, half, color="#e07b00", linewidth=1.6, capsize=3, **style)
            first = axes is row[0]
            unit = result.table.units[name]
            label = _y(name.rpartition(".")[2], unit) if first else ""
            dress(axes, title=name if first else "", x=field.label, y=label)
            scale(axes, field)
            _mark_missing([axes], result, field)
    figure.suptitle(_title(result, len(shown), len(drawn)), fontsize=11)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color="#1b4f9c", alpha=0.5, marker=".", ls="", label="a point"),
        Line2D([], [], color="#e07b00", label="mean over the other fields, 95 % interval"),
    ]
    if (result.table["status"] != OK).any():
        handles.append(Line2D([], [], label=_without(result), **_GONE))
    _figure_legend(figure, handles)
    return figure


def _means(field: FieldAxis, values: NDArray[np.float64]) -> Iterator[tuple[float, float, float]]:
    """Yield places along a field, the points' mean there and half of its interval."""
    places = field.places()
    bins = min(_BINS, max(2, len(values) // _IN_A_BIN))
    if len(places) <= _BINS:
        groups = [(float(place), field.at == place) for place in places]
    else:
        scaled = np.log(field.at) if field.logarithmic else field.at
        edges = np.linspace(scaled.min(), scaled.max(), bins + 1)
        index = np.clip(np.digitize(scaled, edges) - 1, 0, bins - 1)
        middles = (edges[1:] + edges[:-1]) / 2
        middles = np.exp(middles) if field.logarithmic else middles
        groups = [(float(middles[k]), index == k) for k in range(bins)]
    for place, inside in groups:
        known = values[inside & np.isfinite(values)]
        mean, half = mean_interval(known) if len(known) else (math.nan, math.nan)
        yield place, mean, half


def _subplots(
    count: int, *, width: float = 4.2, height: float = 3.2
) -> tuple[Figure, Sequence[Axes]]:
    columns = min(count, 3 if count != 4 else 2)
    rows = math.ceil(count / columns)
    figure = new_figure(max(5.5, width * columns), 0.8 + height * rows)
    each = figure.subplots(rows, columns, squeeze=False).ravel()
    for unused in each[count:]:
        unused.set_axis_off()
    return figure, list(each[:count])
