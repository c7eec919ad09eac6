"""Hybrid position/force control with Jacobian inverse or transpose (Figs. 2-1 and 2-2)."""

import contextlib
import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, LeafSystem, System
from pydrake.systems.framework import State as DrakeState

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import (
    ParameterError,
    known,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.contact_detection_law import APPROACH, LOST
from chamfer.systems.force.projection import require_projection
from chamfer.systems.force.sampled_loop import Plant, Sampled, closed, growth_rate, held
from chamfer.systems.ports import finite, finite_input, require_ports

Array = NDArray[np.float64]
Law = Literal["inverse", "transpose", "projected"]
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

    law: Law = "inverse"  # with which Cartesian errors become torques
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
    """What one period of the controller hands to the next; its discrete states."""

    torque: Array  # (n,)
    position_integral: Array  # (n,), in joint or endpoint coordinates
    force_integral: Array  # (m,), N
    offset: Array  # (n,), N m
    creep: Array  # (1,), N, the push while contact is lost
    mode: Array  # (1,)
    position_error: Array  # (m,), m (rad)
    force_error: Array  # (m,), N


class HybridController(LeafSystem):
    """Position control in the domain P, force control in the domain F = I - P.

    .. pydrake_system::

        name: HybridController
        input_ports:
        - encoders
        - desired_position
        - desired_force
        - measured_force
        - selection
        - mode
        - desired_velocity
        output_ports:
        - torque
        - position_error
        - force_error

    With endpoint x, Jacobian J and the projected error e = P (x_d - x), a period T computes

    * ``transpose`` (Fig. 2-1): ``I += Ki e T``, ``tau = J^T (Kp e + I - Kd P x')``
    * ``inverse`` (Fig. 2-2): ``e_q = J^-1 e``, ``I += Ki e_q T``,
      ``tau = Kp e_q + I - Kd J^-1 P x'``
    * ``projected``: the same with the pseudo-inverse ``(P J)^+`` in place of ``J^-1 P``. It is
      ours: it moves the joints no more than the position domain needs, and the kinematic
      instability of the inverse law is gone.
    * force: ``I_f += Kif F (F_d - F_m) T``, ``tau += J^T (F F_d + I_f - Kdf F x')``. The damping
      is ours: on a soft gripper the integral swings without it, from Kif = b / m on for an arm of
      mass m and viscous friction b. The thesis has none (0).

    Both integrators are behind the selection. At a change of ``mode`` an offset torque takes up
    the difference but for that of the force domain's damping, so that the torque does not jump
    (section 2.1.4).

    With ``desired_velocity`` connected the damping acts on the rate's error, ``P (x' - x_d')`` in
    place of ``P x'``, so that a motion lags by its acceleration alone and not by ``Kd / Kp`` times
    its speed. Unconnected, as in the thesis, it acts on the rate. What damps the force domain acts
    on the rate in any case.

    While contact is lost (mode 2) a velocity damping and an integral term replace the force
    integral: ``f = L d - B F x'``, where d is the direction of F F_d and L integrates from 0 what
    is missing to the creep speed, no faster than the ramp. The offset is then chosen so that the
    push starts at 0.

    With ``full_dynamics`` the model of (2-1) is used: the law's joint torque, divided by the
    nominal ``inertia``, is taken as a joint acceleration and multiplied by the mass matrix, and
    Coriolis and gravity torques are added.

    ``encoders``, shape (2n,), q and velocity; ``desired_position``, shape (m,), m (rad);
    ``desired_velocity``, shape (m,), m/s (rad/s); ``desired_force`` and ``measured_force``, shape
    (m,), N, of the arm on its environment; ``selection``, shape (m * m,), P row by row; ``mode``,
    size 1, as :class:`chamfer.systems.force.contact_detection.ContactDetection` gives it, or more
    than that: another contact, in which all position integrators are held, because in a joint that
    presses one would push on by the errors of the others.
    ``torque``, shape (n,), and the errors, desired less measured, shape (m,), before the
    selection, are held over the period.

    Raises:
        ParameterError: If an input is not finite, P is no projection or, in contact, leaves the
            force no direction, or the arm comes to a singular pose.
    """

    def __init__(
        self,
        arm: Kinematics,
        params: HybridControllerParams,
        *,
        dynamics: ArmDynamics | None = None,
    ) -> None:
        super().__init__()
        n, m = arm.num_joints, arm.num_coordinates
        if (dynamics is not None) != params.full_dynamics:
            raise ParameterError(
                "full_dynamics", params.full_dynamics, "true with a model, false without one"
            )
        self._arm, self._params, self._model = arm, params, dynamics
        self._gains = params.for_joints(n)
        self._inertia = np.array(known("inertia", params.inertia)) if dynamics else np.ones(n)
        feedforward = known("feedforward_torque", params.feedforward_torque)
        self._known = np.array(feedforward or [0.0] * n)
        self._ports = [
            self.DeclareVectorInputPort(name, size)
            for name, size in (
                ("encoders", 2 * n),
                ("desired_position", m),
                ("desired_force", m),
                ("measured_force", m),
                ("selection", m * m),
                ("mode", 1),
            )
        ]
        self._desired_velocity = self.DeclareVectorInputPort("desired_velocity", m)
        start = HybridMemory(
            torque=self._known,
            position_integral=np.zeros(n),
            force_integral=np.zeros(m),
            offset=np.zeros(n),
            creep=np.zeros(1),
            mode=np.zeros(1),
            position_error=np.zeros(m),
            force_error=np.zeros(m),
        )
        for name, value in start._asdict().items():
            group = self.DeclareDiscreteState(value)
            if name in ("torque", "position_error", "force_error"):
                self.DeclareStateOutputPort(name, group)
        self._checked = b""
        # Unrestricted updates come before the discrete ones of the same instant, so that the arm
        # sees the new torque at once.
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, state: DrakeState) -> None:
        ports = self._ports
        if self._desired_velocity.HasValue(context):
            ports = [*ports, self._desired_velocity]
        held = context.get_discrete_state()
        memory = HybridMemory(*(held.value(i) for i in range(len(HybridMemory._fields))))
        settled = self.step(memory, *(finite_input(port, context) for port in ports))
        finite("torque", settled.torque)
        values = state.get_mutable_discrete_state()
        for i, value in enumerate(settled):
            values.set_value(i, value)

    def step(
        self,
        memory: HybridMemory,
        encoders: Array,
        desired_position: Array,
        desired_force: Array,
        measured_force: Array,
        selection: Array,
        mode: Array,
        desired_velocity: Array | None = None,
    ) -> HybridMemory:
        """Return the memory after one period; its torque is the output."""
        params, n = self._params, self._arm.num_joints
        q, v = encoders[:n], encoders[n:]
        P = selection.reshape(len(desired_position), -1)
        domain = selection.tobytes() + mode.tobytes()
        if domain != self._checked:  # it seldom changes
            require_projection(P)
            if mode[0] != APPROACH and np.trace(P) > len(P) - 0.5:  # the trace is the rank
                allowed = f"a rank below {len(P)} in contact, to leave the force a direction"
                raise ParameterError("selection", P.tolist(), allowed)
            self._checked = domain
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
            model = self._model.evaluate(q, v)
            # Gravity at the start is in the constant estimate already.
            position = model.mass @ (position / self._inertia) + model.bias - self._known
        law = position + J.T @ force
        offset = memory.offset
        if switched and params.bumpless:
            before = memory.torque - self._known
            # Losing contact, keep what acts along the surface and let go of what pushes.
            offset = J.T @ (P @ (inverse.T @ before)) - position if lost else before - law
        return HybridMemory(
            torque=law + offset + self._known - J.T @ damped,
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


def require_hybrid_ports(controller: System, arm: Kinematics) -> None:
    """Raise :class:`ParameterError` unless a system has :class:`HybridController`'s ports.

    It can do without ``desired_velocity``.
    """
    n, m = arm.num_joints, arm.num_coordinates
    inputs = {"encoders": 2 * n, "desired_position": m, "desired_force": m, "measured_force": m}
    require_ports(
        "controller",
        controller,
        inputs={**inputs, "selection": m * m, "mode": 1},
        outputs={"torque": n, "position_error": m, "force_error": m},
    )


class AccelerationFeedforward(LeafSystem):
    """Adds what the inertia takes, so that a motion neither lags nor overshoots as it speeds up.

    .. pydrake_system::

        name: AccelerationFeedforward
        input_ports:
        - encoders
        - desired_acceleration
        - selection
        output_ports:
        - torque

    ``tau = M(q) J^-1 P x_d''``, with mass matrix M, or its diagonal alone, Jacobian J and the
    position domain P, as the computed-torque law has it; what a turning Jacobian adds,
    ``J' q'``, is left to the feedback.
    It is apart from :class:`chamfer.systems.force.hybrid_controller.HybridController`, whose
    offset at a change of mode would keep what is accelerated with at that instant.

    ``encoders``, shape (2n,), q and velocity; ``desired_acceleration``, shape (m,), m/s^2 and
    rad/s^2; ``selection``, shape (m * m,), P row by row. ``torque``, shape (n,), N m or N, is held
    over the period, s.

    Raises:
        ParameterError: If the period is not positive; while running, if an input is not finite or
            the arm comes to a singular pose.
    """

    def __init__(
        self, arm: Kinematics, dynamics: ArmDynamics, *, period: float, diagonal: bool = False
    ) -> None:
        super().__init__()
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        n, m = arm.num_joints, arm.num_coordinates
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)
        desired = self.DeclareVectorInputPort("desired_acceleration", m)
        selection = self.DeclareVectorInputPort("selection", m * m)
        self.DeclareStateOutputPort("torque", self.DeclareDiscreteState(n))

        def tick(context: Context, state: DrakeState) -> None:
            acceleration, torque = desired.Eval(context), np.zeros(n)
            if np.any(acceleration):
                q, joints = encoders.Eval(context)[:n], np.full(n, np.nan)
                wanted = selection.Eval(context).reshape(m, m) @ acceleration
                with contextlib.suppress(np.linalg.LinAlgError):
                    joints = np.linalg.solve(arm.jacobian(q), wanted)
                mass = dynamics.evaluate(q, np.zeros(n)).mass
                torque = np.diag(mass) * joints if diagonal else mass @ joints
            state.get_mutable_discrete_state().set_value(0, finite("torque", torque))

        # Of the kind that the hybrid controller's are, so that both torques change at once.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, tick)


def position_map(J: Array, P: Array, law: Law) -> Array:
    """Return what takes joint motion to the error that the law's gains see, shape (n, n).

    Joint coordinates for ``inverse`` and ``projected``, endpoint coordinates for ``transpose``.
    """
    if law == "inverse":
        return np.asarray(np.linalg.solve(J, P @ J), dtype=np.float64)
    projected: Array = P @ J
    if law == "projected":
        projected = np.linalg.pinv(projected, rcond=1e-6) @ projected
    return projected


def stiffness_eigenvalues(mass: Array, J: Array, P: Array, law: Law) -> NDArray[np.complex128]:
    """Return the eigenvalues of ``M^-1 J^-1 P J`` or its kin, for a gain of 1; shape (n,)."""
    seen = position_map(J, P, law)
    if law == "transpose":
        seen = J.T @ seen
    return np.linalg.eigvals(np.linalg.solve(mass, seen)).astype(np.complex128)


class Pose(NamedTuple):
    """An arm at rest as the hybrid controller knows it, n joints."""

    mass: Array  # (n, n)
    J: Array  # (n, n), of the endpoint
    turning: Array  # (n, n), N m/rad, how a constant endpoint force's torque changes with q
    sinking: Array  # (n, n), N m/rad, how gravity's torque does, as the full dynamics know


def linear_law(pose: Pose, P: Array, params: HybridControllerParams, mode: int) -> Sampled:
    """Return the hybrid controller about a pose at rest, in a mode of contact detection.

    Input: joint positions and velocities, and the measured force, shape (2n + m,). Output: the
    torque, shape (n,). States: the position integral, shape (n,), the force integral (m,), and
    the push with which lost contact is sought (1,). P, shape (m, m), is the position domain.
    """
    n, m, period = len(pose.J), len(P), params.period
    stiffness, integrates, damping = params.for_joints(n)
    seen = position_map(pose.J, P, params.law)
    grows = period * np.diag(integrates) @ seen
    if mode != APPROACH:
        grows[list(params.held_integrators)] = 0.0
    if mode > LOST:
        grows[:] = 0.0
    gain, known_load = np.eye(n), np.zeros((n, n))
    if params.law == "transpose":
        gain = pose.J.T
    elif params.full_dynamics:
        gain = pose.mass @ np.diag(1 / np.array(known("inertia", params.inertia)))
        known_load = pose.sinking
    integral, force, push = slice(0, n), slice(n, n + m), slice(n + m, n + m + 1)
    q, v, measured = slice(0, n), slice(n, 2 * n), slice(2 * n, 2 * n + m)
    A, B = np.eye(n + m + 1), np.zeros((n + m + 1, 2 * n + m))
    C, D = np.zeros((n, n + m + 1)), np.zeros((n, 2 * n + m))
    B[integral, q] = -grows
    C[:, integral] = gain
    D[:, q] = known_load - gain @ (np.diag(stiffness) @ seen + grows)
    D[:, v] = -gain @ np.diag(damping) @ seen
    pushes = np.eye(m) - P
    if mode == LOST and params.loss_mode:
        ahead = np.linalg.eigh(pushes)[1][:, -1:]
        slows = params.creep_ramp * period / params.creep_speed * ahead.T @ pose.J
        B[push, v] = -slows
        C[:, push] = pose.J.T @ ahead
        D[:, v] -= pose.J.T @ (ahead @ slows + params.creep_damping * pushes @ pose.J)
    else:
        B[force, measured] = -params.force_integral * period * pushes
        C[:, force] = pose.J.T
        D[:, measured] = pose.J.T @ B[force, measured]
        D[:, v] -= params.force_damping * pose.J.T @ pushes @ pose.J
        D[:, q] += pose.turning
    return Sampled(A, B, C, D)


def free_loop(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> Array:
    """Return what a period does to the position loop out of contact and without gravity.

    States: joint positions and velocities about a pose at rest, and those of the law. Mass matrix,
    Jacobian and position domain P have shape (n, n), the viscous friction (n,).
    """
    n = len(mass)
    zero = np.zeros((n, n))
    slowing = np.linalg.solve(mass, np.hstack([-np.diag(viscous), np.eye(n)]))
    flow = np.block([[zero, np.eye(n)], [zero, slowing[:, :n]]])
    drive = np.vstack([zero, slowing[:, n:]])
    unmeasured = np.zeros((n, 2 * n))  # the force
    arm = held(Plant(flow, drive, np.eye(2 * n), unmeasured), period=params.period)
    return closed(arm, linear_law(Pose(mass, J, zero, zero), P, params, APPROACH))


def free_growth_rate(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> float:
    """Return how fast :func:`free_loop` grows, 1/s.

    The force domain's free directions are poles at 1, so that a stable loop has about 0. Gains
    and friction that overflow count as infinite growth.
    """
    with np.errstate(all="ignore"):
        return growth_rate(free_loop(mass, J, P, params, viscous), params.period)
