"""The Adept One with the three joints of its wrist: seven joints that place a gripped nugget.

Thesis, sections 1.1.1 and 6.3: a custom end-effector with a three-joint wrist, and an endpoint
vector of seven elements, position and orientation of the nugget and the gripper's own angle that
keeps it off the wall. Where the wrist's axes lie is not published (Leier 1998): this structure is
assumed, as are its lengths and masses.

The mount M hangs on joint 4. Joint 5 leans the gripper's body, which hangs from the mount, about
M's y axis, fingers outwards; joint 6 pitches the fingers about the same axis at the body's lower
end, joint 7 rolls them about their own x axis. The endpoint's frame E is at the fingers' tips, in
the middle of the nugget's top: +x_E points towards the wall, the nugget hangs along -z_E, and
``R_WE = Rz(yaw) Ry(pitch) Rx(roll)``.
"""

import math
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms import adept_one
from chamfer.models.arms.arm import Arm, Elbow
from chamfer.models.validation import ParameterError

BODY_LENGTH: Final = 0.20  # m, from joint 5 to joint 6; assumed
FINGER_LENGTH: Final = 0.06  # m, from joint 6 to the tips; assumed

# Joints that turn the mount in the plane.
_TURNS = np.array([1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def endpoint(q: NDArray[Any]) -> NDArray[Any]:
    """Return (x, y, z, yaw, pitch, roll, lean), m and rad, of joint positions q, shape (7,).

    q is in rad but for d3, in m downwards. Angles are not wrapped.
    """
    x, y, z, yaw = adept_one.endpoint(q[:4]).tolist()
    lean, joint_6, roll = q[4:].tolist()
    pitch = joint_6 - lean
    ahead, aside, up = _from_mount(pitch, roll, lean)
    c, s = np.cos(yaw), np.sin(yaw)
    tip = x + c * ahead - s * aside, y + s * ahead + c * aside, z + up
    return np.array([*tip, yaw, pitch, roll, lean])


def jacobian(q: NDArray[Any]) -> NDArray[Any]:
    """Return d(x, y, z, yaw, pitch, roll, lean)/dq, shape (7, 7).

    Its determinant is that of the Adept One without the wrist: leaning, pitching and rolling add
    no singular pose.
    """
    yaw = q[0] + q[1] + q[3]
    lean, joint_6, roll = q[4:].tolist()
    pitch = joint_6 - lean
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, aside, _ = _from_mount(pitch, roll, lean)
    cp, sp, cr, sr = np.cos(pitch), np.sin(pitch), np.cos(roll), np.sin(roll)
    found = np.zeros((7, 7), dtype=q.dtype)
    found[:4, :4] = adept_one.jacobian(q[:4])
    found[0] += (-s * ahead - c * aside) * _TURNS
    found[1] += (c * ahead - s * aside) * _TURNS
    # In the mount's axes: what lean (the pitch held), pitch and roll move.
    by_lean = BODY_LENGTH * np.cos(lean), 0.0, BODY_LENGTH * np.sin(lean)
    by_pitch = -FINGER_LENGTH * cp * cr, 0.0, FINGER_LENGTH * sp * cr
    by_roll = FINGER_LENGTH * sp * sr, FINGER_LENGTH * cr, FINGER_LENGTH * cp * sr
    for column, (a, b, up) in enumerate(
        (tuple(u - v for u, v in zip(by_lean, by_pitch, strict=True)), by_pitch, by_roll), 4
    ):
        found[:3, column] = c * a - s * b, s * a + c * b, up
    found[4, 4:6] = -1.0, 1.0
    found[5, 6] = found[6, 4] = 1.0
    return found


def joint_positions(x: NDArray[Any], elbow: Elbow) -> NDArray[Any]:
    """Return q, rad and m, shape (7,), for x = (x, y, z, yaw, pitch, roll, lean), m and rad.

    ``elbow`` is the sign of q2. Angles are met without whole turns between.
    """
    if not np.isfinite(x).all():
        raise ParameterError("endpoint", tuple(x.tolist()), "finite numbers")
    px, py, pz, yaw, pitch, roll, lean = x.tolist()
    ahead, aside, up = _from_mount(pitch, roll, lean)
    c, s = math.cos(yaw), math.sin(yaw)
    mount = np.array([px - c * ahead + s * aside, py - s * ahead - c * aside, pz - up, yaw])
    try:
        arm = adept_one.joint_positions(mount, elbow)
    except ParameterError as error:
        allowed = f"the mount {error.allowed}"
        raise ParameterError("endpoint", tuple(x.tolist()), allowed) from error
    return np.array([*arm, lean, pitch + lean, roll])


def _from_mount(pitch: Any, roll: Any, lean: Any) -> tuple[Any, Any, Any]:
    """Return p_ME in the mount's axes, m."""
    cr = np.cos(roll)
    return (
        BODY_LENGTH * np.sin(lean) - FINGER_LENGTH * np.sin(pitch) * cr,
        FINGER_LENGTH * np.sin(roll),
        -BODY_LENGTH * np.cos(lean) - FINGER_LENGTH * np.cos(pitch) * cr,
    )


ADEPT_WRIST = Arm(
    name="Adept One with its wrist",
    urdf=Path(__file__).with_name("adept_wrist.urdf"),
    joint_names=tuple(f"joint_{i + 1}" for i in range(7)),
    prismatic=("joint_3",),
    coordinates=("x", "y", "z", "yaw", "pitch", "roll", "lean"),
    coordinate_units=("m", "m", "m", "rad", "rad", "rad", "rad"),
    endpoint=endpoint,
    jacobian=jacobian,
    joint_positions=joint_positions,
    assumed=True,
    note="the Adept One's lengths; the wrist's axes, lengths and all masses are not published",
)

Array = NDArray[np.float64]

_BODY: Final = (0.030, 0.040, 0.17)  # m, of the body, along its axes
_BODY_ABOVE: Final = 0.10  # m, of its middle, above joint 6
_FORK: Final = (0.008, 0.05)  # m, radius and length of the fork's cylinder about joint 6
_FINGER: Final = (0.014, 0.006, 0.06)  # m, of each finger
_FINGER_ASIDE: Final = 0.016  # m, of its middle from the nugget's
_ROUND: Final = 16  # points of the fork's circles


def _box(size: tuple[float, float, float], middle: tuple[float, float, float]) -> Array:
    signs = np.array(list(product((-0.5, 0.5), repeat=3)))
    return signs * size + middle


def _fork() -> Array:
    radius, length = _FORK
    angle = np.repeat(2 * np.pi * np.arange(_ROUND) / _ROUND, 2)
    side = np.tile([-1.0, 1.0], _ROUND)
    return np.stack([radius * np.cos(angle), side * length / 2, radius * np.sin(angle)], axis=1)


# In the body's axes, from joint 6, and in the endpoint's frame.
_ON_BODY: Final = np.vstack([_box(_BODY, (0.0, 0.0, _BODY_ABOVE)), _fork()])
_ON_FINGERS: Final = np.vstack(
    [_box(_FINGER, (0.0, side * _FINGER_ASIDE, FINGER_LENGTH / 2)) for side in (-1.0, 1.0)]
)


def gripper_points(x: Array) -> Array:
    """Return the gripper's corners in the world, m, shape (k, 56, 3).

    Args:
        x: Endpoint vectors (x, y, z, yaw, pitch, roll, lean), m and rad, shape (k, 7).
    """
    yaw, pitch, roll, lean = x[:, 3:].T
    R_WM = _turn(yaw, 2)
    R_WE = R_WM @ _turn(pitch, 1) @ _turn(roll, 0)
    p_WE = x[:, np.newaxis, :3]
    p_WJ = p_WE + FINGER_LENGTH * R_WE[:, np.newaxis, :, 2]
    body = p_WJ + np.einsum("kij,pj->kpi", R_WM @ _turn(-lean, 1), _ON_BODY)
    fingers = p_WE + np.einsum("kij,pj->kpi", R_WE, _ON_FINGERS)
    return np.concatenate([body, fingers], axis=1)


def _turn(angle: Array, axis: int) -> Array:
    """Return rotations about a coordinate axis, shape (k, 3, 3)."""
    found = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[:, axis, axis] = 1.0
    found[:, i, i] = found[:, j, j] = np.cos(angle)
    found[:, j, i] = np.sin(angle)
    found[:, i, j] = -found[:, j, i]
    return found
