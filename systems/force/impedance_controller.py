"""Cartesian impedance control (Ruybal, Lumia and Wood, eq. 1): law, damping, stability.

Spatial vectors have their angular part first.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from scipy.linalg import eigh, null_space

from chamfer.models.arms.serial_arm import SerialArm
from chamfer.models.validation import ParameterError, require_not_negative, require_positive
from chamfer.systems.compiled import add_product, compiled, inverse
from chamfer.systems.force.arm_model import ArmModel, Vector3
from chamfer.systems.force.tool_pose import advance_of, spring_force
from chamfer.systems.ports import finite_input
from chamfer.systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]


def modal_damping(stiffness: Array, inertia: Array, ratio: float) -> tuple[Array, Array]:
    """Return the damping matrix that gives every mode the same ratio, and the modes' frequencies.

    Double diagonalisation: with modes Phi such that ``Phi^T Lambda Phi = 1`` and ``Phi^T K Phi =
    diag(omega^2)``, ``D = Lambda Phi diag(2 ratio omega) Phi^T Lambda``. K and Lambda are
    symmetric and positive, shape (n, n); omega, rad/s, shape (n,), ascends.
    """
    squares, modes = eigh(stiffness, inertia)
    frequencies: Array = np.sqrt(squares)
    weighted = inertia @ modes
    damping: Array = (weighted * (2 * ratio * frequencies)) @ weighted.T
    return damping, frequencies


def stable_damping_ratios(frequency: float, period: float) -> tuple[float, float]:
    """Return between which damping ratios a mode is stable whose controller samples it.

    A mass m is held by ``f = -(k x + d v)``, computed once a period T, s. If the plant takes n
    semi-implicit steps a period (v before x) the motion decays for ``d T/m + k T^2/(2 n m) < 2``
    and ``d T/m > (1 - 1/n) k T^2/(2 m)``; the worst cases are n = 1 in the first and n without end
    in the second. Of the frequency sqrt(k/m), rad/s, ``frequency * period`` must be below sqrt(2).
    """
    x = frequency * period
    return x / 4, (4 - x * x) / (4 * x)


@compiled
def impedance_torque(
    pose: Array,
    jacobian: Array,
    mass: Array,
    gravity: Array,
    encoders: Array,
    desired_pose: Array,
    desired_velocity: Array,
    last_pose: Array,
    stiffness: Array,
    damping: Array,
    posture: Array,
    null_stiffness: float,
    null_damping: float,
    regularisation: Array,
    limits: Array,
) -> Array:
    """Return limited torque, tool pose and saturation, shape (2 n + 7,); of n joints.

    The law of :class:`ImpedanceController`, with ``pose`` = [R_WT, p_WT], shape (3, 4), and the
    arm's J_V_WT, mass matrix and gravity torque; ``regularisation``, shape (6,), is added to the
    diagonal of ``J M^-1 J^T``.
    """
    n = len(posture)
    q, v = encoders[:n], encoders[n:]
    tool = _quaternion(pose)
    wanted = _unit(desired_pose[:4])
    R_WD = _rotation(wanted)
    R_DW = R_WD.T
    zero = np.zeros(6)

    # Errors and the wrench of eq. (1), in the axes of D.
    rate = _plus(zero, jacobian, v)
    slip, error, effort = np.zeros(6), np.zeros(6), np.zeros(6)
    vector = rotation_vector(wanted, tool)
    slip[:3] = _plus(zero[:3], R_DW, rate[:3] - desired_velocity[:3])
    slip[3:] = _plus(zero[:3], R_DW, rate[3:] - desired_velocity[3:])
    error[:3] = vector
    error[3:] = _plus(zero[:3], R_DW, pose[:, 3] - desired_pose[4:])
    wrench = stiffness * error
    wrench[:3] = gradient(vector, wrench[:3])
    wrench = _plus(wrench, damping, slip)
    effort[:3] = _plus(zero[:3], R_WD, wrench[:3])  # the same in the world's axes
    effort[3:] = _plus(zero[:3], R_WD, wrench[3:])

    # How the joints move though the tool does not.
    torque = gravity.copy()
    if n > 6:
        null, push = _null_torque(
            jacobian, mass, q, v, rate, posture, null_stiffness, null_damping, regularisation
        )
        torque += null
        effort += push
    torque = _plus(torque, jacobian.T, -effort)

    result = np.zeros(2 * n + 7)
    for i in range(n):
        result[i] = torque[i]
        if abs(torque[i]) > limits[i]:
            result[n + 7 + i] = math.copysign(1.0, torque[i])
            result[i] = math.copysign(limits[i], torque[i])
    result[n : n + 4] = -tool if _dot(tool, last_pose[:4]) < 0 else tool
    result[n + 4 : n + 7] = pose[:, 3]
    return result


@compiled
def _null_torque(
    jacobian: Array,
    mass: Array,
    q: Array,
    v: Array,
    rate: Array,
    posture: Array,
    null_stiffness: float,
    null_damping: float,
    regularisation: Array,
) -> tuple[Array, Array]:
    """Return the torque towards the rest posture, (n,), and the wrench that it would be, (6,)."""
    n = len(posture)
    zero = np.zeros(6)
    inverse_mass = inverse(mass)
    weighted = np.zeros((n, 6))  # M^-1 J^T
    mobility = np.diag(regularisation)
    for j in range(6):
        weighted[:, j] = _plus(np.zeros(n), inverse_mass, jacobian[j])
        mobility[:, j] = _plus(mobility[:, j], jacobian, weighted[:, j])
    inertia = inverse(mobility)
    own_motion = _plus(v, weighted, -_plus(zero, inertia, rate))
    null = null_stiffness * (posture - q) - null_damping * own_motion
    return null, _plus(zero, inertia, _plus(zero, weighted.T, null))


@compiled
def _plus(start: Array, matrix: Array, vector: Array) -> Array:
    """Return ``start + matrix vector``."""
    total = start.copy()
    add_product(matrix, vector, total)
    return total


@compiled
def rotation_vector(start: Array, end: Array) -> Array:
    """Return axis times angle, rad, from one orientation to another, in the axes of ``start``.

    Unit quaternions (w, x, y, z) of either sign; the length is up to pi.
    """
    w = _dot(start, end)
    # The vector part of conj(start) end.
    vector: Array = _cross(end[1:], start[1:]) + (start[0] * end[1:] - end[0] * start[1:])
    sine = math.sqrt(_dot(vector, vector))
    factor = 2 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    vector *= -factor if w < 0 else factor
    return vector


@compiled
def gradient(vector: Array, force: Array) -> Array:
    """Return the moment, N m, of a potential energy of the rotation vector, up to pi long, rad.

    It is the transposed inverse of the rotation vector's left Jacobian times ``force``, the
    energy's derivative with respect to it; the force itself where that is along the vector.
    """
    square = _dot(vector, vector)
    half = math.sqrt(square) / 2
    c = 1 / 12 if half < 1e-3 else (1 - half * math.cos(half) / math.sin(half)) / square
    twist = _cross(vector, force)
    moment: Array = force + twist / 2 + c * _cross(vector, twist)
    return moment


@compiled
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@compiled
def _unit(a: Array) -> Array:
    length = math.sqrt(_dot(a, a))
    unit: Array = a / (length if length > 0 else math.nan)
    return unit


@compiled
def _cross(a: Array, b: Array) -> Array:
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@compiled
def _rotation(q: Array) -> Array:
    """Return the rotation matrix of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@compiled
def _quaternion(R: Array) -> Array:
    """Return a unit quaternion of the rotation in the first three columns (Shepperd)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    q = np.empty(4)
    i = 0
    for k in range(1, 3):
        if R[k, k] > R[i, i]:
            i = k
    if trace > R[i, i]:
        q[0] = 1 + trace
        q[1], q[2], q[3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    else:
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0] = R[k, j] - R[j, k]
        q[1 + i] = 1 + 2 * R[i, i] - trace
        q[1 + j] = R[j, i] + R[i, j]
        q[1 + k] = R[k, i] + R[i, k]
    return _unit(q)


# Added to the diagonal of (J M^-1 J^T), relative to its value at the rest posture, before it is
# inverted: the null space's projection stays finite where the arm is singular.
_REGULARISATION: Final = 1e-6
_STILL: Final = np.zeros(6)


@dataclass(frozen=True, kw_only=True)
class ImpedanceControllerParams:
    """Parameters of :class:`ImpedanceController`; axes are those of the desired pose."""

    stiffness: Vector3 = (400.0, 400.0, 400.0)  # N/m, along each axis; section 5, alignment
    rotational_stiffness: Vector3 = (5.0, 5.0, 5.0)  # N m/rad, about each axis; section 5
    damping_ratio: float = 0.7  # of all six modes, from which the damping follows; assumed
    null_stiffness: float = 5.0  # N m/rad, of every joint towards the rest posture; assumed
    null_damping_ratio: float = 0.7  # of every joint's motion that doesn't move the tool; assumed
    torque_limits: tuple[float, ...] | None = None  # N m, of each joint; None: the arm's own
    smallest_singular_value: float = 0.05  # of the rest posture's Jacobian, rad and m
    allow_unstable: bool = False  # True: run with damping beyond what the period allows
    period: float = 0.002  # s, of the controller, 500 Hz; assumed

    def __post_init__(self) -> None:
        require_positive(self, "damping_ratio", "null_damping_ratio", "period")
        require_not_negative(self, "null_stiffness", "smallest_singular_value")
        for name in ("stiffness", "rotational_stiffness"):
            self._require_some(name, 3)
        if self.torque_limits is not None:
            self._require_some("torque_limits", len(self.torque_limits))

    def limits(self, arm: SerialArm) -> Array:
        """Return the largest torques of an arm's joints, N m, shape (n,)."""
        if self.torque_limits is None:
            return np.array(arm.torque_limits)
        self._require_some("torque_limits", arm.num_joints)
        return np.array(self.torque_limits)

    def _require_some(self, name: str, size: int) -> None:
        values = getattr(self, name)
        if len(values) != size or not all(0 < value < math.inf for value in values):
            raise ParameterError(name, values, f"{size} finite numbers > 0")


class ImpedanceController(LeafSystem):
    """Makes the tool behave as a mass on springs and dampers anchored at a desired pose, eq. (1).

    .. pydrake_system::

        name: ImpedanceController
        input_ports:
        - encoders
        - desired_pose
        - desired_velocity (optional)
        output_ports:
        - torque
        - tool_pose
        - saturated

    ``T = T_g(q) - J^T [K_p (x - x_d) + K_d (x' - x'_d)] + T_null``, once a period, with the
    controller's own model of the arm. Position and velocity errors are taken in the axes of the
    desired pose D. The orientation error is the rotation vector theta of R_DT, up to pi; the
    moment is the gradient of ``theta^T K theta / 2``, for equal stiffnesses k theta, so that the
    springs store what they take. K_d is the :func:`modal_damping` for the effective inertia
    ``Lambda = (J M^-1 J^T)^-1`` at the rest posture.

    The torque towards the rest posture, and the damping of the elbow's own motion, are projected
    into the null space that is consistent with the mass matrix: they do not accelerate the tool.
    The law needs no inverse of the Jacobian, the projection a regularised one, so that in a
    singular pose the torque is finite and the tool compliant as eq. (1) says. The torque is
    limited at last. An arm with six joints has no null space.

    Of an arm with n joints ``encoders``, shape (2 n,), is q (rad) and velocity;
    ``desired_pose``, shape (7,), quaternion (w, x, y, z), of any length and sign, and position of
    the tool frame, m; ``desired_velocity``, shape (6,), rad/s and m/s in the world's axes, 0 if
    not connected. ``torque``, shape (n,), N m;
    ``tool_pose``, shape (7,), where the model takes the tool to be, the quaternion's sign without
    jumps (w >= 0 at the rest posture); ``saturated``, shape (n,), is the sign of a torque that
    was limited, else 0. All are held over the period; the first ones are those of the start.

    The model is what the controller knows of the arm, ``posture`` the rest posture q, rad, shape
    (n,).

    Raises:
        ParameterError: At construction if the posture is outside the joints' ranges or too close
            to a singularity, or a mode is unstable at this period; in a run if an input is not
            finite or a quaternion is zero.
    """

    def __init__(self, model: ArmModel, posture: Array, params: ImpedanceControllerParams) -> None:
        super().__init__()
        n = model.arm.num_joints
        self._model, self._params = model, params
        self.posture = np.array(posture, dtype=np.float64)  # rad, shape (n,)
        if self.posture.shape != (n,) or not model.arm.within_limits(self.posture):
            raise ParameterError("rest posture", tuple(self.posture.tolist()), model.arm.ranges)
        self._limits = params.limits(model.arm)
        self._stiffness = np.array([*params.rotational_stiffness, *params.stiffness])
        rest = model.evaluate(self.posture)
        self._design(rest.X_WT.rotation().matrix(), rest.J_V_WT, rest.mass)
        self._ports = [
            self.DeclareVectorInputPort(name, size)
            for name, size in (("encoders", 2 * n), ("desired_pose", 7), ("desired_velocity", 6))
        ]
        for name, start in (
            ("torque", np.clip(rest.gravity, -self._limits, self._limits)),
            ("tool_pose", pose_vector(rest.X_WT)),
            ("saturated", np.zeros(n)),
        ):
            self.DeclareStateOutputPort(name, self.DeclareDiscreteState(start))
        self.DeclareInitializationDiscreteUpdateEvent(self._tick)
        # A MultibodyPlant with sampled outputs has made its step of the same instant before: no
        # step of delay gets into the loop.
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    def _design(self, R_WT: Array, J_V_WT: Array, mass: Array) -> None:
        """Set damping and regularisation for the rest posture."""
        params = self._params
        J = np.vstack([R_WT.T @ J_V_WT[:3], R_WT.T @ J_V_WT[3:]])  # in the tool's axes
        smallest = float(np.linalg.svd(J, compute_uv=False)[-1])
        if not smallest >= params.smallest_singular_value:
            raise ParameterError(
                "rest posture",
                tuple(self.posture.round(4).tolist()),
                f"joint positions at which the Jacobian's smallest singular value, here "
                f"{smallest:.3g}, is {params.smallest_singular_value:g} or more",
            )
        mobility = J_V_WT @ np.linalg.solve(mass, J_V_WT.T)
        self._regularisation = _REGULARISATION * mobility.diagonal()
        # Effective inertia in the tool's axes, K_d in those of the desired pose, (6, 6), angular
        # first; the six modes' natural frequencies, rad/s, ascending.
        self.inertia = np.linalg.inv(J @ np.linalg.solve(mass, J.T))
        self.damping, self.frequencies = modal_damping(
            np.diag(self._stiffness), self.inertia, params.damping_ratio
        )
        if not params.allow_unstable:
            _require_stable(params, "damping_ratio", float(self.frequencies[-1]))
        self.null_damping = 0.0  # N m s/rad, of every joint; 0 where there is no null space
        free = null_space(J)
        if not (free.size and params.null_stiffness):
            return
        # The slowest mode has the damping ratio that is asked for, all others more.
        inertias = np.linalg.eigvalsh(free.T @ mass @ free)
        frequencies = np.sqrt(params.null_stiffness / inertias)
        slowest, inertia = float(frequencies[-1]), float(inertias[-1])
        self.null_damping = 2 * params.null_damping_ratio * slowest * inertia
        if params.allow_unstable:
            return
        for frequency in frequencies.tolist():
            _require_stable(params, "null_damping_ratio", frequency, frequency / slowest)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        encoders, pose, velocity = self._ports
        rate = finite_input(velocity, context) if velocity.HasValue(context) else _STILL
        inputs = finite_input(encoders, context), finite_input(pose, context), rate
        result = self.step(context.get_discrete_state(1).value(), *inputs)
        n = len(self.posture)
        for i, part in enumerate((result[:n], result[n : n + 7], result[n + 7 :])):
            values.set_value(i, part)

    def step(
        self,
        last_pose: Array,
        encoders: Array,
        desired_pose: Array,
        desired_velocity: Array = _STILL,
    ) -> Array:
        """Return torque, tool pose and saturation, shape (2 n + 7,), that follow from the inputs.

        ``last_pose``, shape (7,), is the tool pose before; it decides the quaternion's sign.
        """
        tool = self._model.evaluate(encoders[: len(self.posture)])
        result = impedance_torque(
            tool.X_WT.GetAsMatrix34(),
            tool.J_V_WT,
            tool.mass.T,  # symmetric, row by row
            tool.gravity,
            encoders,
            desired_pose,
            desired_velocity,
            last_pose.copy(),  # writable: one signature, compiled once
            self._stiffness,
            self.damping,
            self.posture,
            self._params.null_stiffness,
            self.null_damping,
            self._regularisation,
            self._limits,
        )
        if not math.isfinite(float(result @ result)):
            if not float(desired_pose[:4] @ desired_pose[:4]) > 0:
                allowed = "a quaternion that is not zero"
                raise ParameterError("desired_pose", desired_pose.tolist(), allowed)
            raise ParameterError("torque", result[: len(self.posture)].tolist(), "finite numbers")
        return result


def _require_stable(
    params: ImpedanceControllerParams, name: str, frequency: float, factor: float = 1.0
) -> None:
    """Refuse a named damping ratio, ``factor`` times of which is that of a mode, in rad/s."""
    period = params.period
    low, high = (ratio / factor for ratio in stable_damping_ratios(frequency, period))
    if not low < high:
        raise ParameterError(
            "period", period, f"less than {math.sqrt(2) / frequency:.3g} s for this stiffness"
        )
    value = getattr(params, name)
    if not low < value < high:
        raise ParameterError(
            name,
            value,
            f"more than {low:.3g} and less than {high:.3g} for a mode of {frequency:.0f} rad/s "
            f"and a period of {period:g} s (damping below 2 Lambda/period)",
        )


class SpringForce(LeafSystem):
    """Reads the force of an arm's virtual springs, and how far its tool is beyond another one.

    .. pydrake_system::

        name: SpringForce
        input_ports:
        - command
        - tool_pose
        - hole_pose
        output_ports:
        - force
        - advance

    ``command`` and ``tool_pose``, shape (7,), are where the arm is told to be and where its
    encoders say that it is, ``hole_pose`` where the hole is, by encoders too, or by what is known.
    ``force``, shape (3,), N, is that of the springs on the tool along the hole's axes,
    ``K_p (x_d - x)`` of eq. (1) of Ruybal, Lumia and Wood: at rest it is what the tool pushes
    with, but for what the model of the arm lacks (payload, the joints' dry friction), which is to
    be tared. ``advance``, m, is how far the tool is beyond the hole's mouth along its axis.

    ``stiffness``, N/m, is that of the springs along the axes of the commanded pose.
    """

    def __init__(self, stiffness: Vector3) -> None:
        super().__init__()
        if not all(0 < one < math.inf for one in stiffness):
            raise ParameterError("stiffness", stiffness, "finite numbers > 0")
        springs = np.array(stiffness)
        command, tool, hole = (
            self.DeclareVectorInputPort(name, POSE_SIZE)
            for name in ("command", "tool_pose", "hole_pose")
        )

        def calc_force(context: Context, vector: BasicVector) -> None:
            poses = (port.Eval(context) for port in (command, tool, hole))
            vector.SetFromVector(spring_force(springs, *poses))

        def calc_advance(context: Context, vector: BasicVector) -> None:
            vector[0] = advance_of(tool.Eval(context), hole.Eval(context))

        depends = {tool.ticket(), hole.ticket()}
        self.DeclareVectorOutputPort("force", 3, calc_force, {command.ticket(), *depends})
        self.DeclareVectorOutputPort("advance", 1, calc_advance, depends)
