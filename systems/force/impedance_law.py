"""The law of Cartesian impedance control, its damping, and when a sampled mode is stable.

Source: Ruybal, Lumia and Wood, eq. (1). Spatial vectors have their angular part first.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from chamfer.systems.compiled import compiled, inverse

Array = NDArray[np.float64]


def modal_damping(stiffness: Array, inertia: Array, ratio: float) -> tuple[Array, Array]:
    """Return the damping matrix that gives every mode the same ratio, and the modes' frequencies.

    Double diagonalisation: with modes Phi such that ``Phi^T Lambda Phi = 1`` and
    ``Phi^T K Phi = diag(omega^2)``, ``D = Lambda Phi diag(2 ratio omega) Phi^T Lambda``.

    Args:
        stiffness: K, symmetric and positive, shape (n, n).
        inertia: Lambda, likewise.
        ratio: Damping ratio.

    Returns:
        D, shape (n, n), and omega, rad/s, shape (n,), ascending.
    """
    squares, modes = eigh(stiffness, inertia)
    frequencies: Array = np.sqrt(squares)
    weighted = inertia @ modes
    damping: Array = (weighted * (2 * ratio * frequencies)) @ weighted.T
    return damping, frequencies


def stable_damping_ratios(frequency: float, period: float) -> tuple[float, float]:
    """Return between which damping ratios a mode is stable whose controller samples it.

    A mass m is held by ``f = -(k x + d v)``, computed once a period T. If the plant takes n
    semi-implicit steps a period (v before x) the motion decays for ``d T/m + k T^2/(2 n m) < 2``
    and ``d T/m > (1 - 1/n) k T^2/(2 m)``; n = 1 in the first, the bound d < 2 m/T on the damping
    less a little for the stiffness, and n without end in the second are the worst cases.

    Args:
        frequency: sqrt(k/m), rad/s.
        period: T, s.

    Returns:
        Lower and upper bound, for all n; nothing is between if ``frequency * period`` is
        sqrt(2) or more.
    """
    x = frequency * period
    return x / 4, (4 - x * x) / (4 * x)


@compiled
def all_finite(first: Array, second: Array, third: Array) -> bool:
    """Return whether three vectors are finite."""
    for vector in (first, second, third):
        for value in vector:
            if not math.isfinite(value):
                return False
    return True


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

    What they are is said by
    :class:`chamfer.systems.force.impedance_controller.ImpedanceController`.

    Args:
        pose: [R_WT, p_WT], shape (3, 4).
        jacobian: J_V_WT in the world's axes, shape (6, n).
        mass: Mass matrix, shape (n, n).
        gravity: Torque against gravity, N m, shape (n,).
        encoders: q and velocity, rad and rad/s, shape (2 n,).
        desired_pose: Quaternion, not zero, and m, shape (7,).
        desired_velocity: rad/s and m/s in the world's axes, shape (6,).
        last_pose: Whose quaternion decides the sign of the new one, shape (7,).
        stiffness: N m/rad, then N/m, along the axes of the desired pose, shape (6,).
        damping: In the axes of the desired pose, shape (6, 6).
        posture: Rest posture, rad, shape (n,).
        null_stiffness: N m/rad.
        null_damping: N m s/rad.
        regularisation: Added to the diagonal of ``J M^-1 J^T``, shape (6,).
        limits: Largest torques, N m, shape (n,).
    """
    n = len(posture)
    q, v = encoders[:n], encoders[n:]
    tool = _quaternion(pose)
    wanted = _unit(desired_pose[:4])
    R_WD = _rotation(wanted)

    # Errors and the wrench of eq. (1), in the axes of D.
    rate = np.zeros(6)
    for i in range(6):
        for k in range(n):
            rate[i] += jacobian[i, k] * v[k]
    slip, error = np.zeros(6), np.zeros(6)
    vector = rotation_vector(wanted, tool)
    for i in range(3):
        error[i] = vector[i]
        for k in range(3):
            slip[i] += R_WD[k, i] * (rate[k] - desired_velocity[k])
            slip[i + 3] += R_WD[k, i] * (rate[k + 3] - desired_velocity[k + 3])
            error[i + 3] += R_WD[k, i] * (pose[k, 3] - desired_pose[k + 4])
    wrench = np.zeros(6)
    for i in range(6):
        wrench[i] = stiffness[i] * error[i]
    moment = gradient(vector, wrench[:3])
    for i in range(6):
        if i < 3:
            wrench[i] = moment[i]
        for k in range(6):
            wrench[i] += damping[i, k] * slip[k]
    effort = np.zeros(6)  # the same in the world's axes
    for i in range(3):
        for k in range(3):
            effort[i] += R_WD[i, k] * wrench[k]
            effort[i + 3] += R_WD[i, k] * wrench[k + 3]

    # How the joints move though the tool does not.
    null, push = np.zeros(n), np.zeros(6)
    if n > 6:
        null, push = _null_torque(
            jacobian, mass, q, v, rate, posture, null_stiffness, null_damping, regularisation
        )

    result = np.zeros(2 * n + 7)
    for i in range(n):
        torque = gravity[i] + null[i]
        for k in range(6):
            torque -= jacobian[k, i] * (effort[k] + push[k])
        result[i] = torque
        if abs(torque) > limits[i]:
            result[n + 7 + i] = math.copysign(1.0, torque)
            result[i] = math.copysign(limits[i], torque)
    sign = -1.0 if _dot(tool, last_pose[:4]) < 0 else 1.0
    for i in range(4):
        result[n + i] = sign * tool[i]
    for i in range(3):
        result[n + 4 + i] = pose[i, 3]
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
    # M^-1 J^T, and the effective inertia.
    inverse_mass = inverse(mass)
    weighted = np.zeros((n, 6))
    for i in range(n):
        for j in range(6):
            for k in range(n):
                weighted[i, j] += inverse_mass[i, k] * jacobian[j, k]
    mobility = np.zeros((6, 6))
    for i in range(6):
        mobility[i, i] = regularisation[i]
        for j in range(6):
            for k in range(n):
                mobility[i, j] += jacobian[i, k] * weighted[k, j]
    inertia = inverse(mobility)
    momentum, known, push = np.zeros(6), np.zeros(6), np.zeros(6)
    for i in range(6):
        for k in range(6):
            momentum[i] += inertia[i, k] * rate[k]
    null = np.zeros(n)
    for i in range(n):
        own_motion = v[i]
        for k in range(6):
            own_motion -= weighted[i, k] * momentum[k]
        null[i] = null_stiffness * (posture[i] - q[i]) - null_damping * own_motion
        for k in range(6):
            known[k] += weighted[i, k] * null[i]
    for i in range(6):
        for k in range(6):
            push[i] += inertia[i, k] * known[k]
    return null, push


@compiled
def rotation_vector(start: Array, end: Array) -> Array:
    """Return axis times angle, rad, of the rotation from one orientation to another.

    Args:
        start: Unit quaternion (w, x, y, z), shape (4,), of either sign.
        end: Likewise.

    Returns:
        In the axes of ``start``, shape (3,), of a length up to pi.
    """
    w = _dot(start, end)
    # The vector part of conj(start) end.
    vector = _cross(end[1:], start[1:])
    for i in range(3):
        vector[i] += start[0] * end[i + 1] - end[0] * start[i + 1]
    sine = math.sqrt(_dot(vector, vector))
    factor = 2 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    for i in range(3):
        vector[i] *= -factor if w < 0 else factor
    return vector


@compiled
def gradient(vector: Array, force: Array) -> Array:
    """Return the moment, N m, of a potential energy of the rotation vector.

    It is the transposed inverse of the rotation vector's left Jacobian times ``force``; the force
    itself where that is along the vector.

    Args:
        vector: Rotation vector, rad, shape (3,), of a length up to pi.
        force: Derivative of the energy with respect to it, N m, shape (3,).
    """
    square = _dot(vector, vector)
    half = math.sqrt(square) / 2
    c = 1 / 12 if half < 1e-3 else (1 - half * math.cos(half) / math.sin(half)) / square
    twist = _cross(vector, force)
    again = _cross(vector, twist)
    moment = np.zeros(3)
    for i in range(3):
        moment[i] = force[i] + twist[i] / 2 + c * again[i]
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
    unit = np.zeros(len(a))
    for i in range(len(a)):
        unit[i] = a[i] / length if length > 0 else math.nan
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
