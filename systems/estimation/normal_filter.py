r"""The thesis' recursive observer of a surface normal, and three corrections of it.

Sections 4.1 and 4.2 (Figs. 4-1 to 4-4) derive the normal that one sample shows. The
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
from typing import Final, Literal, NamedTuple, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.compiled import compiled, inverse
from chamfer.systems.estimation.model_error import ModelErrorParams

Array = NDArray[np.float64]

_ROOT_3: Final = math.sqrt(3.0)
CONTACT_THRESHOLD: Final = 3.0  # u_F, less force is no contact
MOTION_THRESHOLD: Final = 2.0  # u_v, less speed is no motion
_PARALLEL: Final = 1e-12  # what is left of F beside v, over F, when both are parallel
_ROUNDING: Final = 1e-9  # of a sum, over its terms
_TOLERANCE: Final = 1e-14
_ITERATIONS: Final = 100


class NormalStatus(IntEnum):
    """Use of a sample; all values but the first and the last mean no measurement."""

    MEASURED = 0
    HALTED = 1  # the gripper is not commanded to move
    STUCK = 2  # it is, and the contact point does not move
    NO_CONTACT = 3  # there is no force
    UNDEFINED = 4  # force and velocity are parallel: they give no normal
    PULLED = 5  # by the estimate the surface pulled, which none can: the observer restarted
    UNFIT = 6  # used, but samples contradict each other by the observer's settings


class Sample(NamedTuple):
    """Input of the observer, in d = 2 or 3 dimensions, world frame."""

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
def instantaneous_normal(
    force: Array, velocity: Array, force_noise: float, velocity_noise: float, prior: Array
) -> NormalMeasurement:
    """Return the normal that a sample shows (4-7), with an infinite uncertainty if it shows none.

    Friction is along the velocity, whatever its coefficient; what is left of the force is along
    the normal. Nothing is without velocity or force, or where both are parallel.

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
    none = NormalMeasurement(np.zeros(len(force)), math.inf)
    square = velocity @ velocity
    if not 0.0 < square < math.inf:
        return none
    N = force - velocity * ((velocity @ force) / square)  # (4-6)
    length = math.sqrt(N @ N)
    normal_force = abs(prior @ force) if prior.any() else length
    if not _PARALLEL**2 * (force @ force) < N @ N or normal_force == 0.0:
        return none
    friction = math.sqrt(max(float(force @ force) - normal_force**2, 0.0))
    by_force = force_noise / (_ROOT_3 * normal_force)  # (4-18)
    by_velocity = velocity_noise / (_ROOT_3 * math.sqrt(square)) * (1 + friction / normal_force)
    return NormalMeasurement(N / length, math.hypot(by_force, by_velocity))


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
    """Knowledge of a filter after a sample."""

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


ObserverKind = Literal["adaptive", "thesis", "gated", "prior_weights", "curvature", "friction"]
KINDS: Final[tuple[ObserverKind, ...]] = get_args(ObserverKind)


@dataclass(frozen=True, kw_only=True)
class SurfaceObserverParams:
    """The observer of the normal, and its settings for gripper, sensor and surface.

    * ``adaptive``: a multiple-model extended Kalman filter that follows the Darboux frame of the
      contact point's path
      (:class:`chamfer.systems.estimation.contact_frame_filter.ContactFrameFilter`). It assumes
      nothing about the friction coefficient, and can allow for errors of its model.
    * ``thesis``: the constrained Kalman filter of section 4.3 as printed.
    * ``gated``: the same, without update and process noise while the gripper is at a halt, and
      without update while the contact point sticks.
    * ``prior_weights``: gated, and the force is divided by the prior estimate in (4-18).
    * ``curvature``: follows direction of motion and curvature, gated.
    * ``friction``: the same with the friction angle as a state, for friction known to be constant.

    A noise is the rms length of a vector with three axes (4-9), (4-15).
    """

    stiffness: tuple[tuple[float, ...], ...] | None = None  # N/m, K; None: derived, the gripper's
    force_noise: float | None = None  # N, u_F, of the force; None: derived, the sensor's
    force_rate_noise: float | None = None  # N/s, u_Fdot, of its rate; None: derived, the sensor's
    smallest_radius: float = 0.75  # m, rho_min: the surface bends no sharper, section 5.2.2
    initial_deviation: float = 0.1  # rad, of the initial normal, on each axis; calibrated
    halt_speed: float = 1e-3  # m/s, of the nominal motion; less is a halt
    period: float = 0.05  # s, T, between two estimates; calibrated
    kind: ObserverKind = "adaptive"  # kind of observer; thesis: the paper's own
    # Of kind adaptive only:
    model_error: ModelErrorParams = ModelErrorParams()  # of its model
    rate_lag: float | None = None  # s, lag of a rate that is derived from the force
    # 0: measured separately; None: derived, the sensor's

    def __post_init__(self) -> None:
        rows = self.stiffness
        if rows is not None:
            square = len(rows) in (2, 3) and all(len(row) == len(rows) for row in rows)
            if not (square and np.all(np.isfinite(rows))):
                raise ParameterError("stiffness", rows, "2 x 2 or 3 x 3 finite numbers")
            K = np.array(rows)
            if np.abs(K - K.T).max() > 1e-9 * np.abs(K).max() or np.linalg.eigvalsh(K)[0] <= 0:
                raise ParameterError("stiffness", rows, "symmetric and positive definite")
        require_not_negative(
            self, "force_noise", "force_rate_noise", "initial_deviation", "halt_speed"
        )
        require_positive(self, "smallest_radius", "period")
        require_one_of(self, "kind", KINDS)
        if self.kind == "adaptive":
            require_not_negative(self, "rate_lag")
        elif self.model_error != ModelErrorParams():
            raise ParameterError("model_error", self.model_error, "none unless kind=adaptive")
        elif self.rate_lag is not None:
            raise ParameterError("rate_lag", self.rate_lag, "null unless kind=adaptive")


@dataclass(frozen=True, kw_only=True)
class ResolvedSurfaceObserverParams(SurfaceObserverParams):
    """The same, with nothing left open."""

    stiffness: tuple[tuple[float, ...], ...]
    force_noise: float
    force_rate_noise: float

    @property
    def compliance(self) -> Array:
        """The inverse of K, shape (d, d), m/N."""
        return np.asarray(np.linalg.inv(np.array(self.stiffness)), dtype=np.float64)

    @property
    def velocity_noise(self) -> float:
        """u_v, m/s, that of v: u_Fdot over the smallest eigenvalue of K (4-11)."""
        return self.force_rate_noise / float(np.linalg.eigvalsh(np.array(self.stiffness))[0])


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

    def __init__(
        self,
        params: ResolvedSurfaceObserverParams,
        solver: Literal["closed_form", "newton"] = "closed_form",
    ) -> None:
        self._params, self._solver = params, solver
        self._compliance, self._velocity_noise = params.compliance, params.velocity_noise
        self._eye = np.eye(len(params.stiffness))

    def start(self, normal: Array) -> Array:
        """Return the memory before the first sample, from an initial unit normal."""
        P = self._params.initial_deviation**2 * self._eye
        return np.concatenate([normal, P.ravel(), np.zeros(len(normal))])

    def update(self, memory: Array, sample: Sample) -> Estimate:
        """Return the estimate after a sample."""
        params = self._params
        d = len(self._eye)
        memory = memory.copy()  # compiled once, for arrays that may be written
        normal, P, predicted = memory[:d], memory[d:-d].reshape(d, d), memory[-d:]
        if sample.predicted_normal is not None:
            if predicted.any():
                turn = rotation_between(predicted, sample.predicted_normal)
                normal, P = turn @ normal, turn @ P @ turn.T
            predicted = sample.predicted_normal
        v = contact_velocity(sample, self._compliance)
        status = NormalStatus.MEASURED
        if params.kind != "thesis":
            status = gate(params, sample, v, self._velocity_noise)
        if status is not NormalStatus.HALTED:
            # Where there is no contact the measured velocity is still right: K^-1 Fdot is noise.
            P = P + (float(v @ v) * (params.period / params.smallest_radius) ** 2 / 3) * self._eye
        if status is NormalStatus.MEASURED:
            measured, u = instantaneous_normal(
                sample.force,
                v,
                params.force_noise,
                self._velocity_noise,
                normal if params.kind == "prior_weights" else np.zeros(d),
            )
            if u == math.inf:
                status = NormalStatus.UNDEFINED if v.any() else NormalStatus.STUCK
                if not sample.force.any():
                    status = NormalStatus.NO_CONTACT
            else:
                R = (u**2 / 3) * self._eye
                normal, P = self._solve(normal, P, measured, R)
        return Estimate(np.concatenate([normal, P.ravel(), predicted]), normal, P, status)

    def _solve(self, normal: Array, P: Array, measured: Array, R: Array) -> Updated:
        if self._solver == "closed_form":
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
    """Return the contact point's velocity (4-3), shape (d,), m/s; zero if only rounding."""
    v: Array = sample.nominal_velocity + compliance @ sample.force_rate
    nominal = sample.nominal_velocity
    if float(v @ v) <= _ROUNDING**2 * float(nominal @ nominal):
        return np.zeros(len(v))
    return v


def gate(
    params: ResolvedSurfaceObserverParams, sample: Sample, velocity: Array, velocity_noise: float
) -> NormalStatus:
    """Return the use of a sample, from the knowledge before it.

    ``velocity``, m/s, shape (d,), is the contact point's, and ``velocity_noise``, m/s, u_v.
    """
    nominal = sample.nominal_velocity
    if float(nominal @ nominal) <= params.halt_speed**2:
        return NormalStatus.HALTED
    if float(sample.force @ sample.force) <= (CONTACT_THRESHOLD * params.force_noise) ** 2:
        return NormalStatus.NO_CONTACT
    if float(velocity @ velocity) <= (MOTION_THRESHOLD * velocity_noise) ** 2:
        return NormalStatus.STUCK
    return NormalStatus.MEASURED


def rotation_between(before: Array, after: Array) -> Array:
    """Return the smallest rotation, shape (d, d), from one unit vector to another.

    Raises:
        ParameterError: If they are opposite, so that there is more than one.
    """
    if float(before @ after) <= -1 + 1e-9:
        allowed = f"less than a half turn from {before.tolist()}"
        raise ParameterError("predicted_normal", after.tolist(), allowed)
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
    flat = np.eye(len(normal)) - np.outer(normal, normal)
    return math.sqrt(max(np.linalg.eigvalsh(flat @ covariance @ flat)[-1], 0.0))
