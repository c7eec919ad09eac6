"""The motion of an arm, with or without a compliant gripper, at a surface, step by step."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled, inverse
from systems.contact.serial_chain import (
    Chain,
    Pose,
    bias,
    mass_matrix,
    point_jacobian,
    pose,
    potential,
)
from systems.contact.stick_slip import Held, Material, Motion, along, step

Array = NDArray[np.float64]

CONTACT_SIGNALS: Final = (
    "gap",
    "approach_speed",
    "slip_speed",
    "peak_force",
    "impact_speed",
    "dissipated",
)
ENERGIES: Final = ("kinetic", "potential", "elastic", "dissipated", "work")
# Of an arm of n joints, and how many numbers each has, or None for n.
OUTPUTS: Final = {
    "contact_force": 3,
    "tool_force": 3,
    "base_torque": None,
    "contact": len(CONTACT_SIGNALS),
    "tip": 6,
    "energy": len(ENERGIES),
}


class Tool(NamedTuple):
    """What the arm touches with; axes of the endpoint's frame."""

    offset: Array  # (3,), m, of the tip from the endpoint, without load
    rigid: bool  # True: the tip is fixed there
    stiffness: Array  # (3, 3), N/m, of the gripper between
    damping: Array  # (3, 3), N s/m, of the gripper


class Patch(NamedTuple):
    """The surface as it is taken for a while: its level function to second order, world frame."""

    point: Array  # (3,), m, about which
    level: float  # m
    gradient: Array  # (3,), away from the material
    hessian: Array  # (3, 3), 1/m
    mu: float  # coefficient of friction


@compiled
def _tip(at: Pose, offset: Array, stretch: Array) -> Array:
    point = np.empty(3)
    for i in range(3):
        point[i] = at.p_WE[i]
        for k in range(3):
            point[i] += at.R_WE[i, k] * (offset[k] + stretch[k])
    return point


@compiled
def _locate(patch: Patch, point: Array, normal: Array) -> float:
    """Fill in the normal at a point and return the gap, m.

    The gap is the level over its gradient's length, the normal the direction in which it grows:
    the contact's spring would else gain or lose energy where that length changes.
    """
    gradient, turned = np.empty(3), np.empty(3)
    level = patch.level
    for i in range(3):
        bend = 0.0
        for k in range(3):
            bend += patch.hessian[i, k] * (point[k] - patch.point[k])
        level += (patch.gradient[i] + bend / 2) * (point[i] - patch.point[i])
        gradient[i] = patch.gradient[i] + bend
    square = along(gradient, gradient)
    for i in range(3):
        turned[i] = along(patch.hessian[i], gradient)
        normal[i] = gradient[i] - level * turned[i] / square
    normal /= math.sqrt(along(normal, normal))
    return level / math.sqrt(square)


@compiled
def _quadratic(vector: Array, matrix: Array) -> float:
    total = 0.0
    for i in range(len(vector)):
        total += vector[i] * along(matrix[i], vector)
    return total


@compiled
def _turned(rotation: Array, matrix: Array) -> Array:
    """Return a matrix of the endpoint's frame in the world frame."""
    half, result = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                half[i, j] += rotation[i, k] * matrix[k, j]
    for i in range(3):
        for j in range(3):
            result[i, j] = along(half[i], rotation[j])
    return result


@compiled
def energies(
    chain: Chain,
    material: Material,
    tool: Tool,
    q: Array,
    v: Array,
    stretch: Array,
    gap: float,
) -> Array:
    """Return kinetic, potential and elastic energy, J, shape (3,)."""
    at = pose(chain, q)
    elastic = material.stiffness * min(gap, 0.0) ** 2 + _quadratic(stretch, tool.stiffness)
    kinetic = _quadratic(v, mass_matrix(chain, at)) / 2
    return np.array([kinetic, potential(chain, at), elastic / 2])


@compiled
def advance(
    chain: Chain,
    material: Material,
    tool: Tool,
    patch: Patch,
    state: Array,
    outputs: Array,
    lasting: bool,
    torque: Array,
    disturbance: Array,
    h: float,
    count: int,
) -> tuple[Array, Array, float, int]:
    """Take ``count`` steps of ``h`` seconds.

    Mass matrix, bias, Jacobian and normal are those of each step's middle, with the velocity's
    change in the step before taken to go on: second order in h wherever forces are smooth.

    Args:
        chain: The arm, n joints.
        material: Friction of the joints, and the contact's spring and damper.
        tool: What touches.
        patch: What is touched.
        state: At the begin, shape (5n + 6,), in this order: joint positions q and velocities v;
            1 where a joint sticks; the joints' impulses and the change of v in the last step, (n,)
            each; the contact's impulse in it, N s, world frame, and the gripper's stretch, m,
            endpoint's frame, (3,) each.
        outputs: At the begin, shape (n + 23,), in the order of ``OUTPUTS``.
        lasting: Whether peak force and impact speed go on from those of ``outputs``.
        torque: shape (n,), N m or N.
        disturbance: shape (3,), N, on the arm at the tip, world frame.
        h: s.
        count: steps.

    Returns:
        State and outputs at the end, the largest error of the steps, and how many of them are not
        solved.
    """
    n = len(torque)
    q = state[:n].copy()
    motion = Motion(
        state[n : 2 * n].copy(),
        state[2 * n : 3 * n].copy(),
        state[3 * n : 4 * n].copy(),
        state[5 * n : 5 * n + 3].copy(),
    )
    change, stretch = state[4 * n : 5 * n].copy(), state[5 * n + 3 :].copy()
    at = pose(chain, q)
    normal = np.empty(3)
    gap = _locate(patch, _tip(at, tool.offset, stretch), normal)
    matrix = np.zeros((3, 3))
    if not tool.rigid:
        matrix = inverse(h * tool.stiffness + tool.damping)
    after = outputs.copy()
    contact, tip, energy = n + 6, n + 12, n + 18  # where they begin
    if not lasting:
        after[contact + 3] = after[contact + 4] = 0.0
    error, unsolved = 0.0, 0
    force, middle, stretched = np.empty(n), np.empty(n), np.zeros(3)
    yielding, stiffness = np.zeros((3, 3)), np.zeros((3, 3))
    for _ in range(count):
        before = motion.velocity
        for j in range(n):
            middle[j] = q[j] + h * (before[j] + change[j] / 2) / 2
        at = pose(chain, middle)
        point = _tip(at, tool.offset, stretch)
        _locate(patch, point, normal)
        jacobian = point_jacobian(at, point)
        slow = bias(chain, at, before + change / 2)
        for j in range(n):
            force[j] = torque[j] - slow[j]
            for i in range(3):
                force[j] += jacobian[i, j] * disturbance[i]
        if not tool.rigid:
            yielding, stiffness = _turned(at.R_WE, matrix), _turned(at.R_WE, tool.stiffness)
            for i in range(3):
                stretched[i] = along(at.R_WE[i], stretch)
        held = Held(
            mass_matrix(chain, at),
            force,
            jacobian,
            gap,
            normal,
            patch.mu,
            tool.rigid,
            yielding,
            stiffness,
            stretched,
        )
        done = step(held, material, motion, h)
        motion, gap = done.motion, done.gap
        change = motion.velocity - before
        for j in range(n):
            q[j] += done.displacement[j]
            after[energy + 4] += done.displacement[j] * (force[j] + slow[j])
            viscous = material.viscous[j] * done.displacement[j]
            after[6 + j] = torque[j] + (motion.joint_impulse[j] - viscous) / h
        for i in range(3):
            for k in range(3):
                stretch[i] += at.R_WE[k, i] * done.stretch[k]
        after[contact] = gap
        after[contact + 1] = done.approach_speed
        after[contact + 2] = done.slip_speed
        push = along(normal, motion.impulse) / h
        after[contact + 3] = max(after[contact + 3], push)
        after[contact + 4] = max(after[contact + 4], done.impact_speed)
        after[contact + 5] += done.dissipated
        error = max(error, done.error)
        unsolved += 0 if done.solved else 1
    at = pose(chain, q)
    point = _tip(at, tool.offset, stretch)
    jacobian = point_jacobian(at, point)
    after[:6] = 0.0
    for i in range(3):
        if gap <= 0.0:
            after[i] = motion.impulse[i] / h
            for k in range(3):
                after[3 + i] += at.R_WE[k, i] * motion.impulse[k] / h
        after[tip + i] = point[i]
        after[tip + 3 + i] = along(jacobian[i], motion.velocity)
    after[energy : energy + 3] = energies(chain, material, tool, q, motion.velocity, stretch, gap)
    after[energy + 3] = after[contact + 5]
    new = np.concatenate(
        (
            q,
            motion.velocity,
            motion.stuck,
            motion.joint_impulse,
            change,
            motion.impulse,
            stretch,
        )
    )
    return new, after, error, unsolved
