"""How stable a loop is, said below its figure."""

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Outcome


def note_stability(figure: Figure, outcome: Outcome) -> None:
    """Write growth and margins, the metrics of ``loop``."""
    found = {
        name.removeprefix("loop."): metric
        for name, metric in outcome.metrics.items()
        if name.startswith("loop.")
    }
    if not found:
        return
    grows = max(found[name].value or 0.0 for name in found if name.startswith("growth"))
    gain, delay = found["gain_margin"].value, found["delay_margin"].value
    parts = (
        f"unstable, grows at {grows:.3g} 1/s" if grows else "stable",
        "no gain margin" if gain is None else f"gain margin {gain:.3g}",
        "no delay margin" if delay is None else f"delay margin {1e3 * delay:.3g} ms",
    )
    where = found["delay_margin"].note.removeprefix("of the torque; ")
    figure.supxlabel(
        f"linear loop: {', '.join(parts)} ({where})",
        x=0.01,
        ha="left",
        fontsize=8,
        color="#b00020" if grows else "#333333",
    )
