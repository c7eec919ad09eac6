"""The extended Kalman filters that follow the contact point's frame, for one sample.

The contact frame has its origin p at the contact point, t along the path, n along the surface's
normal and b = n x t. Along the path it turns like a Darboux frame: moved by ds it is displaced by
ds t and turned by ds w, where w, rad/m in the frame's own axes, is

* w_t, how the normal tilts sideways (the surface's geodesic torsion),
* w_b, how it tilts forward (less the normal curvature),
* w_n, how the path turns within the surface.

The surface's bound on its curvature bounds w_t and w_b; w_n is the path's. Each entry of w is a
first-order Gauss-Markov process over the path's length. All errors are small rotations and
displacements in the frame's own axes, in the order p, rotation, w, friction angle (ten entries).

Beside its covariance P a frame carries S, how its error changes with what is only considered and
not estimated: the relative error c of the compliance, and the force sensor's bias. The gains are
those of P, the estimate is that of a filter that knows of neither, and its whole covariance is
``P + S C S^T``, with the covariance C of the considered (Schmidt 1966; Jazwinski, Stochastic
Processes and Filtering Theory, 1970, section 8.4).

In the plane everything out of it has no uncertainty and stays zero.

Several frames run side by side, a multiple-model filter. Each model assumes another bound on the
surface's curvature and has its own frame. Their probabilities follow from their innovations
(Magill, "Optimal adaptive estimation of sampled stochastic processes", 1965), with a chance that
another model holds from a sample to the next. That chain of models is that of the interacting
multiple model filter (Blom and Bar-Shalom, "The interacting multiple model algorithm for systems
with Markovian switching coefficients", 1988), but the estimates themselves are not mixed before
a sample, only for the output.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]

SIZE: Final = 10  # of the error
CONSIDERED: Final = 4  # c, relative error of the compliance, and the bias, N, world frame
NUMBERS: Final = 3 + 9 + 3 + 1 + SIZE * (SIZE + CONSIDERED)  # that make up a frame
_ANYWHERE: Final = 1.0  # m, how far the contact point may have jumped along its path
_FORCE_DIRECTION: Final = 0.02  # rad, by which friction may be off the path's direction
_TURN_THRESHOLD: Final = 4.0  # standard deviations, a larger turn begins a new path
_SHARP_TURN: Final = math.pi / 3  # more than this begins a new path in any case
_UNKNOWN_TURN: Final = 1.0  # rad, standard deviation of the path's direction, more is unknown
_FRICTION_DRIFT: Final = 1e-3  # rad, standard deviation of the friction angle's change per sample
_LEAST_WEIGHT: Final = 1e-9  # of a model
_MOST_REPEATS: Final = 1e3  # of an error that stays


class ContactFrame(NamedTuple):
    """The contact frame and what goes with it."""

    p: Array  # (3,), m, contact point, world frame
    R: Array  # (3, 3), columns t, b, n in the world frame
    w: Array  # (3,), rad/m
    friction: Array  # (1,), rad, friction angle
    P: Array  # (10, 10), covariance of the error
    S: Array  # (10, 4), the error's derivative by what is considered


class GripperModel(NamedTuple):
    """The assumed model of the gripper and its sensor, in three dimensions."""

    stiffness: Array  # (3, 3), N/m
    compliance: Array  # (3, 3), m/N
    force_deviation: float  # N, a component's
    point_covariance: Array  # (3, 3), m^2
    point_root: Array  # (3, 3), 1/m, inverse Cholesky factor of it
    point_deviation: float  # m, the largest of any direction
    velocity_covariance: Array  # (3, 3), m^2/s^2
    velocity_deviation: float  # m/s, the largest of any direction
    pulled_deviation: float = 0.0  # N, of the force that the spring shows with what x_nom is off


class ContactReading(NamedTuple):
    """A sample, in three dimensions and in the contact point's terms."""

    point: Array  # (3,), m, x_nom + K^-1 F, by (4-2)
    velocity: Array  # (3,), m/s, v_nom + K^-1 Fdot, by (4-3)
    force: Array  # (3,), N, of the surface on the gripper
    nominal: Array  # (3,), m, x_nom
    nominal_velocity: Array  # (3,), m/s, v_nom
    gripper: GripperModel


class ContactModel(NamedTuple):
    """Assumptions and settings of the filters."""

    turn: Array  # (models, 4), rad/m, standard deviations of w, and m, over which it changes
    switch: Array  # (models, models), probability of the one after the other
    by_point: bool  # True: the contact point's path is used, not the velocity alone
    differenced: bool  # True: the velocity was made of the force, and shows nothing beside it
    by_friction: bool  # True: the friction angle is taken to be nearly constant
    period: float  # s
    friction: float = 0.0  # rad, deviation of friction's direction from the path's


@compiled
def repeats(distance: float, length: float) -> float:
    """Return how many samples count as one, if their error changes over a length.

    Samples with an error of the correlation ``r = exp(-distance / length)`` from one to the next
    tell as much, together, as samples of independent errors of ``(1 + r) / (1 - r)`` its variance.
    """
    if not length > 0.0:
        return 1.0
    return 1.0 / math.tanh(max(0.5 * distance / length, 1.0 / _MOST_REPEATS))


@compiled
def as_frame(numbers: Array) -> ContactFrame:
    """Return a frame as a view of its numbers, shape (156,)."""
    return ContactFrame(
        numbers[0:3],
        numbers[3:12].reshape(3, 3),
        numbers[12:15],
        numbers[15:16],
        numbers[16 : 16 + SIZE * SIZE].reshape(SIZE, SIZE),
        numbers[16 + SIZE * SIZE :].reshape(SIZE, CONSIDERED),
    )


@compiled
def rotation(vector: Array) -> Array:
    """Return the rotation matrix of a rotation vector, rad (Rodrigues)."""
    x, y, z = vector[0], vector[1], vector[2]
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-8:
        a, b = 1.0, 0.5
    else:
        a, b = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    R: Array = np.eye(3) + a * K + b * (K @ K)
    return R


@compiled
def correct(
    frame: ContactFrame, d: Array, row: Array, by: Array, residual: float, variance: float
) -> float:
    """Process a scalar ``residual = row . error + by . considered + noise``.

    ``d`` is the error's estimate, shape (10,), changed as the frame's P and S are. Returns the log
    likelihood, as if nothing were considered.
    """
    P, S = frame.P, frame.S
    across = np.zeros(SIZE)
    innovation, total = residual, variance
    for i in range(SIZE):
        for j in range(SIZE):
            across[i] += P[i, j] * row[j]
        innovation -= row[i] * d[i]
        total += row[i] * across[i]
    if not total > 0.0:
        return 0.0
    gain = across / total
    for j in range(CONSIDERED):
        seen = by[j]
        for i in range(SIZE):
            seen += row[i] * S[i, j]
        for i in range(SIZE):
            S[i, j] -= gain[i] * seen
    # Joseph's form, (I - gain row) P (I - gain row)^T + gain variance gain^T: the short one,
    # P - gain across^T, can leave a negative variance where a large one is measured exactly.
    once, left = np.empty((SIZE, SIZE)), np.zeros(SIZE)
    for i in range(SIZE):
        d[i] += gain[i] * innovation
        for j in range(SIZE):
            once[i, j] = P[i, j] - gain[i] * across[j]
            left[i] += once[i, j] * row[j]
    for i in range(SIZE):
        for j in range(i + 1):
            P[i, j] = once[i, j] - left[i] * gain[j] + variance * gain[i] * gain[j]
            P[j, i] = P[i, j]
    return -0.5 * (innovation * innovation / total + math.log(total))


@compiled
def sandwich(A: Array, P: Array) -> Array:
    """Return A P A^T, symmetric to the last bit."""
    found = A @ P @ A.T
    return 0.5 * (found + found.T)


@compiled
def begins(frame: ContactFrame, step: Array, deviation: float) -> bool:
    """Return whether a motion begins a path: the last one has no known direction, or another.

    ``step`` is how the contact point moves on, shape (3,), m, other than zero, and ``deviation``
    that of its angle, rad.
    """
    P = frame.P
    ahead = frame.R.T @ step
    ds = math.hypot(ahead[0], ahead[1])
    variance = deviation**2 + P[5, 5] + ds * (2.0 * P[5, 8] + ds * P[8, 8])
    limit = min(_SHARP_TURN, _TURN_THRESHOLD * math.sqrt(max(variance, 0.0)))
    turn = math.atan2(ahead[1], ahead[0]) - ds * frame.w[2]
    return bool(abs(turn) > limit or P[5, 5] >= _UNKNOWN_TURN**2)


@compiled
def head(frame: ContactFrame, turn: Array, step: Array, deviation: float) -> None:
    """Turn the frame about its normal where a path begins; the normal stays.

    ``turn`` is a model's; ``step`` and ``deviation`` are as in :func:`begins`. How well the new
    path's direction is known is left to the measurements.
    """
    if not begins(frame, step, deviation):
        return
    R, P, S = frame.R, frame.P, frame.S
    ahead = R.T @ step
    length = math.hypot(ahead[0], ahead[1])
    # Not by the angle: the sine of a half turn is not 0 in floating point, which would take the
    # frame out of the plane, where the filter has nothing to bring it back by.
    heading = np.eye(3)
    if length > 0.0:
        heading[0, 0] = heading[1, 1] = ahead[0] / length
        heading[1, 0] = ahead[1] / length
        heading[0, 1] = -heading[1, 0]
    R[:] = R @ heading
    whole = np.eye(SIZE)
    whole[0:3, 0:3] = heading.T
    whole[3:6, 3:6] = heading.T
    P[:] = sandwich(whole, P)
    S[:] = whole @ S
    frame.w[:] = 0.0
    S[5:9], P[5:9], P[:, 5:9] = 0.0, 0.0, 0.0
    for i in range(3):
        P[6 + i, 6 + i] = turn[i] ** 2
    P[5, 5] = _UNKNOWN_TURN**2 if turn[2] > 0.0 else 0.0


@compiled
def travel(frame: ContactFrame, turn: Array, ds: float) -> None:
    """Move the frame along its path by ds, m, with a model's ``turn``, shape (4,)."""
    R, P, w = frame.R, frame.P, frame.w
    step = ds * w
    half, whole = rotation(0.5 * step), rotation(step)
    frame.p[:] += ds * (R @ half)[:, 0]
    R[:] = R @ whole
    # The error in the new frame's axes: turned back, displaced by the rotation's and w's.
    back = whole.T
    A = np.eye(SIZE)
    A[0:3, 0:3] = back
    A[3:6, 3:6] = back
    for i in range(3):  # r x t = (0, r_n, -r_b), a rotation r moves what lies ahead
        A[i, 5] = ds * back[i, 1]
        A[i, 4] = -ds * back[i, 2]
        A[i, 8] = 0.5 * ds * A[i, 5]
        A[i, 7] = 0.5 * ds * A[i, 4]
    kept = math.exp(-abs(ds) / turn[3])
    for i in range(3):
        A[3 + i, 6 + i] = ds
        A[6 + i, 6 + i] = kept
        w[i] *= kept
    P[:] = sandwich(A, P)
    frame.S[:] = A @ frame.S
    for i in range(3):
        new = (1.0 - kept**2) * turn[i] ** 2
        P[6 + i, 6 + i] += new
        P[3 + i, 3 + i] += new * ds**2 / 3.0
    P[9, 9] += _FRICTION_DRIFT**2


@compiled
def follow(
    frame: ContactFrame, model: ContactModel, turn: Array, reading: ContactReading
) -> tuple[float, float]:
    """Move the frame on and process a sample.

    Returns the sample's log likelihood, and the square of the point's distance from the surface
    that was foreseen, over its variance. The frame is changed in place. The contact point moves;
    it must be known that it does.
    """
    p, R, P, S, gripper = frame.p, frame.R, frame.P, frame.S, reading.gripper
    v = R.T @ reading.velocity
    ds = v[0] * model.period
    if model.by_point:
        ds = (R.T @ (reading.point - p))[0]
    travel(frame, turn, ds)
    d = np.zeros(SIZE)
    row = np.zeros(SIZE)
    by = np.zeros(CONSIDERED)
    likelihood, surprise = 0.0, 1.0
    if model.by_point:
        beyond = (R.T @ (reading.point - p))[2]
        surprise = beyond**2 / (P[2, 2] + (R.T @ gripper.point_covariance @ R)[2, 2])
        # How far the point has come is measured, not predicted.
        P[0], P[:, 0], S[0] = 0.0, 0.0, 0.0
        P[0, 0] = _ANYWHERE**2
        root = gripper.point_root
        shown, moved, pushed = root @ R, root @ (reading.nominal - p), root @ gripper.compliance
        whitened = root @ (reading.point - p)
        for i in range(3):
            row[0:3], by[0], by[1:] = shown[i], moved[i], pushed[i]
            likelihood += correct(frame, d, row, by, whitened[i], 1.0)
        row[:], by[:] = 0.0, 0.0
    else:
        P[0:3], P[:, 0:3], S[0:3] = 0.0, 0.0, 0.0
    if not model.differenced:
        # The velocity is along t, and a rotation r takes t to t + r x t = (1, r_n, -r_b).
        v = R.T @ reading.velocity
        beside = R.T @ reading.nominal_velocity  # as the velocity is foreseen to have none
        C = R.T @ gripper.velocity_covariance @ R
        row[5], by[0] = v[0], beside[1]
        likelihood += correct(frame, d, row, by, v[1], C[1, 1])
        slope = C[1, 2] / C[1, 1] if C[1, 1] > 0.0 else 0.0
        row[4], row[5], by[0] = -v[0], -slope * v[0], beside[2] - slope * beside[1]
        variance = max(C[2, 2] - slope * C[1, 2], 0.0)
        likelihood += correct(frame, d, row, by, v[2] - slope * v[1], variance)
        row[:], by[:] = 0.0, 0.0
    # Friction opposes the motion, so that the force has no component along b.
    F = R.T @ reading.force
    gain = np.zeros((3, 3))
    noise = gripper.force_deviation
    by_path = model.by_point and gripper.pulled_deviation < noise
    if by_path:  # the path tells the force better than the sample
        F = R.T @ (gripper.stiffness @ (p + R @ d[0:3] - reading.nominal))
        gain = R.T @ gripper.stiffness @ R
        noise = gripper.pulled_deviation
    square = F @ F
    size = math.sqrt(square)
    if size > 0.0:
        row[0:3] = gain[1] / size
        row[3] = F[2] / size
        row[5] = -F[0] / size
        off = F[1] / size + row[3] * d[3] + row[5] * d[5]
        # The residual is of the whole error, whose estimate F takes into account already.
        residual = row @ d - off
        variance = _FORCE_DIRECTION**2 + (noise / size) ** 2
        if model.friction > 0.0:
            variance += (model.friction * F[0] / size) ** 2
        likelihood += correct(frame, d, row, by, residual, variance)
        row[:] = 0.0
    if model.by_friction and F[2] > 0.0:
        across = F[0] * F[0] + F[2] * F[2]
        row[0:3] = (F[0] * gain[2] - F[2] * gain[0]) / across
        row[4] = 1.0
        row[9] = -1.0
        off = math.atan2(-F[0], F[2]) - frame.friction[0] + d[4] - d[9]
        residual = row @ d - off
        variance = _FORCE_DIRECTION**2 if by_path else noise**2 / across
        likelihood += correct(frame, d, row, by, residual, variance)
    p[:] += R @ d[0:3]
    R[:] = R @ rotation(d[3:6])
    frame.w[:] += d[6:9]
    frame.friction[0] += d[9]
    return likelihood, surprise


@compiled
def follow_all(
    numbers: Array,
    weights: Array,
    model: ContactModel,
    reading: ContactReading,
    step: Array,
    deviation: float,
) -> float:
    """Process a sample with every model, and weight the models by how well they predicted it.

    Returns how far the sample was from what the last model foresaw, as :func:`follow`.

    Args:
        numbers: Shape (models, 156), each model's frame; changed.
        weights: Shape (models,), their probabilities; changed.
        model: What they assume.
        reading: The sample.
        step: How the contact point moves on, shape (3,), m.
        deviation: Standard deviation of its angle, rad.
    """
    likelihood, surprise = np.empty(len(weights)), 1.0
    for i in range(len(weights)):
        frame = as_frame(numbers[i])
        head(frame, model.turn[i], step, deviation)
        likelihood[i], surprise = follow(frame, model, model.turn[i], reading)
    weights[:] = model.switch.T @ weights * np.exp(likelihood - likelihood.max())
    weights[:] = np.maximum(weights / weights.sum(), _LEAST_WEIGHT)
    weights /= weights.sum()
    return surprise


@compiled
def turn_all(numbers: Array, turn: Array) -> None:
    """Turn the frames of all models, numbers of shape (models, 156), in the world frame."""
    for i in range(len(numbers)):
        R = as_frame(numbers[i]).R
        R[:] = turn @ R


@compiled
def mixture(numbers: Array, weights: Array, considered: Array) -> tuple[Array, Array]:
    """Return the normal, shape (3,), and its covariance, shape (3, 3), over all models.

    Args:
        numbers: Shape (models, 156), each model's frame.
        weights: Shape (models,).
        considered: Covariance of what is considered, shape (4, 4).
    """
    normal = np.zeros(3)
    for i in range(len(weights)):
        normal += weights[i] * as_frame(numbers[i]).R[:, 2]
    normal /= math.sqrt(normal @ normal)
    covariance = np.zeros((3, 3))
    for i in range(len(weights)):
        frame = as_frame(numbers[i])
        R, P = frame.R, frame.P + frame.S @ considered @ frame.S.T
        by_rotation = np.stack((-R[:, 1], R[:, 0]), 1)  # a rotation r takes n to n + r_b t - r_t b
        off = R[:, 2] - normal
        tilted = sandwich(by_rotation, np.ascontiguousarray(P[3:5, 3:5]))
        covariance += weights[i] * (tilted + np.outer(off, off))
    return normal, covariance


@compiled
def ahead(
    numbers: Array, model: ContactModel, speed: float, delay: float, deviation: float
) -> Array:
    """Return the predicted frames further along their paths.

    Args:
        numbers: Shape (models, 156), each model's frame.
        model: What they assume.
        speed: m/s, of the contact point.
        delay: s, how long ago the frames were where they are.
        deviation: s, standard deviation of the delay.
    """
    numbers = numbers.copy()
    for i in range(len(numbers)):
        frame = as_frame(numbers[i])
        travel(frame, model.turn[i], speed * delay)
        turned = np.outer(frame.w, frame.w) + frame.P[6:9, 6:9]
        frame.P[3:6, 3:6] += (speed * deviation) ** 2 * turned
    return numbers
