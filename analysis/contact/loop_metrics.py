"""Metrics of how stable a loop is."""

from chamfer.analysis.scenario.experiment import Metric
from chamfer.diagrams.contact.hybrid_loop_stability import Stability
from chamfer.systems.force.sampled_loop import NEUTRAL


def stability_metrics(found: Stability) -> dict[str, Metric]:
    """Return growth and margins of the linear loop, the worst of its modes."""
    metrics = {} if found.growth is None else {"loop.growth": _growth(found.growth, "out of")}
    return metrics | {
        "loop.growth_contact": _growth(found.growth_contact, "in"),
        "loop.gain_margin": Metric(
            value=found.gain_margin,
            unit="",
            note=f"on the torque; {found.least_gain}" if found.least_gain else "none up to 1000",
        ),
        "loop.delay_margin": Metric(
            value=found.delay_margin,
            unit="s",
            note=f"of the torque; {found.least_delay}"
            if found.least_delay
            else "none up to 10 periods",
        ),
    }


def _growth(growth: float, where: str) -> Metric:
    stable = growth <= NEUTRAL
    note = "" if stable else f"unstable {where} contact, run by controller.allow_unstable"
    return Metric(value=0.0 if stable else growth, unit="1/s", note=note)
