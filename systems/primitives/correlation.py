r"""The correlation primitive: is the commanded motion obstructed, eq. (1).

Source: Morrow, Nelson and Khosla, section 3.2. The commanded velocity f, a dither, is correlated
with the velocity g that accommodation makes of it, over a window of N samples::

    C = N sum(f g) / (sum|f| sum|g|)

Two equal sines over a period, sampled where they are zero, have C = (N^2 / 8) tan^2(pi / N) for
even N, near pi^2 / 8 = 1.2337. (A cosine of N = 4 m + 2 samples is not zero on any of them:
(N^2 / 8) sin^2(pi / N).) A phase lag phi of g lowers it by cos(phi), and so a constraint with the
stiffness k under the damping D and at the frequency w gives (pi^2 / 8) / sqrt(1 + (k / (D w))^2).
As C is normalised it cannot see a constraint that takes from g without shifting it: a stop on one
side leaves C at pi^2 / 8. The ratio of the amplitudes, sum|g| / sum|f|, sees that, and the mean of
g sees that the motion is one-sided.

Eq. (1) is for a command that is a pure dither and for a motion without bias: a mean of g adds to
sum|g|, and so does noise, and both lower C though nothing obstructs. :class:`Phasors` keep of both
signals only what has the dither's frequency: with

    F = integral of f d(e^(-2 pi i t)),  G = integral of g d(e^(-2 pi i t))

over a whole cycle, t from 0 to 1, C is (pi^2 / 8) Re(F G*) / (|F| |G|), what eq. (1) gives for the
two sines alone, and the ratio of the amplitudes is |G| / |F|. A sample stands for the time since
the one before. So a mean of f or g adds nothing, whenever the samples come and however many are
missing: the cycle counts time. Of N samples, white noise with the standard deviation s adds
s sqrt(N) to |G|, against N / 2 times the amplitude, and a g that drifts by d over the cycle
adds d N / (2 pi), all times 2 pi / N.
"""

import cmath
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
    require_whole,
)

FREE = math.pi**2 / 8  # C of two sines without phase lag, of many samples


class Correlation(NamedTuple):
    """What a window shows."""

    value: float  # C of eq. (1); 0 where one of the signals is zero
    amplitude_ratio: float  # sum|g| / sum|f|; 0 without a command
    bias: float  # |sum g| / sum|g|, 0 to 1: how one-sided the motion is; 0 without motion


class Phasors(NamedTuple):
    """What a cycle of a dither has summed up so far of both signals at the dither's frequency."""

    command: complex = 0j
    motion: complex = 0j

    def add(self, command: float, motion: float, begin: float, end: float) -> "Phasors":
        """Return the sums with f and g from ``begin`` to ``end``, shares of the cycle."""
        turn = cmath.exp(-2j * math.pi * end) - cmath.exp(-2j * math.pi * begin)
        return Phasors(self.command + command * turn, self.motion + motion * turn)

    def correlation(self) -> Correlation:
        """Return what the cycle shows; its bias is left out, and so 0."""
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


@dataclass(frozen=True, kw_only=True)
class CorrelatorParams:
    """Parameters of :class:`Correlator`; the paper prints no threshold."""

    samples: int | None = None  # of a window, N; None: derived, a cycle of the dither
    threshold: float = 0.8  # of the correlation C, below it the motion is obstructed; assumed
    amplitude_threshold: float = 0.7
    # of the amplitudes' ratio, below it the motion is obstructed; assumed
    windows: int = 2  # in a row that have to say so; assumed
    period: float | None = None
    # s, between two samples; None: derived, that of the motion's controller

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_not_negative(self, "threshold", "amplitude_threshold")
        if self.samples is not None and not self.samples >= 4:
            raise ParameterError("samples", self.samples, "a whole number >= 4")
        require_whole(self, "windows")

    def resolved(self, *, samples: int, period: float) -> "ResolvedCorrelatorParams":
        """Return the parameters with these values where they leave them open."""
        given: dict[str, Any] = {k: value for k, value in vars(self).items() if value is not None}
        return ResolvedCorrelatorParams(**{"samples": samples, "period": period} | given)


@dataclass(frozen=True, kw_only=True)
class ResolvedCorrelatorParams(CorrelatorParams):
    """Parameters of :class:`Correlator`; nothing is open."""

    samples: int
    period: float


class Correlator(LeafSystem):
    """Watches whether a commanded motion is obstructed, window by window.

    .. pydrake_system::

        name: Correlator
        input_ports:
        - command
        - motion
        output_ports:
        - correlation
        - hindered

    ``command`` and ``motion``, size 1, m/s or rad/s: f and g of eq. (1) along one axis, without
    the velocity that maintains contact. ``correlation``, shape (3,), is the last whole window's
    :class:`Correlation`, pi^2/8, 1 and 0 before there is one. ``hindered``, size 1, is 1 while the
    last ``windows`` windows all had a C or a ratio of amplitudes below its threshold.

    Discrete state: the window's samples and how many there are, the last correlation, and how many
    windows in a row were below.

    Raises:
        ParameterError: In a run if an input is not finite.
    """

    def __init__(self, params: ResolvedCorrelatorParams) -> None:
        super().__init__()
        self._params = params
        self._inputs = [self.DeclareVectorInputPort(name, 1) for name in ("command", "motion")]
        self._window = self.DeclareDiscreteState(2 * params.samples)  # f, then g
        self._taken = self.DeclareDiscreteState(1)
        self._last = self.DeclareDiscreteState(np.array([FREE, 1.0, 0.0]))
        below = self.DeclareDiscreteState(1)
        self._below = below
        self.DeclareStateOutputPort("correlation", self._last)

        def calc(context: Context, vector: BasicVector) -> None:
            vector[0] = float(context.get_discrete_state(below)[0] >= params.windows)

        self.DeclareVectorOutputPort("hindered", 1, calc, {self.discrete_state_ticket(below)})
        # After controllers, which update their velocity at the same instant.
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, changed: DiscreteValues) -> None:
        state = context.get_discrete_state
        taken, window = int(state(self._taken)[0]), np.array(state(self._window).value())
        window = window.reshape(2, -1)
        for signal, port in zip(window, self._inputs, strict=True):
            value = float(port.Eval(context)[0])
            if not math.isfinite(value):
                raise ParameterError(port.get_name(), value, "a finite number")
            signal[taken] = value
        taken += 1
        if taken == self._params.samples:
            found = correlation(*window)
            before = state(self._below)[0]
            low = (
                found.value < self._params.threshold
                or found.amplitude_ratio < self._params.amplitude_threshold
            )
            changed.set_value(self._last, np.array(found))
            changed.set_value(self._below, np.array([before + 1 if low else 0.0]))
            taken = 0
        changed.set_value(self._window, window.ravel())
        changed.set_value(self._taken, [taken])
