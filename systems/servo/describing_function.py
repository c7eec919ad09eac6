"""The compensator's describing function and the limit cycle that it predicts.

It predicts a limit cycle's frequency well; as a certificate of stability it is optimistic (it
allows increments several times larger than the settling theorem), so it is no substitute.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import DiscreteTimeApproximation
from pydrake.systems.primitives import LinearSystem

from chamfer.systems.servo.compensator_law import AxisParams

Array = NDArray[np.float64]


def describing_function(axis: AxisParams, amplitude: Array) -> Array:
    """Return N(A) of the five-level relay, increment per m of error amplitude.

    ``N(A) = 4/(pi A) [n_s sqrt(1-(eps/A)^2) + (n_L-n_s) sqrt(1-(E/A)^2)]``, each term from its
    threshold on.
    """

    def term(height: float, threshold: float) -> Array:
        return height * np.sqrt(np.maximum(1.0 - (threshold / amplitude) ** 2, 0.0))

    small, large = axis.small_increment, axis.increment
    levels = term(small, axis.dead_zone) + term(large - small, axis.large_error)
    return 4.0 / (math.pi * amplitude) * levels


class LimitCycle(NamedTuple):
    """A predicted limit cycle of the error."""

    frequency: float  # rad/s
    amplitude: float  # m


def loop_response(
    plant: LinearSystem, period: float, frequencies: Array, *, delay_samples: int = 0
) -> NDArray[np.complex128]:
    """Return L(e^jwT) from increment to output: accumulator, hold, plant and dead time.

    The accumulator z/(z-1) passes an increment on in the tick in which it is added.
    """
    sampled = DiscreteTimeApproximation(plant, period)
    z = np.exp(1j * frequencies * period)
    resolvent = np.linalg.solve(
        z[:, None, None] * np.eye(len(sampled.A())) - sampled.A(),
        np.broadcast_to(sampled.B(), (len(z), *sampled.B().shape)),
    )
    response: NDArray[np.complex128] = (sampled.C() @ resolvent)[:, 0, 0] * z / (z - 1.0)
    late: NDArray[np.complex128] = response * z**-delay_samples
    return late


def predict_limit_cycle(
    plant: LinearSystem, axis: AxisParams, period: float, *, delay_samples: int = 0
) -> LimitCycle | None:
    """Return the stable limit cycle of the harmonic balance ``1 + N(A) L = 0``, if there is one.

    N is real and positive, so the frequency is where L crosses the negative real axis; the
    amplitude is the largest A for which N(A) = 1/|L|. A cycle of two ticks, at the Nyquist
    frequency, is outside of what this method sees.
    """
    nyquist = math.pi / period
    frequencies = np.geomspace(1e-4 * nyquist, nyquist * (1 - 1e-9), 20_001)
    response = loop_response(plant, period, frequencies, delay_samples=delay_samples)
    crossing = np.flatnonzero((np.diff(np.sign(response.imag)) != 0) & (response.real[:-1] < 0))
    if len(crossing) == 0:
        return None
    i = int(crossing[np.argmax(np.abs(response[crossing]))])
    part = response.imag[i] / (response.imag[i] - response.imag[i + 1])
    frequency = float(frequencies[i] + part * (frequencies[i + 1] - frequencies[i]))
    gain = float(abs(response[i]))
    # N(A) never exceeds 4 n/(pi A), which bounds the amplitude.
    largest = 4.0 * axis.increment * gain / math.pi
    if largest <= axis.dead_zone:
        return None
    amplitudes = np.geomspace(axis.dead_zone, largest, 20_001)
    enough = np.flatnonzero(describing_function(axis, amplitudes) * gain >= 1.0)
    if len(enough) == 0:
        return None
    return LimitCycle(frequency, float(amplitudes[enough[-1]]))
