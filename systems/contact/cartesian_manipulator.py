"""The Cartesian manipulator of eq. (5-7) as a block."""

import math

import numpy as np
from pydrake.systems.primitives import LinearSystem

from chamfer.models.arms.cartesian_manipulator import CartesianManipulatorParams, sampled_dynamics
from chamfer.models.validation import ParameterError


def make_cartesian_manipulator(
    params: CartesianManipulatorParams, *, start: tuple[float, ...], step: float
) -> LinearSystem:
    """Return the manipulator as a discrete linear system, exact for forces held over a step, s.

    Its input, shape (d,), N, is the sum of the effort and of the contact force of the surface on
    the manipulator. State and output, shape (2d,), are position, m, then velocity, m/s, as
    encoders give them. There is no direct feedthrough. It starts at rest at ``start``, m, shape
    (d,).
    """
    d = len(start)
    if d not in (2, 3) or not all(map(math.isfinite, start)):
        raise ParameterError("start", start, "2 or 3 finite numbers")
    A, B = sampled_dynamics(params, step, dimension=d)
    manipulator = LinearSystem(A, B, np.eye(2 * d), np.zeros((2 * d, d)), step)
    manipulator.configure_default_state(np.array([*start, *(0.0,) * d]))
    manipulator.set_name("manipulator")
    return manipulator
