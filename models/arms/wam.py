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

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.serial_arm import FlangeState, SerialArm
from chamfer.models.validation import ParameterError

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
POSTURE: Final = (0.0, 0.75, 0.0, 1.75, 0.0, -0.93, 0.0)  # rad, elbow up and bent; assumed


def pose(q: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the flange's rotation R_BF, shape (3, 3), and position p_BF, m, of q, rad, (7,)."""
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


def _kinematics(q: Array) -> FlangeState:
    R, p = pose(q)
    return FlangeState(R, p, jacobian(q))


WAM: Final = SerialArm(
    name="wam",
    urdf=URDF.read_text(encoding="utf-8"),
    base="base",
    flange="flange",
    joint_names=JOINT_NAMES,
    lower_limits=LOWER_LIMITS,
    upper_limits=UPPER_LIMITS,
    torque_limits=TORQUE_LIMITS,
    rotor_inertia=REFLECTED_INERTIAS,
    dry_friction=DRY_FRICTION,
    kinematics=_kinematics,
    posture=POSTURE,
    base_height=0.346,  # as the URDF draws it
)
