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
from chamfer.systems.force.contact_detection_law import APPROACH, LOST, push_along
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

    law: LawKind = "inverse"  # from Cartesian errors to torques
    feedforward_torque: tuple[float, ...] | None = None
    # N m or N, constant estimate of gravity, [] for none; None: derived, gravity at the start
    loss_mode: bool = True  # False: the force integral continues while contact is lost
    creep_speed: float = 0.05  # m/s, in the search for lost contact
    creep_damping: float = 60.0  # N s/m, against the speed in that search
    creep_ramp: float = 40.0  # N/s, growth of the push at rest
    bumpless: bool = True  # False: no offset torque, for comparison
    held_integrators: tuple[int, ...] = ()  # joints or coordinates, off while in contact
    full_dynamics: bool = False  # True: with the whole model of (2-1)
    inertia: tuple[float, ...] | None = None
    # kg m^2 or kg, nominal, of the full dynamics; None: derived, the arm's at the contact point

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
        """Return the same as :meth:`HybridGains.for_joints`, with all parameters checked."""
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
    """Memory of the controller from one period to the next."""

    torque: Array  # (n,)
    position_integral: Array  # (n,), in joint or endpoint coordinates
    force_integral: Array  # (m,), N
    offset: Array  # (n,), N m
    creep: Array  # (1,), N, the push while contact is lost
    mode: Array  # (1,)
    position_error: Array  # (m,), m (rad)
    force_error: Array  # (m,), N


class HybridObservation(NamedTuple):
    """Inputs of the law."""

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
    made: list[Any] = [LAWS.index(params.law), *params.for_joints(n)]
    made += [np.array(feedforward or [0.0] * n, np.float64), np.array(inertia, np.float64)]
    made += [np.isin(np.arange(n), params.held_integrators)]
    made += [float(getattr(params, name)) for name in HybridCode._fields[7:13]]
    return HybridCode(*made, *(getattr(params, name) for name in HybridCode._fields[13:]))


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
        rate, model = seen.desired_velocity, (np.zeros((n, n)), np.zeros(n))
        if self._model is not None:
            model = self._model(q, v)[:2]
        found, regular = control(
            self.code,
            # Copies, because compiled code tells views of a Context from arrays.
            HybridMemory(*(one.copy() for one in state)),
            (v, x, J),
            (seen.desired_position, np.zeros(m) if rate is None else rate, seen.desired_force),
            seen.measured_force,
            seen.selection.reshape(m, m),
            mode,
            model,
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
def _times(matrix: NDArray[Any], vector: Array) -> Array:
    result = np.zeros(len(matrix))
    add_product(matrix, vector, result)
    return result


@compiled
def control(
    code: HybridCode,
    memory: HybridMemory,
    arm: tuple[Array, Array, Array],
    desired: tuple[Array, Array, Array],
    measured_force: Array,
    P: Array,
    mode: float,
    model: tuple[Array, Array],
) -> tuple[HybridMemory, bool]:
    """Return the controller's memory after one period; False in a singular pose.

    ``arm`` is joint velocities, endpoint and Jacobian, ``desired`` position, velocity and force,
    ``model`` mass matrix and bias, with full dynamics. See
    :class:`chamfer.systems.force.hybrid_controller.HybridController`.
    """
    v, x, J = arm
    desired_position, desired_velocity, desired_force = desired
    n, period, inverse = len(J), code.period, np.linalg.pinv(J, 0.0)
    condition, rank = np.sum(J * J) * np.sum(inverse * inverse), np.sum(J * inverse.T)
    if not (condition < _WORST_CONDITION**2 and rank > n - 0.5):
        return memory, False
    lost = code.loss_mode and mode == LOST
    switched = mode != memory.mode[0] and (
        code.loss_mode or mode == APPROACH or memory.mode[0] == APPROACH
    )
    x_rate = _times(J, v)
    position_error, force_error = desired_position - x, desired_force - measured_force
    e, rate = _times(P, position_error), _times(P, x_rate)
    across = x_rate - rate
    # The force domain.
    force_integral, creep, damped = memory.force_integral, memory.creep, np.zeros(n)
    push = desired_force - _times(P, desired_force)
    if lost:
        length = math.sqrt(push_along(push, push))
        direction = push / length if length > 0.0 else push
        short = min(max(1.0 - push_along(direction, x_rate) / code.creep_speed, -1.0), 1.0)
        creep = np.zeros(1) if switched else creep + code.creep_ramp * period * short
        force = creep[0] * direction - code.creep_damping * across
    else:
        gain = code.force_integral * period
        force_integral = force_integral + gain * (force_error - _times(P, force_error))
        force = push + force_integral
        damped = code.force_damping * across
    # The position domain.
    rate = rate - _times(P, desired_velocity)
    if code.law == INVERSE:
        e, rate = _times(inverse, e), _times(inverse, rate)
    elif code.law == PROJECTED:
        projected = np.linalg.pinv(P @ J, 1.0 / _WORST_CONDITION)
        e, rate = _times(projected, e), _times(projected, rate)
    grown = code.integral * e * period
    for j in range(n):
        if mode > LOST or (mode != APPROACH and code.held[j]):
            grown[j] = 0.0
    integral = memory.position_integral + grown
    position = code.stiffness * e + integral - code.damping * rate
    if code.law == TRANSPOSE:
        position = _times(J.T, position)
    elif code.full_dynamics:
        # Gravity at the start is in the constant estimate already.
        position = _times(model[0], position / code.inertia) + model[1] - code.known
    law, offset = position + _times(J.T, force), memory.offset
    if switched and code.bumpless:
        before = memory.torque - code.known
        offset = before - law
        if lost:  # keep what acts along the surface and let go of what pushes
            offset = _times(J.T, _times(P, _times(inverse.T, before))) - position
    torque = law + offset + code.known - _times(J.T, damped)
    now, errors = np.array([mode]), (position_error, force_error)
    return HybridMemory(torque, integral, force_integral, offset, creep, now, *errors), True


def efforts(units: tuple[str, ...]) -> tuple[str, ...]:
    """Return the units of efforts along coordinates in m or rad."""
    return tuple("N m" if unit == "rad" else "N" for unit in units)


@lru_cache(maxsize=16)  # it seldom changes
def _require_domain(selection: bytes, size: int, mode: float) -> None:
    P = np.frombuffer(selection).reshape(size, size)
    require_projection(P)
    if mode != APPROACH and np.trace(P) > size - 0.5:  # the trace is the rank
        allowed = f"a rank below {size} in contact, to leave the force a direction"
        raise ParameterError("selection", P.tolist(), allowed)
