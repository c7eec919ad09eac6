"""Dithers in a diagram without a skill: one block commands them, one correlates them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
    require_whole,
)
from chamfer.systems.primitives.correlation import FREE, correlation
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx


class TrajectoryPrimitive(LeafSystem):
    """Commands the velocity of one or several trajectory primitives, from t = 0.

    .. pydrake_system::

        name: TrajectoryPrimitive
        output_ports:
        - velocity

    ``velocity``, shape (6,), rad/s above m/s, is a continuous function of time. A block that
    samples it has to hold it.
    """

    def __init__(self, *primitives: MoveDx | Dither) -> None:
        super().__init__()

        def calc(context: Context, vector: BasicVector) -> None:
            time = context.get_time()
            velocities = [STILL if one.done(time) else one.velocity(time) for one in primitives]
            vector.SetFromVector(np.sum(velocities, axis=0))

        self.DeclareVectorOutputPort("velocity", 6, calc, {self.time_ticket()})


@dataclass(frozen=True, kw_only=True)
class CorrelatorParams:
    """Parameters of :class:`Correlator`; the paper prints no threshold."""

    samples: int | None = None  # of a window, N; None: derived, a cycle of the dither
    threshold: float = 0.8  # of the correlation C; below it the motion is obstructed; assumed
    amplitude_threshold: float = 0.7
    # of the amplitudes' ratio, below it the motion is obstructed; assumed
    windows: int = 2  # in a row below a threshold until the motion counts as obstructed; assumed
    period: float | None = None
    # s, between two samples; None: derived, that of the motion's controller

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_not_negative(self, "threshold", "amplitude_threshold")
        if self.samples is not None and not self.samples >= 4:
            raise ParameterError("samples", self.samples, "a whole number >= 4")
        require_whole(self, "windows")

    def resolved(self, *, samples: int, period: float) -> "ResolvedCorrelatorParams":
        """Return the parameters with these values in the fields that are open."""
        given: dict[str, Any] = {k: value for k, value in vars(self).items() if value is not None}
        return ResolvedCorrelatorParams(**{"samples": samples, "period": period} | given)


@dataclass(frozen=True, kw_only=True)
class ResolvedCorrelatorParams(CorrelatorParams):
    """Parameters of :class:`Correlator`; nothing is open."""

    samples: int
    period: float


class Correlator(LeafSystem):
    """Detects obstructed motion, window by window.

    .. pydrake_system::

        name: Correlator
        input_ports:
        - command
        - motion
        output_ports:
        - correlation
        - hindered

    - ``command`` and ``motion``, size 1, m/s or rad/s: f and g of eq. (1) along one axis, without
      the velocity that maintains contact.
    - ``correlation``, shape (3,): the :class:`Correlation` of the last whole window; pi^2/8, 1 and
      0 before there is one.
    - ``hindered``, size 1: 1 while C or the ratio of amplitudes was below its threshold in all of
      the last ``windows`` windows.

    Windows count samples. The block misses none, because Drake's time waits for it.

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
