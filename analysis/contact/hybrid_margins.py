"""What the planar loop bears, of delay and force integral, and whether its model is right."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from chamfer.analysis.contact.still_loop import settled, smooth
from chamfer.analysis.linear.to_control import to_control
from chamfer.analysis.scenario.experiment import Metric, Table, column
from chamfer.diagrams.contact.hybrid_filled import filled
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.diagrams.contact.linear_loop import linear_loop, linear_loops
from chamfer.diagrams.contact.planar_scenarios import PlanarLoop
from chamfer.systems.force.contact_detection import CONTACT
from chamfer.systems.force.sampled_loop import NEUTRAL

MODES: Final = {"the approach's end": "approach", "lost contact": "lost", "contact": "contact"}
_DELAYS: Final = np.linspace(0.0, 2.0, 41)  # periods
_FORCE_INTEGRALS: Final = np.linspace(0.0, 25.0, 26)  # 1/s
_SETTLED: Final = 2.0  # s after the time of the contact


def margin_metrics(name: str, loop: PlanarLoop) -> dict[str, Metric]:
    """Return growth in contact and margins of a loop, stable or not, and growth a sample late."""
    found = stability(filled(loop))
    late = replace(loop.controller, computation_delay=loop.controller.period)
    worst = max(one.growth_rate() for one in linear_loops(replace(loop, controller=late)))
    return {
        f"{name}.growth_contact": Metric(value=_or_zero(found.growth_contact), unit="1/s"),
        f"{name}.growth_one_sample_late": Metric(value=_or_zero(worst), unit="1/s"),
        f"{name}.gain_margin": Metric(
            value=found.gain_margin, unit="", note=found.least_gain or "none up to 1000"
        ),
        f"{name}.delay_margin": Metric(
            value=found.delay_margin, unit="s", note=found.least_delay or "none up to 10 periods"
        ),
    }


def margin_tables(sets: Mapping[str, PlanarLoop]) -> dict[str, Table]:
    """Return growth by delay and by force integral.

    ``delays``: ``gains`` and ``mode``, numbers in ``sets`` and :data:`MODES`; ``delay`` s;
    ``growth`` 1/s. ``force_integrals``: ``gains``, ``force_integral`` 1/s and ``growth``, in
    contact.
    """
    delays: dict[str, list[float]] = {"gains": [], "mode": [], "delay": [], "growth": []}
    integrals: dict[str, list[float]] = {"gains": [], "force_integral": [], "growth": []}
    for i, loop in enumerate(sets.values()):
        control = loop.controller
        modes = [one for one in linear_loops(loop) if one.name in MODES]
        for j, one in enumerate(modes):
            for delay in (_DELAYS * control.period).tolist():
                grows = one._replace(delay=delay).growth_rate()
                for name, value in zip(delays, (i, j, delay, _or_zero(grows)), strict=True):
                    delays[name].append(value)
        for gain in _FORCE_INTEGRALS.tolist():
            changed = replace(loop, controller=replace(control, force_integral=gain))
            grows = linear_loop(changed, "contact", CONTACT, loop.touching).growth_rate()
            for name, value in zip(integrals, (i, gain, _or_zero(grows)), strict=True):
                integrals[name].append(value)
    return {
        "delays": {name: column(values) for name, values in delays.items()},
        "force_integrals": {name: column(values) for name, values in integrals.items()},
    }


def _or_zero(growth: float) -> float:
    """Return 0 for what is a neutral pole in floating point."""
    return growth if growth > NEUTRAL else 0.0


def poles(loop: PlanarLoop) -> tuple[Table, Metric]:
    """Return poles in contact, of the linear loop and of its diagram, and how far they are apart.

    The table has ``model``, 1 for those of the linear loop and 0 for those of the diagram,
    ``real`` and ``imaginary``.
    """
    note = "of the linear loop's from the diagram's, without dry friction"
    still = smooth(filled(loop))
    if max(one.growth_rate() for one in linear_loops(still)) > NEUTRAL:
        return _no_poles("unstable")
    diagram, period = make_hybrid_diagram(still), still.controller.period
    context = settled(diagram, still.distance / still.task.speed + _SETTLED)
    if diagram.GetOutputPort("mode").Eval(context)[0] != CONTACT:
        return _no_poles("no contact")
    found = to_control(diagram, at=context, period=period, whole=True).poles()
    q = diagram.GetOutputPort("encoders").Eval(context)[: still.ARM.num_joints]
    model = linear_loop(still, "contact", CONTACT, still.ARM.endpoint(q))
    expected = np.linalg.eigvals(model.period_map())
    apart = max(float(np.abs(found - pole).min()) for pole in expected)
    both = np.concatenate([expected, found])
    table = {
        "model": np.repeat([1.0, 0.0], [len(expected), len(found)]),
        "real": both.real,
        "imaginary": both.imag,
    }
    return table, Metric(value=apart, unit="", note=note)


def _no_poles(note: str) -> tuple[Table, Metric]:
    none = {name: np.zeros(0) for name in ("model", "real", "imaginary")}
    return none, Metric(value=None, unit="", note=note)
