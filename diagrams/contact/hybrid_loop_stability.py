"""Whether a hybrid position/force loop is stable, and how far it is from the end of that."""

import warnings
from dataclasses import replace
from typing import NamedTuple

from diagrams.contact.hybrid_scenario import HybridScenario
from diagrams.contact.linear_loop import LinearLoop, linear_loops
from models.validation import ParameterError
from systems.force.contact_detection import CONTACT
from systems.force.sampled_loop import NEUTRAL, delay_margin, gain_margin


class Stability(NamedTuple):
    """How a loop's small motions grow, and what it bears; the worst of its modes."""

    growth: float  # 1/s, out of contact
    growth_contact: float  # 1/s
    gain_margin: float | None  # a factor on the torque; None: none up to a thousand
    delay_margin: float | None  # s, of the torque; None: none up to 20 periods
    weakest: str  # the mode that bears least


def growth_rate(scenario: HybridScenario) -> float:
    """Return the largest growth of the loop out of contact, 1/s.

    Raises:
        ParameterError: If the full dynamics' inertia is open, or a point out of reach.
    """
    return _growth(linear_loops(scenario), contact=False)


def growth_contact(scenario: HybridScenario) -> float:
    """Return the largest growth of the loop in contact, 1/s.

    Raises:
        ParameterError: As :func:`growth_rate`.
    """
    return _growth(linear_loops(scenario), contact=True)


def stability(scenario: HybridScenario) -> Stability:
    """Return growth and margins.

    Raises:
        ParameterError: As :func:`growth_rate`.
    """
    loops = linear_loops(scenario)
    period = scenario.controller.period

    def grows(factor: float = 1.0, delay: float = 0.0) -> float:
        return max(loop.growth_rate(factor, delay) for loop in loops)

    factor = gain_margin(grows)
    bears = {loop.name: gain_margin(loop.growth_rate) or float("inf") for loop in loops}
    return Stability(
        growth=_growth(loops, contact=False),
        growth_contact=_growth(loops, contact=True),
        gain_margin=factor,
        delay_margin=delay_margin(lambda delay: grows(delay=delay), period),
        weakest=min(bears, key=lambda name: bears[name]),
    )


def require_stable(scenario: HybridScenario) -> None:
    """Refuse a loop that is unstable, or warn of it with ``controller.allow_unstable``.

    Raises:
        ParameterError: If the loop would be unstable and may not be.
    """
    loops, control = linear_loops(scenario), scenario.controller
    free, contact = _growth(loops, contact=False), _growth(loops, contact=True)
    if max(free, contact) <= NEUTRAL:
        return
    where = "out of contact" if free > NEUTRAL else "in contact"
    found = f"the loop is unstable {where}, it grows at {max(free, contact):.3g} 1/s"
    if control.allow_unstable:
        # One place, so that it is said once, however often this is called.
        warnings.warn(found, stacklevel=1)
        return
    name, remedy = "law", "projected, transpose or other gains"
    if free <= NEUTRAL:
        calm = replace(scenario, controller=replace(control, force_integral=0.0))
        if growth_contact(calm) <= NEUTRAL:
            name, remedy = "force_integral", "a lower one"
    raise ParameterError(
        f"controller.{name}",
        getattr(control, name),
        f"{remedy}: {found} (or controller.allow_unstable=true)",
    )


def _growth(loops: tuple[LinearLoop, ...], *, contact: bool) -> float:
    return max(loop.growth_rate() for loop in loops if (loop.mode == CONTACT) is contact)
