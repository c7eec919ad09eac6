"""The Adept One, a SCARA arm: two turns in the plane, a vertical quill, a turn of the tool.

Thesis, Fig. 3-10 and appendix A.2. It prints ``l2 = 0.03775 m``, a misprint: the arm would reach
no further than 0.4627 m. Here l2 is 0.375 m, for the 0.800 m that the arm is known to reach.
Masses are not published: those in the URDF are assumed, of a size for which the experiments of
chapter 3 come out. The 6 kg that move vertically are a payload of 5 kg and 1 kg of quill.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.arm import Arm, Elbow
from chamfer.models.arms.planar_two_link import two_link_angles
from chamfer.models.validation import ParameterError

LENGTH_1 = 0.425  # m, l1 of Fig. A-2
LENGTH_2 = 0.375  # m, l2 of Fig. A-2, there misprinted as 0.03775
HEIGHT = 0.877  # m, h0 of Fig. A-2


def endpoint(q: NDArray[Any]) -> NDArray[Any]:
    """Return the tip (x, y, z, phi), m and rad, of q = (q1, q2, d3, q4); eq. (A-4).

    d3 is in m and counts downwards, the others are in rad. phi is not wrapped.
    """
    q1, q12 = q[0], q[0] + q[1]
    return np.array(
        [
            LENGTH_1 * np.cos(q1) + LENGTH_2 * np.cos(q12),
            LENGTH_1 * np.sin(q1) + LENGTH_2 * np.sin(q12),
            HEIGHT - q[2],
            q12 + q[3],
        ]
    )


def jacobian(q: NDArray[Any]) -> NDArray[Any]:
    """Return d(x, y, z, phi)/dq, shape (4, 4); eq. (A-6); its determinant is -l1 l2 sin(q2)."""
    q1, q12 = q[0], q[0] + q[1]
    x2, y2 = LENGTH_2 * np.cos(q12), LENGTH_2 * np.sin(q12)
    return np.array(
        (
            (-LENGTH_1 * np.sin(q1) - y2, -y2, 0.0, 0.0),
            (LENGTH_1 * np.cos(q1) + x2, x2, 0.0, 0.0),
            (0.0, 0.0, -1.0, 0.0),
            (1.0, 1.0, 0.0, 1.0),
        )
    )


def joint_positions(x: NDArray[Any], elbow: Elbow) -> NDArray[Any]:
    """Return q = (q1, q2, d3, q4), rad and m, that puts the tip at x = (x, y, z, phi), shape (4,).

    ``elbow`` is the sign of q2. q4 is not wrapped: phi is met without whole turns between.
    """
    px, py, pz, phi = x.tolist()
    if not np.isfinite(x).all():
        raise ParameterError("endpoint", tuple(x.tolist()), "finite numbers")
    q1, q2 = two_link_angles(px, py, (LENGTH_1, LENGTH_2), elbow, x, "the base's axis")
    return np.array([q1, q2, HEIGHT - pz, phi - q1 - q2])


ADEPT_ONE = Arm(
    name="Adept One",
    urdf=Path(__file__).with_name("adept_one.urdf"),
    joint_names=("joint_1", "joint_2", "joint_3", "joint_4"),
    prismatic=("joint_3",),
    coordinates=("x", "y", "z", "phi"),
    coordinate_units=("m", "m", "m", "rad"),
    endpoint=endpoint,
    jacobian=jacobian,
    joint_positions=joint_positions,
    assumed=True,
    note="lengths of appendix A.2 with l2 = 0.375 m for a misprint; masses are not published",
)
