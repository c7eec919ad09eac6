"""Figures of calibrations: what remains in every corner, and errors beside their deviations."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.calibration.calibration import Calibration, Picture
from chamfer.analysis.drawing.figure_kit import colour_bar, draw_cumulative
from chamfer.analysis.drawing.figure_style import BAND, LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.models.cameras.camera_file import CalibratedCamera

Array = NDArray[np.float64]

_USED, _OUT = "#1b4f9c", "#b00020"
_CELLS: Final = (16, 12)  # of the picture, in which corners are counted
_LONG: Final = 0.05  # of the picture's width, an arrow of a long residual
_NAMED: Final = 40  # pictures, at most, that are called by their names


def plot_residuals(found: Calibration) -> Figure:
    """Draw a row for each camera: residuals, coverage and the error of each picture."""
    cameras = [found.cameras.left, *([found.cameras.right] if found.cameras.right else [])]
    most = max(map(len, found.pictures))
    height = max(4.2, 0.17 * min(most, _NAMED) + 1.4)
    figure = new_figure(15.0, height * len(cameras))
    panels = figure.subplots(len(cameras), 3, width_ratios=(1.25, 1.25, 1.0), squeeze=False)
    whose = [""] if len(cameras) == 1 else ["Left camera: ", "Right camera: "]
    rows = zip(panels, cameras, found.pictures, whose, strict=True)
    for (residuals, coverage, errors), camera, pictures, name in rows:
        _residuals(residuals, camera, *_corners(pictures), name)
        _coverage(coverage, camera, _corners(pictures)[0])
        for axes in (residuals, coverage):
            axes.set_xlim(-0.5, camera.width - 0.5)
            axes.set_ylim(camera.height - 0.5, -0.5)
            axes.set_aspect("equal")
        _errors(errors, pictures)
    return figure


def _corners(pictures: tuple[Picture, ...]) -> tuple[Array, Array]:
    """Return all corners and what remains in them, pixels, both shape (n, 2)."""
    used = [one for one in pictures if one.pixels is not None and one.residuals is not None]
    pixels = np.concatenate([one.pixels for one in used if one.pixels is not None])
    residuals = np.concatenate([one.residuals for one in used if one.residuals is not None])
    return pixels, residuals


def _residuals(
    axes: Axes, camera: CalibratedCamera, pixels: Array, residuals: Array, whose: str
) -> None:
    long = float(np.quantile(np.linalg.norm(residuals, axis=1), 0.95)) or 1e-9
    shown = float(f"{long:.1g}")
    arrows = axes.quiver(
        *pixels.T,
        *residuals.T,
        angles="xy",
        scale_units="xy",
        scale=long / (_LONG * camera.width),
        width=0.0018,
        color=_USED,
    )
    axes.quiverkey(
        arrows, 0.93, 0.04, shown, f"{shown:g} px", labelpos="W", fontproperties={"size": 8}
    )
    axes.plot(*camera.principal_point, "+", color=_OUT, markersize=10)
    title = f"{whose}Seen minus projected, rms {camera.reprojection_error:.3f} px"
    dress(axes, title=title, x="u / pixels", y="v / pixels")


def _coverage(axes: Axes, camera: CalibratedCamera, pixels: Array) -> None:
    u = np.linspace(-0.5, camera.width - 0.5, _CELLS[0] + 1)
    v = np.linspace(-0.5, camera.height - 0.5, _CELLS[1] + 1)
    counts, _, _ = np.histogram2d(pixels[:, 0], pixels[:, 1], bins=[u, v])
    shown = np.where(counts > 0, counts, np.nan)
    mesh = axes.pcolormesh(u, v, shown.T, cmap="Blues", vmin=0)
    colour_bar(axes, mesh, "corners / cell", shrink=0.8)
    covered = 100 * float(np.mean(counts > 0))
    dress(axes, title=f"Corners in {covered:.0f} % of the cells", x="u / pixels", y="v / pixels")


def _errors(axes: Axes, pictures: tuple[Picture, ...]) -> None:
    places = np.arange(len(pictures))
    axes.barh(places, [one.error or 0.0 for one in pictures], color=_USED, height=0.7)
    for place, one in enumerate(pictures):
        if one.left_out:
            axes.text(0, place, " left out", color=_OUT, fontsize=7, va="center")
    dress(axes, title="Error of each picture", x="rms / pixels", y="")
    if len(pictures) <= _NAMED:
        axes.set_yticks(places, [_short(one.name) for one in pictures], fontsize=7)
    else:
        axes.set_ylabel("picture / number", fontsize=9)
    axes.set_ylim(len(pictures) - 0.4, -0.6)


def _short(name: str) -> str:
    """Return a name as a label: no longer than a label may be, and nothing in it is a formula."""
    return (name if len(name) <= 24 else f"...{name[-21:]}").replace("$", r"\$")


_POINT: Final[Style] = {"color": "#1b4f9c", "linestyle": "none", "marker": "o", "markersize": 3}
_SPREAD: Final = 0.3  # of a column, to either side


def plot_calibrations(
    outcome: Outcome,
    parameters: Sequence[str],
    focal: Array,
    *,
    near: float,
    deviations: float,
) -> Figure:
    """Draw errors over standard deviations, how many are within, and focal lengths' errors.

    Args:
        outcome: With the traces and the metrics.
        parameters: Their names.
        focal: Errors of the focal lengths, %, shape (sets,).
        near: What they should be within, %.
        deviations: Within how many standard ones parameters should be.
    """
    figure = new_figure(13.0, 4.6)
    over, within, lengths = figure.subplots(1, 3, width_ratios=(1.5, 1.0, 1.0))
    _over(over, outcome, parameters, deviations)
    _within(within, outcome, parameters, deviations)
    _lengths(lengths, focal, near)
    return figure


def _over(axes: Axes, outcome: Outcome, parameters: Sequence[str], deviations: float) -> None:
    for i, name in enumerate(parameters):
        off = outcome.traces[f"{name}_error"] / outcome.traces[f"{name}_sd"]
        places = i + np.linspace(-_SPREAD, _SPREAD, len(off))
        axes.plot(places, off, **_POINT, alpha=0.6, label="a set" if i == 0 else None)
    axes.axhspan(-deviations, deviations, **BAND)
    axes.set_xticks(range(len(parameters)), parameters)
    largest = max(np.abs(axes.get_ylim()).max(), deviations + 1)
    axes.set_ylim(-largest, largest)
    y = "error / standard deviation"
    dress(axes, title="Each parameter in each set", x="", y=y)
    legend(axes, loc="upper right")


def _within(axes: Axes, outcome: Outcome, parameters: Sequence[str], deviations: float) -> None:
    def values(key: str) -> Array:
        return np.array([outcome.metrics[f"{name}.{key}"].value for name in parameters], float)

    shares, low, high = values("within"), values("within.low"), values("within.high")
    places = np.arange(len(parameters))
    axes.errorbar(places, shares, [shares - low, high - shares], **_POINT, capsize=3)
    axes.axhline(95, **LIMIT, label="asked: 95 %")
    axes.set_xticks(places, parameters)
    axes.set_ylim(min(80, *low) - 1, 101)
    dress(axes, title=f"Within {deviations:g} standard deviations", x="", y="sets / %")
    legend(axes, loc="lower right")


def _lengths(axes: Axes, focal: Array, near: float) -> None:
    draw_cumulative(axes, focal, {"color": _POINT["color"]}, "drawn sets")
    axes.axvline(near, **LIMIT, label=f"asked: {near:g} %")
    axes.set_xlim(0, 1.1 * max(near, float(focal.max())))
    axes.set_ylim(0, 101)
    axes.locator_params(axis="x", nbins=5)
    dress(axes, title="Focal lengths", x="error, at most / %", y="sets / %")
    legend(axes, loc="lower right")
