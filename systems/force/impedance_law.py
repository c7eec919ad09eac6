"""Cartesian impedance control (Ruybal, Lumia and Wood, eq. 1): law, damping, stability.

Spatial vectors have their angular part first.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError, require_not_negative, require_positive
from chamfer.systems.compiled import add_product, compiled, inverse
from chamfer.systems.force.accommodation_law import VELOCITY
from chamfer.systems.force.tool_pose import POSE
from chamfer.systems.law import Array, HeldLaw, Signal

Vector3 = tuple[float, float, float]


def modal_damping(stiffness: Array, inertia: Array, ratio: float) -> tuple[Array, Array]:
    """Return the damping matrix that gives every mode the same ratio, and the modes' frequencies.

    Double diagonalisation: with modes Phi such that ``Phi^T Lambda Phi = 1`` and ``Phi^T K Phi =
    diag(omega^2)``, ``D = Lambda Phi diag(2 ratio omega) Phi^T Lambda``. K and Lambda are
    symmetric and positive, shape (n, n); omega, rad/s, shape (n,), ascends.
    """
    from scipy.linalg import eigh  # half of the time that a law takes to import

    squares, modes = eigh(stiffness, inertia)
    frequencies: Array = np.sqrt(squares)
    weighted = inertia @ modes
    damping: Array = (weighted * (2 * ratio * frequencies)) @ weighted.T
    return damping, frequencies


def stable_damping_ratios(frequency: float, period: float) -> tuple[float, float]:
    """Return the range of damping ratios in which a sampled mode is stable.

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

    The law of :class:`ImpedanceLaw`, with ``pose`` = [R_WT, p_WT], shape (3, 4), and the
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


class KnownArm(NamedTuple):
    """A controller's knowledge of its arm at joint positions; of n joints."""

    pose: Array  # (3, 4), [R_WT, p_WT] of the tool frame, m
    J_V_WT: Array  # (6, n), rad/s above m/s, of T's origin, in the world's axes
    mass: Array  # (n, n), kg m^2, reflected inertias included
    gravity: Array  # (n,), N m, the torque that holds the arm at rest


@dataclass(frozen=True, kw_only=True)
class ImpedanceControllerParams:
    """Parameters of :class:`ImpedanceLaw`; axes are those of the desired pose."""

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

    def limits(self, motors: tuple[float, ...]) -> Array:
        """Return the largest torques of joints whose motors have limits, N m, shape (n,)."""
        if self.torque_limits is None:
            return np.array(motors)
        self._require_some("torque_limits", len(motors))
        return np.array(self.torque_limits)

    def _require_some(self, name: str, size: int) -> None:
        values = getattr(self, name)
        if len(values) != size or not all(0 < value < math.inf for value in values):
            raise ParameterError(name, values, f"{size} finite numbers > 0")


class ImpedanceObservation(NamedTuple):
    """Inputs of the law."""

    encoders: Array
    desired_pose: Array
    desired_velocity: Array | None


class ImpedanceState(NamedTuple):
    """Memory from one step to the next, and outputs of the law."""

    torque: Array
    tool_pose: Array
    saturated: Array


class ImpedanceLaw(HeldLaw[ImpedanceState, ImpedanceObservation, ImpedanceState]):
    """See :class:`chamfer.systems.force.impedance_controller.ImpedanceController`.

    Args:
        arm: The controller's knowledge of it at joint positions q, rad, shape (n,).
        posture: The rest posture q.
        params: The springs and the rest.
        limits: Largest torques of the joints, N m, shape (n,).
    """

    observation = ImpedanceObservation

    def __init__(
        self,
        arm: Callable[[Array], KnownArm],
        posture: Array,
        params: ImpedanceControllerParams,
        *,
        limits: Array,
    ) -> None:
        n = len(posture)
        self._arm, self.params, self._limits = arm, params, limits
        self.posture = np.array(posture, dtype=np.float64)  # rad, shape (n,)
        self._stiffness = np.array([*params.rotational_stiffness, *params.stiffness])
        rest = arm(self.posture)
        self._design(rest)
        quaternion = _quaternion(rest.pose)
        quaternion = -quaternion if quaternion[0] < 0 else quaternion
        super().__init__(
            period=params.period,
            inputs={
                "encoders": Signal(2 * n, ("rad",) * n + ("rad/s",) * n, finite=True),
                "desired_pose": POSE._replace(finite=True),
                "desired_velocity": Signal(6, VELOCITY, optional=True, finite=True),
            },
            outputs={"torque": Signal(n, "N m"), "tool_pose": POSE, "saturated": Signal(n)},
            start=ImpedanceState(
                np.clip(rest.gravity, -limits, limits),
                np.concatenate([quaternion, rest.pose[:, 3]]),
                np.zeros(n),
            ),
        )

    def _design(self, rest: KnownArm) -> None:
        """Set damping and regularisation for the rest posture."""
        from scipy.linalg import null_space

        params, mass, J_V_WT = self.params, rest.mass, rest.J_V_WT
        R_WT = rest.pose[:, :3]
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

    def update(
        self, state: ImpedanceState, observation: ImpedanceObservation, time: float
    ) -> ImpedanceState:
        """Return the state after a step."""
        encoders, pose, velocity = observation
        rate = _STILL if velocity is None else velocity
        result, n = self.torque(state.tool_pose, encoders, pose, rate), len(self.posture)
        return ImpedanceState(result[:n], result[n : n + 7], result[n + 7 :])

    def torque(
        self,
        last_pose: Array,
        encoders: Array,
        desired_pose: Array,
        desired_velocity: Array = _STILL,
    ) -> Array:
        """Return torque, tool pose and saturation, shape (2 n + 7,), for the inputs.

        ``last_pose``, shape (7,), is the tool pose before; it decides the quaternion's sign.
        """
        tool = self._arm(encoders[: len(self.posture)])
        result = impedance_torque(
            tool.pose,
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
            self.params.null_stiffness,
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
