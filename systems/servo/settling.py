r"""When the compensator settles: the theorem, and the design that follows from it.

One axis. The plant has the DC gain g and, sampled at the compensator's period, the unit-gain step
response s_j (s_0 = 0, dead time included); d_j = 1 - s_j is what of an increment has not arrived j
samples later, d+ and d- its positive and negative parts, T(j) = sum_{i >= j} |d_i| its tail. The
measurement is off by at most nu. The compensator acts on measured errors from the dead zone eps
on, with the increment n_s below the large error E and n_L from E on.

**Theorem.** Start at rest with an error of either sign and any size. If

1. g n_s (1 + T(1)) <= 2 (eps - nu), and
2. with J = floor((E + eps - 2 nu - g n_L (1 + T(1))) / (g n_s)), J >= 0 and
   g n_s (1 + T(1)) + g (n_L - n_s) T(J + 1) <= 2 (eps - nu),

then no action ever reverses, finitely many actions are taken, and the loop comes to rest with a
measured error inside the dead zone.

*Proof.* Take e_0 > 0. Let all actions a_i before sample k be >= 0. The settled error
z_k = r - g sum_{i<k} a_i is what would remain if nothing were added any more, and
e_k = z_k + g sum_{i<k} a_i d_{k-i} >= z_k - g sum a_i d-_{k-i}. At the last action before k, at
sample n, z_{n+1} = e_n - g sum_{i<n} a_i d_{n-i} - g a_n. If a_n = n_L then e_n >= E - nu, every
a_i <= n_L, and e_k >= E - nu - g n_L (1 + T(1)), which is at least -(eps - nu) because J >= 0. If
a_n = n_s and the last large action was j samples before n, there are two bounds. Counting small
actions down from there, e_k >= E - nu - g n_L (1 + T(1)) - g j n_s: enough for j <= J. And, since
e_n >= eps - nu and what is left of the large actions is in the tail from j on,
e_k >= eps - nu - g n_s (1 + T(1)) - g (n_L - n_s) T(j): enough for j >= J + 1. So the measured
error stays above -eps, and the first reversal can't happen. Each action lowers z by at least
g n_s and z is bounded below, so the actions end; then e tends to z, and as no action is taken the
measured error is inside the dead zone. (An error that tends to the edge itself from outside would
be acted on; measure-zero ties at the edge count as inside.) For e_0 < 0 mirror.

Condition 1 alone is the theorem for starts within the small band. For a plant that settles
within a sample T = 0, and g n_s <= 2 (eps - nu) is also necessary for every offset to have a
rest point.

**Play.** The theorem holds with a play before the plant: backlash, or a spring against dry
friction, of any width and entered anywhere. While no action reverses, what the play passes on of
an action a_i is between 0 and a_i, which is all that the proof uses of it, and the play is crossed
once, in finitely many actions. So it takes time only: in the small band up to its width over g n_s
periods.

**Overshoot.** Let J' = floor((E - eps - 2 nu - g n_L (1 + T(1))) / (g n_s)) >= 0 and let condition
2 hold with J' in place of J. Then, at the samples, the output goes beyond its resting value by at
most g n_s D(1) + g (n_L - n_s) D(J' + 2), with D(j) = sum_{i >= j} d-_i. Between samples a lightly
damped plant can go further.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import DiscreteTimeApproximation
from pydrake.systems.primitives import LinearSystem

from chamfer.models.plants.linear_response import free_response
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.compensator_law import AxisParams, OpenAxisParams

Array = NDArray[np.float64]

_NEGLIGIBLE = 1e-13  # of the step response, where its tail is cut
_LONGEST = 1_000_000  # samples
_SHARE = 0.9  # of the bound on the small increment that the design uses
_OVERSHOOT = 0.25  # of the dead zone that the design lets the output go beyond its rest
_ROUNDING = 1e-6  # samples, so that floor() does not lose one


@dataclass(frozen=True)
class SettlingPlant:
    """The properties of a plant that the theorem needs."""

    gain: float  # output per compensation at rest, g
    undelivered: Array  # d_1, d_2, ..., of the unit-gain step response

    @property
    def total(self) -> float:
        """T(1), the sum of all |d_j|."""
        return float(np.abs(self.undelivered).sum())

    def tail(self) -> Array:
        """Return T(1), T(2), ... and a last zero."""
        return _tail(np.abs(self.undelivered))

    def overshoot_tail(self) -> Array:
        """Return D(1), D(2), ... and a last zero."""
        return _tail(np.maximum(-self.undelivered, 0.0))


def _tail(values: Array) -> Array:
    return np.append(np.cumsum(values[::-1])[::-1], 0.0)


def sample_plant(
    plant: LinearSystem,
    period: float,
    *,
    delay_samples: int = 0,
    dead_time: float = 0.0,
    owner: str = "",
) -> SettlingPlant:
    """Return the properties of a continuous plant that the settling theorem needs.

    Args:
        plant: One input, one output, no feed-through.
        period: s, the compensator's.
        delay_samples: Dead time of the loop, for instance the camera's latency.
        dead_time: s, further dead time, of the plant.
        owner: What a refusal names before the period, "fsm.".

    Raises:
        ParameterError: If the plant is not asymptotically stable, has no DC gain, or settles too
            slowly to be sampled at this period.
    """
    if np.any(plant.D()):
        raise ParameterError("the plant's feed-through", plant.D().tolist(), "zero")
    eigenvalues = np.linalg.eigvals(plant.A())
    slowest = float(eigenvalues.real.max())
    if not slowest < 0:
        raise ParameterError("the plant's slowest pole", slowest, "a real part < 0")
    rest = np.linalg.solve(plant.A(), -plant.B())
    gain = float((plant.C() @ rest)[0, 0])
    if not gain > 0:
        raise ParameterError(
            "the plant's DC gain", gain, "a finite number > 0, the theorem needs one"
        )
    sampled = DiscreteTimeApproximation(plant, period)
    count = 2.0 + math.log(_NEGLIGIBLE) / (slowest * period)
    if count > _LONGEST:
        raise ParameterError(
            f"{owner}period",
            period,
            f"at least {period * count / _LONGEST:g} s, the plant's slowest pole is "
            f"{slowest:g} 1/s",
        )
    # The error of the state, rest - x, decays as A_d^j once the plant has begun to answer.
    whole, part = divmod(dead_time, period)
    begun, first = rest[:, 0], 1
    if part:
        begun, first = DiscreteTimeApproximation(plant, period - part).A() @ begun, 0
    states = free_response(sampled.A(), begun / gain, math.ceil(count))
    undelivered = (plant.C() @ states)[0, first:]
    return SettlingPlant(gain, np.concatenate([np.ones(delay_samples + int(whole)), undelivered]))


@dataclass(frozen=True)
class Guarantee:
    """The guarantees of the settling theorem for one axis."""

    small_band: bool  # from rest within the small band: condition 1
    everywhere: bool  # from rest at any error: both conditions
    small_share: float  # g n_s (1 + T(1)) / (2 (eps - nu)), at most 1 where condition 1 holds
    more_delay: int  # samples of further dead time that condition 1 bears, -1 if it does not hold


def guarantee(axis: AxisParams, plant: SettlingPlant, measurement_error: float) -> Guarantee:
    """Return the theorem's guarantee for an axis; ``measurement_error`` is nu."""
    g, tail = plant.gain, plant.tail()
    small, large = g * axis.small_increment, g * axis.increment
    room = _room(axis.dead_zone, measurement_error)
    small_need = small * (1.0 + tail[0])
    small_band = bool(small_need <= room)
    # A sample of dead time is one more d_j = 1.
    more_delay = math.floor((room - small_need) / small + _ROUNDING) if small_band else -1
    above = axis.large_error + axis.dead_zone - 2 * measurement_error - large * (1.0 + tail[0])
    everywhere = False
    if small_band and above >= 0:
        j = min(math.floor(above / small) + 1, len(tail))
        everywhere = bool(small_need + (large - small) * tail[j - 1] <= room)
    return Guarantee(small_band, everywhere, float(small_need / room), more_delay)


def allowed_increment(
    plant: SettlingPlant, *, dead_zone: float, measurement_error: float, divider: float = 5.0
) -> float:
    """Return the large increment n that the theorem allows, in the compensation's unit.

    It uses a share of the bound on the small increment; what is left lets the large increments
    die out. The overshoot that it allows is a part of the dead zone, which has to be more than
    the measurement error.
    """
    room = _room(dead_zone, measurement_error)
    small = _SHARE * room / (1.0 + plant.total)
    overshoot = plant.overshoot_tail()[0]
    if overshoot > 0:
        small = min(small, _SHARE * _OVERSHOOT * dead_zone / overshoot)
    return float(divider * small / plant.gain)


def allowed_axis(
    plant: SettlingPlant,
    *,
    dead_zone: float,
    measurement_error: float,
    divider: float = 5.0,
    increment: float | None = None,
    share: float = 1.0,
    limit: float = math.inf,
) -> AxisParams:
    """Return an axis with a large error E that the theorem allows.

    Its increment n is that share of :func:`allowed_increment`, whose arguments the others are, if
    none is given. The overshoot, at the samples, stays below a quarter of the dead zone. For an
    increment beyond condition 1 no large error is allowed; that of the axis then satisfies J >= 0.
    """
    if increment is None:
        increment = share * allowed_increment(
            plant, dead_zone=dead_zone, measurement_error=measurement_error, divider=divider
        )
    large = plant.gain * increment
    small = large / divider
    tail, over = plant.tail(), plant.overshoot_tail()
    left = _room(dead_zone, measurement_error) - small * (1.0 + tail[0])
    dies_out = (large - small) * tail <= left
    beyond = _OVERSHOOT * dead_zone - small * over[0]
    if beyond >= 0:
        dies_out[:-1] &= (large - small) * over[1:] <= beyond
    # Where the increment is within the bound the tail's last entry, zero, is small enough.
    samples = int(np.argmax(dies_out)) + _ROUNDING
    waiting = dead_zone + 2 * measurement_error + large * (1.0 + tail[0]) + samples * small
    return AxisParams(
        dead_zone=dead_zone,
        large_error=float(waiting),
        increment=increment,
        divider=divider,
        limit=limit,
    )


def designed_axis(
    given: OpenAxisParams,
    plants: Sequence[SettlingPlant],
    *,
    increment: float,
    measurement_error: float,
    limit: float,
) -> AxisParams:
    """Return an axis with open fields designed such that it settles on every plant.

    The dead zone is the smallest one in which the wanted increment settles, the large error the
    smallest one that the theorem allows. Both are rounded up to three digits, which the theorem
    admits, so that they don't depend on how a machine rounds the response. A dead zone that is
    given makes the increment smaller if it has to be.

    Raises:
        ParameterError: If a dead zone that is given leaves nothing beyond the measurement error.
    """
    divider = given.divider

    def allowed(dead_zone: float, error: float) -> float:
        return min(
            allowed_increment(one, dead_zone=dead_zone, measurement_error=error, divider=divider)
            for one in plants
        )

    dead_zone, large_error = given.dead_zone, given.large_error
    if given.increment is not None:
        increment = given.increment
    elif dead_zone is not None:
        most = allowed(dead_zone, measurement_error)
        increment = increment if increment <= most else _rounded(most, math.floor)
    if dead_zone is None:
        # allowed() is linear in what the dead zone has beyond the measurement error.
        dead_zone = _rounded(measurement_error + increment / allowed(1.0, 0.0), math.ceil)
    if large_error is None:
        needed = max(
            allowed_axis(
                one,
                dead_zone=dead_zone,
                measurement_error=measurement_error,
                increment=increment,
                divider=divider,
            ).large_error
            for one in plants
        )
        large_error = _rounded(max(needed, dead_zone), math.ceil)
    return AxisParams(
        dead_zone=dead_zone,
        large_error=large_error,
        increment=increment,
        divider=divider,
        limit=limit if given.limit is None else given.limit,
    )


def _rounded(value: float, to_whole: Callable[[float], int]) -> float:
    """Return a number > 0 with three digits."""
    digits = 2 - math.floor(math.log10(value))
    return float(f"{to_whole(value * 10.0**digits)}e{-digits}")


def _room(dead_zone: float, measurement_error: float) -> float:
    if not dead_zone > measurement_error:
        raise ParameterError(
            "dead_zone", dead_zone, f"more than the measurement error, {measurement_error:g}"
        )
    return 2.0 * (dead_zone - measurement_error)


def approach_time(axis: AxisParams, plant: SettlingPlant, error: float, period: float) -> float:
    """Return an estimate of the time, s, in which the loop comes to rest from ``error`` m.

    One increment per period: large ones until the error, which lags behind by what has not
    arrived yet, is no longer large, then small ones, then the plant's answer to the last.
    """
    large, small = plant.gain * axis.increment, plant.gain * axis.small_increment
    lag = min(axis.large_error, large * float(plant.undelivered.sum()))
    far = max(0.0, abs(error) - axis.large_error)
    near = min(abs(error), axis.large_error)
    count = (far + lag) / large + (near - lag) / small if far > 0 else near / small
    answer = int(np.argmax(plant.tail() <= 0.05 * (1.0 + plant.total)))
    return period * (math.ceil(count) + answer)
