"""Growth of the position loop out of contact over the workspace."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from analysis.drawing.figure_style import DESIRED, dress, new_figure
from analysis.run.experiment import Outcome
from diagrams.contact.planar_scenarios import PlanarLoop
from systems.force.sampled_loop import NEUTRAL

_STABLE = "#dfe7f2"


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


def _only(colour: str) -> ListedColormap:
    return ListedColormap([colour])
