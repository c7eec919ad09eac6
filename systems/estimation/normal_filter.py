r"""The thesis' recursive observer of a surface normal, and three corrections of it.

What one sample of the force says of the normal is sections 4.1 and 4.2 (Figs. 4-1 to 4-4). The
Kalman update keeps the estimate's unit length (4-22 to 4-27), in closed form:

For a prior n with covariance P_d, a measurement n + e with covariance R and a gain G, the thesis
minimises ``tr[(I - G) P_d (I - G)^T + G R G^T] + lambda (|n + G e|^2 - 1)``. Its derivative is
zero for (4-26)::

    G = (P_d - lambda n e^T) (P_d + R + lambda e e^T)^-1

Write ``S = P_d + R``, ``K = P_d S^-1`` (the ordinary gain) and ``s = e^T S^-1 e``. With Sherman
and Morrison ``(S + lambda e e^T)^-1 e = S^-1 e / (1 + lambda s)``, and so::

    n + G e = (n + K e) / (1 + lambda s)

The left side has length one if ``|1 + lambda s| = l``, with ``l = |n + K e|``. The trace is least
where ``1 + lambda s > 0`` (the other root is the antipode), hence ``lambda = (l - 1) / s`` and::

    n+ = (n + K e) / l
    G  = K + (1/l - 1)/s (n + K e) e^T S^-1
    P+ = (I - K) P_d (I - K)^T + K R K^T + (1 - l)^2 / s n+ n+^T

The constrained estimate is the ordinary one, normalised; nothing has to be iterated.
:func:`newton_multiplier` solves the thesis' pair of equations by Newton's method all the same.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.compiled import compiled, inverse

Array = NDArray[np.float64]

_ROOT_3: Final = math.sqrt(3.0)
CONTACT_THRESHOLD: Final = 3.0  # u_F, less force is no contact
MOTION_THRESHOLD: Final = 2.0  # u_v, less speed is no motion
_PARALLEL: Final = 1e-12  # what is left of F beside v, over F, when both are parallel
_ROUNDING: Final = 1e-9  # of a sum, over its terms
_TOLERANCE: Final = 1e-14
_ITERATIONS: Final = 100


class NormalStatus(IntEnum):
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


class Updated(NamedTuple):
    """An estimate after a measurement."""

    normal: Array  # (d,), unit
    covariance: Array  # (d, d), symmetric, positive semidefinite


@compiled
def constrained_update(normal: Array, covariance: Array, measured: Array, noise: Array) -> Updated:
    """Return the estimate of least covariance and unit length.

    Where it is not defined - neither the prior nor the measurement is uncertain, or both cancel -
    the prior is returned.

    Args:
        normal: n, shape (d,), unit.
        covariance: P_d, shape (d, d).
        measured: Shape (d,), unit.
        noise: R, shape (d, d).
    """
    e = measured - normal
    S_inverse = inverse(covariance + noise)
    K = covariance @ S_inverse
    step = K @ e
    raw = normal + step
    length = math.sqrt(raw @ raw)
    if not _TOLERANCE < length < math.inf:
        return Updated(normal.copy(), covariance.copy())
    left = np.eye(len(e)) - K
    P = left @ covariance @ left.T + K @ noise @ K.T
    s = float(e @ (S_inverse @ e))
    # 1 - l without the rounding of l, which a small s would magnify.
    short = -(2.0 * (normal @ step) + step @ step) / (1.0 + length)
    stretch = short**2 / s if s > 0.0 else 0.0
    updated = raw / length
    for i in range(len(e)):
        for j in range(len(e)):
            P[i, j] += stretch * updated[i] * updated[j]
    return Updated(updated, 0.5 * (P + P.T))


def constrained_gain(
    normal: Array, covariance: Array, measured: Array, noise: Array, multiplier: float
) -> Array:
    """Return the gain G (4-26), shape (d, d), for a Lagrange multiplier."""
    e = measured - normal
    S = covariance + noise
    left, right = covariance - multiplier * np.outer(normal, e), S + multiplier * np.outer(e, e)
    return np.asarray(np.linalg.solve(right.T, left.T).T, dtype=np.float64)


def newton_multiplier(normal: Array, covariance: Array, measured: Array, noise: Array) -> float:
    """Return the Lagrange multiplier by Newton's method, from 0.

    It solves the second equation of (4-26), ``|n + G e|^2 = 1``, as
    ``l^2 / (1 + lambda s)^2 = 1``. The first step crosses the pole at ``-1/s`` if and only if
    ``l < 1 / sqrt(3)``, and then ends at the antipode or nowhere; such a step is cut to go half
    the way to the pole.

    Raises:
        ArithmeticError: If it does not converge, or nothing is uncertain.
    """
    e = measured - normal
    try:
        inverse = np.linalg.inv(covariance + noise)
    except np.linalg.LinAlgError as error:
        raise ArithmeticError("neither the prior nor the measurement is uncertain") from error
    s = float(e @ inverse @ e)
    if s == 0.0:
        return 0.0
    raw = normal + covariance @ inverse @ e
    square = float(raw @ raw)
    x = 1.0  # 1 + lambda s
    for _ in range(_ITERATIONS):
        step = 0.5 * x * (1.0 - x * x / square)
        while x + step <= 0.0:
            step = -0.5 * x
        x += step
        if abs(step) <= _TOLERANCE * x:
            return (x - 1.0) / s
    raise ArithmeticError(f"no multiplier within {_ITERATIONS} iterations")


class Estimate(NamedTuple):
    """What a filter knows after a sample."""

    memory: Array  # what it hands to the next sample
    normal: Array  # (d,), unit
    covariance: Array  # (d, d)
    status: NormalStatus


class NormalFilter(Protocol):
    """An observer of the surface normal as a function from sample to sample."""

    def start(self, normal: Array) -> Array:
        """Return the memory before the first sample, from an initial normal, shape (d,)."""

    def update(self, memory: Array, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""


class GripperSensing(NamedTuple):
    """What is known of gripper and sensor, in d dimensions."""

    stiffness: Array  # K, (d, d), N/m
    compliance: Array  # its inverse, m/N
    force_noise: float  # u_F, N
    force_rate_noise: float  # u_Fdot, N/s
    velocity_noise: float  # u_v, m/s (4-11)


@dataclass(frozen=True, kw_only=True)
class SensingParams:
    """What every observer of the normal is told about gripper, sensor and surface.

    A noise is the rms length of a vector with three axes (4-9), (4-15).
    """

    stiffness: tuple[tuple[float, ...], ...] | None = None  # N/m, K; None: derived, the gripper's
    force_noise: float | None = None  # N, u_F, of the force; None: derived, the sensor's
    force_rate_noise: float | None = None  # N/s, u_Fdot, of its rate; None: derived, the sensor's
    smallest_radius: float = 0.75  # m, rho_min: the surface bends no sharper, section 5.2.2
    initial_deviation: float = 0.1  # rad, of the initial normal, on each axis; calibrated
    halt_speed: float = 1e-3  # m/s, of the nominal motion; less is a halt
    period: float = 0.05  # s, T, between two estimates; calibrated

    def __post_init__(self) -> None:
        rows = self.stiffness
        if rows is not None:
            square = len(rows) in (2, 3) and all(len(row) == len(rows) for row in rows)
            if not (square and np.all(np.isfinite(rows))):
                raise ParameterError("stiffness", rows, "2 x 2 or 3 x 3 finite numbers")
            K = np.array(rows)
            if np.abs(K - K.T).max() > 1e-9 * np.abs(K).max() or np.linalg.eigvalsh(K)[0] <= 0:
                raise ParameterError("stiffness", rows, "symmetric and positive definite")
        for name in ("force_noise", "force_rate_noise"):
            if getattr(self, name) is not None:
                require_not_negative(self, name)
        require_not_negative(self, "initial_deviation", "halt_speed")
        require_positive(self, "smallest_radius", "period")


@dataclass(frozen=True, kw_only=True)
class ResolvedSensingParams(SensingParams):
    """The same, with nothing left open."""

    stiffness: tuple[tuple[float, ...], ...]
    force_noise: float
    force_rate_noise: float

    @property
    def sensing(self) -> GripperSensing:
        """What is known of gripper and sensor."""
        K = np.array(self.stiffness)
        return GripperSensing(
            stiffness=K,
            compliance=np.linalg.inv(K),
            force_noise=self.force_noise,
            force_rate_noise=self.force_rate_noise,
            velocity_noise=self.force_rate_noise / float(np.linalg.eigvalsh(K)[0]),
        )


Weights = Literal["sample", "prior"]
Solver = Literal["closed_form", "newton"]


@dataclass(frozen=True, kw_only=True)
class ConstrainedFilterParams(ResolvedSensingParams):
    """Parameters of :class:`ConstrainedFilter`; the defaults are the thesis' filter."""

    gated: bool = False  # no update and no process noise at a halt, no update while stuck
    weights: Weights = "sample"  # what divides F in (4-18): the sample or the prior estimate
    solver: Solver = "closed_form"  # newton: the thesis' iteration, the same result

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "weights", ("sample", "prior"))
        require_one_of(self, "solver", ("closed_form", "newton"))


class ConstrainedFilter:
    """The unit-norm constrained Kalman filter of section 4.3.

    The normal takes a random walk with the covariance ``Q = (|v| T / rho_min)^2 / 3 I`` a step
    (4-20), and a sample measures it with ``R = u_meas^2 / 3 I`` (4-21). Without a measurement the
    normal stays and P grows by Q.

    The measured velocity of a halted gripper is noise, with which the thesis' filter drifts on.
    With ``gated`` nothing happens while the nominal motion, which is known, is at a halt, and no
    sample is used while the contact point sticks or there is no contact; section 4.4.1 then holds
    exactly.

    A predicted normal (section 4.5) turns estimate and covariance along, and Q is what the
    prediction leaves over: ``smallest_radius`` is then the one of the prediction's error.

    The memory is the normal, P row by row and the last prediction (zeros before the first).
    """

    def __init__(self, params: ConstrainedFilterParams) -> None:
        self._params = params
        self._sensing = params.sensing
        d = len(self._sensing.stiffness)
        self._eye = np.eye(d)
        self._none = np.zeros(d)
        self._split = (d, d + d * d)

    def start(self, normal: Array) -> Array:
        """Return the memory before the first sample, from an initial unit normal."""
        P = self._params.initial_deviation**2 * self._eye
        return np.concatenate([normal, P.ravel(), np.zeros(len(normal))])

    def update(self, memory: Array, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        params = self._params
        first, second = self._split
        memory = memory.copy()  # compiled once, for arrays that may be written
        normal, P = memory[:first], memory[first:second].reshape(first, first)
        predicted = memory[second:]
        if sample.predicted_normal is not None:
            if predicted.any():
                turn = rotation_between(predicted, sample.predicted_normal)
                normal, P = turn @ normal, turn @ P @ turn.T
            predicted = sample.predicted_normal
        v = contact_velocity(sample, self._sensing.compliance)
        status = NormalStatus.MEASURED
        if params.gated:
            status = gate(params.halt_speed, self._sensing, sample, v)
        if status is not NormalStatus.HALTED:
            # Where there is no contact the measured velocity is still right: K^-1 Fdot is noise.
            P = P + (float(v @ v) * (params.period / params.smallest_radius) ** 2 / 3) * self._eye
        if status is NormalStatus.MEASURED:
            measured, u = instantaneous_normal(
                sample.force,
                v,
                self._sensing.force_noise,
                self._sensing.velocity_noise,
                normal if params.weights == "prior" else self._none,
            )
            if u == math.inf:
                status = why_undefined(sample.force, v)
            else:
                R = (u**2 / 3) * self._eye
                normal, P = self._solve(normal, P, measured, R)
        return Estimate(np.concatenate([normal, P.ravel(), predicted]), normal, P, status)

    def _solve(self, normal: Array, P: Array, measured: Array, R: Array) -> Updated:
        if self._params.solver == "closed_form":
            return constrained_update(normal, P, measured, R)
        try:
            multiplier = newton_multiplier(normal, P, measured, R)
        except ArithmeticError:
            return Updated(normal, P)
        G = constrained_gain(normal, P, measured, R, multiplier)
        updated = normal + G @ (measured - normal)
        left = self._eye - G
        return Updated(updated / np.linalg.norm(updated), left @ P @ left.T + G @ R @ G.T)


def contact_velocity(sample: Sample, compliance: Array) -> Array:
    """Return the contact point's velocity (4-3), shape (d,), m/s; zero if it is but rounding."""
    v: Array = sample.nominal_velocity + compliance @ sample.force_rate
    nominal = sample.nominal_velocity
    if float(v @ v) <= _ROUNDING**2 * float(nominal @ nominal):
        return np.zeros(len(v))
    return v


def gate(
    halt_speed: float, sensing: GripperSensing, sample: Sample, velocity: Array
) -> NormalStatus:
    """Return what a sample is good for, from what is known before it is used.

    Args:
        halt_speed: m/s, less nominal speed is a halt.
        sensing: What is known of the sensor.
        sample: The sample.
        velocity: Of the contact point, shape (d,), m/s.
    """
    nominal = sample.nominal_velocity
    if float(nominal @ nominal) <= halt_speed**2:
        return NormalStatus.HALTED
    if float(sample.force @ sample.force) <= (CONTACT_THRESHOLD * sensing.force_noise) ** 2:
        return NormalStatus.NO_CONTACT
    if float(velocity @ velocity) <= (MOTION_THRESHOLD * sensing.velocity_noise) ** 2:
        return NormalStatus.STUCK
    return NormalStatus.MEASURED


def why_undefined(force: Array, velocity: Array) -> NormalStatus:
    """Return why there is no instantaneous normal."""
    if not force.any():
        return NormalStatus.NO_CONTACT
    return NormalStatus.UNDEFINED if velocity.any() else NormalStatus.STUCK


def rotation_between(before: Array, after: Array) -> Array:
    """Return the smallest rotation, shape (d, d), from one unit vector to another.

    Raises:
        ParameterError: If they are opposite, so that there is more than one.
    """
    cosine = float(before @ after)
    if cosine <= -1 + 1e-9:
        raise ParameterError(
            "predicted_normal", after.tolist(), f"less than a half turn from {before.tolist()}"
        )
    return _reflections(before, after)


@compiled
def _reflections(before: Array, after: Array) -> Array:
    """Reflect at the plane across ``before``, then at that across the half-way vector."""
    both = before + after
    scale = 1.0 + before @ after
    return np.eye(len(both)) - np.outer(both, both) / scale + 2.0 * np.outer(after, before)


@compiled
def tangential_deviation(normal: Array, covariance: Array) -> float:
    """Return the largest standard deviation, rad, of the normal's direction.

    It is that of the covariance's part in the tangent plane: the normal's length is certain.
    """
    if len(normal) == 2:
        t = np.array([-normal[1], normal[0]])
        return math.sqrt(max(float(t @ covariance @ t), 0.0))
    least = 0
    for i in range(1, 3):
        if abs(normal[i]) < abs(normal[least]):
            least = i
    t = -normal[least] * normal
    t[least] += 1.0
    t /= math.sqrt(t @ t)
    b = np.array(
        [
            normal[1] * t[2] - normal[2] * t[1],
            normal[2] * t[0] - normal[0] * t[2],
            normal[0] * t[1] - normal[1] * t[0],
        ]
    )
    along, across, both = t @ covariance @ t, b @ covariance @ b, t @ covariance @ b
    largest = 0.5 * (along + across) + math.hypot(0.5 * (along - across), both)
    return math.sqrt(max(float(largest), 0.0))
