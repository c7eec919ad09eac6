"""Residuals of the fits to a log, over time."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_kit import Curve, ReferenceLine, draw_lines
from chamfer.analysis.drawing.figure_style import new_figure
from chamfer.analysis.identify.quantity import Array


class Residual(NamedTuple):
    """Residual of a fit."""

    title: str
    unit: str
    time: Array  # (n,), s
    values: Array  # (n,) or (n, k); NaN where nothing was fitted
    labels: tuple[str, ...] = ("x", "y", "z")


def draw_residuals(residuals: Sequence[Residual]) -> Figure:
    """Return a panel for each residual, with its root mean square."""
    caption = "Residuals of the fits over time, with their root mean squares."
    figure = new_figure(7.0, 1.9 * len(residuals), caption=caption)
    panels = figure.subplots(len(residuals), 1, squeeze=False, sharex=True)[:, 0]
    for axes, one in zip(panels, residuals, strict=True):
        columns = one.values.reshape(len(one.time), -1)
        rms = np.sqrt(np.nanmean(columns**2))
        several = columns.shape[1] > 1
        curves = [
            Curve(values, one.labels[i] if several else None, {"linewidth": 0.7})
            for i, values in enumerate(columns.T)
        ]
        zero = ReferenceLine(0.0, None, {"color": "#888888", "linewidth": 0.6})
        draw_lines(
            axes,
            one.time,
            curves,
            title=f"{one.title}: {rms:.2g} {one.unit} rms",
            y=f"residual / {one.unit}",
            over="time / s" if axes is panels[-1] else "",
            levels=[zero],
            key="beside" if several else None,
        )
    return figure
