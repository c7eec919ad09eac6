"""Growth of the position loop out of contact over the workspace."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from chamfer.analysis.contact.hybrid_margins import MODES
from chamfer.analysis.drawing.figure_style import DESIRED, LIMIT, NOTE, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.planar_scenarios import PlanarLoop
from chamfer.systems.force.sampled_loop import NEUTRAL

_STABLE = "#dfe7f2"
_SETS = ("#1b4f9c", "#e07b00")


def plot_stability(loop: PlanarLoop, cases: Sequence[tuple[str, str]], outcome: Outcome) -> Figure:
    """Draw a map for each elbow and law: blue where stable, shaded by growth where not."""
    traces = outcome.traces
    size = round(np.sqrt(len(traces["x"]) / len(cases)))
    figure = new_figure(11.0, 9.5)
    figure.set_layout_engine("compressed")  # for panels of equal scale
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    growth = traces["growth"]
    unstable = growth[np.isfinite(growth) & (growth > NEUTRAL)]
    norm = LogNorm(max(1.0, float(unstable.min(initial=1.0))), float(unstable.max(initial=100.0)))
    drawn = None
    for i, (axes, (elbow, law)) in enumerate(zip(panels, cases, strict=True)):
        of = traces["case"] == i
        x, y = traces["x"][of].reshape(size, size), traces["y"][of].reshape(size, size)
        rate = growth[of].reshape(size, size)
        reached = np.where(np.isfinite(rate), 1.0, np.nan)
        axes.pcolormesh(x, y, reached, cmap=_only(_STABLE), shading="nearest", rasterized=True)
        shown = np.where(rate > NEUTRAL, rate, np.nan)
        drawn = axes.pcolormesh(
            x, y, shown, cmap="inferno_r", norm=norm, shading="nearest", rasterized=True
        )
        axes.add_patch(Circle((1.0, -0.75), 0.75, fill=False, **DESIRED))
        axes.plot(*loop.touching, "o", mfc="white", mec="black", ms=7)
        share = outcome.metrics[f"{elbow}.{law}.unstable_share"].value
        title = f"{law}, {elbow} elbow: {share:.3g} % unstable"
        dress(axes, title=title, x="x / m" if i > 1 else "", y="" if i % 2 else "y / m")
        axes.set_aspect("equal")
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=panels.tolist(), shrink=0.6)
        bar.set_label("growth out of contact / (1/s); blue: stable", fontsize=9)
    return figure


def plot_margins(sets: Mapping[str, PlanarLoop], outcome: Outcome) -> Figure:
    """Draw growth by the torque's delay and by the force integral, and poles in contact."""
    figure = new_figure(12.0, 4.6)
    delay, integral, plane = figure.subplots(1, 3)
    table = outcome.tables["delays"]
    for i, (name, loop) in enumerate(sets.items()):
        control = loop.controller
        gains = f"Kp {control.stiffness:g}, Ki {control.integral:g}, Kd {control.damping:g}"
        for j, mode in enumerate(MODES.values()):
            of = (table["gains"] == i) & (table["mode"] == j)
            style = {"color": _SETS[i], "linestyle": ("-", "--", ":")[j], "linewidth": 1.6}
            delay.plot(
                1e3 * table["delay"][of], table["growth"][of], label=f"{name}, {mode}", **style
            )
        of = outcome.tables["force_integrals"]["gains"] == i
        integral.plot(
            outcome.tables["force_integrals"]["force_integral"][of],
            outcome.tables["force_integrals"]["growth"][of],
            label=f"{name}: {gains}",
            color=_SETS[i],
        )
        integral.axvline(control.force_integral, color=_SETS[i], linestyle=":", linewidth=1.0)
    period = next(iter(sets.values())).controller.period
    delay.axvline(1e3 * period, **LIMIT)
    delay.annotate(
        "one sample", (1.02e3 * period, 0.93), xycoords=("data", "axes fraction"), **NOTE
    )
    dress(delay, title="(a) Torque that comes late", x="delay / ms", y="growth / (1/s)")
    delay.set_ylim(top=1.7 * max(1.0, float(table["growth"].max())))  # room for the legend
    legend(delay, loc="upper left")
    dress(
        integral,
        title="(b) Force integral in contact, dotted: as it is",
        x="force integral / (1/s)",
        y="growth / (1/s)",
    )
    legend(integral, loc="upper left")
    drawn = outcome.tables["poles"]
    for model, label, marker, size in (
        (0, "differences of the diagram", "o", 8),
        (1, "model", "x", 6),
    ):
        of = drawn["model"] == model
        plane.plot(
            drawn["real"][of],
            drawn["imaginary"][of],
            marker,
            ms=size,
            mfc="none",
            color=_SETS[model],
            label=label,
        )
    plane.add_patch(Circle((0.0, 0.0), 1.0, fill=False, **DESIRED))
    plane.set_aspect("equal")
    dress(plane, title="(c) Poles in contact, chapter 2", x="real part", y="imaginary part")
    legend(plane, loc="center", bbox_to_anchor=(0.45, 0.25))
    return figure


def _only(colour: str) -> ListedColormap:
    return ListedColormap([colour])
