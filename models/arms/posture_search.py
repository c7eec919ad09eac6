"""Joint positions of a pose where none are known to be near."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.solvers import Solve

from chamfer.models.arms.plant_kinematics import arm_alone
from chamfer.models.arms.serial_arm import SerialArm
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_STARTS: Final = 40
_MARGIN: Final = 0.05  # rad, that a solution keeps from the ends of the joints' ranges
_NEAR: Final = 1e-4  # m and rad, from where Newton's method finishes
# Of the largest smallest singular value there is; so much is far enough from a singularity.
_AGILE: Final = 0.5
_SAME: Final = 1e-3  # m, of height, that makes no difference


def searched_posture(arm: SerialArm, R: Array, p: Array, up: Array) -> Array:
    """Return joint positions, rad, shape (n,), that put the flange at a pose.

    Of the solutions that Drake's :class:`InverseKinematics` finds from starts all over the
    joints' ranges it is, far from singularities, the one whose links are highest on average: the
    elbow is up. Of those the one with the least turned joints. A redundant arm's joints are near
    the middle of their ranges. Links don't collide here.

    Args:
        arm: Which.
        R: Rotation R_BF, shape (3, 3).
        p: Position p_BF, m, shape (3,).
        up: Unit vector against gravity, in the base frame, shape (3,).

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
