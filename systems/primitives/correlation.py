r"""The correlation primitive, eq. (1), which detects that a commanded motion is obstructed.

Source: Morrow, Nelson and Khosla, section 3.2. The commanded velocity f, a dither, is correlated
with the velocity g that accommodation makes of it, over a window of N samples::

    C = N sum(f g) / (sum|f| sum|g|)

Two equal sines over a period, sampled where they are zero, have C = (N^2 / 8) tan^2(pi / N) for
even N, near pi^2 / 8 = 1.2337. (A cosine of N = 4 m + 2 samples is not zero on any of them:
(N^2 / 8) sin^2(pi / N).) A phase lag phi of g lowers it by cos(phi). A constraint with the
stiffness k under the damping D and at the frequency w gives (pi^2 / 8) / sqrt(1 + (k / (D w))^2).
C is normalised, so that it cannot detect a constraint that reduces g without shifting it: a stop
on one side leaves C at pi^2 / 8. The ratio of the amplitudes, sum|g| / sum|f|, detects that stop,
and the mean of g shows that the motion is one-sided.

Eq. (1) is for a command that is a pure dither and for a motion without bias. A mean of g adds to
sum|g|, and so does noise, and both lower C without any obstruction. :class:`Phasors` keep of both
signals only the part at the dither's frequency: with

    F = integral of f d(e^(-2 pi i t)),  G = integral of g d(e^(-2 pi i t))

over a whole cycle, t from 0 to 1, C is (pi^2 / 8) Re(F G*) / (|F| |G|), what eq. (1) gives for the
two sines alone, and the ratio of the amplitudes is |G| / |F|. A sample stands for the time since
the one before: a mean of f or g adds nothing, whichever samples are late or missing. White noise
of N samples with the standard deviation s adds 2 pi s / sqrt(N) to |G|, against pi times the
amplitude, and a g that drifts by d over the cycle adds d.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

FREE = math.pi**2 / 8  # C of two sines without phase lag, of many samples


class Correlation(NamedTuple):
    """The correlation of a window and its companions."""

    value: float  # C of eq. (1); 0 where one of the signals is zero
    amplitude_ratio: float  # sum|g| / sum|f|; 0 without a command
    bias: float  # |sum g| / sum|g|, 0 to 1: how one-sided the motion is; 0 without motion


class Phasors(NamedTuple):
    """Sums of both signals at the dither's frequency, over the part of a cycle so far."""

    command: complex = 0j
    motion: complex = 0j

    def add(self, command: float, motion: float, begin: float, end: float) -> "Phasors":
        """Return the sums with f and g from ``begin`` to ``end``, shares of the cycle."""
        turn = cmath.exp(-2j * math.pi * end) - cmath.exp(-2j * math.pi * begin)
        return Phasors(self.command + command * turn, self.motion + motion * turn)

    def correlation(self) -> Correlation:
        """Return the correlation of the cycle; its bias is left out, and so 0."""
        f, g = abs(self.command), abs(self.motion)
        product = (self.command * self.motion.conjugate()).real
        return Correlation(
            FREE * product / (f * g) if f * g > 0 else 0.0, g / f if f > 0 else 0.0, 0.0
        )


def correlation(command: ArrayLike, motion: ArrayLike) -> Correlation:
    """Return eq. (1) and its companions of two signals, shape (N,) each."""
    f, g = np.asarray(command, dtype=np.float64), np.asarray(motion, dtype=np.float64)
    if f.shape != g.shape or f.ndim != 1:
        raise ValueError(f"the signals have the shapes {f.shape} and {g.shape}, allowed: one (N,)")
    commanded, moved = float(np.abs(f).sum()), float(np.abs(g).sum())
    both = commanded * moved
    return Correlation(
        len(f) * float(f @ g) / both if both > 0 else 0.0,
        moved / commanded if commanded > 0 else 0.0,
        abs(float(g.sum())) / moved if moved > 0 else 0.0,
    )
