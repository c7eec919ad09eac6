"""The figure of a sweep: lines over one field, maps over two, a panel for each of several."""

import math
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
from chamfer.analysis.drawing.figure_style import LOOPS, Style, dress, legend, new_figure
from chamfer.analysis.sweep.sweep import INTERVAL, OK, SweepResult, as_column
from chamfer.analysis.sweep.sweep_design import Drawn, VariedField

Array = NDArray[np.float64]

_MOST_PANELS: Final = 6
_MOST_ROWS: Final = 4  # of panels, where each field has one
_MOST_LINES: Final = 8  # in a panel
_MOST_MARKERS: Final = 60  # on a line, before they hide it
_MOST_SHAPES: Final = 1000  # that are drawn as such, and not as a picture of them
_BINS: Final = 8  # of a drawn field's interval, for means
_IN_A_BIN: Final = 8  # points, at least
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


def plot_sweep(result: SweepResult) -> Figure | None:
    """Draw the metrics over the fields that take several values; None if nothing can be drawn.

    The metrics are those asked for, or those that change.
    """
    fields = [_field_axis(result, varied) for varied in result.plan.varied]
    fields = [field for field in fields if len(field.places) > 1]
    shown = [
        name
        for name in result.metrics.values()
        if (_changes if result.plan.metrics is None else _defined)(result.table[name])
    ]
    if not fields or not shown:
        return None
    if len(fields) == 1:
        return _lines(result, fields[0], _panels_of_metrics(result, shown), shown)
    if len(fields) == 2 and not any(field.ticks for field in fields):
        return _maps(result, fields[0], fields[1], shown)
    if len(fields) == 2:
        over, by = sorted(fields, key=lambda field: bool(field.ticks))
        return _lines(result, over, _panels_of_values(result, by, shown), shown, by.path)
    return _grid(result, fields, shown)


def _defined(values: Array) -> bool:
    return bool(np.isfinite(values).any())


def _changes(values: Array) -> bool:
    known = values[np.isfinite(values)]
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
    looks = list(zip(by.ticks, _COLORS, _MARKERS, strict=False))
    return [
        [
            _Line(name, np.flatnonzero(by.at == i), label, {"color": color, "marker": marker})
            for i, (label, color, marker) in enumerate(looks)
        ]
        for name in shown[:_MOST_PANELS]
    ]


def _lines(
    result: SweepResult,
    over: _FieldAxis,
    panels: Sequence[Sequence[_Line]],
    shown: Sequence[str],
    by: str = "",
) -> Figure:
    figure, each = _subplots(len(panels))
    for axes, lines in zip(each, panels, strict=True):
        for line in lines:
            _draw(axes, result, over, line)
        name = lines[0].metric
        last = name.rpartition(".")[2]
        metrics = {line.metric for line in lines}
        title = name if len(metrics) == 1 else last
        dress(axes, title=title, x=over.label, y=_measured(result, name))
        over.dress(axes.xaxis)
        if by:
            legend(axes, title=by, title_fontsize=8)
        elif len(lines) > 1:
            legend(axes)
        _mark_missing(axes, result, over)
    handles: list[Line2D | Patch] = []
    if result.plan.trials > 1:
        text = f"mean of {result.plan.trials} seeds"
        handles.append(Line2D([], [], color="#333333", marker="o", markersize=4, label=text))
        handles.append(Patch(facecolor="#333333", alpha=0.2, label="its 95 % interval"))
    handles += _missing(result, Line2D([], [], **_GONE))
    count = len({line.metric for lines in panels for line in lines})
    return _finish(figure, result, shown, count, handles)


def _draw(axes: Axes, result: SweepResult, field: _FieldAxis, line: _Line) -> None:
    order = line.points[np.argsort(field.at[line.points], kind="stable")]
    x, y = field.at[order], result.table[line.metric][order]
    style = {**line.style, "markersize": 4}
    if field.ticks:
        style["linestyle"] = ""
    elif len(order) > _MOST_MARKERS:
        style["marker"] = ""
    (drawn,) = axes.plot(x, y, label=line.label, **style)
    if result.plan.trials == 1:
        return
    half, color = result.table[f"{line.metric}{INTERVAL}"][order], drawn.get_color()
    if field.ticks:
        axes.errorbar(x, y, half, color=color, linestyle="", capsize=4)
    else:
        axes.fill_between(x, y - half, y + half, color=color, alpha=0.2, linewidth=0)


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
    shown: Sequence[str],
    count: int,
    handles: Sequence[Line2D | Patch],
) -> Figure:
    """Write the title, which says how many of the metrics there are, and the legend."""
    title = f"Sweep of {result.plan.job.entry.name}"
    if count < len(shown):
        title += f": {count} of the {len(shown)} metrics that change (--metric chooses)"
    figure.suptitle(title, fontsize=11)
    if handles:
        place: Style = {"loc": "outside lower center", "fontsize": 8, "frameon": False}
        figure.legend(handles=list(handles), ncols=4, **place)
    return figure


def _maps(result: SweepResult, x: _FieldAxis, y: _FieldAxis, shown: Sequence[str]) -> Figure:
    """Draw each metric as a map, with contours."""
    drawn = shown[:_MOST_PANELS]
    figure, each = _subplots(len(drawn), width=4.6, height=3.7)
    cells = result.plan.design == "grid"
    for axes, name in zip(each, drawn, strict=True):
        (_cells if cells else _scattered)(axes, result, x, y, name)
        dress(axes, title=name, x=x.label, y=y.label)
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
    for text in axes.clabel(contours, fontsize=7, fmt="%.3g"):
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


def _grid(result: SweepResult, fields: Sequence[_FieldAxis], shown: Sequence[str]) -> Figure:
    """Draw each metric over each field, all others being what they are."""
    drawn = shown[:_MOST_ROWS]
    fields = fields[:_MOST_PANELS]
    figure = new_figure(1.0 + 3.0 * len(fields), 1.3 + 2.5 * len(drawn))
    grid = figure.subplots(len(drawn), len(fields), squeeze=False, sharey="row")
    dots: Style = {"color": "#1b4f9c", "alpha": 0.35, "markersize": 5}
    for row, name in zip(grid, drawn, strict=True):
        values = result.table[name]
        many = len(values) > _MOST_SHAPES
        for axes, field in zip(row, fields, strict=True):
            axes.plot(field.at, values, ".", rasterized=many, **dots)
            x, y, half = zip(*_means(field, values), strict=True)
            style = {"marker": "_", "linestyle": ""} if field.ticks else {}
            axes.errorbar(x, y, half, color="#e07b00", linewidth=1.6, capsize=3, **style)
            title, label = (name, _measured(result, name)) if axes is row[0] else ("", "")
            dress(axes, title=title, x=field.label, y=label)
            field.dress(axes.xaxis)
            _mark_missing(axes, result, field)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color="#1b4f9c", alpha=0.5, marker=".", ls="", label="a point"),
        Line2D([], [], color="#e07b00", label="mean over the other fields, 95 % interval"),
        *_missing(result, Line2D([], [], **_GONE)),
    ]
    return _finish(figure, result, shown, len(drawn), handles)


def _means(field: _FieldAxis, values: Array) -> Iterator[tuple[float, float, float]]:
    """Yield places along a field, the points' mean there and half of its interval."""
    if len(field.places) <= _BINS:
        places, of = np.unique(field.at, return_inverse=True)
    else:
        bins = min(_BINS, max(2, len(values) // _IN_A_BIN))
        scaled = field.scaled(field.at)
        edges = np.linspace(scaled.min(), scaled.max(), bins + 1)
        of = np.clip(np.digitize(scaled, edges) - 1, 0, bins - 1)
        places = field.unscaled((edges[1:] + edges[:-1]) / 2)
    for k, place in enumerate(places.tolist()):
        known = values[(of == k) & np.isfinite(values)]
        yield place, *(mean_interval(known) if len(known) else (math.nan, math.nan))


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
