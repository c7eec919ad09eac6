"""The manipulator of the surface-tracking simulations, a mass and a damper in every axis.

Thesis, section 5.3.3, eq. (5-7): ``m x'' = u - b x' + F`` in each endpoint coordinate, with the
effort u and the contact force F, linear and decoupled, as an inner loop of a real arm would make
it.
"""

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.arms.arm import Kinematics
from models.validation import ParameterError

AXES: Final = ("x", "y", "z")

_SERIES_TERMS: Final = 20  # enough below 1: 1/22! is under the rounding


@dataclass(frozen=True, kw_only=True)
class CartesianManipulatorParams:
    """Parameters of the manipulator, one number an axis; x and y, or x, y and z."""

    mass: tuple[float, ...] = (0.5, 0.5)  # kg, not published: assumed
    damping: tuple[float, ...] = (10.0, 10.0)  # N s/m, not published: assumed

    def __post_init__(self) -> None:
        size = len(self.mass)
        if size not in (2, 3) or not all(0 < mass < math.inf for mass in self.mass):
            raise ParameterError("mass", self.mass, "2 or 3 finite numbers > 0")
        if len(self.damping) != size or not all(0 <= one < math.inf for one in self.damping):
            raise ParameterError("damping", self.damping, f"{size} finite numbers >= 0")

    @property
    def dimension(self) -> int:
        """Number of axes d."""
        return len(self.mass)


class SampledDynamics(NamedTuple):
    """Matrices of ``x[k + 1] = A x[k] + B u[k]``."""

    A: NDArray[np.float64]
    B: NDArray[np.float64]


def sampled_dynamics(params: CartesianManipulatorParams, step: float) -> SampledDynamics:
    """Return eq. (5-7) over a step in which the force is held; exact, in closed form.

    Args:
        params: Masses and dampings of d axes.
        step: s, > 0.

    Returns:
        A, shape (2d, 2d), and B, shape (2d, d), for the state position (m), then velocity (m/s),
        and as input the sum of effort and contact force, N.

    Raises:
        ParameterError: If the step is not a finite number > 0.
    """
    if not 0 < step < math.inf:
        raise ParameterError("step", step, "a finite number > 0")
    mass, damping = np.array(params.mass), np.array(params.damping)
    decay = damping * step / mass
    once = step * np.array([_phi_1(z) for z in decay.tolist()])
    twice = step**2 * np.array([_phi_2(z) for z in decay.tolist()])
    stay = np.eye(params.dimension)
    return SampledDynamics(
        A=np.block([[stay, np.diag(once)], [0 * stay, np.diag(np.exp(-decay))]]),
        B=np.vstack([np.diag(twice / mass), np.diag(once / mass)]),
    )


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
    """Return the kinematics of a manipulator whose joints are its endpoint coordinates.

    Args:
        dimension: 2 for x and y, 3 for x, y and z.

    Raises:
        ParameterError: If the dimension is another one.
    """
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
        coordinates=axes,
        coordinate_units=("m",) * dimension,
        endpoint=endpoint,
        jacobian=jacobian,
    )
