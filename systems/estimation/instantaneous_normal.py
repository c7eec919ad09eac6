"""What one sample of a force sensor says of the normal (sections 4.1, 4.2, Figs. 4-1 to 4-4)."""

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]

_ROOT_3: Final = math.sqrt(3.0)
_PARALLEL: Final = 1e-12  # what is left of F beside v, over F, when both are parallel


class Status(IntEnum):
    """What a sample was good for; every value but the first means no measurement."""

    MEASURED = 0
    HALTED = 1  # the gripper is not commanded to move
    STUCK = 2  # it is, and the contact point does not move
    NO_CONTACT = 3  # there is no force
    UNDEFINED = 4  # force and velocity are parallel: no normal can be told


class Sample(NamedTuple):
    """What the observer is given, in d = 2 or 3 dimensions, world frame."""

    force: Array  # (d,), N, of the surface on the gripper
    force_rate: Array  # (d,), N/s
    nominal_position: Array  # (d,), m, of the endpoint with a relaxed gripper, known exactly
    nominal_velocity: Array  # (d,), m/s
    predicted_normal: Array | None = None  # (d,), unit, from another source, section 4.5


class NormalMeasurement(NamedTuple):
    """An instantaneous normal with its uncertainty."""

    normal: Array  # (d,), unit, or zeros where there is none
    uncertainty: float  # rad, u_meas, the length of a vector with three axes; infinite likewise


@compiled
def project_out(force: Array, velocity: Array) -> Array:
    """Return the normal force ``N = (I - v v^T / v^T v) F`` (4-6), shape (d,).

    Friction is along the velocity, whatever its coefficient; what is left is along the normal.
    Zero if there is no velocity, no force, or both are parallel.
    """
    square = velocity @ velocity
    if not 0.0 < square < math.inf:
        return np.zeros(len(force))
    N = force - velocity * ((velocity @ force) / square)
    return N if _PARALLEL**2 * (force @ force) < N @ N else np.zeros(len(force))


@compiled
def uncertainty(
    normal_force: float, friction_force: float, speed: float, force: float, velocity: float
) -> float:
    """Return u_meas, rad (4-18).

    Args:
        normal_force: |N|, N.
        friction_force: |F - N|, N.
        speed: |v|, m/s.
        force: u_F, N, the length of the error of F.
        velocity: u_v, m/s, that of v: u_Fdot over the smallest eigenvalue of K (4-11).
    """
    by_force = force / (_ROOT_3 * normal_force)
    by_velocity = velocity / (_ROOT_3 * speed) * (1 + friction_force / normal_force)
    return math.hypot(by_force, by_velocity)


@compiled
def instantaneous_normal(
    force: Array, velocity: Array, force_noise: float, velocity_noise: float, prior: Array
) -> NormalMeasurement:
    """Return the normal that a sample shows (4-7), with an infinite uncertainty if it shows none.

    Args:
        force: F, shape (d,), N, of the surface on the gripper.
        velocity: v, shape (d,), m/s, of the contact point (4-3).
        force_noise: u_F, N.
        velocity_noise: u_v, m/s.
        prior: A unit normal, shape (d,), that divides F into normal force and friction for the
            uncertainty, or zeros to take the sample's own, as the thesis does. The sample's own
            makes the uncertainty depend on the sample's error, which biases what is estimated
            with it.
    """
    N = project_out(force, velocity)
    length = math.sqrt(float(N @ N))
    normal_force = length
    if prior.any():
        normal_force = abs(float(prior @ force))
    if length == 0.0 or normal_force == 0.0:
        return NormalMeasurement(np.zeros(len(force)), math.inf)
    friction = math.sqrt(max(float(force @ force) - normal_force**2, 0.0))
    u = uncertainty(
        normal_force, friction, math.sqrt(velocity @ velocity), force_noise, velocity_noise
    )
    return NormalMeasurement(N / length, u)
