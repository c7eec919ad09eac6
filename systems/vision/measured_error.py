"""The alignment error as a camera sees it: sampled, of finite resolution, late, sometimes lost."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)
from pydrake.systems.primitives import RandomSource

from chamfer.models.validation import ParameterError, require_not_negative, require_positive

_MOST_DELAYED: Final = 10_000  # samples, all of them state


@dataclass(frozen=True, kw_only=True)
class CameraErrorParams:
    """Camera errors that act on the measured error."""

    resolution: float = 0.0  # m, the error is rounded to multiples of it; 0: not rounded
    latency: float = 0.0  # s, taken up to the next whole sample
    noise: float = 0.0  # m, half-width of a uniform noise, 1.73 times its standard deviation

    def __post_init__(self) -> None:
        require_not_negative(self, "resolution", "latency", "noise")


@dataclass(frozen=True, kw_only=True)
class MeasuredErrorParams(CameraErrorParams):
    """Parameters of :class:`MeasuredError`; with noise its port of that name has to be fed."""

    size: int = 1
    period: float = 1 / 80  # s, section 4

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.size < 1:
            raise ParameterError("size", self.size, "a whole number >= 1")
        require_positive(self, "period")
        longest = _MOST_DELAYED * self.period
        if self.latency > longest:
            raise ParameterError(
                "latency",
                self.latency,
                f"at most {longest:g} s, {_MOST_DELAYED} periods of {self.period:g} s",
            )

    @property
    def delay_samples(self) -> int:
        """Whole samples between the exposure and the sample at which its error is there."""
        return math.ceil(self.latency / self.period - 1e-9)

    @property
    def bound(self) -> float:
        """Largest difference between measured and true error at the time of the exposure, m."""
        return self.resolution / 2 + self.noise


def seen(error: float, sample: float, noise: float, resolution: float) -> float:
    """Return an error as a camera measures it, m.

    The true error and the noise's half-width are in m, its sample from 0 to 1; without resolution,
    m, it is not rounded. A plain function of numbers, so that the compiled loops can compile it.
    """
    if noise:
        error += noise * (2.0 * sample - 1.0)
    if resolution:
        # Unlike math.floor, // gives a float, in machine code too, however large it is.
        error = resolution * ((error / resolution + 0.5) // 1.0)
    return error


class MeasuredError(LeafSystem):
    """Measures desired minus actual trajectory with the errors of a camera.

    .. pydrake_system::

        name: MeasuredError
        input_ports:
        - desired_trajectory
        - actual_trajectory
        - visible (optional)
        - noise (optional)
        output_ports:
        - error

    ``error`` is in the inputs' unit, one element per axis. While ``visible`` (size 1) is below one
    half it is NaN, which compensators treat as no measurement. ``noise`` is a sample from 0 to 1
    per axis (Drake's uniform ``RandomSource``). The block scales it to an error of up to the
    parameter of that name in either direction. It has to be connected if that parameter is not 0.
    Without latency the output follows the inputs directly. With latency it is held between samples
    and the first ones are NaN. A block that samples at the same instants sees the whole delay.

    Discrete state: the errors on their way, oldest last, NaN where nothing was seen.

    Raises:
        ValueError: If a trajectory is not finite while the part is visible.
    """

    def __init__(self, params: MeasuredErrorParams) -> None:
        super().__init__()
        self._params = params
        size, delay = params.size, params.delay_samples
        self._desired = self.DeclareVectorInputPort("desired_trajectory", size)
        self._actual = self.DeclareVectorInputPort("actual_trajectory", size)
        self._visible = self.DeclareVectorInputPort("visible", 1)
        self._noise = self.DeclareVectorInputPort("noise", size)
        depends = {self.all_input_ports_ticket()}
        if delay:
            depends = {self.xd_ticket()}
            self.DeclareDiscreteState(np.full(delay * size, math.nan))
            self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._shift)
        self.DeclareVectorOutputPort("error", size, self._calc_error, depends)

    def _measure(self, context: Context) -> list[float]:
        params = self._params
        if self._visible.HasValue(context) and not self._visible.Eval(context)[0] >= 0.5:
            return [math.nan] * params.size
        # A list is faster than an array for the few axes of a robot.
        error: list[float] = (self._desired.Eval(context) - self._actual.Eval(context)).tolist()
        if not all(map(math.isfinite, error)):
            raise ValueError(
                f"{self.get_name()}: desired_trajectory minus actual_trajectory is {error} at "
                f"t = {context.get_time():g} s, must be finite"
            )
        noise = self._noise.Eval(context).tolist() if params.noise else [0.0] * params.size
        return [
            seen(e, sample, params.noise, params.resolution)
            for e, sample in zip(error, noise, strict=True)
        ]

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        if self._params.delay_samples:
            late = context.get_discrete_state_vector().value()
            output.SetFromVector(late[-self._params.size :])
        else:
            output.SetFromVector(self._measure(context))

    def _shift(self, context: Context, values: DiscreteValues) -> None:
        older = context.get_discrete_state_vector().value()[: -self._params.size]
        values.set_value(np.concatenate([self._measure(context), older]))


def add_measured_error(builder: DiagramBuilder, params: MeasuredErrorParams) -> MeasuredError:
    """Add a block named "computer vision" and, if it is noisy, the source of its noise."""
    vision: MeasuredError = builder.AddNamedSystem("computer vision", MeasuredError(params))
    if params.noise:
        noise = builder.AddNamedSystem(
            "camera noise",
            RandomSource(RandomDistribution.kUniform, params.size, params.period),
        )
        builder.Connect(noise.get_output_port(), vision.GetInputPort("noise"))
    return vision
