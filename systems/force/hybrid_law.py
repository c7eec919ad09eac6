"""Hybrid position/force control with Jacobian inverse or transpose (Figs. 2-1 and 2-2)."""

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import (
    ParameterError,
    finite,
    known,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.force.contact_detection_law import APPROACH, LOST
from chamfer.systems.force.projection import require_projection
from chamfer.systems.law import Array, HeldLaw, Signal

LawKind = Literal["inverse", "transpose", "projected"]
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
        require_one_of(self, "law", ("inverse", "transpose", "projected"))
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
        self._gains = params.for_joints(n)
        self._inertia = np.array(known("inertia", params.inertia)) if dynamics else np.ones(n)
        feedforward = known("feedforward_torque", params.feedforward_torque)
        self._known = np.array(feedforward or [0.0] * n)
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
                torque=self._known,
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
        encoders, desired_position, desired_force, measured_force = observation[:4]
        selection, mode, desired_velocity = observation[4:]
        params, memory, n = self.params, state, self._arm.num_joints
        q, v = encoders[:n], encoders[n:]
        P = selection.reshape(len(desired_position), -1)
        _require_domain(selection.tobytes(), len(P), float(mode[0]))
        J = self._arm.jacobian(q)
        inverse = self._inverse(q, J)
        x_rate = J @ v
        position_error = desired_position - self._arm.endpoint(q)
        force_error = desired_force - measured_force
        e, rate = P @ position_error, P @ x_rate
        across = x_rate - rate
        lost = params.loss_mode and mode[0] == LOST
        switched = mode[0] != memory.mode[0] and (
            params.loss_mode or APPROACH in (mode[0], memory.mode[0])
        )
        # The force domain.
        force_integral, creep, damped = memory.force_integral, memory.creep, np.zeros_like(e)
        push = desired_force - P @ desired_force
        if lost:
            length = float(np.linalg.norm(push))
            direction = push / length if length > 0 else push
            short = 1 - float(direction @ x_rate) / params.creep_speed
            growth = params.creep_ramp * params.period * min(max(short, -1.0), 1.0)
            creep = np.zeros(1) if switched else memory.creep + growth
            force = creep * direction - params.creep_damping * across
        else:
            gain = params.force_integral * params.period
            force_integral = force_integral + gain * (force_error - P @ force_error)
            force = push + force_integral
            damped = params.force_damping * across
        # The position domain.
        stiffness, integral, damping = self._gains
        if desired_velocity is not None:
            rate = rate - P @ desired_velocity
        if params.law == "inverse":
            e, rate = inverse @ e, inverse @ rate
        elif params.law == "projected":
            projected = np.linalg.pinv(P @ J, rcond=1 / _WORST_CONDITION)
            e, rate = projected @ e, projected @ rate
        grown = integral * e * params.period
        if mode[0] != APPROACH and params.held_integrators:
            grown[list(params.held_integrators)] = 0.0
        if mode[0] > LOST:
            grown[:] = 0.0
        integral = memory.position_integral + grown
        position: Array = stiffness * e + integral - damping * rate
        if params.law == "transpose":
            position = J.T @ position
        elif self._model is not None:
            model = self._model(q, v)
            # Gravity at the start is in the constant estimate already.
            position = model.mass @ (position / self._inertia) + model.bias - self._known
        law = position + J.T @ force
        offset = memory.offset
        if switched and params.bumpless:
            before = memory.torque - self._known
            # Losing contact, keep what acts along the surface and let go of what pushes.
            offset = J.T @ (P @ (inverse.T @ before)) - position if lost else before - law
        torque = finite("torque", law + offset + self._known - J.T @ damped)
        return HybridMemory(
            torque=torque,
            position_integral=integral,
            force_integral=force_integral,
            offset=offset,
            creep=creep,
            mode=mode,
            position_error=position_error,
            force_error=force_error,
        )

    def _inverse(self, q: Array, J: Array) -> Array:
        with contextlib.suppress(np.linalg.LinAlgError):
            inverse: Array = np.asarray(np.linalg.inv(J), dtype=np.float64)
            if float(np.vdot(J, J) * np.vdot(inverse, inverse)) < _WORST_CONDITION**2:
                return inverse
        raise ParameterError(
            f"the pose of the {self._arm.name}",
            q.tolist(),
            "one in which the Jacobian is regular",
        )


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
