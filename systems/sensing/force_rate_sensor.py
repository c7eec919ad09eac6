"""A force sensor that also gives the force's rate, with Gaussian noise on both."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem

from chamfer.models.validation import ParameterError, require_not_negative

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
    arm on the surface: the opposite sign.

    Args:
        params: The noise.
        dimension: d, 2 or 3.

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
            self.DeclareVectorInputPort(name, d)
            for name in ("contact_force", "contact_force_rate")
        ]
        noise = self.DeclareVectorInputPort("noise", 2 * d)

        def declare(
            name: str, signal: InputPort, length: float, samples: slice, constant: Array
        ) -> None:
            scale = length / math.sqrt(3)

            def calc(context: Context, vector: BasicVector) -> None:
                measured = constant - signal.Eval(context)
                if not silent:
                    measured += scale * noise.Eval(context)[samples]
                if not all(map(math.isfinite, measured.tolist())):
                    printed = name.replace("_", " ")
                    raise ParameterError(printed, measured.tolist(), "finite numbers")
                vector.SetFromVector(measured)

            self.DeclareVectorOutputPort(name, d, calc, {signal.ticket(), noise.ticket()})

        none = np.zeros(d)
        declare("measured_force", inputs[0], params.force_noise, slice(0, d), bias)
        declare("measured_force_rate", inputs[1], params.force_rate_noise, slice(d, 2 * d), none)
