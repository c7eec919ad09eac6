"""Hybrid position/force control with Jacobian inverse or transpose (Figs. 2-1 and 2-2)."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import (
    ParameterError,
    finite,
    known,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.compiled import add_product, compiled
from chamfer.systems.force.arm_kinematics import arm_index, kinematics
from chamfer.systems.force.contact_detection_law import APPROACH, LOST
from chamfer.systems.force.projection import require_projection
from chamfer.systems.law import Array, HeldLaw, Signal

LawKind = Literal["inverse", "transpose", "projected"]
LAWS: Final = get_args(LawKind)
INVERSE, TRANSPOSE, PROJECTED = range(3)  # their indices
Gain = float | tuple[float, ...]  # one a joint or coordinate, or one number for all of them

_WORST_CONDITION: Final = 1e6  # of the Jacobian, in the Frobenius norm


@dataclass(frozen=True, kw_only=True)
class HybridGains:
    """Gains of both domains.

    Those of the position domain act on joint errors with the laws ``inverse`` and ``projected``
    (N m/rad) and on endpoint errors with ``transpose`` (N/m).
    """

    stiffness: Gain  # N m/rad or N/m, Kp, on the position error
    integral: Gain  # N m/(rad s) or N/(m s), Ki, on its integral
    damping: Gain  # N m s/rad or N s/m, Kd, on the rate, or on its error where one is desired
    period: float = 0.005  # s, of the controller; section 6.2.1
    force_integral: float  # 1/s, Kif, on the integral of the force error
    force_damping: float = 0.0  # N s/m, Kdf, against the speed in the force domain

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_not_negative(self, "force_integral", "force_damping")
        for name in ("stiffness", "integral", "damping"):
            gains = getattr(self, name)
            if not all(0 <= gain < math.inf for gain in np.atleast_1d(gains)):
                raise ParameterError(name, gains, "finite numbers >= 0")

    def for_joints(self, n: int) -> list[Array]:
        """Return Kp, Ki and Kd of n joints or coordinates, shape (n,) each."""
        found = []
        for name in ("stiffness", "integral", "damping"):
            gains = getattr(self, name)
            if isinstance(gains, tuple) and len(gains) != n:
                raise ParameterError(name, gains, f"{n} numbers, or one for all")
            found.append(np.full(n, gains, dtype=np.float64))
        return found


@dataclass(frozen=True, kw_only=True)
class HybridControllerParams(HybridGains):
    """Parameters of :class:`HybridController`, for n joints and m = n endpoint coordinates."""

    law: LawKind = "inverse"  # with which Cartesian errors become torques
    feedforward_torque: tuple[float, ...] | None = None
    # N m or N, constant estimate of gravity, [] for none; None: derived, gravity at the start
    loss_mode: bool = True  # False: the force integral goes on while contact is lost
    creep_speed: float = 0.05  # m/s, with which lost contact is sought
    creep_damping: float = 60.0  # N s/m, against the speed while lost contact is sought
    creep_ramp: float = 40.0  # N/s, with which the push grows at rest
    bumpless: bool = True  # False: no offset torque, for comparison
    held_integrators: tuple[int, ...] = ()  # joints or coordinates, off while in contact
    full_dynamics: bool = False  # True: with the whole model of (2-1)
    inertia: tuple[float, ...] | None = None
    # kg m^2 or kg, nominal, of the full dynamics; None: derived, the arm's where it should touch

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "law", LAWS)
        require_positive(self, "creep_speed", "creep_damping", "creep_ramp")
        if self.full_dynamics and self.law == "transpose":
            raise ParameterError("law", self.law, "inverse or projected with full dynamics")
        if not all(0 < one < math.inf for one in self.inertia or ()):
            raise ParameterError("inertia", self.inertia, "finite numbers > 0")
        if not all(map(math.isfinite, self.feedforward_torque or ())):
            raise ParameterError("feedforward_torque", self.feedforward_torque, "finite numbers")

    def for_joints(self, n: int) -> list[Array]:
        """Return what :meth:`HybridGains.for_joints` does, all parameters checked."""
        if not all(0 <= index < n for index in self.held_integrators):
            raise ParameterError("held_integrators", self.held_integrators, f"indices below {n}")
        if self.inertia is not None and len(self.inertia) != n:
            raise ParameterError("inertia", self.inertia, f"{n} numbers")
        if self.inertia is not None and not self.full_dynamics:
            raise ParameterError("inertia", self.inertia, "None without full dynamics")
        if self.feedforward_torque and len(self.feedforward_torque) != n:
            allowed = f"{n} numbers, or none"
            raise ParameterError("feedforward_torque", self.feedforward_torque, allowed)
        return super().for_joints(n)


class HybridMemory(NamedTuple):
    """What one period of the controller hands to the next."""

    torque: Array  # (n,)
    position_integral: Array  # (n,), in joint or endpoint coordinates
    force_integral: Array  # (m,), N
    offset: Array  # (n,), N m
    creep: Array  # (1,), N, the push while contact is lost
    mode: Array  # (1,)
    position_error: Array  # (m,), m (rad)
    force_error: Array  # (m,), N


class HybridObservation(NamedTuple):
    """What the law reads."""

    encoders: Array
    desired_position: Array
    desired_force: Array
    measured_force: Array
    selection: Array
    mode: Array
    desired_velocity: Array | None = None


class HybridCode(NamedTuple):
    """Parameters of :class:`HybridControllerParams`, of n joints, for machine code."""

    law: int  # INVERSE, TRANSPOSE or PROJECTED
    stiffness: Array  # (n,), as are those down to ``held``
    integral: Array
    damping: Array
    known: Array  # N m or N, the constant estimate of gravity
    inertia: Array
    held: NDArray[np.bool_]  # integrators that are off while in contact
    period: float
    force_integral: float
    force_damping: float
    creep_speed: float
    creep_damping: float
    creep_ramp: float
    loss_mode: bool
    bumpless: bool
    full_dynamics: bool


def hybrid_code(params: HybridControllerParams, n: int) -> HybridCode:
    """Return the parameters of n joints for :func:`control`."""
    feedforward = known("feedforward_torque", params.feedforward_torque)
    inertia = known("inertia", params.inertia) if params.full_dynamics else (1.0,) * n
    stiffness, integral, damping = params.for_joints(n)
    return HybridCode(
        law=LAWS.index(params.law),
        stiffness=stiffness,
        integral=integral,
        damping=damping,
        known=np.array(feedforward or [0.0] * n, np.float64),
        inertia=np.array(inertia, np.float64),
        held=np.isin(np.arange(n), params.held_integrators),
        period=float(params.period),
        force_integral=float(params.force_integral),
        force_damping=float(params.force_damping),
        creep_speed=float(params.creep_speed),
        creep_damping=float(params.creep_damping),
        creep_ramp=float(params.creep_ramp),
        loss_mode=params.loss_mode,
        bumpless=params.bumpless,
        full_dynamics=params.full_dynamics,
    )


class HybridLaw(HeldLaw[HybridMemory, HybridObservation, HybridMemory]):
    """See :class:`chamfer.systems.force.hybrid_controller.HybridController`.

    ``dynamics``, of q and v, shape (n,), has ``mass``, shape (n, n), and ``bias``, shape (n,), of
    ``mass v' + bias = torque``.
    """

    observation = HybridObservation

    def __init__(
        self,
        arm: Kinematics,
        params: HybridControllerParams,
        *,
        dynamics: Callable[[Array, Array], Any] | None = None,
    ) -> None:
        n, m = arm.num_joints, arm.num_coordinates
        if (dynamics is not None) != params.full_dynamics:
            raise ParameterError(
                "full_dynamics", params.full_dynamics, "true with a model, false without one"
            )
        self._arm, self.params, self._model = arm, params, dynamics
        self.code = hybrid_code(params, n)
        joints, x = arm.joint_units, arm.coordinate_units
        force, rates = efforts(x), tuple(f"{unit}/s" for unit in (*joints, *x))
        super().__init__(
            period=params.period,
            inputs={
                "encoders": Signal(2 * n, (*joints, *rates[:n]), finite=True),
                "desired_position": Signal(m, x, finite=True),
                "desired_force": Signal(m, force, finite=True),
                "measured_force": Signal(m, force, finite=True),
                "selection": Signal(m * m, finite=True),
                "mode": Signal(finite=True),
                "desired_velocity": Signal(m, rates[n:], optional=True, finite=True),
            },
            outputs={
                "torque": Signal(n, efforts(joints)),
                "position_error": Signal(m, x),
                "force_error": Signal(m, force),
            },
            start=HybridMemory(
                torque=self.code.known,
                position_integral=np.zeros(n),
                force_integral=np.zeros(m),
                offset=np.zeros(n),
                creep=np.zeros(1),
                mode=np.zeros(1),
                position_error=np.zeros(m),
                force_error=np.zeros(m),
            ),
        )

    def update(
        self, state: HybridMemory, observation: HybridObservation, time: float
    ) -> HybridMemory:
        """Return the memory after one period."""
        seen, n = observation, self._arm.num_joints
        q, v = seen.encoders[:n].copy(), seen.encoders[n:].copy()
        mode, m = float(seen.mode[0]), len(seen.desired_position)
        _require_domain(seen.selection.tobytes(), m, mode)
        x, J = self._kinematics(q)
        model = None if self._model is None else self._model(q, v)
        found, regular = control(
            self.code,
            # Copies, because compiled code tells views of a Context from arrays.
            HybridMemory(*(one.copy() for one in state)),
            v,
            x,
            J,
            seen.desired_position,
            np.zeros(m) if seen.desired_velocity is None else seen.desired_velocity,
            seen.desired_force,
            seen.measured_force,
            seen.selection.reshape(m, m),
            mode,
            np.zeros((n, n)) if model is None else model.mass,
            np.zeros(n) if model is None else model.bias,
        )
        if not regular:
            allowed = "one in which the Jacobian is regular"
            raise ParameterError(f"the pose of the {self._arm.name}", q.tolist(), allowed)
        finite("torque", found.torque)
        return found

    def _kinematics(self, q: Array) -> tuple[Array, Array]:
        arm = self._arm
        if (index := arm_index(arm)) is not None:
            return kinematics(index, q)
        return np.array(arm.endpoint(q), np.float64), np.array(arm.jacobian(q), np.float64)


@compiled
def _times(matrix: Array, vector: Array) -> Array:
    result = np.zeros(len(matrix))
    add_product(matrix, vector, result)
    return result


@compiled
def _inverse(matrix: Array) -> tuple[Array, bool]:
    """Return a matrix' inverse (Gauss-Jordan with pivots), and whether it is well conditioned."""
    n = len(matrix)
    left, right = matrix.copy(), np.eye(n)
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(left[i, k]) > abs(left[best, k]):
                best = i
        if left[best, k] == 0.0:
            return right, False
        for j in range(n):
            left[k, j], left[best, j] = left[best, j], left[k, j]
            right[k, j], right[best, j] = right[best, j], right[k, j]
        for i in range(n):
            factor = left[i, k] / left[k, k]
            if i != k:
                for j in range(n):
                    left[i, j] -= factor * left[k, j]
                    right[i, j] -= factor * right[k, j]
    forth, back = 0.0, 0.0
    for i in range(n):
        for j in range(n):
            right[i, j] /= left[i, i]
            forth += matrix[i, j] ** 2
            back += right[i, j] ** 2
    return right, forth * back < _WORST_CONDITION**2


@compiled
def control(
    code: HybridCode,
    memory: HybridMemory,
    v: Array,
    x: Array,
    J: Array,
    desired_position: Array,
    desired_velocity: Array,
    desired_force: Array,
    measured_force: Array,
    P: Array,
    mode: float,
    mass: Array,
    bias: Array,
) -> tuple[HybridMemory, bool]:
    """Return the controller's memory after one period; False: it is none, in a singular pose.

    At joint velocities v, endpoint x and Jacobian J, with the position domain P; ``mass``, (n, n),
    and ``bias``, (n,), are the model's with full dynamics. See
    :class:`chamfer.systems.force.hybrid_controller.HybridController`.
    """
    n, period, (inverse, regular) = len(J), code.period, _inverse(J)
    if not regular:
        return memory, False
    before, contact = memory.mode[0], mode != APPROACH
    lost = code.loss_mode and mode == LOST
    switched = mode != before and (code.loss_mode or not contact or before == APPROACH)
    position_error, force_error = np.empty(n), np.empty(n)
    for i in range(n):
        position_error[i] = desired_position[i] - x[i]
        force_error[i] = desired_force[i] - measured_force[i]
    x_rate = _times(J, v)
    e, rate, wanted = _times(P, position_error), _times(P, x_rate), _times(P, desired_velocity)
    along_force, along_error = _times(P, desired_force), _times(P, force_error)
    # The force domain.
    force_integral, creep = memory.force_integral.copy(), memory.creep.copy()
    force, damped, push = np.empty(n), np.zeros(n), np.empty(n)
    length, ahead = 0.0, 0.0
    for i in range(n):
        push[i] = desired_force[i] - along_force[i]
        length += push[i] ** 2
        ahead += push[i] * x_rate[i]
    length = math.sqrt(length)
    if lost:
        reached = ahead / length if length > 0.0 else 0.0
        short = min(max(1.0 - reached / code.creep_speed, -1.0), 1.0)
        creep[0] = 0.0 if switched else creep[0] + code.creep_ramp * period * short
    for i in range(n):
        across = x_rate[i] - rate[i]
        if lost:
            direction = push[i] / length if length > 0.0 else push[i]
            force[i] = creep[0] * direction - code.creep_damping * across
        else:
            force_integral[i] += code.force_integral * period * (force_error[i] - along_error[i])
            force[i] = push[i] + force_integral[i]
            damped[i] = code.force_damping * across
        rate[i] -= wanted[i]
    # The position domain.
    if code.law == INVERSE:
        e, rate = _times(inverse, e), _times(inverse, rate)
    elif code.law == PROJECTED:
        motion = np.empty((n, n))
        for i in range(n):
            motion[i] = _times(J.T, P[i])
        projected: Array = np.linalg.pinv(motion, 1 / _WORST_CONDITION)  # type: ignore[assignment]
        e, rate = _times(projected, e), _times(projected, rate)
    integral, position = memory.position_integral.copy(), np.empty(n)
    for i in range(n):
        if not (mode > LOST or (contact and code.held[i])):
            integral[i] += code.integral[i] * e[i] * period
        position[i] = code.stiffness[i] * e[i] + integral[i] - code.damping[i] * rate[i]
    if code.law == TRANSPOSE:
        position = _times(J.T, position)
    elif code.full_dynamics:
        for i in range(n):
            position[i] /= code.inertia[i]
        position = _times(mass, position)
        for i in range(n):
            # Gravity at the start is in the constant estimate already.
            position[i] += bias[i] - code.known[i]
    pushed, slowed, offset = _times(J.T, force), _times(J.T, damped), memory.offset.copy()
    torque = np.empty(n)
    if switched and code.bumpless:
        for i in range(n):
            torque[i] = memory.torque[i] - code.known[i]
        # Losing contact, keep what acts along the surface and let go of what pushes.
        kept = _times(J.T, _times(P, _times(inverse.T, torque)))
        for i in range(n):
            offset[i] = (kept[i] if lost else torque[i] - pushed[i]) - position[i]
    for i in range(n):
        torque[i] = position[i] + pushed[i] + offset[i] + code.known[i] - slowed[i]
    now = np.array([mode])
    errors = position_error, force_error
    return HybridMemory(torque, integral, force_integral, offset, creep, now, *errors), True


def efforts(units: tuple[str, ...]) -> tuple[str, ...]:
    """Return the units of what does work along coordinates in m or rad."""
    return tuple("N m" if unit == "rad" else "N" for unit in units)


@lru_cache(maxsize=16)  # it seldom changes
def _require_domain(selection: bytes, size: int, mode: float) -> None:
    P = np.frombuffer(selection).reshape(size, size)
    require_projection(P)
    if mode != APPROACH and np.trace(P) > size - 0.5:  # the trace is the rank
        allowed = f"a rank below {size} in contact, to leave the force a direction"
        raise ParameterError("selection", P.tolist(), allowed)
