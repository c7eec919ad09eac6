"""A compliant wrist or gripper: six springs about the tip of the tool, a remote centre.

Three prismatic joints along the axes of what carries it, then three revolute ones about x, y and
z, whose origin is the tool's tip. Springs and dampers act on the joints as torques and forces.

In a plant with the step h they are implicit: what acts is the law at the step's end,

    f = K (q_D + h v_D - q - h v) + D (v_D - v) = K (q_D - q) + B (v_D - v),  B = D + h K,

with positions from the step's begin and v from its end. Drake's actuation takes v_0, the v of the
begin: the rest, ``B (v_0 - v)``, is what an inertia ``h B`` of the actuators does in a step. It
adds none to the tool, and no spring is too stiff for the step, whatever the inertia couples.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    Frame,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)

from chamfer.models.validation import ParameterError, require_not_negative, require_positive

Array = NDArray[np.float64]

SIZE: Final = 6  # of displacements and wrenches, angular above linear
# Joints from what carries the wrist to the tool, and the place of each in a displacement.
_JOINTS: Final = (("x", 3), ("y", 4), ("z", 5), ("rx", 0), ("ry", 1), ("rz", 2))
ORDER: Final = tuple(index for _, index in _JOINTS)


@dataclass(frozen=True, kw_only=True)
class WristParams:
    """Parameters of the wrist and of what it carries; the paper prints none."""

    stiffness: tuple[float, ...] = (20.0, 20.0, 20.0, 2e4, 2e4, 2e4)
    # N m/rad and N/m, about and along x, y, z; assumed
    damping_ratio: float = 0.7  # of the tool on each spring; assumed
    mass: float = 0.3  # kg, of fingers and plug; assumed
    inertia: float = 4e-4  # kg m^2, about every axis through the tip; assumed
    centre_of_mass: float = 0.02  # m, above the tip; assumed

    def __post_init__(self) -> None:
        require_positive(self, "mass", "inertia", "damping_ratio")
        require_not_negative(self, "centre_of_mass")
        if len(self.stiffness) != SIZE or not all(0 < k < math.inf for k in self.stiffness):
            raise ParameterError("stiffness", self.stiffness, "six finite numbers > 0")
        least = 2 * self.mass * self.centre_of_mass**2  # so that a body can have what is left
        if not self.inertia > least:
            raise ParameterError("inertia", self.inertia, f"more than 2 mass arm^2, {least:.3g}")

    @property
    def damping(self) -> tuple[float, ...]:
        """N m s/rad and N s/m, in the order of the stiffness."""
        inertia = (self.inertia,) * 3 + (self.mass,) * 3
        return tuple(
            2 * self.damping_ratio * math.sqrt(k * m)
            for k, m in zip(self.stiffness, inertia, strict=True)
        )

    @property
    def law(self) -> Array:
        """Forces of the joints of what the joints lack, positions above rates, shape (6, 12)."""
        return self.implicit_law(0.0)

    def implicit_law(self, step: float) -> Array:
        """Return that of a plant with a step, s; a lack of rates counts for more."""
        stiffness = np.array(self.stiffness)
        rates = np.array(self.damping) + step * stiffness
        order = list(ORDER)
        return np.asarray(np.hstack([np.diag(stiffness[order]), np.diag(rates[order])]))


class Wrist(NamedTuple):
    """What was added to a plant."""

    instance: ModelInstanceIndex
    body: RigidBody  # which the wrist holds, its frame at the tip


def add_wrist(plant: MultibodyPlant, carrier: Frame, params: WristParams) -> Wrist:
    """Add a wrist to a plant that has a step; weight is taken to be compensated.

    At rest the tip's frame coincides with the carrier's. The actuation is
    :meth:`WristParams.implicit_law` of what the joints lack.
    """
    instance = plant.AddModelInstance("wrist")
    plant.set_gravity_enabled(instance, False)
    p = np.array([0.0, 0.0, params.centre_of_mass])
    # The given inertia is about the tip; off it, only the axes across grow.
    about = params.inertia - params.mass * params.centre_of_mass**2
    inertia = SpatialInertia.MakeFromCentralInertia(
        params.mass, p, RotationalInertia(about, about, params.inertia)
    )
    step = plant.time_step()
    added = step * np.diag(params.implicit_law(step)[:, SIZE:])
    parent, body = carrier, plant.world_body()
    for (name, index), given in zip(_JOINTS, added.tolist(), strict=True):
        last = index == ORDER[-1]
        body = plant.AddRigidBody(
            "tool" if last else f"wrist_{name}",
            instance,
            inertia if last else SpatialInertia.Zero(),
        )
        axis = np.eye(3)[index % 3]
        kind = RevoluteJoint if index < 3 else PrismaticJoint
        joint = plant.AddJoint(kind(name, parent, body.body_frame(), axis))
        plant.AddJointActuator(name, joint).set_default_rotor_inertia(given)
        parent = body.body_frame()
    return Wrist(instance, body)


def in_joint_order(size: int = 1) -> Array:
    """Return the matrix that puts ``size`` displacements, one behind the other, in joint order."""
    matrix: Array = np.asarray(np.kron(np.eye(size), np.eye(SIZE)[list(ORDER)]), np.float64)
    return matrix


def tip_pose(displacement: Array) -> RigidTransform:
    """Return the tip's pose in the carrier's frame of a displacement, rad above m, shape (6,)."""
    rx, ry, rz, *p = displacement.tolist()
    R = (
        RotationMatrix.MakeXRotation(rx)
        @ RotationMatrix.MakeYRotation(ry)
        @ RotationMatrix.MakeZRotation(rz)
    )
    return RigidTransform(R, p)


def tip_displacement(X: RigidTransform) -> Array:
    """Return the displacement of a tip's pose in the carrier's frame: :func:`tip_pose` undone."""
    R = X.rotation().matrix()
    turn = (
        math.atan2(-R[1, 2], R[2, 2]),
        math.asin(max(-1.0, min(1.0, R[0, 2]))),
        math.atan2(-R[0, 1], R[0, 0]),
    )
    return np.array([*turn, *X.translation()])
