"""Whether a hybrid position/force loop is stable, and how far it is from the end of that."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, NamedTuple, Protocol

from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.diagrams.contact.linear_loop import LinearLoop, linear_loops
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import CONTACT
from chamfer.systems.force.sampled_loop import NEUTRAL

# What a loop may be unstable by alone, and the settings without it.
_BLAMED: Final[Mapping[str, dict[str, Any]]] = {
    "force_integral": {"force_integral": 0.0},
    "force_damping": {"force_damping": 0.0},
    "creep_damping": {"creep_damping": 1e-6},
    "computation_delay": {"computation_delay": 0.0, "computation_jitter": 0.0},
}


class MayBeUnstable(Protocol):
    """A controller's settings."""

    @property
    def allow_unstable(self) -> bool:
        """Return whether a loop may run that is unstable."""


class Stability(NamedTuple):
    """How a loop's small motions grow, and what it bears; the worst of its modes."""

    growth: float | None  # 1/s, out of contact; None: it never is
    growth_contact: float  # 1/s
    gain_margin: float | None  # a factor on the torque; None: none up to a thousand
    delay_margin: float | None  # s, of the torque; None: none up to 10 periods
    least_gain: str  # the mode with that gain margin
    least_delay: str  # and the one with that delay margin


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
    return stability_of(linear_loops(scenario))


def stability_of(loops: tuple[LinearLoop, ...]) -> Stability:
    """Return growth and margins of a loop in its modes."""
    free = any(loop.mode != CONTACT for loop in loops)
    gains = {loop.name: loop.gain_margin() for loop in loops}
    delays = {loop.name: loop.delay_margin() for loop in loops}
    gain, delay = _least(gains), _least(delays)
    return Stability(
        growth=_growth(loops, contact=False) if free else None,
        growth_contact=_growth(loops, contact=True),
        gain_margin=gains.get(gain),
        delay_margin=delays.get(delay),
        least_gain=gain,
        least_delay=delay,
    )


def _least(margins: dict[str, float | None]) -> str:
    """Return the mode with the smallest margin, or nothing if none has one."""
    known = {name: margin for name, margin in margins.items() if margin is not None}
    return min(known, key=lambda name: known[name], default="")


def require_stable(scenario: HybridScenario) -> None:
    """Refuse a loop that is unstable, or warn of it with ``controller.allow_unstable``.

    Raises:
        ParameterError: If the loop would be unstable and may not be.
    """
    control = scenario.controller
    loops = {loop.name: loop for loop in linear_loops(scenario)}
    grows = {name: loop.growth_rate() for name, loop in loops.items()}
    unstable = [name for name, growth in grows.items() if growth > NEUTRAL]
    if not unstable:
        return
    free = [name for name in unstable if loops[name].mode != CONTACT]
    worst = max(free or unstable, key=lambda name: grows[name])
    where = "out of contact" if free else "in contact"
    if worst.startswith("sliding"):
        where = f"{where}, {worst}"
    found = f"the loop is unstable {where}, it grows at {grows[worst]:.3g} 1/s"
    for name, less in _BLAMED.items():
        calm = linear_loops(replace(scenario, controller=replace(control, **less)))
        if all(loop.growth_rate() <= NEUTRAL for loop in calm):
            refuse_or_warn(found, name, control, "a lower one")
            return
    refuse_or_warn(found, "law", control, "projected, transpose or other gains")


def refuse_or_warn(found: str, name: str, control: MayBeUnstable, remedy: str) -> None:
    """Refuse a controller's setting, or warn with ``allow_unstable``.

    Args:
        found: What is wrong.
        name: The setting.
        control: The controller's settings.
        remedy: What may be set instead.

    Raises:
        ParameterError: Unless ``allow_unstable`` is set.
    """
    if not control.allow_unstable:
        allowed = f"{remedy}: {found} (or controller.allow_unstable=true)"
        raise ParameterError(f"controller.{name}", getattr(control, name), allowed)
    # One place, so that it is said once, however often this is called.
    warnings.warn(found, stacklevel=1)


def _growth(loops: tuple[LinearLoop, ...], *, contact: bool) -> float:
    return max(loop.growth_rate() for loop in loops if (loop.mode == CONTACT) is contact)
