"""The Puma 250 with its wrist held: three joints, a tip at the load cell.

Thesis, Fig. 3-2 and appendix A.1. The waist turns about the vertical, shoulder and elbow about a
horizontal axis; the tip lies ``l2 + l4`` beside the vertical plane through the waist. No masses
are published: those in the URDF are assumed (6.5 kg moving), and so are the rotor inertias.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.arm import Arm, Elbow
from chamfer.models.arms.planar_two_link import two_link_angles, wrapped
from chamfer.models.validation import ParameterError

HEIGHT = 0.3429  # m, l1 of Fig. A-1, from the floor to the shoulder
SHOULDER_OFFSET = 0.0660  # m, l2
UPPER_ARM = 0.2032  # m, l3
ELBOW_OFFSET = -0.0550  # m, l4, back towards the waist's plane
FOREARM = 0.3400  # m, l5, with the load cell

OFFSET = SHOULDER_OFFSET + ELBOW_OFFSET  # m, as it appears in

# A tip that is nearer to its closest approach to the waist's axis leaves q1 to rounding.
_SMALLEST_RADIUS = 1e-6  # m


def endpoint(q: NDArray[Any]) -> NDArray[Any]:
    """Return the tip (x, y, z), m, of joint positions q (rad), shape (3,); eq. (A-1)."""
    q2, q23 = q[1], q[1] + q[2]
    c1, s1 = np.cos(q[0]), np.sin(q[0])
    r = FOREARM * np.cos(q23) + UPPER_ARM * np.cos(q2)
    z = FOREARM * np.sin(q23) + UPPER_ARM * np.sin(q2)
    return np.array([r * c1 + OFFSET * s1, r * s1 - OFFSET * c1, HEIGHT + z])


def jacobian(q: NDArray[Any]) -> NDArray[Any]:
    """Return d(x, y, z)/dq, shape (3, 3), m/rad; eq. (A-3).

    Its determinant is ``-l3 l5 sin(q3) r`` with ``r = l5 cos(q2 + q3) + l3 cos(q2)``.
    """
    q2, q23 = q[1], q[1] + q[2]
    c1, s1 = np.cos(q[0]), np.sin(q[0])
    r3, z3 = FOREARM * np.cos(q23), FOREARM * np.sin(q23)
    r, z = r3 + UPPER_ARM * np.cos(q2), z3 + UPPER_ARM * np.sin(q2)
    return np.array(
        (
            (-s1 * r + OFFSET * c1, -c1 * z, -c1 * z3),
            (c1 * r + OFFSET * s1, -s1 * z, -s1 * z3),
            (0.0, r, r3),
        )
    )


def joint_positions(x: NDArray[Any], elbow: Elbow) -> NDArray[Any]:
    """Return the joint positions, rad, that put the tip at x, m, with the waist facing it (r > 0).

    ``elbow`` is the sign of q3.
    """
    px, py, pz = x.tolist()
    radius_squared = px * px + py * py - OFFSET * OFFSET
    if not radius_squared > _SMALLEST_RADIUS**2:  # also NaN
        allowed = f"more than {OFFSET:.3g} m from the waist's axis"
        raise ParameterError("endpoint", tuple(x.tolist()), allowed)
    r = math.sqrt(radius_squared)
    q1 = wrapped(math.atan2(py, px) + math.atan2(OFFSET, r))
    links = (UPPER_ARM, FOREARM)
    q2, q3 = two_link_angles(r, pz - HEIGHT, links, elbow, x, "the shoulder, in its plane")
    return np.array([q1, q2, q3])


PUMA_250 = Arm(
    name="Puma 250",
    urdf=Path(__file__).with_name("puma_250.urdf"),
    joint_names=("joint_1", "joint_2", "joint_3"),
    coordinates=("x", "y", "z"),
    coordinate_units=("m", "m", "m"),
    endpoint=endpoint,
    jacobian=jacobian,
    joint_positions=joint_positions,
    assumed=True,
    note="lengths of appendix A.1; masses and rotor inertias are not published: assumed",
)
