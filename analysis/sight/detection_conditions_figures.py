"""Conditions and severities as a table of bars, and a picture of each condition."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_kit import colour_legend, draw_shares, name_rows
from chamfer.analysis.drawing.figure_style import new_figure
from chamfer.analysis.scenario.experiment import Outcome

_COLOURS: Final = {"found": "#8fc79a", "refused": "#d9d9d9", "wrong": "#b00020"}
_SAID: Final = {"found": "found", "refused": "refused", "wrong": "valid but wrong"}
_EXPLAINED: Final = 40  # %, refused, from which on it is said why
_COLUMNS: Final = 5  # of pictures


def _words(reasons: str) -> str:
    """Return the most frequent reason of a refusal, as of 'peg NOT_STRAIGHT 12, hole ...'."""
    part, status, _ = reasons.split(", ")[0].split(" ")
    return f"{part}: {status.lower().replace('_', ' ')}"


def plot_conditions(
    outcome: Outcome,
    said: Mapping[str, str],
    levels: Mapping[str, Sequence[float]],
    severities: Sequence[str],
) -> Figure:
    """Draw for every condition and severity which share of the pictures ended how.

    Args:
        outcome: With the metrics.
        said: What is said of each condition, by name, with its level as {}.
        levels: Of each severity, by condition.
        severities: Their names.
    """
    figure = new_figure(12.0, 1.6 + 0.27 * len(said))
    panels: list[Axes] = list(figure.subplots(1, len(severities), sharey=True, squeeze=False)[0])
    for k, (axes, severity) in enumerate(zip(panels, severities, strict=True)):
        rows, texts = [], []
        for row, condition in enumerate(said):
            found = {one: outcome.metrics[f"{condition}.{severity}.{one}"] for one in _COLOURS}
            shares = {one: metric.value or 0.0 for one, metric in found.items()}
            own = {"wrong": f"{shares['wrong']:.0f}"}  # however small
            if shares["refused"] > _EXPLAINED:
                why = _words(found["refused"].note)
                own["refused"] = f"{shares['refused']:.0f} {why}"
            rows.append(shares)
            texts.append(own)
            level = f"{levels[condition][k]:g}"
            axes.text(101, row, level, va="center", fontsize=7, color="#555555")
        draw_shares(axes, rows, _COLOURS, texts)
        axes.set_title(severity, fontsize=10, loc="left", fontweight="bold")
        axes.set_xlabel("pictures / %", fontsize=9)
    name_rows(panels[0], [text.split(", ")[0] for text in said.values()])
    count, wrong = (outcome.metrics[name].value or 0.0 for name in ("pictures", "wrong"))
    figure.suptitle(
        f"{count:.0f} pictures, both parts wanted in each: {wrong:.0f} valid but wrong; "
        "right of a bar its level",
        fontsize=10,
    )
    colour_legend(figure, {_SAID[ending]: colour for ending, colour in _COLOURS.items()})
    return figure


def plot_pictures(
    outcome: Outcome,
    said: Mapping[str, str],
    levels: Mapping[str, Sequence[float]],
    *,
    order: Sequence[str],
    size: tuple[int, int],
) -> Figure:
    """Draw a picture of each condition at its middle severity.

    Args:
        outcome: With the table ``pictures``.
        said: What is said of each condition, by name, with its level as {}.
        levels: Of each severity, by condition.
        order: Names of the conditions as they are numbered in the table.
        size: Of the pictures, pixels, width and height.
    """
    table = outcome.tables["pictures"]
    rows = math.ceil(len(said) / _COLUMNS)
    figure = new_figure(2.4 * _COLUMNS, 1.45 * rows)
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, (condition, text) in zip(panels, said.items(), strict=False):
        of = table["condition"] == order.index(condition)
        pixels = np.column_stack([table[name][of] for name in ("red", "green", "blue")])
        axes.imshow(pixels.reshape(size[1], size[0], 3), interpolation="nearest")
        title = text.format(levels[condition][1])
        axes.set_title(title, fontsize=8, loc="left")
    return figure
