"""The manipulator of the surface-tracking simulations, a mass and a damper in every axis.

Thesis, section 5.3.3, eq. (5-7): ``m x'' = u - b x' + F`` in each endpoint coordinate, with the
effort u and the contact force F, linear and decoupled, as an inner loop of a real arm would make
it.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import ParameterError, require_not_negative, require_positive

AXES: Final = ("x", "y", "z")

_SERIES_TERMS: Final = 20  # enough below 1: 1/22! is under the rounding


@dataclass(frozen=True, kw_only=True)
class CartesianManipulatorParams:
    """Parameters of the manipulator, the same in every axis."""

    mass: float = 0.5  # kg, in every direction; not published: assumed
    damping: float = 10.0  # N s/m, in every direction; not published: assumed

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_not_negative(self, "damping")


def sampled_dynamics(
    params: CartesianManipulatorParams, step: float, *, dimension: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return eq. (5-7) over a step, s, in which the force is held; exact, in closed form.

    A, shape (2d, 2d), and B, shape (2d, d), of ``x[k + 1] = A x[k] + B u[k]``, for the state
    position (m), then velocity (m/s), and as input the sum of effort and contact force, N, in d
    axes.
    """
    if not 0 < step < math.inf:
        raise ParameterError("step", step, "a finite number > 0")
    decay = params.damping * step / params.mass
    once, twice = step * _phi_1(decay), step**2 * _phi_2(decay)
    A = np.array([[1.0, once], [0.0, math.exp(-decay)]])
    B = np.array([[twice / params.mass], [once / params.mass]])
    each = np.eye(dimension)
    return np.kron(A, each), np.kron(B, each)


def _phi_1(z: float) -> float:
    """Return ``(1 - exp(-z)) / z``."""
    return -math.expm1(-z) / z if z > 0 else 1.0


def _phi_2(z: float) -> float:
    """Return ``(z - 1 + exp(-z)) / z^2``."""
    if z >= 1:
        return (1 + math.expm1(-z) / z) / z
    # The closed form cancels.
    return sum((-z) ** k / math.factorial(k + 2) for k in range(_SERIES_TERMS))


def cartesian_kinematics(dimension: int) -> Kinematics:
    """Return the kinematics of a manipulator whose joints are its endpoint coordinates."""
    if dimension not in (2, 3):
        raise ParameterError("dimension", dimension, "2, 3")
    axes = AXES[:dimension]

    def endpoint(q: NDArray[Any]) -> NDArray[Any]:
        return np.array(q)

    def jacobian(q: NDArray[Any]) -> NDArray[Any]:
        return np.eye(dimension)

    return Kinematics(
        name="Cartesian manipulator",
        joint_names=axes,
        prismatic=axes,
        coordinates=axes,
        coordinate_units=("m",) * dimension,
        endpoint=endpoint,
        jacobian=jacobian,
    )
