"""A compliant gripper that sticks to a rigid surface with friction, or slides on it.

The contact model of section 5.2.1, for any smooth surface in the plane or in space. The gripper is
a spring without inertia, stiffness K, between its nominal endpoint x_nom, which moves as it likes,
and its real endpoint x, which cannot enter the surface. The surface's force on the gripper is

    F = K (x - x_nom) = N n - f v^                                              (4-2), (4-1)

with the normal n out of the material, and the rates follow from F' = K (x' - x_nom') (4-3).

* Free: x = x_nom and F = 0, until x_nom is below the surface. Then the contact is made at that
  point of the surface where the gripper pushes along the normal alone; for a stiffness that is the
  same in every direction it is the nearest one.
* Sticking, x' = 0, while the tangential force is less than mu N.
* Sliding: the tangential force is mu N, against the velocity, ``x' = s v^`` with ``v^ = -F_t /
  |F_t|``. The speed s >= 0 keeps it so, d/dt (|F_t| - mu N) = 0, with n turning along the surface
  and mu changing from place to place.
* The contact is broken where N would be negative, before or behind a slide. If x_nom is below the
  surface then, it is made again, elsewhere.

A new contact point depends on x_nom's new place and on the contact before. In the plane it is
exact for any step while x_nom's motion does not reverse: the first point ahead where friction
holds, or after a drop of the friction the point that x jumps to. (A step of many wavelengths of
the friction may pass over the first of several such points.) In space each step follows the
surface in a plane, along the mean of its first and last direction; the path is second-order
accurate in the step. Force, normal and rates always fit the point that is reached.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    LeafSystem,
    ValueProducer,
)

from chamfer.models.compiled import compiled, interpreted
from chamfer.models.surfaces.friction import SurfaceFriction, friction_at
from chamfer.models.surfaces.nearest import find_nearest, too_far, uncoded
from chamfer.models.surfaces.surface import Surface
from chamfer.models.surfaces.surface_code import evaluate, surface_code
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.ports import finite_input

Array = NDArray[np.float64]

ROUNDING: Final = 1e-12  # of a force, relative to the whole force

_SLIPPERY: Final = 1e-9  # coefficient of friction that counts as none
_NEWTON: Final = 12  # iterations
_CLOSE: Final = 1e-16  # m, error of the point
_MARCH: Final = 2000  # steps to a jump's end
_HALVINGS: Final = 100

FREE: Final = 0
STICK: Final = 1
SLIP: Final = 2


class Spring(NamedTuple):
    """A spring's force at any point of a surface, for one nominal position and velocity."""

    surface: Array  # its code
    friction: Array  # its six numbers
    K: Array  # (d, d), N/m, symmetric positive definite
    x_nom: Array
    v_nom: Array


class Look(NamedTuple):
    """The quantities at a point of the surface, or very near to it."""

    p: Array
    level: float
    size: float  # of the level's gradient
    n: Array
    hessian: Array
    force: Array
    push: float  # N
    pull: Array  # F_t
    drag: float  # |F_t|
    mu: float
    rise: float  # 1/m, of mu along x
    excess: float  # |F_t| - mu N: positive where friction does not hold


@compiled
def _dot(a: Array, b: Array) -> float:
    return float(a @ b)


@compiled
def _length(vector: Array) -> float:
    return math.sqrt(_dot(vector, vector))


@compiled
def _look(spring: Spring, p: Array) -> Look:
    """Return the quantities at a point, m."""
    gradient, hessian = np.empty_like(p), np.empty_like(spring.K)
    level = evaluate(spring.surface, 0, p, gradient, hessian)
    size = _length(gradient)
    n = gradient / size
    force = spring.K @ (p - spring.x_nom)
    push = _dot(n, force)
    pull = force - push * n
    drag = _length(pull)
    mu, rise = friction_at(spring.friction, p[0])
    return Look(p, level, size, n, hessian, force, push, pull, drag, mu, rise, drag - mu * push)


@compiled
def _is_outside(spring: Spring) -> bool:
    """Return whether the nominal endpoint is outside of the material, or on the surface."""
    x, K = spring.x_nom, spring.K
    return bool(evaluate(spring.surface, 0, x, np.empty_like(x), np.empty_like(K)) >= 0.0)


@compiled
def _growth(spring: Spring, look: Look) -> Array:
    """Return the excess' gradient for places along the surface and near it, N/m.

    From |F_t|' = (F_t . K u) / |F_t| - N (F_t . n') / |F_t| and N' = n . K u + F_t . n', with
    n' = P H u / size, where P takes away the part along n.
    """
    growth: Array = spring.K @ (look.pull / look.drag - look.mu * look.n)
    growth -= (look.push / look.drag + look.mu) / look.size * (look.hessian @ look.pull)
    growth[0] -= look.push * look.rise
    return growth


@compiled
def _velocity(spring: Spring, look: Look) -> tuple[bool, Array]:
    """Return the velocity of a point where friction holds, or just holds.

    False, and rest, if it just holds and does not hold a little further on.
    """
    whole, rest = _length(look.force), np.zeros(len(look.p))
    if look.mu <= _SLIPPERY:
        return True, _frictionless(spring, look)
    if look.excess < -ROUNDING * whole or not look.drag > ROUNDING * whole:
        return True, rest
    ahead = look.pull / -look.drag
    ahead -= _dot(ahead, look.n) * look.n
    driven = spring.K @ spring.v_nom
    rate = _dot(ahead, driven) + look.mu * _dot(look.n, driven)
    if rate <= ROUNDING * _length(driven):
        return True, rest
    growth = _dot(_growth(spring, look), ahead)
    if growth < 0.0:
        return True, -rate / growth * ahead
    return False, rest


@compiled
def _frictionless(spring: Spring, look: Look) -> Array:
    """Return the velocity with which the force stays along the normal."""
    d = len(look.p)
    system, right = np.zeros((d + 1, d + 1)), np.zeros(d + 1)
    system[:d, :d] = spring.K - look.push / look.size * look.hessian
    system[d, :d], system[:d, d], right[:d] = look.n, look.n, spring.K @ spring.v_nom
    return np.linalg.solve(system, right)[:d].astype(np.float64)


# The way to the point where friction holds


@compiled
def _slide(spring: Spring, start: Look, before: Array) -> tuple[bool, Look]:
    """Return the point where a slide from a point where friction does not hold ends.

    That is the first on the way where it holds; False if the contact is lost before. ``before``,
    m/s, is the velocity before, zeros at the begin of sliding.
    """
    ahead = start.pull / -start.drag
    found, end = _newton(spring, start, ahead)
    if found:
        return True, _straightened(spring, start, end, before)
    held, end = _march(spring, start, ahead)
    if end.push < 0.0:
        return False, end
    return (True, end) if held else _unloaded(spring, end)


@compiled
def _unloaded(spring: Spring, start: Look) -> tuple[bool, Look]:
    """Return where friction holds on the way to the point without tangential force.

    Little friction leaves a cone that a long step against the force may miss. False if the nominal
    endpoint is outside.
    """
    if _is_outside(spring):
        return False, start
    goal = _look(spring, find_nearest(spring.surface, spring.x_nom, spring.K))
    way = goal.p - start.p
    ahead = way - _dot(way, start.n) * start.n
    length = _length(ahead)
    if goal.excess >= 0.0 or length == 0.0:
        return True, goal
    return True, _first(spring, start.p, way, ahead / length, start.n, 1.0)


@compiled
def _straightened(spring: Spring, start: Look, end: Look, before: Array) -> Look:
    """Return a slide's end in space along the mean of its first and last direction."""
    speed = _length(before)
    if len(before) == 2 or speed == 0.0 or end.drag == 0.0:
        return end
    ahead = before / speed - end.pull / end.drag
    ahead -= _dot(ahead, start.n) * start.n
    length, travelled = _length(ahead), _length(end.p - start.p)
    # In steps longer than the spring's tangential stretch the mean would swing to and fro.
    if length < 1.0 or travelled > end.drag / _stiffness_along(spring, end):
        return end
    found, straight = _newton(spring, start, ahead / length)
    return straight if found else end


@compiled
def _stiffness_along(spring: Spring, look: Look) -> float:
    """Return the stiffness in the tangential force's direction, N/m."""
    return _dot(look.pull, spring.K @ look.pull) / (look.drag * look.drag)


@compiled
def _newton(spring: Spring, start: Look, ahead: Array) -> tuple[bool, Look]:
    """Return the end of a short, smooth slide; False if it is not clearly that."""
    here, first, travelled = start, 0.0, 0.0
    stiff = _stiffness_along(spring, start)
    for _ in range(_NEWTON):
        if here.drag == 0.0:
            return False, here
        along, across, tilt = _section(here.n, ahead, start.n)
        growth = _growth(spring, here)
        ascent = _dot(growth, along)
        if not ascent < 0.0:
            return False, here
        down = -here.level / (here.size * tilt)
        step = -(here.excess + down * _dot(growth, across)) / ascent
        travelled += step
        if first == 0.0:
            first = step
        here = _look(spring, here.p + step * along + down * across)
        # Newton's error, at most about the step's square over the spring's stretch.
        if (step * step + down * down) * stiff < _CLOSE * here.drag:
            smooth = first > 0.0 and 0.5 * first <= travelled <= 2.0 * first
            return smooth and here.push >= 0.0 and _dot(here.pull, along) < 0.0, here
    return False, here


@compiled
def _march(spring: Spring, start: Look, ahead: Array) -> tuple[bool, Look]:
    """Follow the surface to the first point where friction holds.

    Returns:
        Whether friction holds there, and the point. Without friction to hold it, it is where
        the contact is lost or where the pull in this direction ends.
    """
    stretch = start.drag / _stiffness_along(spring, start) / 64.0
    here = start
    for _ in range(_MARCH):
        along, _across, _tilt = _section(here.n, ahead, start.n)
        bend = _dot(along, here.hessian @ along) / here.size
        step = min(stretch, 0.1 / (abs(bend) + 1e-9))
        there = _onto(spring, here.p + step * along, ahead, start.n)
        if there.push >= 0.0 and there.excess <= 0.0:
            return True, _first(spring, here.p, along, ahead, start.n, step)
        if there.push < 0.0 or _dot(there.pull, along) >= 0.0:
            return False, there
        here = there
    return False, here


@compiled
def _first(spring: Spring, origin: Array, way: Array, ahead: Array, up: Array, end: float) -> Look:
    """Return where friction holds first between an origin and a part of a way from it, by halving.

    It is one of the two if there is no such place between them.
    """
    here = _onto(spring, origin, ahead, up)
    if here.excess <= 0.0:
        return here
    here = _onto(spring, origin + end * way, ahead, up)
    if here.excess >= 0.0:
        return here
    first, step = 0.0, end
    for _ in range(_HALVINGS):
        step *= 0.5
        middle = first + step
        here = _onto(spring, origin + middle * way, ahead, up)
        if here.excess >= 0.0:
            first = middle
        if here.excess == 0.0 or step < 1e-17 + 1e-15 * middle:
            break
    return here


@compiled
def _onto(spring: Spring, p: Array, ahead: Array, up: Array) -> Look:
    """Return the point of the surface below or above p, in the plane of the two directions."""
    look = _look(spring, p)
    for _ in range(_NEWTON):
        _along, across, tilt = _section(look.n, ahead, up)
        down = -look.level / (look.size * tilt)
        if abs(down) < 1e-15:
            break
        look = _look(spring, look.p + down * across)
    return look


@compiled
def _section(n: Array, ahead: Array, up: Array) -> tuple[Array, Array, float]:
    """Return the surface's directions in the plane of two orthonormal directions.

    Returns:
        The tangent, the normal within the plane, and the length of the normal's part in it.
    """
    a, b = _dot(n, ahead), _dot(n, up)
    length = math.hypot(a, b)
    a, b = a / length, b / length
    return b * ahead - a * up, a * ahead + b * up, length


@compiled
def _moved(spring: Spring, point: Array, velocity: Array) -> tuple[bool, Look]:
    """Return where a contact point is now, from point and velocity before; False if it is lost."""
    look = _look(spring, point)
    least = ROUNDING * _length(look.force)
    if look.push < 0.0 and (_is_outside(spring) or not look.drag > least):
        return False, look
    if look.excess > least:
        # Without friction the contact is made anew, its force along the normal.
        if look.mu <= _SLIPPERY or abs(look.mu * look.push) <= least:
            return False, look
    elif _velocity(spring, look)[0]:
        return True, look
    return _slide(spring, look, velocity)


@compiled
def next_contact(
    surface: Array, friction: Array, stiffness: Array, before: Array, motion: Array
) -> Array:
    """Return the contact after the nominal endpoint has moved, shape (5d + 1,).

    Point, velocity, normal and mode, as the block's ``contact``, then the force on the gripper, N,
    and its rate, N/s.

    Args:
        surface: Its code.
        friction: Its six numbers.
        stiffness: N/m, shape (d, d), symmetric positive definite.
        before: The contact before, of which the first 3d + 1 numbers are read.
        motion: The nominal endpoint, m, then its velocity, m/s, shape (2d,).

    Raises:
        ArithmeticError: If the nominal endpoint is too deep in the material for a new contact.
    """
    d = len(stiffness)
    spring = Spring(surface, friction, stiffness, motion[:d], motion[d:])
    kept = False
    if before[3 * d] != FREE:
        kept, look = _moved(spring, before[:d].copy(), before[d : 2 * d])
    if not kept:
        if _is_outside(spring):
            return np.append(motion, np.zeros(3 * d + 1))
        look = _look(spring, find_nearest(surface, spring.x_nom, stiffness))
    velocity = _velocity(spring, look)[1]  # at rest if it cannot slide steadily
    rate = stiffness @ (velocity - spring.v_nom)  # (4-3)
    mode = np.full(1, float(SLIP if velocity.any() else STICK))
    return np.concatenate((look.p, velocity, look.n, mode, look.force, rate))


def contact_on(surface: Surface) -> Callable[..., Array]:
    """Return :func:`next_contact` on a surface; one of a user's own class is not compiled.

    Raises:
        ParameterError: When called, if the nominal endpoint is too deep in the material for a new
            contact.
    """
    code: Any = surface_code(surface)
    step = next_contact
    if code is None:
        code, own = surface, {"evaluate": uncoded}
        step = interpreted(next_contact, **own, find_nearest=interpreted(find_nearest, **own))

    def following(friction: Array, stiffness: Array, before: Array, motion: Array) -> Array:
        try:
            return step(code, friction, stiffness, before, motion)
        except ArithmeticError as error:
            raise too_far(motion[: len(stiffness)]) from error

    return following


class Touch(NamedTuple):
    """The contact at one time; d is the surface's dimension."""

    point: Array  # x, (d,), m
    velocity: Array  # of the point, (d,), m/s
    force: Array  # of the surface on the gripper, (d,), N
    force_rate: Array  # (d,), N/s
    normal: Array  # out of the material, (d,), unit; zeros while free
    mode: int  # FREE, STICK or SLIP


def advance(
    surface: Surface,
    friction: SurfaceFriction,
    stiffness: Array,
    previous: Touch | None,
    nominal_position: Array,
    nominal_velocity: Array,
) -> Touch:
    """Return the contact after the gripper's nominal endpoint has moved.

    ``stiffness``, N/m, shape (d, d), is symmetric and positive definite, d = 2 or 3. Of
    ``previous``, free if None, the point, the velocity's direction and the mode matter.
    ``nominal_velocity``, m/s, decides the rates, not the point.

    Raises:
        ParameterError: if the nominal endpoint is too deep in the material for a new contact.
    """
    d = surface.dimension
    before = np.zeros(3 * d + 1)
    if previous is not None:
        p, v, n, mode = previous.point, previous.velocity, previous.normal, previous.mode
        before = np.concatenate((p, v, n, [float(mode)]))
    motion = np.concatenate((nominal_position, nominal_velocity))
    found = contact_on(surface)(friction.numbers, np.array(stiffness, float), before, motion)
    x, v, n, _, force, rate = np.split(found, [d, 2 * d, 3 * d, 3 * d + 1, 4 * d + 1])
    return Touch(x, v, force, rate, n, int(found[3 * d]))


@dataclass(frozen=True, kw_only=True)
class SlidingContactParams:
    """Parameters of :class:`SlidingContact`."""

    # N/m, K by rows, symmetric positive definite (section 5.2.1)
    stiffness: tuple[tuple[float, ...], ...] = ((100.0, 0.0), (0.0, 100.0))
    friction: SurfaceFriction = SurfaceFriction()  # mu = 1 (section 5.2.1)
    step: float = 1e-3  # s, after which the contact point is stored

    def __post_init__(self) -> None:
        require_positive(self, "step")
        rows = self.stiffness
        size = len(rows)
        if size not in (2, 3) or any(len(row) != size for row in rows):
            raise ParameterError("stiffness", rows, "2 rows of 2 numbers or 3 rows of 3")
        matrix = np.array(rows, dtype=float)
        if not (
            np.all(np.isfinite(matrix))
            and np.array_equal(matrix, matrix.T)
            and np.linalg.eigvalsh(matrix)[0] > 0
        ):
            raise ParameterError("stiffness", rows, "a symmetric positive definite matrix")


class SlidingContact(LeafSystem):
    """Simulates a compliant gripper at a rigid surface with friction (section 5.2.1).

    .. pydrake_system::

        name: SlidingContact
        input_ports:
        - nominal_motion
        output_ports:
        - contact_force
        - contact_force_rate
        - contact

    ``nominal_motion``, shape (2d,): the nominal endpoint's position, m, then its velocity, m/s.
    ``contact_force``, shape (d,), N, of the surface on the gripper, and its rate, shape (d,), N/s,
    belong to the nominal motion of the same time. ``contact``, shape (3d + 1,), has the contact
    point, m, its velocity, m/s, the normal, zeros while free, and the mode, :data:`FREE`,
    :data:`STICK` or :data:`SLIP`.

    Discrete state: ``contact`` of the last step, shape (3d + 1,), from which the contact
    continues; free before the first.

    Raises:
        ParameterError: if the stiffness is not of the surface's dimension; while running, if the
            nominal motion is not finite, or too deep in the material when contact is made.
    """

    def __init__(self, surface: Surface, params: SlidingContactParams) -> None:
        super().__init__()
        d = surface.dimension
        if len(params.stiffness) != d:
            raise ParameterError("stiffness", params.stiffness, f"{d} rows, as the surface has")
        self.surface, self.params = surface, params
        step = contact_on(surface)
        friction, stiffness = params.friction.numbers, np.array(params.stiffness, dtype=float)
        nominal_motion = self.DeclareVectorInputPort("nominal_motion", 2 * d)
        stored = self.DeclareDiscreteState(3 * d + 1)

        def solve(context: Context, value: AbstractValue) -> None:
            motion = np.array(finite_input(nominal_motion, context))
            before = np.array(context.get_discrete_state(stored).value())
            value.set_value(step(friction, stiffness, before, motion))

        # One solution for all ports and the update.
        solution = self.DeclareCacheEntry(
            "contact",
            ValueProducer(allocate=lambda: AbstractValue.Make(None), calc=solve),
            {nominal_motion.ticket(), self.discrete_state_ticket(stored)},
        )
        for name, part in (
            ("contact_force", slice(3 * d + 1, 4 * d + 1)),
            ("contact_force_rate", slice(4 * d + 1, 5 * d + 1)),
            ("contact", slice(3 * d + 1)),
        ):

            def calc(context: Context, vector: BasicVector, part: slice = part) -> None:
                vector.SetFromVector(solution.Eval(context)[part])

            size = len(range(5 * d + 1)[part])
            self.DeclareVectorOutputPort(name, size, calc, {solution.ticket()})

        def store(context: Context, values: DiscreteValues) -> None:
            values.set_value(stored, solution.Eval(context)[: 3 * d + 1])

        self.DeclarePeriodicDiscreteUpdateEvent(params.step, 0.0, store)
