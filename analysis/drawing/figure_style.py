"""One look for every figure: the same colours and line styles for the same things."""

import re
import textwrap
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

Style = dict[str, Any]

DESIRED: Final[Style] = {"color": "#555555", "linestyle": "-", "linewidth": 1.0}
PID: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.8}
FSM: Final[Style] = {"color": "#e07b00", "linestyle": "-", "linewidth": 1.8}
_DOTS: Final = (0, (6, 1, 1, 1, 1, 1))


def _line(color: str, linestyle: Any, linewidth: float) -> Style:
    return {"color": color, "linestyle": linestyle, "linewidth": linewidth}


# Variants have the hue of their controller, another lightness and another pattern.
LOOPS: Final[dict[str, tuple[str, Style]]] = {
    "pid": ("PID", PID),
    "fsm": ("FSM", FSM),
    "fsm_velocity": ("FSM, force to velocity", _line("#7a4100", "-.", 1.3)),
    "fsm_feedforward": ("FSM with feedforward", _line("#f2b25c", "-", 2.6)),
    "fsm_compensation": ("FSM, compensation only", _line("#7a4100", _DOTS, 1.4)),
    "pid_position": ("PID, force to position", _line("#6fa0e8", (0, (4, 1.5)), 1.8)),
    "pid_command": ("PID, commanded position to position", _line("#0a2650", ":", 1.6)),
    "pid_camera": ("eq. (2) behind the camera", _line("#6fa0e8", "-", 1.3)),
    "pid_designed": ("PID designed for the camera", _line("#1b4f9c", "-.", 1.8)),
}
# Axes of a frame, and the planes in which an axis is across: XY has the look of Y.
AXIS_LOOKS: Final[dict[str, Style]] = {
    "x": _line("#1b4f9c", "-", 1.4),
    "y": _line("#e07b00", "--", 1.6),
    "z": _line("#1b7f5c", "-.", 1.6),
}
LATERAL: Final[Style] = _line("#e07b00", "-", 1.6)  # errors of a part
ROTATIONAL: Final[Style] = _line("#1b4f9c", "--", 1.6)
# Estimators of the surface normal: label, colour, marker.
OBSERVER_LOOKS: Final[dict[str, tuple[str, str, str]]] = {
    "thesis": ("thesis", "#555555", "s"),
    "gated": ("gated", "#9a9a9a", "v"),
    "prior_weights": ("weights from the prior", "#b58900", "<"),
    "vision": ("weights from the prior, with camera", "#7a0060", "P"),
    "curvature": ("curvature state", "#6fa0e8", ">"),
    "friction": ("friction-angle state", "#b00020", "X"),
    "mixture": ("earlier adaptive, mixture only", "#8f5bb5", "p"),
    "trusting": ("adaptive, without model_error", "#1b4f9c", "D"),
    "adaptive": ("adaptive", "#e07b00", "o"),
    "adaptive_vision": ("adaptive, with camera", "#7a4100", "d"),
}
REGION: Final[Style] = {"color": "#dfe7f2", "linewidth": 0}  # free of wedging, or stable
PUBLISHED: Final[Style] = {"color": "#b00020", "linestyle": (0, (1, 1.5)), "linewidth": 1.3}
FORCE: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.2}
POSITION: Final[Style] = {"color": "#e07b00", "linestyle": "-", "linewidth": 1.6}
LIMIT: Final[Style] = {"color": "#7a0060", "linestyle": (0, (6, 2)), "linewidth": 1.0}
CONTACT_LOST: Final[Style] = {"color": "#e0b000", "alpha": 0.35, "linewidth": 0}
BAND: Final[Style] = {"color": "#9a9a9a", "alpha": 0.3, "linewidth": 0}
NOTE: Final[Style] = {"fontsize": 8, "color": "#b00020"}
# Places of a legend that cover no data: below the labels, beside, or above right of the title.
BELOW: Final[Style] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0)}
BESIDE: Final[Style] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
ABOVE: Final[Style] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
_COLUMNS: Final = 10.4  # letters of a title in an inch of figure, with room for the labels


def new_figure(width: float = 8.0, height: float = 6.0, *, caption: str = "") -> Figure:
    """Return an empty figure that lays itself out.

    Args:
        width: In inches; a page shows at most 8, with letters of at least 9 pixels.
        height: In inches.
        caption: Say what is seen, answer first, in one or two sentences. It is the figure's label.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.set_label(caption)
    return figure


def dress(axes: Axes, *, title: str, x: str, y: str) -> None:
    """Give axes a title, which is wrapped to their column, labels with units and a light grid."""
    axes.set_title(wrapped(axes, title), fontsize=9, loc="left", fontweight="bold")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8, which="both")
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def wrapped(axes: Axes, title: str) -> str:
    """Return a title in as many lines as it needs to stay within its column of the figure."""
    part, place = axes.get_figure(root=False), axes.get_subplotspec()
    if part is None or place is None:
        return title
    grid = place.get_gridspec()
    widths: Any = grid.get_width_ratios() or [1] * grid.ncols
    share = sum(widths[i] for i in place.colspan) / sum(widths)
    columns = max(int(_COLUMNS * share * part.bbox.width / part.dpi), 12)
    together = re.sub(r"(?<=\d) (?=%|[a-zA-Z/]{1,4}\b)", "\N{NO-BREAK SPACE}", title)  # units
    lines = textwrap.wrap(together, columns, break_long_words=False)
    return "\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def legend(axes: Axes, **options: Any) -> None:
    """Draw a small legend, below the axes unless options say where, so that it covers no data."""
    place: Style = {}
    if not {"loc", "bbox_to_anchor"} & set(options):
        label = axes.get_xlabel()
        place = BELOW | {"borderaxespad": 3.2 + 1.4 * label.count("\n") if label else 1.4}
        place["borderaxespad"] += 1.4 if axes.xaxis.get_tick_params()["labelbottom"] else 0.0
    axes.legend(**{"fontsize": 8, "framealpha": 0.9, "edgecolor": "none", **place, **options})


def legend_below(figure: Figure | SubFigure, *shown: Axes, columns: int = 3) -> None:
    """Draw one legend below a figure, of what axes show."""
    found: dict[str, Any] = {}
    for axes in shown:
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    look: Style = {"loc": "outside lower center", "fontsize": 8, "edgecolor": "none"}
    figure.legend([*found.values()], [*found], ncols=columns, **look)
