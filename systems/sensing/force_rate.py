"""Sensors of a force and its rate: measured, filtered, differenced and averaged."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from chamfer.models.validation import (
    ParameterError,
    finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.ports import finite_input

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ForceRateSensorParams:
    """Parameters of :class:`ForceRateSensor`.

    A noise is the rms length of a vector with three axes (4-9), (4-15): also in the plane, the
    standard deviation of each axis is the noise by the square root of 3.
    """

    force_noise: float = 1.0  # N, u_F, of the force; section 5.2
    force_rate_noise: float = 5.0  # N/s, u_Fdot, of its rate; section 5.2
    bias: tuple[float, ...] | None = None  # N, constant error of the force on each axis

    def __post_init__(self) -> None:
        require_not_negative(self, "force_noise", "force_rate_noise")
        if self.bias is not None and not all(map(math.isfinite, self.bias)):
            raise ParameterError("bias", self.bias, "finite numbers")


class ForceRateSensor(LeafSystem):
    """Measures the contact force and its rate of change (Figs. 5-1 and 5-7).

    .. pydrake_system::

        name: ForceRateSensor
        input_ports:
        - contact_force
        - contact_force_rate
        - noise
        output_ports:
        - measured_force
        - measured_force_rate

    ``contact_force``, shape (d,), N, and ``contact_force_rate``, shape (d,), N/s, of the surface
    on the arm. ``noise``, shape (2d,), independent standard normal samples (Drake's Gaussian
    ``RandomSource``), first for the force, then for the rate; it is not read if both noises are
    zero. ``measured_force``, shape (d,), N, and ``measured_force_rate``, shape (d,), N/s, of the
    arm on the surface: the opposite sign. The ``dimension`` d is 2 or 3.

    Raises:
        ParameterError: If the bias has another dimension; while running, if a measured value is
            not finite.
    """

    def __init__(self, params: ForceRateSensorParams, *, dimension: int) -> None:
        super().__init__()
        d = dimension
        bias = np.zeros(d) if params.bias is None else np.array(params.bias)
        if bias.shape != (d,):
            raise ParameterError("bias", params.bias, f"{d} numbers")
        silent = params.force_noise == params.force_rate_noise == 0
        inputs = [
            self.DeclareVectorInputPort(f"contact_{of}", d) for of in ("force", "force_rate")
        ]
        noise = self.DeclareVectorInputPort("noise", 2 * d)

        def declare(
            of: str, signal: InputPort, length: float, first: int, constant: Array
        ) -> None:
            scale = length / math.sqrt(3)

            def calc(context: Context, vector: BasicVector) -> None:
                measured = constant - signal.Eval(context)
                if not silent:
                    measured += scale * noise.Eval(context)[first : first + d]
                vector.SetFromVector(finite(f"measured {of.replace('_', ' ')}", measured))

            depends = {signal.ticket(), noise.ticket()}
            self.DeclareVectorOutputPort(f"measured_{of}", d, calc, depends)

        declare("force", inputs[0], params.force_noise, 0, bias)
        declare("force_rate", inputs[1], params.force_rate_noise, d, np.zeros(d))


@dataclass(frozen=True, kw_only=True)
class ForceRateParams:
    """Parameters of :class:`ForceRate`."""

    time_constant: float = 0.1  # s, of the filter before the difference; the rate lags by it

    def __post_init__(self) -> None:
        require_positive(self, "time_constant")

    def share(self, period: float) -> float:
        """Return the filter's response to a step of the force after one period, s."""
        return 1 - math.exp(-period / self.time_constant)

    def noise_gain(self, period: float) -> float:
        """Return the rate's standard deviation over that of a force with white noise, 1/s."""
        share = self.share(period)
        return share / period * math.sqrt(2 / (2 - share))


class ForceRate(LeafSystem):
    """Differentiates a force numerically after a first-order filter.

    .. pydrake_system::

        name: ForceRate
        input_ports:
        - measured_force
        output_ports:
        - measured_force_rate

    With the filtered force ``f <- f + a (F - f)`` and the period T the rate is ``a (F - f) / T``,
    of the sample at the inputs.

    ``measured_force``, shape (d,), N; ``measured_force_rate``, shape (d,), N/s. The period is in
    s.

    Discrete state: the last period's filtered force, shape (d,), N; 0 at first.

    Raises:
        ParameterError: If the force is not finite.
    """

    def __init__(self, params: ForceRateParams, *, dimension: int, period: float) -> None:
        super().__init__()
        share = params.share(period)
        force = self.DeclareVectorInputPort("measured_force", dimension)
        filtered = self.DeclareDiscreteState(dimension)

        def change(context: Context) -> np.ndarray:
            measured = finite_input(force, context)
            step: np.ndarray = share * (measured - context.get_discrete_state(filtered).value())
            return step

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(change(context) / period)

        def tick(context: Context, values: DiscreteValues) -> None:
            before = context.get_discrete_state(filtered).value()
            values.set_value(filtered, before + change(context))

        sources = {force.ticket(), self.discrete_state_ticket(filtered)}
        self.DeclareVectorOutputPort("measured_force_rate", dimension, calc, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)


class MovingAverage(LeafSystem):
    """Averages the last samples of a signal, the present one included.

    .. pydrake_system::

        name: MovingAverage
        input_ports:
        - signal
        output_ports:
        - mean

    With white noise the mean of n samples has the n-th part of the variance, and a delay of
    (n - 1) / 2 periods. Before n samples it is the mean of the samples so far.

    ``signal`` and ``mean``, shape (size,), in the signal's unit; the period is in s.

    Discrete state: the last n - 1 samples, the newest first, shape ((n - 1) * size,), and their
    number so far, size 1.

    Raises:
        ParameterError: If one of them is not positive; while running, if the signal is not finite.
    """

    def __init__(self, *, samples: int, period: float, size: int) -> None:
        super().__init__()
        if samples < 1:
            raise ParameterError("samples", samples, "1 or more")
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        kept = samples - 1
        signal = self.DeclareVectorInputPort("signal", size)
        last = self.DeclareDiscreteState(kept * size)
        counted = self.DeclareDiscreteState(1)

        def calc(context: Context, vector: BasicVector) -> None:
            count = context.get_discrete_state(counted).value()[0]
            before = context.get_discrete_state(last).value().reshape(kept, size)
            # What there was not yet is zero.
            total = finite_input(signal, context) + before.sum(axis=0)
            vector.SetFromVector(total / (1 + count))

        def tick(context: Context, values: DiscreteValues) -> None:
            before = context.get_discrete_state(last).value()
            count = context.get_discrete_state(counted).value()[0]
            newest = np.concatenate([finite_input(signal, context), before])
            values.set_value(last, newest[: kept * size])
            values.set_value(counted, np.array([min(count + 1, kept)]))

        self.DeclareVectorOutputPort("mean", size, calc, {signal.ticket(), self.xd_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)
