"""Interface of all arms: the kinematics that a controller uses, and joint friction."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Elbow = Literal["negative", "positive"]  # sign of the elbow joint's angle

ELBOW_SIGN: dict[Elbow, float] = {"negative": -1.0, "positive": 1.0}


@dataclass(frozen=True, kw_only=True)
class Kinematics:
    """A controller's model of a manipulator with as many joints as endpoint coordinates.

    Its functions take complex q, for complex-step derivatives; those of the built-in arms are
    compiled too.
    """

    name: str  # its name in a sentence, "planar two-link arm"
    joint_names: tuple[str, ...]  # in the order of q, n of them; rad, or m if prismatic
    coordinates: tuple[str, ...]  # of the endpoint vector, m = n of them
    coordinate_units: tuple[str, ...]
    endpoint: Callable[[NDArray[Any]], NDArray[Any]]  # q, shape (n,), to x, shape (m,)
    jacobian: Callable[[NDArray[Any]], NDArray[Any]]  # q to dx/dq, shape (m, n)
    prismatic: tuple[str, ...] = ()  # names of the joints that slide

    @property
    def num_joints(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Units of q, joint by joint."""
        return tuple("m" if name in self.prismatic else "rad" for name in self.joint_names)

    @property
    def num_coordinates(self) -> int:
        """Number of endpoint coordinates m."""
        return len(self.coordinates)


@dataclass(frozen=True, kw_only=True)
class Arm(Kinematics):
    """A serial arm: kinematics, both ways, and a URDF.

    Conventions of the URDF: the link ``base`` carries the world's axes and is not fixed by the
    file; the code that loads it welds ``base`` to the world. The origin of the link ``endpoint``
    is the tip. The joints, named in ``joint_names``, carry no limits, damping or friction. Each
    has its own actuator, ``<joint>_motor``, in the joints' order, with the rotor inertia as seen
    at the joint.
    """

    urdf: Path  # with links, inertias and visual geometry
    joint_positions: Callable[[NDArray[Any], Elbow], NDArray[Any]]
    # x, shape (m,), and the sign of the elbow joint to q, shape (n,); refuses an x that is out of
    # reach or only reached in a singular pose
    assumed: bool  # True: masses and inertias are not published but plausible guesses
    note: str  # where masses and lengths come from


@dataclass(frozen=True, kw_only=True)
class JointFrictionParams:
    """Friction of n joints; N m for revolute joints, N for prismatic ones.

    A joint at rest holds up to ``breakaway`` times its Coulomb friction. Once it moves at speed w
    the friction falls off, ``coulomb * (1 + (breakaway - 1) exp(-(w / stribeck)^2))``, and
    ``viscous * w`` is added.
    """

    coulomb: tuple[float, ...]  # N m or N, Coulomb's, of each joint
    breakaway: float = 1.5  # static over Coulomb friction
    stribeck: float = 0.02  # rad/s or m/s, speed over which the breakaway fades
    viscous: tuple[float, ...]  # N m s/rad or N s/m, of each joint

    def __post_init__(self) -> None:
        for name in ("coulomb", "viscous"):
            values = getattr(self, name)
            if not values or not all(0 <= value < np.inf for value in values):
                raise ParameterError(name, values, "finite numbers >= 0, one a joint")
        if len(self.coulomb) != len(self.viscous):
            raise ParameterError("viscous", self.viscous, f"{len(self.coulomb)} numbers")
        if not 1 <= self.breakaway < np.inf:
            raise ParameterError("breakaway", self.breakaway, "a finite number >= 1")
        if not 0 < self.stribeck < np.inf:
            raise ParameterError("stribeck", self.stribeck, "a finite number > 0")
