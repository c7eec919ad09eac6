"""Identification of the arm's impedance: stiffness, damping, delay.

The law K (x0 - x) + F = D v + M a + C v/|v|, F of the surface on the tool, C the friction that
the arm has itself, is fitted as displacement on force and motion: the force is what is measured
best, its noise is taken out of its squares, and a fit of force on displacement makes the stiffness
too small by what else displaces.
"""

from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from scipy.interpolate import make_interp_spline

from chamfer.analysis.identify.contact_fit import Touched
from chamfer.analysis.identify.motion import Motion
from chamfer.analysis.identify.quantity import (
    Array,
    Estimate,
    Quantity,
    in_blocks,
    jackknife,
    solve,
    unknown,
)
from chamfer.analysis.identify.sensor_fit import Sensed

_DELAYS: Final = np.arange(-0.06, 0.405, 0.01)  # s, that are tried
_SURE = 0.8  # of a compliance: half an interval that tells one is narrower
_FEWEST = 100  # rows
_STAMP = 0.01  # of a row: the standard deviation of its time
_STAMP_FREE = 0.1  # the same where nothing is touched, for the noise of the acceleration
_ALIKE = 0.01  # s, by which delays of axes may differ
_TIME = 0.3  # s, of damping over stiffness, the same
_MOVING = 0.3  # of the rows: where fewer move, those at rest are taken too
_AXES = "xyz"
_UNITS: Final = {
    **{f"stiffness.{axis}": "N/m" for axis in _AXES},
    **{f"damping.{axis}": "N s/m" for axis in _AXES},
    "delay": "s",
    "sensor.unit": "",
}


@dataclass(frozen=True, kw_only=True)
class Impedance:
    """Identified impedance."""

    quantities: dict[str, Quantity]
    residual: Array | None = None  # (n, 3), m, of the displacement; None: nothing was fitted


def fit_impedance(
    motion: Motion, touched: Touched, sensed: Sensed, told: float | None
) -> Impedance:
    """Return the impedance; without contact the motion determines only the delay.

    ``told``, N/m, is the stiffness that was set: it determines the unit of the forces.
    """
    known = np.zeros(len(motion.time), dtype=bool)
    known[int(_DELAYS[-1] / motion.period) + 1 : int(_DELAYS[0] / motion.period) - 1] = True
    known &= touched.steady
    if motion.reference is None or known.sum() < _FEWEST:
        why = "no reference position in the log" if motion.reference is None else "too short a log"
        return Impedance(quantities={name: unknown(unit, why) for name, unit in _UNITS.items()})
    moves = motion.moves(known)
    if np.sum(known & moves) > _MOVING * np.sum(known):
        known &= moves  # at rest the arm's friction is anything
    force = touched.force if touched.any else 0 * touched.force
    columns = [force, motion.velocity, motion.acceleration, motion.heading, np.ones_like(force)]
    given = np.stack(columns, axis=2)[known]  # (m, 3, 5)
    asked = make_interp_spline(motion.time, motion.reference)
    late = asked(motion.time[known, None] - _DELAYS)  # (m, delays, 3)
    moved = motion.position[known, :, None] - late.transpose(0, 2, 1)  # (m, 3, delays)
    moved -= moved.mean(axis=0)
    sums = (
        in_blocks(given[..., :, None] * given[..., None, :]),
        in_blocks(np.einsum("mak,mad->makd", given, moved)),
        in_blocks(moved**2),
    )
    noise = motion.quieter * (sensed.quantities["sensor.noise"].value or 0.0)
    sums[0][:, :, 0, 0] -= in_blocks(np.full(len(given), noise**2 * touched.any))[:, None]
    found = jackknife(_values, *sums)
    unsure = (_STAMP if touched.any else _STAMP_FREE) * motion.row
    stamp = np.diag([unsure**2, *[0.0] * 9])
    found = found._replace(covariance=found.covariance + stamp)
    delay = _delay(found, 0)
    lows, highs = found.values[7:] - found.half()[7:], found.values[7:] + found.half()[7:]
    if lows.max() > highs.min() + _ALIKE:
        first = int(np.argmin(found.values[7:]))
        each = ", ".join(f"{a} {d:.2f}" for a, d in zip(_AXES, found.values[7:], strict=True))
        delay = _delay(found, 7 + first, f"the first of the axes ({each} s): where the arm moves "
                       "its own friction looks like delay")  # fmt: skip
        found = jackknife(partial(_values, axis=first), *sums)
    late_by = float(found.values[0])
    totals = [s.sum(axis=0) for s in sums]
    chosen = _at(_coefficients(totals[0], totals[1]), late_by)
    residual = np.full_like(force, np.nan)
    at = np.stack([_at(moved[:, i], late_by) for i in range(3)], axis=1)
    residual[known] = at - np.einsum("mak,ak->ma", given, chosen)
    quantities = {"delay": delay}
    for i, axis in enumerate(_AXES):
        stiffness = _stiffness(found, i)
        quantities[f"stiffness.{axis}"] = stiffness
        damping = found.quantity(4 + i, "N s/m")
        if stiffness.value is None:
            damping = unknown("N s/m", stiffness.note)
        elif found.half()[4 + i] > _TIME * stiffness.value:
            damping = unknown("N s/m", f"too little motion along {axis}")
        quantities[f"damping.{axis}"] = damping
    quantities["sensor.unit"] = _unit(quantities, told)
    return Impedance(quantities=quantities, residual=residual)


def _coefficients(products: Array, right: Array) -> Array:
    """Return the coefficients of each axis and delay, (3, 5, delays)."""
    return np.stack([solve(p, r) for p, r in zip(products, right, strict=True)])


def _at(values: Array, delay: float) -> Array:
    """Return values, (..., delays), at a delay, s."""
    place = np.clip((delay - _DELAYS[0]) / (_DELAYS[1] - _DELAYS[0]), 0, len(_DELAYS) - 1.001)
    left = int(place)
    return np.asarray(
        values[..., left] + (place - left) * (values[..., left + 1] - values[..., left])
    )


def _lowest(costs: Array) -> float:
    """Return the delay, s, of the least cost, (delays,), interpolated between those tried."""
    i = int(np.argmin(costs))
    if i in (0, len(costs) - 1):
        return float(_DELAYS[i])
    before, here, after = costs[i - 1 : i + 2]
    return float(_DELAYS[i] + 0.5 * (before - after) / (before - 2 * here + after)
        * (_DELAYS[1] - _DELAYS[0]))  # fmt: skip


def _values(products: Array, right: Array, squares: Array, axis: int | None = None) -> Array:
    """Return delay, compliances, dampings, and the delay of each axis alone, (10,).

    The delay is that of all axes together, or of one.
    """
    coefficients = _coefficients(products, right)
    left = squares - np.einsum("akd,akd->ad", coefficients, right)
    costs = left / np.maximum(left.min(axis=1, keepdims=True), 1e-300)
    alone = [_lowest(cost) for cost in costs]
    delay = _lowest(costs.sum(axis=0)) if axis is None else alone[axis]
    chosen = _at(coefficients, delay)
    stiff = 1 / np.where(chosen[:, 0] == 0, np.inf, chosen[:, 0])
    return np.array([delay, *chosen[:, 0], *(-chosen[:, 1] * stiff), *alone])


def _stiffness(found: Estimate, i: int) -> Quantity:
    """Return the stiffness of an axis from its compliance."""
    compliance, half = float(found.values[1 + i]), float(found.half()[1 + i])
    if compliance + half < 0:
        return unknown("N/m", f"the tip gives way against the force along {_AXES[i]}: is it that "
                       "of the surface on the tool?")  # fmt: skip
    if half >= _SURE * compliance:
        return unknown("N/m", f"too little force along {_AXES[i]}")
    low, high = 1 / (compliance + half), 1 / (compliance - half)
    return Quantity(1 / compliance, low, high, "N/m", "in the log's unit of force")


def _delay(found: Estimate, i: int, note: str = "") -> Quantity:
    """Return a delay, which is not below 0."""
    value, half = float(found.values[i]), float(found.half()[i])
    if value >= _DELAYS[-1]:
        return unknown("s", "the motion follows the reference too little")
    return Quantity(max(0.0, value), max(0.0, value - half), max(0.0, value + half), "s", note)


def _unit(quantities: dict[str, Quantity], told: float | None) -> Quantity:
    """Return the factor to newton that makes the best known stiffness the one that was set."""
    known = [q for name, q in quantities.items() if name.startswith("stiff") and q.value]
    if told is None or not known:
        return unknown("", "the log does not determine it: forces and stiffness scale with it")
    best = min(known, key=lambda q: (q.high or 0.0) / (q.low or 1.0))
    value, low, high = (told / (one or np.nan) for one in (best.value, best.high, best.low))
    return Quantity(
        value, low, high, "", f"inferred from the stiffness that was set, {told:g} N/m"
    )
