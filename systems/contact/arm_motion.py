"""The motion of an arm, with or without a compliant gripper, at a surface, step by step."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.friction import friction_at
from chamfer.models.surfaces.surface_code import evaluate
from chamfer.systems.compiled import compiled, in_place, inverse
from chamfer.systems.contact.arm_dynamics import (
    GRAVITY,
    ZERO,
    Chain,
    Nine,
    Pose,
    Three,
    add,
    add_cross,
    add_turned,
    base_forces,
    dot,
    fill_bias,
    fill_jacobian,
    fill_mass_matrix,
    mass_matrix,
    nine,
    nine_of,
    no_pose,
    place_links,
    pose,
    potential,
    product,
    row,
    scaled,
    shared,
    transposed,
    vector,
)
from chamfer.systems.contact.stick_slip import (
    SOLVED,
    Material,
    Motion,
    StepModel,
    Work,
    take_step,
    workspace,
)

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
    """The arm's contact points, m of them; axes of the endpoint's frame."""

    offset: Array  # (m, 3), m, of the points from the endpoint, without force
    rigid: bool  # True: the tip is fixed there
    stiffness: Array  # (3, 3), N/m, of the gripper between
    damping: Array  # (3, 3), N s/m, of the gripper
    load: float  # kg, that is held; its weight and inertia are in the chain's last link
    centre: Array  # (3,), m, of the load


class Patch(NamedTuple):
    """Local approximation of surfaces: level functions to second order, world frame."""

    point: Array  # (m, 3), m, about which
    level: Array  # (m,), m
    gradient: Array  # (m, 3), away from the material
    hessian: Array  # (m, 3, 3), 1/m
    mu: Array  # (m,), coefficients of friction


class Contacts(NamedTuple):
    """The surfaces of the points, for machine code."""

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


@in_place
def _tip(at: Pose, offset: Three, stretch: Three) -> Three:
    return add_turned(nine(at.R_WE), add(offset, stretch), vector(at.p_WE))


@in_place
def _locate(patch: Patch, which: int, point: Three) -> tuple[float, Three]:
    """Return the gap of a surface at a point, m, and its normal there.

    The gap is the level over its gradient's length, the normal the direction in which it grows:
    the contact's spring would else gain or lose energy where that length changes.
    """
    hessian = nine_of(patch.hessian, which)
    way = add(point, scaled(row(patch.point, which, 0), -1.0))
    bend, flat = add_turned(hessian, way, ZERO), row(patch.gradient, which, 0)
    level = patch.level[which] + (flat[0] + bend[0] / 2) * way[0]
    level = level + (flat[1] + bend[1] / 2) * way[1] + (flat[2] + bend[2] / 2) * way[2]
    gradient = add(flat, bend)
    square = dot(gradient, gradient)
    turned = add_turned(hessian, gradient, ZERO)
    normal = add(gradient, shared(scaled(turned, -level), square))
    return level / math.sqrt(square), shared(normal, math.sqrt(dot(normal, normal)))


@in_place
def _fill_turned(turn: Nine, matrix: Array, result: Array) -> None:
    """Fill in a matrix of the endpoint's frame in the world frame."""
    turned = product(product(turn, nine(matrix)), transposed(turn))
    for i in range(9):
        result[i // 3, i % 3] = turned[i]


@compiled
def energies(
    chain: Chain, material: Material, tool: Tool, q: Array, v: Array, stretch: Array, gap: Array
) -> Array:
    """Return kinetic, potential and elastic energy, J, shape (3,)."""
    at, result = pose(chain, q), np.empty(3)
    _fill_energies(chain, material, tool, at, mass_matrix(chain, at), v, stretch, gap, result, 0)
    return result


@in_place
def _fill_energies(
    chain: Chain,
    material: Material,
    tool: Tool,
    at: Pose,
    mass: Array,
    v: Array,
    stretch: Array,
    gap: Array,
    result: Array,
    first: int,
) -> None:
    """Fill in the energies; the mass matrix is that of the pose."""
    elastic, kinetic = 0.0, 0.0
    for point in range(len(gap)):
        elastic += material.stiffness[point] * min(gap[point], 0.0) ** 2
    elastic += dot(vector(stretch), add_turned(nine(tool.stiffness), vector(stretch), ZERO))
    for j in range(len(v)):
        moment = 0.0
        for k in range(len(v)):
            moment += mass[j, k] * v[k]
        kinetic += v[j] * moment
    result[first], result[first + 1] = kinetic / 2, potential(chain, at)
    result[first + 2] = elastic / 2


@compiled
def gaps(chain: Chain, tool: Tool, patch: Patch, q: Array, stretch: Array) -> Array:
    """Return the gaps of the points, m, shape (m,)."""
    at, found = pose(chain, q), np.empty(len(tool.offset))
    for point in range(len(found)):
        tip = _tip(at, row(tool.offset, point, 0), vector(stretch))
        found[point] = _locate(patch, point, tip)[0]
    return found


@in_place
def _velocity(at: Pose, point: Three, v: Array) -> Three:
    """Return the velocity of a point of the last link, m/s, world frame."""
    total = ZERO
    for j in range(len(v)):
        column = add_cross(row(at.twist, j, 0), point, row(at.twist, j, 3))
        total = add(total, scaled(column, v[j]))
    return total


@in_place
def coefficient(friction: Array, x: float, push: float, up: float) -> float:
    """Return the coefficient of friction, of a row of :class:`Contacts`.

    At x, m, where the surface pushes with a normal force, N, along a normal whose z is ``up``. The
    row's last numbers are mass, kg, and slip friction of a body that lies loose, mass 0 if there
    is none. Of two dry frictions in series, that on it and that of it on what it lies on, the
    weaker gives. The latter holds ``slip_friction (N + m g)``; on a slope it is as down the slope.
    """
    mu = friction_at(friction, x)[0]
    if friction[7] > 0.0 and push > 0.0:
        holds = math.atan(friction[8] * (1.0 + friction[7] * GRAVITY / push))
        mu = min(mu, math.tan(max(holds - math.acos(min(max(up, 0.0), 1.0)), 0.0)))
    return mu


@in_place
def roughen(uneven: Array, drawn: Array, outputs: Array, n: int, period: float) -> None:
    """Change the friction's relative noise, shape (M,), as far as the points slip in a period.

    ``drawn``, shape (M,), is white, of deviation 1, and so is the noise then.
    """
    contact = 3 * len(uneven) + 3 + n
    for a in range(len(uneven)):
        kept = math.exp(-abs(outputs[contact + 6 * a + 2]) * period / _FRICTION_LENGTH)
        uneven[a] = kept * uneven[a] + math.sqrt(1.0 - kept**2) * drawn[a]


@in_place
def fill_patch(
    contacts: Contacts, outputs: Array, uneven: Array, n: int, period: float, patch: Patch
) -> None:
    """Fill in the surfaces about where the points, with velocities, are in half a period."""
    tip = 3 * len(uneven) + 3 + n + 6 * len(uneven)
    for a in range(len(patch.mu)):
        point, slope, way = patch.point[a], patch.gradient[a], 0.0
        for i in range(3):
            ahead = period / 2 * outputs[tip + 6 * a + 3 + i]
            point[i] = outputs[tip + 6 * a + i] + ahead
            way += ahead**2
        level = evaluate(contacts.surfaces, a, point, slope, patch.hessian[a])
        patch.level[a], patch.mu[a] = level, 0.0
        length = math.sqrt(dot(vector(slope), vector(slope)))
        if level <= (FAR + 2.0 * math.sqrt(way)) * length:
            force, normal = vector(outputs[3 * a : 3 * a + 3]), scaled(vector(slope), 1.0 / length)
            mu = coefficient(contacts.friction[a], point[0], dot(force, normal), normal[2])
            patch.mu[a] = mu * max(1.0 + contacts.friction[a, 6] * uneven[a], 0.0)
            continue
        # Out of reach, where a level function may have any shape.
        slope[0] = 1.0 if length == 0.0 else slope[0]
        for i in range(3):
            slope[i] /= length or 1.0
            for k in range(3):
                patch.hessian[a, i, k] = 0.0
        patch.level[a] /= length or 1.0


class Room(NamedTuple):
    """Room for the steps of an arm."""

    at: Pose
    patch: Patch
    model: StepModel
    work: Work
    joints: Array  # (3, n)
    links: Array  # (n, 6)
    points: Array  # (m, 3)
    compliance: Array  # (3, 3), (h K + D)^-1 of the gripper


@compiled
def make_room(chain: Chain, material: Material, tool: Tool, h: float) -> Room:
    """Return room for steps of ``h`` seconds."""
    n, m = len(chain.mass), len(tool.offset)
    patch = Patch(
        np.empty((m, 3)), np.empty(m), np.empty((m, 3)), np.empty((m, 3, 3)), np.empty(m)
    )
    a, b, c = np.empty((n, n)), np.empty(n), np.empty((m, 3, n))
    gap, normal, gripper, stretch = np.empty(m), np.empty((m, 3)), np.zeros((2, 3, 3)), np.zeros(3)
    model = StepModel(a, b, c, gap, normal, patch.mu, tool.rigid, gripper[0], gripper[1], stretch)
    work, joints, links = workspace(model, material, h), np.empty((3, n)), np.empty((n, 6))
    compliance = np.zeros((3, 3)) if tool.rigid else inverse(h * tool.stiffness + tool.damping)
    return Room(no_pose(chain), patch, model, work, joints, links, np.empty((m, 3)), compliance)


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
    room = make_room(chain, material, tool, h)
    fill_patch(contacts, outputs, uneven, len(torque), h * count, room.patch)
    return advance(
        chain, material, tool, room, state, outputs, torque, disturbance, lasting, h, count
    )


@in_place
def advance(
    chain: Chain,
    material: Material,
    tool: Tool,
    room: Room,
    state: Array,
    outputs: Array,
    torque: Array,
    disturbance: Array,
    lasting: bool,
    h: float,
    count: int,
) -> tuple[float, int]:
    """Take ``count`` steps of ``h`` seconds at the patch of the room; change state and outputs.

    Mass matrix, bias, Jacobians and normals are those of each step's middle, with the velocity's
    change in the step before taken to go on: second order in h wherever forces are smooth.

    ``state``, shape (5n + 3M + 3,) with room for M >= m points, has in this order: joint positions
    q and velocities v; 1 where a joint sticks; the joints' impulses and the change of v in the
    last step, (n,) each; the points' impulses in it, N s, world frame, (3M,), and the gripper's
    stretch, m, endpoint's frame, (3,). ``outputs`` are as :func:`output_sizes` has them; a point
    that is not there has no force and a large gap. ``lasting``: peak forces and impact speeds go
    on from those of ``outputs``. ``torque``, (n,), N m or N, is held, and so is ``disturbance``,
    (3,), N, on the arm at the first point, world frame.

    Returns the largest error of the steps, and how many of them are not solved, more than 0 too if
    the state is not finite.
    """
    n, m, most = len(torque), len(tool.offset), (len(state) - 5 * len(torque) - 3) // 3
    at, patch, model, work, (mid, speed, slow), links, points, _ = room
    q, v, sticking, pushes, change = state[: 5 * n].reshape((5, n))
    impulse, stretch = state[5 * n : 5 * n + 3 * m].reshape((m, 3)), state[5 * n + 3 * most :]
    motion = Motion(v, sticking, pushes, impulse)
    place_links(chain, q, at)
    for a in range(m):
        tip_at = _tip(at, row(tool.offset, a, 0), vector(stretch))
        model.gap[a] = _locate(patch, a, tip_at)[0]
    # Where the outputs begin.
    base, contact = 3 * most + 3, 3 * most + 3 + n
    tip, energy = contact + 6 * most, contact + 12 * most
    if not lasting:
        for a in range(most):
            outputs[contact + 6 * a + 3] = outputs[contact + 6 * a + 4] = 0.0
    largest, unsolved, began = 0.0, 0, ZERO
    for k in range(count):
        if tool.load > 0.0 and k == count - 1:
            place_links(chain, q, at)
            began = _velocity(at, _tip(at, vector(tool.centre), ZERO), v)
        for j in range(n):
            speed[j] = v[j] + change[j] / 2
            mid[j] = q[j] + h * speed[j] / 2
            change[j] = v[j]
        place_links(chain, mid, at)
        turn = nine(at.R_WE)
        for a in range(m):
            point = _tip(at, row(tool.offset, a, 0), vector(stretch))
            normal = _locate(patch, a, point)[1]
            fill_jacobian(at, point, model.J_v_WC, a)
            for i in range(3):
                points[a, i], model.normal[a, i] = point[i], normal[i]
        fill_bias(chain, at, speed, links, slow)
        for j in range(n):
            model.force[j] = torque[j] - slow[j]
            for i in range(3):
                model.force[j] += model.J_v_WC[0, i, j] * disturbance[i]
        if not tool.rigid:
            _fill_turned(turn, room.compliance, model.yielding)
            _fill_turned(turn, tool.stiffness, model.stiffness)
            stretched = add_turned(turn, vector(stretch), ZERO)
            for i in range(3):
                model.stretch[i] = stretched[i]
        fill_mass_matrix(chain, at, model.mass)
        dissipated, error = take_step(model, material, motion, work)
        for j in range(n):
            moved = work.displacement[j]
            change[j] = v[j] - change[j]
            q[j] += moved
            viscous = material.viscous[j] * moved
            outputs[base + j] = torque[j] + (pushes[j] - viscous) / h
            outputs[energy + 4] += moved * (model.force[j] + slow[j])
        for i in range(3):
            for c in range(3):
                stretch[i] += at.R_WE[c, i] * work.change[c]
        for a in range(m):
            own = contact + 6 * a
            push = dot(row(model.normal, a, 0), row(impulse, a, 0)) / h
            outputs[own + 3] = max(outputs[own + 3], push)
            outputs[own + 4] = max(outputs[own + 4], work.speeds[2, a])
        outputs[energy + 3] += dissipated
        largest = max(largest, error)
        unsolved += 0 if error <= SOLVED else 1
    for j in range(n):
        mid[j] = change[j] / h
    moment, force = base_forces(at, links, mid)
    for a in range(m):
        pushed = shared(row(impulse, a, 0), h)
        if a == 0:
            pushed = add(pushed, vector(disturbance))
        moment = add_cross(pushed, row(points, a, 0), moment)
        force = add(force, scaled(pushed, -1.0))
    place_links(chain, q, at)
    fill_mass_matrix(chain, at, model.mass)
    _fill_energies(chain, material, tool, at, model.mass, v, stretch, model.gap, outputs, energy)
    for i in range(3):
        outputs[energy + 5 + i], outputs[energy + 8 + i] = moment[i], force[i]
    for i in range(base):
        outputs[i] = 0.0
    back, felt = transposed(nine(at.R_WE)), ZERO
    for a in range(most):
        own = contact + 6 * a
        outputs[own + 5] = outputs[energy + 3]
        if a >= m:
            outputs[own], outputs[own + 1], outputs[own + 2] = NOWHERE, 0.0, 0.0
            for i in range(6):
                outputs[tip + 6 * a + i] = 0.0
            continue
        outputs[own], outputs[own + 1] = model.gap[a], work.speeds[0, a]
        outputs[own + 2] = work.speeds[1, a]
        point = _tip(at, row(tool.offset, a, 0), vector(stretch))
        velocity, pushed = _velocity(at, point, v), shared(row(impulse, a, 0), h)
        for i in range(3):
            outputs[tip + 6 * a + i], outputs[tip + 6 * a + 3 + i] = point[i], velocity[i]
            if model.gap[a] <= 0.0:
                outputs[3 * a + i] = pushed[i]
        if model.gap[a] <= 0.0:
            felt = add_turned(back, pushed, felt)
    if tool.load > 0.0:
        ended = _velocity(at, _tip(at, vector(tool.centre), ZERO), v)
        speeding = shared(add(ended, scaled(began, -1.0)), -h)
        felt = add_turned(back, scaled(add(vector(chain.gravity), speeding), tool.load), felt)
    for i in range(3):
        outputs[3 * most + i] = felt[i]
    for value in state:
        unsolved += 0 if math.isfinite(value) else 1
    return largest, unsolved
