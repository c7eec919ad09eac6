"""One look for every figure: the same colours and line styles for the same things."""

from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
PUBLISHED: Final[Style] = {"color": "#b00020", "linestyle": (0, (1, 1.5)), "linewidth": 1.3}
FORCE: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.2}
POSITION: Final[Style] = {"color": "#e07b00", "linestyle": "-", "linewidth": 1.6}
LIMIT: Final[Style] = {"color": "#7a0060", "linestyle": (0, (6, 2)), "linewidth": 1.0}
CONTACT_LOST: Final[Style] = {"color": "#e0b000", "alpha": 0.35, "linewidth": 0}
BAND: Final[Style] = {"color": "#9a9a9a", "alpha": 0.3, "linewidth": 0}
NOTE: Final[Style] = {"fontsize": 8, "color": "#b00020"}


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
    """Give axes a title, labels with units and a light grid."""
    axes.set_title(title, fontsize=10, loc="left", fontweight="bold")
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def legend(axes: Axes, **options: Any) -> None:
    """Draw a small legend on white."""
    axes.legend(fontsize=8, framealpha=0.9, edgecolor="none", **options)
