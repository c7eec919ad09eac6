"""The planar two-link arm of the hybrid-control simulations.

Thesis, section 2.2 and Fig. 2-3: two links, each 1 unit long, turn about z in the x-y plane, the
first about the origin. Masses are not printed; those in the URDF are of uniform rods of 2 kg and
1 kg, and the published results hardly depend on them.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.arm import ELBOW_SIGN, Arm, Elbow
from chamfer.models.validation import ParameterError

LENGTH_1 = 1.0  # m, Fig. 2-3
LENGTH_2 = 1.0  # m, Fig. 2-3

# Cosines this close to 1 differ from it by the rounding of the endpoint: the elbow is straight.
_STRAIGHT = 1e-12


def endpoint(q: NDArray[Any]) -> NDArray[Any]:
    """Return the tip (x, y), m, of joint positions q (rad), shape (2,)."""
    q1, q12 = q[0], q[0] + q[1]
    return np.array(
        [
            LENGTH_1 * np.cos(q1) + LENGTH_2 * np.cos(q12),
            LENGTH_1 * np.sin(q1) + LENGTH_2 * np.sin(q12),
        ]
    )


def jacobian(q: NDArray[Any]) -> NDArray[Any]:
    """Return d(x, y)/dq, shape (2, 2), m/rad; its determinant is l1 l2 sin(q2)."""
    q1, q12 = q[0], q[0] + q[1]
    x2, y2 = LENGTH_2 * np.cos(q12), LENGTH_2 * np.sin(q12)
    return np.array(((-LENGTH_1 * np.sin(q1) - y2, -y2), (LENGTH_1 * np.cos(q1) + x2, x2)))


def joint_positions(x: NDArray[Any], elbow: Elbow) -> NDArray[Any]:
    """Return the joint positions, rad, that put the tip at x, m, shape (2,), with q2's sign."""
    along, across = x.tolist()
    q = two_link_angles(along, across, (LENGTH_1, LENGTH_2), elbow, x, "the base")
    return np.array(q)


def two_link_angles(
    along: float,
    across: float,
    lengths: tuple[float, float],
    elbow: Elbow,
    x: NDArray[Any],
    pivot: str,
) -> tuple[float, float]:
    """Return the two angles, rad, in [-pi, pi], that put the end of two links at a point.

    The triangle inside every arm of this package. ``along`` and ``across``, m, are the point's
    coordinates from the first joint, ``across`` the way in which the first angle grows from 0;
    ``elbow`` is the sign of the second angle. x, asked for, and the pivot are for the message.

    Raises:
        ParameterError: The point is out of reach or at the edge of it, or x is not finite.
    """
    l1, l2 = lengths
    c2 = (along * along + across * across - l1 * l1 - l2 * l2) / (2 * l1 * l2)
    if not abs(c2) < 1 - _STRAIGHT:  # also NaN
        allowed = f"more than {abs(l1 - l2):g} m and less than {l1 + l2:g} m from {pivot}"
        raise ParameterError("endpoint", tuple(x.tolist()), allowed)
    s2 = ELBOW_SIGN[elbow] * math.sqrt((1 - c2) * (1 + c2))
    q1 = math.atan2(across, along) - math.atan2(l2 * s2, l1 + l2 * c2)
    return wrapped(q1), math.atan2(s2, c2)


def wrapped(angle: float) -> float:
    """Return the angle, rad, brought into [-pi, pi] by whole turns."""
    return math.remainder(angle, 2 * math.pi)


PLANAR_TWO_LINK = Arm(
    name="planar two-link arm",
    urdf=Path(__file__).with_name("planar_two_link.urdf"),
    joint_names=("joint_1", "joint_2"),
    coordinates=("x", "y"),
    coordinate_units=("m", "m"),
    endpoint=endpoint,
    jacobian=jacobian,
    joint_positions=joint_positions,
    assumed=True,
    note="unit links of Fig. 2-3; masses are not published: uniform rods of 2 kg and 1 kg",
)
