"""The impulse of a surface's spring and damper over a step, pushing only."""

import math

from chamfer.systems.compiled import compiled


@compiled
def normal_impulse(
    gap: float, free: float, reach: float, spring: float, damping: float, rigid: bool
) -> float:
    """Return p for a gap of ``free + reach p`` after the step, N s.

    The law, as :mod:`chamfer.systems.contact.stick_slip` says it, falls with the gap after the
    step, which grows with p, so that there is exactly one; each case has a closed form.

    Args:
        gap: m, before the step, negative while touching.
        free: m, after the step without an impulse.
        reach: m/(N s), >= 0.
        spring: N s/m, the step's length times the stiffness.
        damping: N s/m.
        rigid: True: the spring gives back all that it takes; False: it is implicit.
    """
    if not rigid:
        wanted = -spring * free - damping * (free - min(gap, 0.0))
        return max(0.0, wanted / (1.0 + reach * (spring + damping)))
    if gap <= 0.0:
        wanted = -spring * (gap + free) / 2 - damping * (free - gap)
        wanted /= 1.0 + reach * (spring / 2 + damping)
        if free + reach * wanted <= 0.0:
            return max(0.0, wanted)
        moved = free - gap + reach * damping * gap  # leaving: g+ - g from a quadratic equation
        moved = (moved + math.hypot(moved, gap * math.sqrt(2.0 * reach * spring))) / 2
        return max(0.0, spring * gap * gap / (2.0 * moved) + damping * gap)
    if free >= 0.0:
        return 0.0
    # Touching: g+ < 0 from a quadratic equation.
    half = (gap * (1.0 + reach * damping) + free) / 2
    square = 1.0 + reach * (spring / 2 + damping)
    root = math.sqrt(half * half - square * free * gap)
    after = free * gap / (half + root) if half > 0.0 else (half - root) / square
    return spring * after * after / (2.0 * (gap - after)) - damping * after


@compiled
def normal_slope(gap: float, after: float, spring: float, damping: float, rigid: bool) -> float:
    """Return by how much p grows with the gap after the step, N s/m, where it pushes.

    Args:
        gap: m, before the step.
        after: m, after it.
        spring: N s/m, as in :func:`normal_impulse`, and so on.
        damping: N s/m.
        rigid: True: the spring gives back all that it takes; False: it is implicit.
    """
    if not rigid:
        return -spring - damping
    if gap <= 0.0:
        if after <= 0.0:
            return -spring / 2 - damping
        return -spring / 2 * (gap / (after - gap)) ** 2
    if after >= 0.0:
        return 0.0
    return spring / 2 * after * (2.0 * gap - after) / (gap - after) ** 2 - damping
