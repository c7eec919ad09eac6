"""A compliant wrist or gripper: six springs at its centre, at the tool's tip or above it.

Three prismatic joints along the axes of what carries it, then three revolute ones about x, y and
z, whose origin is the centre. Springs and dampers act on the joints as torques and forces. At the
tip the centre is remote: a force there moves the tip and does not turn it.

In a plant with the step h they are implicit: what acts is the law at the step's end,

    f = K (q_D + h v_D - q - h v) + D (v_D - v) = K (q_D - q) + B (v_D - v),  B = D + h K,

with positions from the step's begin and v from its end. Drake's actuation takes v_0, the v of the
begin: the rest, ``B (v_0 - v)``, is what an inertia ``h B`` of the actuators does in a step. It
adds none to the tool, and no spring is too stiff for the step, whatever the inertia couples.
"""

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix, cos, sin
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    ModelInstanceIndex,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)

from chamfer.models.validation import (
    ParameterError,
    require_between,
    require_not_negative,
    require_positive,
)

Array = NDArray[np.float64]

SIZE: Final = 6  # of displacements and wrenches, angular above linear
# Joints from what carries the wrist to the tool, and the place of each in a displacement.
_JOINTS: Final = (("x", 3), ("y", 4), ("z", 5), ("rx", 0), ("ry", 1), ("rz", 2))
ORDER: Final = tuple(index for _, index in _JOINTS)
_FARTHEST: Final = 1.0  # m, of a centre from the tip: beyond it the unit is wrong


@dataclass(frozen=True, kw_only=True)
class WristParams:
    """Parameters of the wrist and of its load; the paper prints none."""

    stiffness: tuple[float, ...] = (20.0, 20.0, 20.0, 2e4, 2e4, 2e4)
    # N m/rad and N/m, about and along x, y, z, at the centre; assumed
    centre: float = 0.0  # m, above the tip; assumed
    damping_ratio: float = 0.7  # of the tool on each spring; assumed
    mass: float = 0.3  # kg, of fingers and plug; assumed
    inertia: float = 4e-4  # kg m^2, about every axis through the tip; assumed
    axial_inertia: float | None = None  # kg m^2, about z; None: as about the others
    centre_of_mass: float = 0.02  # m, above the tip; assumed

    def __post_init__(self) -> None:
        require_positive(self, "mass", "inertia", "damping_ratio")
        require_not_negative(self, "centre_of_mass")
        require_between(self, -_FARTHEST, _FARTHEST, "centre", unit="m")
        if len(self.stiffness) != SIZE or not all(0 < k < math.inf for k in self.stiffness):
            raise ParameterError("stiffness", self.stiffness, "six finite numbers > 0")
        own = self.mass * self.centre_of_mass**2
        if self.axial_inertia is None:
            # So that a body can have what is left.
            if not self.inertia > 2 * own:
                allowed = f"more than 2 mass arm^2, {2 * own:.3g}"
                raise ParameterError("inertia", self.inertia, allowed)
        elif not 0 < self.axial_inertia <= 2 * (self.inertia - own):
            allowed = f"> 0, and at most 2 (inertia - mass arm^2), {2 * (self.inertia - own):.3g}"
            raise ParameterError("axial_inertia", self.axial_inertia, allowed)

    @property
    def about_z(self) -> float:
        """Inertia about the wrist's axis, kg m^2."""
        return self.inertia if self.axial_inertia is None else self.axial_inertia

    @property
    def damping(self) -> tuple[float, ...]:
        """N m s/rad and N s/m, in the order of the stiffness."""
        arm, own = self.centre_of_mass - self.centre, self.centre_of_mass
        across = self.inertia + self.mass * (arm**2 - own**2)  # about the centre
        inertia = (across, across, self.about_z) + (self.mass,) * 3
        return tuple(
            2 * self.damping_ratio * math.sqrt(k * m)
            for k, m in zip(self.stiffness, inertia, strict=True)
        )

    @property
    def compliance(self) -> Array:
        """Compliance of the tip to a wrench there, rad above m by N m above N, shape (6, 6)."""
        to_tip = np.eye(SIZE)
        to_tip[3:5, :2] = [[0.0, -self.centre], [self.centre, 0.0]]
        matrix: Array = (to_tip / np.array(self.stiffness)) @ to_tip.T
        return matrix

    @property
    def tip_stiffness(self) -> tuple[float, ...]:
        """Stiffness at the tip that each axis of accommodation is damped against, N m/rad, N/m.

        Seen from there a lateral spring at the height c opposes way x and turn a together,

            k (x + c a)^2 <= 2 k x^2 + 2 k c^2 a^2.

        With half of that on each axis, a damping with which each by itself is monotone, kappa of
        1/4 at most, has all six at 1/2 at most together: stable with a tip that nothing can move.
        """
        rx, ry, rz, x, y, z = self.stiffness
        arm = self.centre**2
        return (max(rx, rx / 2 + arm * y), max(ry, ry / 2 + arm * x), rz, x, y, z)

    @property
    def law(self) -> Array:
        """Matrix from the joints' errors, positions above rates, to forces, shape (6, 12)."""
        return self.implicit_law(0.0)

    def implicit_law(self, step: float) -> Array:
        """Return that matrix for a plant with a step, s; errors of rates count for more."""
        stiffness = np.array(self.stiffness)
        rates = np.array(self.damping) + step * stiffness
        order = list(ORDER)
        return np.asarray(np.hstack([np.diag(stiffness[order]), np.diag(rates[order])]))


class Wrist(NamedTuple):
    """The parts added to a plant."""

    instance: ModelInstanceIndex
    body: RigidBody  # which the wrist holds, its frame at the tip


def add_wrist(plant: MultibodyPlant, carrier: Frame, params: WristParams) -> Wrist:
    """Add a wrist to a plant that has a step; its weight is assumed to be compensated.

    At rest the tip's frame coincides with the carrier's. The joints' positions are a displacement
    of the centre, :func:`moved`. The actuation is :meth:`WristParams.implicit_law` of what they
    lack.
    """
    instance = plant.AddModelInstance("wrist")
    plant.set_gravity_enabled(instance, False)
    p = np.array([0.0, 0.0, params.centre_of_mass])
    # The given inertia is about the tip; off it, only the axes across grow.
    about = params.inertia - params.mass * params.centre_of_mass**2
    inertia = SpatialInertia.MakeFromCentralInertia(
        params.mass, p, RotationalInertia(about, about, params.about_z)
    )
    step = plant.time_step()
    added = step * np.diag(params.implicit_law(step)[:, SIZE:])
    parent, body = _above(plant, carrier, params.centre, "centre at rest"), plant.world_body()
    for (name, index), given in zip(_JOINTS, added.tolist(), strict=True):
        last = index == ORDER[-1]
        body = plant.AddRigidBody(
            "tool" if last else f"wrist_{name}",
            instance,
            inertia if last else SpatialInertia.Zero(),
        )
        axis = np.eye(3)[index % 3]
        kind = RevoluteJoint if index < 3 else PrismaticJoint
        child = body.body_frame()
        if last:
            child = _above(plant, child, params.centre, "centre")
        joint = plant.AddJoint(kind(name, parent, child, axis))
        plant.AddJointActuator(name, joint).set_default_rotor_inertia(given)
        parent = body.body_frame()
    return Wrist(instance, body)


def _above(plant: MultibodyPlant, frame: Frame, height: float, name: str) -> Frame:
    if not height:
        return frame
    return plant.AddFrame(FixedOffsetFrame(name, frame, RigidTransform([0.0, 0.0, height])))


def along_tool(displacement: Any) -> Array:
    """Return the tool's z in the carrier's frame, shape (3,), numbers or expressions."""
    rx, ry = displacement[:2]
    return np.array([sin(ry), -sin(rx) * cos(ry), cos(rx) * cos(ry)])


def moved(displacement: Any, height: float) -> Array:
    """Return the displacement of the point that is higher in the tool, m, likewise, (6,)."""
    off = along_tool(displacement) - np.array([0.0, 0.0, 1.0])
    return np.concatenate([displacement[:3], displacement[3:] + height * off])


def in_joint_order(size: int = 1) -> Array:
    """Return the matrix that puts ``size`` consecutive displacements in joint order."""
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


def tip_axes(rx: float, ry: float, rz: float) -> Array:
    """Return the axes of :func:`tip_pose`, shape (3, 3), of its turns, rad."""
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(one), math.sin(one)) for one in (rx, ry, rz))
    return np.array(
        [
            [cy * cz, -cy * sz, sy],
            [cx * sz + sx * sy * cz, cx * cz - sx * sy * sz, -sx * cy],
            [sx * sz - cx * sy * cz, sx * cz + cx * sy * sz, cx * cy],
        ]
    )


def tip_turns(R: Array) -> tuple[float, float, float]:
    """Return the turns of :func:`tip_pose`, rad, that make a tip's axes in the carrier's frame."""
    return (
        math.atan2(-R[1, 2], R[2, 2]),
        math.asin(max(-1.0, min(1.0, R[0, 2]))),
        math.atan2(-R[0, 1], R[0, 0]),
    )


def tip_displacement(X: RigidTransform) -> Array:
    """Return the displacement of a tip's pose in the carrier's frame: :func:`tip_pose` undone."""
    return np.array([*tip_turns(X.rotation().matrix()), *X.translation()])
