"""The Barrett WAM with seven joints: kinematics, limits, and the URDF beside it.

Classic Denavit-Hartenberg convention, each joint turns about the z axis of the frame before it:
``Rz(q) Tz(d) Tx(a) Rx(alpha)``. The base frame is at the shoulder, z up and x ahead; the flange
is frame 7, its z axis points out of the arm. With all joints at zero the arm stands upright.

Lengths, masses, centres of mass, inertias and reflected inertias are those of Barrett's published
configuration, the joints' ranges those of its manual; the torque limits are second-hand. The
paper of the work cell (Ruybal, Lumia and Wood) prints none of them.
"""

from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from models.validation import ParameterError

Array = NDArray[np.float64]

NUM_JOINTS: Final = 7
JOINT_NAMES: Final = tuple(f"joint_{i + 1}" for i in range(NUM_JOINTS))
URDF: Final = Path(__file__).with_name("wam.urdf")

TWISTS: Final = tuple(quarter * np.pi / 2 for quarter in (-1, 1, -1, 1, -1, 1, 0))  # rad, alpha
LENGTHS: Final = (0.0, 0.0, 0.045, -0.045, 0.0, 0.0, 0.0)  # m, a
OFFSETS: Final = (0.0, 0.0, 0.55, 0.0, 0.30, 0.0, 0.0609)  # m, d

LOWER_LIMITS: Final = (-2.6, -2.0, -2.8, -0.9, -4.76, -1.6, -3.0)  # rad
UPPER_LIMITS: Final = (2.6, 2.0, 2.8, 3.1, 1.24, 1.6, 3.0)  # rad
TORQUE_LIMITS: Final = (77.3, 160.6, 95.6, 29.4, 11.6, 11.6, 2.7)  # N m
REFLECTED_INERTIAS: Final = (  # kg m^2, of the motors, as seen at the joints
    0.20517,
    0.18884,
    0.06691,
    0.03462,
    0.00323,
    0.00323,
    0.000317,
)
DRY_FRICTION: Final = (0.1, 0.1, 0.1, 0.1, 0.03, 0.03, 0.03)  # N m, Coulomb, assumed

_ITERATIONS: Final = 100
_LARGEST_STEP: Final = 0.3  # rad, of a joint in one iteration
_PRECISION: Final = 1e-11  # m and rad


def pose(q: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the flange's rotation R_BF, shape (3, 3), and position p_BF, m, shape (3,).

    Args:
        q: Joint positions, rad, shape (7,), real or complex.
    """
    R, p, _, _ = _chain(q)
    return R, p


def jacobian(q: NDArray[Any]) -> NDArray[Any]:
    """Return the flange's geometric Jacobian J_V_BF in the base frame, shape (6, 7).

    The upper three rows are the angular velocity (rad/s), the lower three the velocity of the
    flange's origin (m/s). Takes complex q.
    """
    _, p, axes, origins = _chain(q)
    return np.vstack([axes.T, np.cross(axes, p - origins).T])


def _chain(
    q: NDArray[Any],
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Return the flange's pose, and axes and origins of the joints, shape (7, 3) each."""
    q = np.asarray(q)
    if q.shape != (NUM_JOINTS,):
        raise ParameterError("q", q.tolist(), f"{NUM_JOINTS} joint positions")
    R = np.eye(3, dtype=q.dtype if np.iscomplexobj(q) else np.float64)
    p = np.zeros(3, dtype=R.dtype)
    axes, origins = np.empty((NUM_JOINTS, 3), R.dtype), np.empty((NUM_JOINTS, 3), R.dtype)
    for i, (angle, alpha, a, d) in enumerate(zip(q, TWISTS, LENGTHS, OFFSETS, strict=True)):
        axes[i], origins[i] = R[:, 2], p
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        p = p + R @ np.array([a * c, a * s, d])
        R = R @ np.array([[c, -s * ca, s * sa], [s, c * ca, -c * sa], [0, sa, ca]])
    return R, p, axes, origins


def joint_positions(R: Array, p: Array, near: Array) -> Array:
    """Return joint positions, rad, shape (7,), that put the flange at a pose.

    Of the one-parameter family of solutions it is the one that Newton's method with the
    pseudo-inverse of the Jacobian comes to from ``near``.

    Args:
        R: Rotation R_BF, shape (3, 3).
        p: Position p_BF, m, shape (3,).
        near: Joint positions from which to start, rad, shape (7,).

    Raises:
        ParameterError: The pose is out of reach from there, or within the joints' ranges.
    """
    q: Array = np.array(near, dtype=np.float64)
    if not (np.isfinite(R).all() and np.isfinite(p).all() and np.isfinite(q).all()):
        raise ParameterError("flange pose", (R.tolist(), p.tolist()), "finite numbers")
    for _ in range(_ITERATIONS):
        R_now, p_now = pose(q)
        error = np.concatenate([_rotation_vector(R @ R_now.T), p - p_now])
        if np.abs(error).max() < _PRECISION:
            break
        step = np.linalg.pinv(jacobian(q), rcond=1e-6) @ error
        q = q + step * min(1.0, _LARGEST_STEP / float(np.abs(step).max()))
    else:
        raise ParameterError(
            "flange position", tuple(p.tolist()), f"within reach from {_rounded(near)} rad"
        )
    if not (np.less(LOWER_LIMITS, q).all() and np.less(q, UPPER_LIMITS).all()):
        raise ParameterError(
            "joint positions of the pose",
            _rounded(q),
            f"between {LOWER_LIMITS} and {UPPER_LIMITS} rad",
        )
    return q


def urdf_text(mass_scale: float = 1.0) -> str:
    """Return the URDF, every link's mass and inertia multiplied by a number > 0."""
    if not 0 < mass_scale < np.inf:
        raise ParameterError("mass_scale", mass_scale, "a finite number > 0")
    text = URDF.read_text(encoding="utf-8")
    if mass_scale == 1.0:
        return text
    ElementTree.register_namespace("drake", "http://drake.mit.edu")
    root = ElementTree.fromstring(text)
    for inertial in root.iter("inertial"):
        for element in (inertial.find("mass"), inertial.find("inertia")):
            if element is not None:
                for name, value in element.items():
                    element.set(name, repr(float(value) * mass_scale))
    return ElementTree.tostring(root, encoding="unicode")


def _rotation_vector(R: Array) -> Array:
    """Return the axis times the angle, rad, of a rotation by less than pi."""
    twice_sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    length = float(np.linalg.norm(twice_sine))
    angle = np.arctan2(length, np.trace(R) - 1)
    vector: Array = twice_sine * (angle / length if length > 1e-9 else 0.5)
    return vector


def _rounded(q: Array) -> tuple[float, ...]:
    return tuple(round(float(angle), 3) for angle in q)
