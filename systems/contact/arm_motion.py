"""The motion of an arm, with or without a compliant gripper, at a surface, step by step."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.friction import friction_at
from chamfer.models.surfaces.surface_code import evaluate
from chamfer.systems.compiled import add_product, compiled, inverse
from chamfer.systems.contact.arm_dynamics import (
    GRAVITY,
    Chain,
    Pose,
    add_cross,
    base_wrench,
    bias,
    mass_matrix,
    point_jacobian,
    pose,
    potential,
    product,
)
from chamfer.systems.contact.stick_slip import Material, Motion, StepModel, along, step

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
NOWHERE: Final = 1e3  # m, gap of a point that a scene does not have
FAR: Final = 0.01  # m, more of a gap than the tip gains on what its speed says in an update
_FRICTION_LENGTH: Final = 0.012  # m, of the way over which its noise changes; measured on a table


class Tool(NamedTuple):
    """What the arm touches with, in m points; axes of the endpoint's frame."""

    offset: Array  # (m, 3), m, of the points from the endpoint, without force
    rigid: bool  # True: the tip is fixed there
    stiffness: Array  # (3, 3), N/m, of the gripper between
    damping: Array  # (3, 3), N s/m, of the gripper
    load: float  # kg, that is held; its weight and inertia are in the chain's last link
    centre: Array  # (3,), m, of the load


class Patch(NamedTuple):
    """Surfaces as they are taken for a while: level functions to second order, world frame."""

    point: Array  # (m, 3), m, about which
    level: Array  # (m,), m
    gradient: Array  # (m, 3), away from the material
    hessian: Array  # (m, 3, 3), 1/m
    mu: Array  # (m,), coefficients of friction


class Contacts(NamedTuple):
    """What the points touch, in machine code."""

    surfaces: Array  # their code
    friction: Array  # (m, 9), the coefficient's six numbers, its noise, and :func:`coefficient`'s


def output_sizes(n: int, points: int) -> dict[str, int]:
    """Return how many numbers each output of :func:`advance` has, for n joints and M points."""
    return {
        "contact_force": 3 * points,
        "tool_force": 3,
        "base_torque": n,
        "contact": len(CONTACT_SIGNALS) * points,
        "tip": 6 * points,
        "energy": len(ENERGIES),
        "base_wrench": 6,
    }


@compiled
def _tip(at: Pose, offset: Array, stretch: Array) -> Array:
    point = at.p_WE.copy()
    add_product(at.R_WE, offset + stretch, point)
    return point


@compiled
def _locate(patch: Patch, which: int, point: Array, normal: Array) -> float:
    """Fill in the normal of a surface at a point and return the gap, m.

    The gap is the level over its gradient's length, the normal the direction in which it grows:
    the contact's spring would else gain or lose energy where that length changes.
    """
    level, hessian, gradient = float(patch.level[which]), patch.hessian[which], np.empty(3)
    way = point - patch.point[which]
    for i in range(3):
        bend = along(hessian[i], way)
        level += (patch.gradient[which, i] + bend / 2) * way[i]
        gradient[i] = patch.gradient[which, i] + bend
    square = along(gradient, gradient)
    for i in range(3):
        normal[i] = gradient[i] - level * along(hessian[i], gradient) / square
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
    half, result = np.empty((3, 3)), np.empty((3, 3))
    product(rotation, matrix, half)
    product(half, rotation.T, result)
    return result


@compiled
def energies(
    chain: Chain, material: Material, tool: Tool, q: Array, v: Array, stretch: Array, gap: Array
) -> Array:
    """Return kinetic, potential and elastic energy, J, shape (3,)."""
    at = pose(chain, q)
    elastic = 0.0
    for point in range(len(gap)):
        elastic += material.stiffness[point] * min(gap[point], 0.0) ** 2
    elastic += _quadratic(stretch, tool.stiffness)
    kinetic = _quadratic(v, mass_matrix(chain, at)) / 2
    return np.array([kinetic, potential(chain, at), elastic / 2])


@compiled
def gaps(chain: Chain, tool: Tool, patch: Patch, q: Array, stretch: Array) -> Array:
    """Return the gaps of the points, m, shape (m,)."""
    at, normal = pose(chain, q), np.empty(3)
    found = np.empty(len(tool.offset))
    for point in range(len(found)):
        found[point] = _locate(patch, point, _tip(at, tool.offset[point], stretch), normal)
    return found


@compiled
def _carried(chain: Chain, tool: Tool, q: Array, v: Array) -> Array:
    """Return the velocity of the load's centre of mass, m/s, shape (3,), world frame."""
    at = pose(chain, q)
    jacobian = point_jacobian(at, _tip(at, tool.centre, np.zeros(3)))
    velocity = np.zeros(3)
    add_product(jacobian, v, velocity)
    return velocity


@compiled
def coefficient(friction: Array, point: Array, force: Array, normal: Array) -> float:
    """Return the coefficient of friction, of a row of :class:`Contacts`.

    At a point, m, with the force, N, of the surface and the normal out of it, shape (3,) each. The
    row's last numbers are mass, kg, and slip friction of a body that lies loose, mass 0 if there
    is none. Of two dry frictions in series, that on it and that of it on what it lies on, the
    weaker gives. The latter holds ``slip_friction (N + m g)``; on a slope it is as down the slope.
    """
    mu, push = friction_at(friction, point[0])[0], along(force, normal)
    if friction[7] > 0.0 and push > 0.0:
        holds = math.atan(friction[8] * (1.0 + friction[7] * GRAVITY / push))
        slope = math.acos(min(max(normal[2], 0.0), 1.0))
        mu = min(mu, math.tan(max(holds - slope, 0.0)))
    return mu


@compiled
def roughen(uneven: Array, drawn: Array, outputs: Array, n: int, period: float) -> None:
    """Change the friction's relative noise, shape (M,), as far as the points slip in a period.

    ``drawn``, shape (M,), is white, of deviation 1, and so is the noise then.
    """
    contact = 3 * len(uneven) + 3 + n
    for a in range(len(uneven)):
        kept = math.exp(-abs(outputs[contact + 6 * a + 2]) * period / _FRICTION_LENGTH)
        uneven[a] = kept * uneven[a] + math.sqrt(1.0 - kept**2) * drawn[a]


@compiled
def patch_at(contacts: Contacts, outputs: Array, uneven: Array, n: int, period: float) -> Patch:
    """Return the surfaces about where the points, with velocities, are in half a period."""
    m, most = len(contacts.friction), len(uneven)
    tip = 3 * most + 3 + n + 6 * most
    found = Patch(
        np.empty((m, 3)), np.empty(m), np.empty((m, 3)), np.empty((m, 3, 3)), np.empty(m)
    )
    for a in range(m):
        point, gradient, hessian = found.point[a], found.gradient[a], found.hessian[a]
        way = 0.0
        for i in range(3):
            ahead = period / 2 * outputs[tip + 6 * a + 3 + i]
            point[i] = outputs[tip + 6 * a + i] + ahead
            way += ahead**2
        level = evaluate(contacts.surfaces, a, point, gradient, hessian)
        found.level[a], found.mu[a] = level, 0.0
        length = math.sqrt(along(gradient, gradient))
        if level > (FAR + 2.0 * math.sqrt(way)) * length:
            # Out of reach, where a level function may have any shape.
            hessian[:] = 0.0
            if length == 0.0:
                gradient[0] = 1.0
            else:
                found.level[a] /= length
                gradient /= length
            continue
        mu = coefficient(
            contacts.friction[a], point, outputs[3 * a : 3 * a + 3], gradient / length
        )
        found.mu[a] = mu * max(1.0 + contacts.friction[a, 6] * uneven[a], 0.0)
    return found


@compiled
def update(
    chain: Chain,
    material: Material,
    tool: Tool,
    contacts: Contacts,
    state: Array,
    outputs: Array,
    uneven: Array,
    torque: Array,
    disturbance: Array,
    lasting: bool,
    h: float,
    count: int,
) -> tuple[float, int]:
    """Take ``count`` steps of ``h`` seconds at the surfaces; change state and outputs.

    ``uneven``, shape (M,), is the friction's relative noise at the points, of deviation 1; the
    rest is as :func:`advance` has it. Returns the largest error of the steps, and how many of them
    are not solved.
    """
    patch = patch_at(contacts, outputs, uneven, len(torque), h * count)
    return advance(
        chain, material, tool, patch, state, outputs, torque, disturbance, lasting, h, count
    )


@compiled
def advance(
    chain: Chain,
    material: Material,
    tool: Tool,
    patch: Patch,
    state: Array,
    outputs: Array,
    torque: Array,
    disturbance: Array,
    lasting: bool,
    h: float,
    count: int,
) -> tuple[float, int]:
    """Take ``count`` steps of ``h`` seconds; change state and outputs.

    Mass matrix, bias, Jacobians and normals are those of each step's middle, with the velocity's
    change in the step before taken to go on: second order in h wherever forces are smooth.

    ``state``, shape (5n + 3M + 3,) with room for M >= m points, has in this order: joint positions
    q and velocities v; 1 where a joint sticks; the joints' impulses and the change of v in the
    last step, (n,) each; the points' impulses in it, N s, world frame, (3M,), and the gripper's
    stretch, m, endpoint's frame, (3,). ``outputs`` are as :func:`output_sizes` has them; a point
    that is not there has no force and a large gap. ``lasting``: peak forces and impact speeds go
    on from those of ``outputs``. ``torque``, (n,), N m or N, is held, and so is ``disturbance``,
    (3,), N, on the arm at the first point, world frame.

    Returns the largest error of the steps, and how many of them are not solved.
    """
    n, m, most = len(torque), len(tool.offset), (len(state) - 5 * len(torque) - 3) // 3
    q = state[:n].copy()
    motion = Motion(
        state[n : 2 * n].copy(),
        state[2 * n : 3 * n].copy(),
        state[3 * n : 4 * n].copy(),
        state[5 * n : 5 * n + 3 * m].copy().reshape((m, 3)),
    )
    change, stretch = state[4 * n : 5 * n].copy(), state[5 * n + 3 * most :].copy()
    gap = gaps(chain, tool, patch, q, stretch)
    matrix = np.zeros((3, 3))
    if not tool.rigid:
        matrix = inverse(h * tool.stiffness + tool.damping)
    after = outputs.copy()
    # Where the outputs begin.
    base, contact = 3 * most + 3, 3 * most + 3 + n
    tip, energy = contact + 6 * most, contact + 12 * most
    if not lasting:
        for a in range(most):
            after[contact + 6 * a + 3] = after[contact + 6 * a + 4] = 0.0
    error, unsolved, dissipated = 0.0, 0, outputs[energy + 3]
    normal, jacobian, points = np.empty((m, 3)), np.empty((m, 3, n)), np.empty((m, 3))
    yielding, stiffness = np.zeros((3, 3)), np.zeros((3, 3))
    began = np.zeros(3)
    for k in range(count):
        if tool.load > 0.0 and k == count - 1:
            began = _carried(chain, tool, q, motion.velocity)
        before = motion.velocity
        speed = before + change / 2
        at = pose(chain, q + h * speed / 2)
        for a in range(m):
            points[a] = _tip(at, tool.offset[a], stretch)
            _locate(patch, a, points[a], normal[a])
            jacobian[a] = point_jacobian(at, points[a])
        slow = bias(chain, at, speed)
        force, stretched = torque - slow, np.zeros(3)
        add_product(jacobian[0].T, disturbance, force)
        if not tool.rigid:
            yielding, stiffness = _turned(at.R_WE, matrix), _turned(at.R_WE, tool.stiffness)
            add_product(at.R_WE, stretch, stretched)
        mass, mu, rigid = mass_matrix(chain, at), patch.mu, tool.rigid
        model = StepModel(
            mass, force, jacobian, gap, normal, mu, rigid, yielding, stiffness, stretched
        )
        done = step(model, material, motion, h)
        motion, gap = done.motion, done.gap
        change = motion.velocity - before
        q += done.displacement
        viscous = material.viscous * done.displacement
        after[base : base + n] = torque + (motion.joint_impulse - viscous) / h
        for j in range(n):
            after[energy + 4] += done.displacement[j] * (force[j] + slow[j])
        add_product(at.R_WE.T, done.stretch, stretch)
        for a in range(m):
            push, own = along(normal[a], motion.impulse[a]) / h, contact + 6 * a
            after[own + 3] = max(after[own + 3], push)
            after[own + 4] = max(after[own + 4], done.impact_speed[a])
        dissipated += done.dissipated
        error = max(error, done.error)
        unsolved += 0 if done.solved else 1
    wrench = base_wrench(chain, at, speed, change / h)
    for a in range(m):
        pushed = motion.impulse[a] / h
        if a == 0:
            pushed = pushed + disturbance
        add_cross(pushed, points[a], wrench[:3])
        wrench[3:] -= pushed
    after[energy + 5 :] = wrench
    at = pose(chain, q)
    after[: 3 * most + 3] = 0.0
    for a in range(most):
        own = contact + 6 * a
        after[own + 5] = dissipated
        if a >= m:
            after[own], after[own + 1], after[own + 2] = NOWHERE, 0.0, 0.0
            after[tip + 6 * a : tip + 6 * a + 6] = 0.0
            continue
        after[own] = gap[a]
        after[own + 1] = done.approach_speed[a]
        after[own + 2] = done.slip_speed[a]
        point = _tip(at, tool.offset[a], stretch)
        reached = point_jacobian(at, point)
        for i in range(3):
            if gap[a] <= 0.0:
                after[3 * a + i] = motion.impulse[a, i] / h
                for k in range(3):
                    after[3 * most + i] += at.R_WE[k, i] * motion.impulse[a, k] / h
            after[tip + 6 * a + i] = point[i]
            after[tip + 6 * a + 3 + i] = along(reached[i], motion.velocity)
    if tool.load > 0.0:
        speeding = (_carried(chain, tool, q, motion.velocity) - began) / h
        lack = tool.load * (chain.gravity - speeding)
        add_product(at.R_WE.T, lack, after[3 * most : 3 * most + 3])
    after[energy : energy + 3] = energies(chain, material, tool, q, motion.velocity, stretch, gap)
    after[energy + 3] = dissipated
    state[:] = np.concatenate(
        (
            q,
            motion.velocity,
            motion.sticking,
            motion.joint_impulse,
            change,
            motion.impulse.ravel(),
            np.zeros(3 * (most - m)),
            stretch,
        )
    )
    outputs[:] = after
    return error, unsolved
