"""Two frames with what was detected in them, and how far off it is in all cases."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_kit import draw_intervals, metric_value
from chamfer.analysis.drawing.figure_style import PUBLISHED, Style, dress, new_figure
from chamfer.analysis.published.work_cell import SIGNAL_ACCURACY
from chamfer.analysis.scenario.experiment import Outcome, Table

Array = NDArray[np.float64]

VIEW_TITLES: Final = {"xz": "X-Z, seen along Y", "xy": "X-Y, seen from above"}
KIND_LABELS: Final = {"clean": "clean", "noisy": "noisy", "sampled": "sampled"}

_PEG, _HOLE, _BOTH = "#b00020", "#1b4f9c", "#555555"
_IN_IMAGE: Final[Mapping[str, tuple[str, Style]]] = {
    "xz.peg": ("peg, X-Z", {"color": _PEG, "marker": "o"}),
    "xy.peg": ("peg, X-Y", {"color": _PEG, "marker": "o", "markerfacecolor": "white"}),
    "xz.hole": ("hole, X-Z", {"color": _HOLE, "marker": "s"}),
    "xy.hole": ("hole, X-Y", {"color": _HOLE, "marker": "s", "markerfacecolor": "white"}),
    "xz.scaled": ("error signal, not calibrated, X-Z", {"color": _BOTH, "marker": "D"}),
    "xy.scaled": (
        "error signal, not calibrated, X-Y",
        {"color": _BOTH, "marker": "D", "markerfacecolor": "white"},
    ),
}
_IN_SPACE: Final[Mapping[str, tuple[str, Style]]] = {
    "space.peg": ("peg", {"color": _PEG, "marker": "o"}),
    "space.hole": ("hole", {"color": _HOLE, "marker": "s"}),
    "space.relative": ("peg to hole, in space", {"color": _BOTH, "marker": "*", "markersize": 7}),
}
_AXIS: Final[Style] = {"color": "black", "linewidth": 1.0, "dashes": (6, 3)}
_TIP: Final[Style] = {"color": "white", "marker": "+", "markersize": 12, "markeredgewidth": 1.6}
_BEYOND: Final = 20  # pixels of the axis that are drawn beyond the tip
_ZOOM: Final = 10  # pixels to either side of the tip


def plot_accuracy(
    outcome: Outcome, *, cases: Mapping[str, str], kinds: Sequence[str], pixel_size: float
) -> Figure:
    """Draw the example frames and, for every case and kind of image, rms and largest errors.

    Args:
        outcome: With the metrics, and the tables ``frames`` and ``frame_detections``.
        cases: What is said of each, by name, in the traces' order.
        kinds: Of images.
        pixel_size: What a pixel covers at the parts, m.
    """
    figure = new_figure(13.0, 8.2)
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=(0.42, 1.0))[:, 0]
    _frames(top, outcome.tables)
    panels = bottom.subplots(1, 4, sharey=True)
    lateral, axial, angle, space = panels
    claim = SIGNAL_ACCURACY / pixel_size
    for axes, quantity, title in (
        (lateral, "lateral", "Across the axis"),
        (axial, "axial", "Along the axis"),
    ):
        factors = {name: 1 / pixel_size if "scaled" in name else 1.0 for name in _IN_IMAGE}
        _errors(axes, outcome, cases, kinds, _IN_IMAGE, quantity, factors)
        axes.axvline(claim, label="published: sub-millimetre", **PUBLISHED)
        dress(axes, title=title, x="error / px", y="")
        above = axes.secondary_xaxis(
            "top",
            functions=(lambda x: 1e3 * pixel_size * x, lambda x: 1e-3 / pixel_size * x),
        )
        above.set_xlabel("at the parts / mm", fontsize=9)
        above.tick_params(labelsize=8)
    _errors(angle, outcome, cases, kinds, _IN_IMAGE, "angle", dict.fromkeys(_IN_IMAGE, 1e3))
    dress(angle, title="Angle of the axis", x="error / mrad", y="")
    _errors(space, outcome, cases, kinds, _IN_SPACE, "tip", dict.fromkeys(_IN_SPACE, 1e3))
    space.axvline(1e3 * SIGNAL_ACCURACY, **PUBLISHED)
    dress(space, title="Tips in space, by stereo", x="error / mm", y="")
    for axes in panels:
        axes.set_xscale("log")
        axes.grid(False, axis="y")
    ends = np.array([axes.get_xlim() for axes in (lateral, axial)])
    for axes in (lateral, axial):
        axes.set_xlim(ends[:, 0].min(), ends[:, 1].max())
    rows, labels, heads = _rows(cases, kinds)
    lateral.set_yticks(rows, labels)
    lateral.set_ylim(max(rows) + 0.6, -0.6)  # of all panels
    for axes in panels:
        for _, row in heads[1:]:
            axes.axhline(row - 0.5, color="#dddddd", linewidth=0.8)
    for text, row in heads:
        lateral.text(
            0.02, row, text, transform=lateral.get_yaxis_transform(), fontsize=8, va="center"
        )
    poses = len(np.unique(outcome.traces["trial"]))
    text = f"Errors in {poses} poses each: rms (marker) and largest (end of the line)"
    if "sampled" in kinds:
        text += "; sampled: a pixel shows one point of the scene, not its mean"
    bottom.suptitle(text, fontsize=10)
    handles, names = lateral.get_legend_handles_labels()
    more, others = space.get_legend_handles_labels()
    bottom.legend(
        [*handles, more[-1]],
        [*names, others[-1]],
        loc="outside lower center",
        ncols=8,
        fontsize=8,
        edgecolor="none",
    )
    return figure


def _rows(
    cases: Mapping[str, str], kinds: Sequence[str]
) -> tuple[list[int], list[str], list[tuple[str, int]]]:
    """Return where the rows are and their labels, and the headings of the cases with theirs."""
    rows, labels, heads = [], [], []
    for i, text in enumerate(cases.values()):
        heads.append((text, i * (len(kinds) + 1)))
        for j, kind in enumerate(kinds):
            rows.append(heads[-1][1] + j + 1)
            labels.append(KIND_LABELS[kind])
    return rows, labels, heads


def _errors(
    axes: Axes,
    outcome: Outcome,
    cases: Mapping[str, str],
    kinds: Sequence[str],
    series: Mapping[str, tuple[str, Style]],
    quantity: str,
    factors: Mapping[str, float],
) -> None:
    """Mark the rms of each series in each row, with a line to the largest error."""
    rows, _, _ = _rows(cases, kinds)
    names = [f"{case}.{kind}" for case in cases for kind in kinds]
    offsets = np.linspace(-0.33, 0.33, len(series))
    for offset, (name, (label, look)) in zip(offsets, series.items(), strict=True):
        rms, largest = (
            [
                metric_value(outcome.metrics, f"{one}.{name}.{quantity}.{key}", factors[name])
                for one in names
            ]
            for key in ("rms", "max")
        )
        style = {"markersize": 4.5, **look}
        draw_intervals(axes, np.array(rows) + offset, rms, rms, largest, style, label)


def _frames(figure: SubFigure, tables: Mapping[str, Table]) -> None:
    """Draw the pixels of both views, what was found in them, and the peg's tip enlarged."""
    marks = tables["frame_detections"]
    panels = figure.subplots(1, 4, width_ratios=(2.1, 1.0, 2.1, 1.0))
    for view, title in enumerate(VIEW_TITLES.values()):
        frame, enlarged = panels[2 * view : 2 * view + 2]
        pixels, extent = _picture(tables["frames"], view)
        found = {name: values[marks["view"] == view] for name, values in marks.items()}
        for axes in (frame, enlarged):
            axes.imshow(pixels, extent=extent, interpolation="nearest")
            _mark(axes, found)
            axes.tick_params(labelsize=8)
            axes.set_xlabel("u / px", fontsize=9)
        frame.set_xlim(extent[:2])
        frame.set_ylim(extent[2:])
        frame.set_ylabel("v / px", fontsize=9)
        tip_u, tip_v = found["tip_u"][0], found["tip_v"][0]
        if np.isfinite([tip_u, tip_v]).all():
            enlarged.set_xlim(tip_u - _ZOOM, tip_u + _ZOOM)
            enlarged.set_ylim(tip_v + _ZOOM, tip_v - _ZOOM)
        for axes, text in ((frame, title), (enlarged, "the peg's tip")):
            axes.set_title(text, fontsize=10, loc="left", fontweight="bold")


def _mark(axes: Axes, found: Table) -> None:
    """Draw the axes that were found through the parts and beyond their tips, and the tips."""
    tips = np.column_stack([found["tip_u"], found["tip_v"]])
    points = np.column_stack([found["point_u"], found["point_v"]])
    for tip, point in zip(tips, points, strict=True):
        way = tip - point
        if np.isfinite(way).all():
            ends = np.array([point - way, tip + _BEYOND * way / np.linalg.norm(way)])
            axes.plot(*ends.T, scalex=False, scaley=False, **_AXIS)
            axes.plot(*tip, scalex=False, scaley=False, **_TIP)


def _picture(frames: Table, view: int) -> tuple[Array, tuple[float, float, float, float]]:
    """Return the pixels of a view, 0 to 1, shape (height, width, 3), and where their edges are."""
    of = frames["view"] == view
    u, v = frames["u"][of].astype(int), frames["v"][of].astype(int)
    left, top, right, bottom = u.min(), v.min(), u.max() + 1, v.max() + 1
    pixels = np.zeros((bottom - top, right - left, 3))
    for channel, colour in enumerate(("red", "green", "blue")):
        pixels[v - top, u - left, channel] = frames[colour][of] / 255
    return pixels, (left - 0.5, right - 0.5, bottom - 0.5, top - 0.5)
