"""A serial arm with six or more revolute joints, as the work cell simulates and controls it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

ElementTree.register_namespace("drake", "http://drake.mit.edu")

_ITERATIONS: Final = 100
_LARGEST_STEP: Final = 0.3  # rad, of a joint in one iteration
_PRECISION: Final = 1e-11  # m and rad


class FlangeState(NamedTuple):
    """Where the flange is, and how it moves with the joints; n of them."""

    R: Array  # R_BF, shape (3, 3)
    p: Array  # p_BF, m, shape (3,)
    J: Array  # J_V_BF in the base frame, (6, n): rad/s above m/s, of the flange's origin


@dataclass(frozen=True, kw_only=True)
class SerialArm:
    """An arm from its base, which is welded to the world, to its flange, which carries the tool.

    Conventions of its URDF: nothing collides, the file does not fix the base, and every joint
    that can move is one of ``joint_names``, with an actuator ``<joint>_motor``, in this order.

    Attributes:
        name: What to call it.
        urdf: The text of the URDF, not its path.
        base: The base's link.
        flange: The flange's link.
        joint_names: The joints in the order of q, n of them, all revolute.
        lower_limits: Of the joints' positions, rad, n of them.
        upper_limits: Likewise.
        torque_limits: Of the motors at the joints, N m, n of them.
        rotor_inertia: Of the motors as seen at the joints, kg m^2, n of them; the URDF's own
            don't count.
        dry_friction: Coulomb's, of each joint, N m, n of them.
        kinematics: Joint positions, rad, shape (n,), to where the flange is.
        posture: Near which the rest posture is sought, rad, n of them; None: nothing is known.
        base_height: m, of the base frame above the arm's foot.
    """

    name: str
    urdf: str
    base: str
    flange: str
    joint_names: tuple[str, ...]
    lower_limits: tuple[float, ...]
    upper_limits: tuple[float, ...]
    torque_limits: tuple[float, ...]
    rotor_inertia: tuple[float, ...]
    dry_friction: tuple[float, ...]
    kinematics: Callable[[Array], FlangeState] = field(compare=False)
    posture: tuple[float, ...] | None = None
    base_height: float = 0.0

    @property
    def num_joints(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    def within_limits(self, q: Array) -> bool:
        """Return whether n joint positions, rad, are inside the joints' ranges."""
        return bool(np.less(self.lower_limits, q).all() and np.less(q, self.upper_limits).all())

    @property
    def ranges(self) -> str:
        """The joints' ranges, for a message."""
        return f"between {_rounded(self.lower_limits)} and {_rounded(self.upper_limits)} rad"

    def joint_positions(self, R: Array, p: Array, near: Array) -> Array:
        """Return joint positions, rad, shape (n,), that put the flange at a pose.

        Of several solutions, or of a redundant arm's family of them, it is the one that Newton's
        method with the pseudo-inverse of the Jacobian comes to from ``near``.

        Args:
            R: Rotation R_BF, shape (3, 3).
            p: Position p_BF, m, shape (3,).
            near: Joint positions from which to start, rad, shape (n,).

        Raises:
            ParameterError: The pose is out of reach from there, or within the joints' ranges.
        """
        q: Array = np.array(near, dtype=np.float64)
        if not (np.isfinite(R).all() and np.isfinite(p).all() and np.isfinite(q).all()):
            raise ParameterError("flange pose", (R.tolist(), p.tolist()), "finite numbers")
        for _ in range(_ITERATIONS):
            now = self.kinematics(q)
            error = np.concatenate([_rotation_vector(R @ now.R.T), p - now.p])
            if np.abs(error).max() < _PRECISION:
                break
            step = np.linalg.pinv(now.J, rcond=1e-6) @ error
            q = q + step * min(1.0, _LARGEST_STEP / float(np.abs(step).max()))
        else:
            raise ParameterError(
                "flange position", _rounded(p), f"within reach from {_rounded(near)} rad"
            )
        if not self.within_limits(q):
            raise ParameterError("joint positions of the pose", _rounded(q), self.ranges)
        return q

    def urdf_text(self, mass_scale: float = 1.0) -> str:
        """Return the URDF, every link's mass and inertia multiplied by a number > 0."""
        if not 0 < mass_scale < np.inf:
            raise ParameterError("mass_scale", mass_scale, "a finite number > 0")
        if mass_scale == 1.0:
            return self.urdf
        root = ElementTree.fromstring(self.urdf)
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


def _rounded(values: Array | tuple[float, ...]) -> tuple[float, ...]:
    return tuple(round(float(value), 3) for value in values)
