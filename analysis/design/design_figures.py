"""The figure of a design's map: the verdict over two fields, and what limits."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.design.design_map import REFUSED, DesignMap, MapAxis
from chamfer.analysis.design.design_words import scaled
from chamfer.analysis.drawing.figure_style import Style, dress, new_figure

Array = NDArray[np.float64]

# Of the verdicts, told apart in grey too.
VERDICTS: Final = {"certain": "#1b4f9c", "likely": "#e9c46a", "no": "#b5482a"}
_REFUSED: Final = "#d9d9d9"
_LINKS: Final = (
    *("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#000000", "#994f00"),
    *("#006cd1", "#e1be6a", "#40b0a6", "#5d3a9b", "#d35fb7"),
)
_HERE: Final[Style] = {
    "marker": "*",
    "markersize": 13,
    "color": "white",
    "markeredgecolor": "black",
    "linestyle": "",
}


def plot_map(found: DesignMap) -> Figure:
    """Draw the verdict over two fields, beside the link that limits."""
    figure = new_figure(10.0, 4.6)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    refused = found.verdict == REFUSED
    shown = {name: colour for name, colour in VERDICTS.items() if (found.verdict == name).any()}
    _show(left, found, _verdict_colours(found), shown)
    names, counts = np.unique(found.limiting[~refused], return_counts=True)
    links = dict(zip(names[np.argsort(-counts)].tolist(), _LINKS, strict=False))
    colours = np.full((*refused.shape, 3), to_rgb(_REFUSED))
    for name, colour in links.items():
        colours[~refused & (found.limiting == name)] = to_rgb(colour)
    _show(right, found, colours, links)
    dress(left, title="Verdict", x=_label(found.x), y=_label(found.y))
    dress(right, title="The smallest margin is that of", x=_label(found.x), y="")
    for axes in (left, right):
        axes.grid(False)
        axes.legend(
            loc="upper center",
            bbox_to_anchor=(0.5, -0.13),
            ncols=3,
            fontsize=8,
            frameon=False,
        )
    return figure


def _verdict_colours(found: DesignMap) -> Array:
    """Return colours, shape (y, x, 3): likely is the deeper, the fewer errors are inside."""
    colours = np.full((*found.verdict.shape, 3), to_rgb(_REFUSED))
    for name, colour in VERDICTS.items():
        colours[found.verdict == name] = to_rgb(colour)
    likely = found.verdict == "likely"
    inside = found.inside[likely, np.newaxis]
    pale, deep = (np.array(to_rgb(one)) for one in ("#f6e7b4", VERDICTS["likely"]))
    colours[likely] = inside * pale + (1 - inside) * deep
    return colours


def _show(axes: Axes, found: DesignMap, colours: Array, names: dict[str, str]) -> None:
    x, y = _places(found.x), _places(found.y)
    half_x, half_y = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    axes.imshow(
        colours,
        origin="lower",
        extent=(x[0] - half_x, x[-1] + half_x, y[0] - half_y, y[-1] + half_y),
        aspect="auto",
        interpolation="nearest",
    )
    if (found.verdict == REFUSED).any():
        names = {**names, "no such design": _REFUSED}
    for name, colour in names.items():
        axes.plot([], [], marker="s", linestyle="", markersize=8, color=colour, label=name)
    at = scaled(found.x.here, found.x.unit)[0], scaled(found.y.here, found.y.unit)[0]
    if x[0] <= at[0] <= x[-1] and y[0] <= at[1] <= y[-1]:
        axes.plot(*at, **_HERE, label="this design")


def _places(axis: MapAxis) -> Array:
    return np.array([scaled(value, axis.unit)[0] for value in axis.values])


def _label(axis: MapAxis) -> str:
    unit = scaled(0.0, axis.unit)[1]
    return f"{axis.path} / {unit}" if unit else axis.path
