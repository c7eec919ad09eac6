"""A serial arm with six or more revolute joints, for the work cell."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable
from pydrake.solvers import Solve

from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

ElementTree.register_namespace("drake", "http://drake.mit.edu")

_ITERATIONS: Final = 100
_LARGEST_STEP: Final = 0.3  # rad, of a joint in one iteration
_PRECISION: Final = 1e-11  # m and rad


class FlangeState(NamedTuple):
    """Pose of the flange, and its Jacobian for n joints."""

    R: Array  # R_BF, shape (3, 3)
    p: Array  # p_BF, m, shape (3,)
    J: Array  # J_V_BF in the base frame, (6, n): rad/s above m/s, of the flange's origin


@dataclass(frozen=True, kw_only=True)
class SerialArm:
    """An arm from its base, which is welded to the world, to its flange, which carries the tool.

    Conventions of its URDF: nothing collides, the file does not fix the base, and every joint
    that can move is one of ``joint_names``, with an actuator ``<joint>_motor``, in this order.
    """

    name: str
    urdf: str  # its text, not its path
    base: str  # link
    flange: str  # link
    joint_names: tuple[str, ...]  # in the order of q, n of them, all revolute
    lower_limits: tuple[float, ...]  # rad, n of them
    upper_limits: tuple[float, ...]
    torque_limits: tuple[float, ...]  # N m, of the motors at the joints, n of them
    rotor_inertia: tuple[float, ...]  # kg m^2, as seen at the joints; the URDF's don't count
    dry_friction: tuple[float, ...]  # N m, Coulomb's, n of them, mean of both directions
    kinematics: Callable[[Array], FlangeState] = field(compare=False)  # of q, rad, shape (n,)
    posture: tuple[float, ...] | None = None
    # rad, near which the rest posture is sought; None: nothing is known
    base_height: float = 0.0  # m, of the base frame above the arm's foot
    friction_asymmetry: tuple[float, ...] | None = None
    # dry friction forward less backward, over their sum, n from -1 to 1; None: as much
    joint_damping: tuple[float, ...] | None = None
    # N m s/rad, viscous, n of them; None: the URDF's

    @property
    def num_joints(self) -> int:
        """Number of joints n."""
        return len(self.joint_names)

    @property
    def friction_bias(self) -> Array:
        """Constant torque against turning forward, N m, shape (n,).

        Friction of c forward and d backward is exactly one of (c + d) / 2 either way and the
        constant (c - d) / 2, also at rest, where it is anything from -d to c.
        """
        asymmetry = self.friction_asymmetry or (0.0,) * self.num_joints
        return np.multiply(self.dry_friction, asymmetry)

    def within_limits(self, q: Array) -> bool:
        """Return whether n joint positions, rad, are inside the joints' ranges."""
        return bool(np.less(self.lower_limits, q).all() and np.less(q, self.upper_limits).all())

    @property
    def ranges(self) -> str:
        """The joints' ranges, for a message."""
        return f"between {_rounded(self.lower_limits)} and {_rounded(self.upper_limits)} rad"

    def joint_positions(self, R: Array, p: Array, near: Array) -> Array:
        """Return joint positions, rad, shape (n,), that put the flange at a pose R_BF, p_BF (m).

        Of several solutions, or of a redundant arm's family of them, it is the one that Newton's
        method with the pseudo-inverse of the Jacobian comes to from ``near``, rad, shape (n,).

        Raises:
            ParameterError: The pose is out of reach from there, or within the joints' ranges.
        """
        q: Array = np.array(near, dtype=np.float64)
        if not (np.isfinite(R).all() and np.isfinite(p).all() and np.isfinite(q).all()):
            raise ParameterError("flange pose", (R.tolist(), p.tolist()), "finite numbers")
        for _ in range(_ITERATIONS):
            now = self.kinematics(q)
            error = np.concatenate([rotation_vector(R @ now.R.T), p - now.p])
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


def rotation_vector(R: Array) -> Array:
    """Return the axis times the angle, rad, of a rotation by less than pi."""
    twice_sine = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    length = float(np.linalg.norm(twice_sine))
    angle = np.arctan2(length, np.trace(R) - 1)
    vector: Array = twice_sine * (angle / length if length > 1e-9 else 0.5)
    return vector


def _rounded(values: Array | tuple[float, ...]) -> tuple[float, ...]:
    return tuple(round(float(value), 3) for value in values)


class PlantKinematics:
    """Pose of the flange of a URDF's arm in its base frame; called with joint positions."""

    def __init__(self, urdf: str, base: str, flange: str) -> None:
        self.plant = arm_alone(urdf, base)
        self.context = self.plant.CreateDefaultContext()
        self.flange = self.plant.GetFrameByName(flange)
        self._origin = np.zeros(3)

    def __call__(self, q: Array) -> FlangeState:
        """Return the flange's pose at joint positions q, rad, shape (n,)."""
        plant, context, base = self.plant, self.context, self.plant.world_frame()
        plant.SetPositions(context, q)
        X_BF = self.flange.CalcPoseInWorld(context)
        J = plant.CalcJacobianSpatialVelocity(
            context, JacobianWrtVariable.kV, self.flange, self._origin, base, base
        )
        return FlangeState(X_BF.rotation().matrix(), X_BF.translation(), J)


def arm_alone(urdf: str, base: str) -> MultibodyPlant:
    """Return a plant whose world is the arm's base."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(urdf, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(base))
    plant.Finalize()
    return plant


_STARTS: Final = 40
_MARGIN: Final = 0.05  # rad, that a solution keeps from the ends of the joints' ranges
_NEAR: Final = 1e-4  # m and rad, from where Newton's method finishes
# Of the largest smallest singular value there is; so much is far enough from a singularity.
_AGILE: Final = 0.5
_SAME: Final = 1e-3  # m, of height, that makes no difference


def searched_posture(arm: SerialArm, R: Array, p: Array, up: Array) -> Array:
    """Return joint positions, rad, shape (n,), that put the flange at a pose R_BF, p_BF (m).

    Of the solutions that Drake's :class:`InverseKinematics` finds from starts all over the joints'
    ranges it is, far from singularities, the one whose links are highest on average (``up``, a
    unit vector in the base frame, is against gravity): the elbow is up. Of those the one with the
    least turned joints. A redundant arm's joints are near the middle of their ranges. Links don't
    collide here.

    Raises:
        ParameterError: If there is none.
    """
    q = _searched(arm, tuple(R.ravel().tolist()), tuple(p.tolist()), tuple(up.tolist()))
    return np.array(q)


@lru_cache(maxsize=64)
def _searched(
    arm: SerialArm, rotation: tuple[float, ...], p: tuple[float, ...], up: tuple[float, ...]
) -> tuple[float, ...]:
    plant = arm_alone(arm.urdf, arm.base)
    found = _solutions(arm, plant, np.reshape(rotation, (3, 3)), np.array(p))
    if not found:
        place = tuple(round(one, 3) for one in p)
        raise ParameterError("flange position", place, f"within reach of {arm.name}, so turned")
    agility = [np.linalg.svd(arm.kinematics(q).J, compute_uv=False)[-1] for q in found]
    agile = [q for q, s in zip(found, agility, strict=True) if s >= _AGILE * max(agility)]
    heights = [_mean_height(plant, q, np.array(up)) for q in agile]
    high = [q for q, h in zip(agile, heights, strict=True) if h >= max(heights) - _SAME]
    return tuple(min(high, key=lambda q: float(q @ q)).tolist())


def _solutions(arm: SerialArm, plant: MultibodyPlant, R: Array, p: Array) -> list[Array]:
    low, high = np.array(arm.lower_limits), np.array(arm.upper_limits)
    margin = np.minimum(_MARGIN, (high - low) / 4)
    low, high = low + margin, high - margin
    problem = InverseKinematics(plant)
    flange, base = plant.GetFrameByName(arm.flange), plant.world_frame()
    problem.AddPositionConstraint(flange, np.zeros(3), base, p - _NEAR, p + _NEAR)
    problem.AddOrientationConstraint(base, RotationMatrix(R), flange, RotationMatrix(), _NEAR)
    program = problem.prog()
    program.AddBoundingBoxConstraint(low, high, problem.q())
    program.AddQuadraticErrorCost(np.eye(arm.num_joints), (low + high) / 2, problem.q())
    middle = np.clip(0.0, low, high)  # more than a turn about it leads to the same poses
    low, high = np.maximum(low, middle - np.pi), np.minimum(high, middle + np.pi)
    found = []
    for start in np.random.default_rng(0).uniform(low, high, (_STARTS, arm.num_joints)):
        result = Solve(program, start)
        if result.is_success():
            try:
                found.append(arm.joint_positions(R, p, result.GetSolution(problem.q())))
            except ParameterError:  # it ends outside of the ranges
                continue
    return found


def _mean_height(plant: MultibodyPlant, q: Array, up: Array) -> float:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    origins = [plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies]
    return float(np.mean(np.array(origins) @ up))
