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
from typing import Final, NamedTuple

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
from scipy.optimize import bisect

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.nearest import nearest
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.ports import finite_input

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

REST: Final = (0.0, 0.0, 0.0)
ROUNDING: Final = 1e-12  # of a force, relative to the whole force

_SLIPPERY: Final = 1e-9  # coefficient of friction that counts as none
_NEWTON: Final = 12  # iterations
_CLOSE: Final = 1e-16  # m, error of the point
_MARCH: Final = 2000  # steps to a jump's end


class Look(NamedTuple):
    """What is known at a point of the surface, or very near to it."""

    p: Triple
    place: Array  # p, (d,)
    level: float
    size: float  # of the level's gradient
    n: Triple
    force: Triple
    push: float  # N
    pull: Triple  # F_t
    drag: float  # |F_t|
    mu: float
    excess: float  # |F_t| - mu N: positive where friction does not hold


class SpringOnSurface:
    """A spring's force at any point of a surface, for one nominal position and velocity.

    ``stiffness``, N/m, shape (d, d), is symmetric positive definite.
    """

    def __init__(
        self,
        surface: Surface,
        friction: SurfaceFriction,
        stiffness: Array,
        nominal_position: Array,
        nominal_velocity: Array,
    ) -> None:
        self.surface, self.friction, self.stiffness = surface, friction, stiffness
        self.nominal_position, self.nominal_velocity = nominal_position, nominal_velocity
        self.d = surface.dimension
        self.K = _rows(stiffness)
        self.x_nom = _triple(nominal_position)
        self.v_nom = _triple(nominal_velocity)

    def is_outside(self) -> bool:
        """Return whether the nominal endpoint is outside of the material, or on the surface."""
        return self.surface.level(self.nominal_position) >= 0

    def is_slippery(self, look: Look) -> bool:
        """Return whether friction is too small to tell a direction from."""
        return look.mu <= _SLIPPERY

    def look_at(self, point: Array) -> Look:
        """Return what is known at a point of the surface, shape (d,), m."""
        return self._look(_triple(point))

    def _look(self, p: Triple) -> Look:
        place = np.array(p[: self.d])
        level = self.surface.level(place)
        gradient = _triple(self.surface.gradient(place))
        size = math.sqrt(_dot(gradient, gradient))
        n = (gradient[0] / size, gradient[1] / size, gradient[2] / size)
        a, b, c = self.x_nom
        force = _times(self.K, (p[0] - a, p[1] - b, p[2] - c))
        push = _dot(n, force)
        pull = _plus(force, -push, n)
        drag = math.sqrt(_dot(pull, pull))
        mu = self.friction.at(place)
        return Look(p, place, level, size, n, force, push, pull, drag, mu, drag - mu * push)

    def _growth(self, look: Look) -> Triple:
        """Return the excess' gradient for places along the surface and near it, N/m.

        From |F_t|' = (F_t . K u) / |F_t| - N (F_t . n') / |F_t| and N' = n . K u + F_t . n', with
        n' = P H u / size, where P takes away the part along n.
        """
        hessian = _rows(self.surface.hessian(look.place))
        stiff = _times(self.K, _plus(_scaled(look.pull, 1 / look.drag), -look.mu, look.n))
        bent = _times(hessian, look.pull)
        rise = _triple(self.friction.gradient(look.place))
        growth = _plus(stiff, -(look.push / look.drag + look.mu) / look.size, bent)
        return _plus(growth, -look.push, rise)

    def velocity(self, look: Look) -> Triple | None:
        """Return the velocity of a point where friction holds, or just holds.

        None if it just holds and does not hold a little further on.
        """
        whole = math.sqrt(_dot(look.force, look.force))
        if self.is_slippery(look):
            return self._frictionless(look)
        if look.excess < -ROUNDING * whole or not look.drag > ROUNDING * whole:
            return REST
        ahead = _scaled(look.pull, -1 / look.drag)
        ahead = _plus(ahead, -_dot(ahead, look.n), look.n)
        driven = _times(self.K, self.v_nom)
        rate = _dot(ahead, driven) + look.mu * _dot(look.n, driven)
        if rate <= ROUNDING * math.sqrt(_dot(driven, driven)):
            return REST
        growth = _dot(self._growth(look), ahead)
        return _scaled(ahead, -rate / growth) if growth < 0 else None

    def force_rate(self, velocity: Triple) -> Triple:
        """Return the force's rate (4-3), N/s, at a velocity of the point, m/s."""
        x, y, z = velocity
        a, b, c = self.v_nom
        return _times(self.K, (x - a, y - b, z - c))

    def _frictionless(self, look: Look) -> Triple:
        """Return the velocity with which the force stays along the normal."""
        n, bend = np.array(look.n[: self.d]), self.surface.hessian(look.place) / look.size
        tangents = np.linalg.svd(n[np.newaxis])[2][1:]
        stiff = tangents @ (self.stiffness - look.push * bend) @ tangents.T
        driven = tangents @ (self.stiffness @ self.nominal_velocity)
        return _triple(np.linalg.solve(stiff, driven) @ tangents)

    # The way to the point where friction holds

    def slide(self, start: Look, before: Array) -> Look | None:
        """Return the point where a slide from a point where friction does not hold ends.

        That is the first on the way where it holds; None if the contact is lost before.
        ``before``, m/s, is the velocity before, zeros at the begin of sliding.
        """
        ahead = _scaled(start.pull, -1 / start.drag)
        found = self._newton(start, ahead)
        if found is not None:
            return self._straightened(start, found, before)
        held, end = self._march(start, ahead)
        if end.push < 0:
            return None
        return end if held else self._unloaded(end)

    def _unloaded(self, start: Look) -> Look | None:
        """Return where friction holds on the way to the point without tangential force.

        Little friction leaves a cone that a long step against the force may miss.
        """
        if self.is_outside():
            return None
        target = nearest(self.surface, self.nominal_position, self.stiffness)
        goal = self._look(_triple(target))
        way = _plus(goal.p, -1.0, start.p)
        ahead = _plus(way, -_dot(way, start.n), start.n)
        length = math.sqrt(_dot(ahead, ahead))
        if goal.excess >= 0 or length == 0:
            return goal
        ahead = _scaled(ahead, 1 / length)

        def at(part: float) -> Look:
            return self._onto(_plus(start.p, part, way), ahead, start.n)

        return at(_root(lambda part: at(part).excess, 1.0))

    def _straightened(self, start: Look, end: Look, before: Array) -> Look:
        """Return a slide's end in space along the mean of its first and last direction."""
        x, y, z = _triple(before)
        speed = math.sqrt(x * x + y * y + z * z)
        if self.d == 2 or speed == 0 or end.drag == 0:
            return end
        ahead = _plus((x / speed, y / speed, z / speed), -1 / end.drag, end.pull)
        ahead = _plus(ahead, -_dot(ahead, start.n), start.n)
        length = math.sqrt(_dot(ahead, ahead))
        travelled = math.dist(start.p, end.p)
        # In steps longer than the spring's tangential stretch the mean would swing to and fro.
        if length < 1 or travelled > end.drag / self._stiffness_along(end):
            return end
        return self._newton(start, _scaled(ahead, 1 / length)) or end

    def _stiffness_along(self, look: Look) -> float:
        """Return the stiffness in the tangential force's direction, N/m."""
        return _dot(look.pull, _times(self.K, look.pull)) / (look.drag * look.drag)

    def _newton(self, start: Look, ahead: Triple) -> Look | None:
        """Return the end of a short, smooth slide; None if it is not clearly that."""
        here, first, travelled = start, 0.0, 0.0
        stiff = self._stiffness_along(start)
        for _ in range(_NEWTON):
            if here.drag == 0:
                return None
            along, across, tilt = _section(here.n, ahead, start.n)
            growth = self._growth(here)
            ascent = _dot(growth, along)
            if not ascent < 0:
                return None
            down = -here.level / (here.size * tilt)
            step = -(here.excess + down * _dot(growth, across)) / ascent
            first, travelled = first or step, travelled + step
            here = self._look(_plus(_plus(here.p, step, along), down, across))
            # Newton's error, at most about the step's square over the spring's stretch.
            if (step * step + down * down) * stiff < _CLOSE * here.drag:
                smooth = first > 0 and 0.5 * first <= travelled <= 2 * first
                forward = here.push >= 0 and _dot(here.pull, along) < 0
                return here if smooth and forward else None
        return None

    def _march(self, start: Look, ahead: Triple) -> tuple[bool, Look]:
        """Follow the surface to the first point where friction holds.

        Returns:
            Whether friction holds there, and the point. Without friction to hold it, it is where
            the contact is lost or where the pull in this direction ends.
        """
        stretch = start.drag / self._stiffness_along(start) / 64
        here = start
        for _ in range(_MARCH):
            along, _, _ = _section(here.n, ahead, start.n)
            origin, direction = here.p, along

            def at(step: float, origin: Triple = origin, direction: Triple = direction) -> Look:
                return self._onto(_plus(origin, step, direction), ahead, start.n)

            step = min(stretch, 0.1 / (abs(self._bend(here, along)) + 1e-9))
            there = at(step)
            if there.push >= 0 and there.excess <= 0:
                return True, at(_root(lambda s: at(s).excess, step))
            if there.push < 0 or _dot(there.pull, along) >= 0:
                return False, there
            here = there
        return False, here

    def _onto(self, p: Triple, ahead: Triple, up: Triple) -> Look:
        """Return the point of the surface below or above p, in the plane of the two directions."""
        look = self._look(p)
        for _ in range(_NEWTON):
            _, across, tilt = _section(look.n, ahead, up)
            down = -look.level / (look.size * tilt)
            if abs(down) < 1e-15:
                break
            look = self._look(_plus(look.p, down, across))
        return look

    def _bend(self, look: Look, along: Triple) -> float:
        hessian = _rows(self.surface.hessian(look.place))
        return _dot(along, _times(hessian, along)) / look.size


def _root(function: Callable[[float], float], end: float) -> float:
    """Return a zero between 0 and the end; one of the two if the function has no zero there."""
    if function(0.0) <= 0:
        return 0.0
    if function(end) >= 0:
        return end
    return float(bisect(function, 0.0, end, xtol=1e-17, rtol=1e-15))


def _section(n: Triple, ahead: Triple, up: Triple) -> tuple[Triple, Triple, float]:
    """Return the surface's directions in the plane of two orthonormal directions.

    Returns:
        The tangent, the normal within the plane, and the length of the normal's part in it.
    """
    a, b = _dot(n, ahead), _dot(n, up)
    length = math.hypot(a, b)
    a, b = a / length, b / length
    along = _plus(_scaled(ahead, b), -a, up)
    return along, _plus(_scaled(ahead, a), b, up), length


def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _plus(a: Triple, scale: float, b: Triple) -> Triple:
    return a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]


def _scaled(a: Triple, scale: float) -> Triple:
    return scale * a[0], scale * a[1], scale * a[2]


def _times(rows: tuple[Triple, Triple, Triple], a: Triple) -> Triple:
    x, y, z = a
    (p, q, r), (s, t, u), (v, w, k) = rows
    return p * x + q * y + r * z, s * x + t * y + u * z, v * x + w * y + k * z


def _padded(values: list[float]) -> Triple:
    x, y, z = [*values, 0.0][:3]
    return x, y, z


def _triple(values: Array) -> Triple:
    return _padded(values.tolist())


def _rows(matrix: Array) -> tuple[Triple, Triple, Triple]:
    first, second, third = [*map(_padded, matrix.tolist()), REST][:3]
    return first, second, third


FREE: Final = 0
STICK: Final = 1
SLIP: Final = 2


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
    spring = SpringOnSurface(surface, friction, stiffness, nominal_position, nominal_velocity)
    if previous is not None and previous.mode != FREE:
        look = _moved(spring, previous)
        if look is not None:
            return _touch(spring, look)
    if spring.is_outside():
        zeros = np.zeros(surface.dimension)
        x, v = nominal_position.copy(), nominal_velocity.copy()
        return Touch(x, v, zeros, zeros, zeros, FREE)
    return _touch(spring, spring.look_at(nearest(surface, nominal_position, stiffness)))


def _moved(spring: SpringOnSurface, previous: Touch) -> Look | None:
    """Return where the contact point is now; None if the contact is lost."""
    look = spring.look_at(previous.point)
    least = ROUNDING * math.hypot(*look.force)
    if look.push < 0 and (spring.is_outside() or not look.drag > least):
        return None
    if look.excess > least:
        # Without friction the contact is made anew, its force along the normal.
        if spring.is_slippery(look) or abs(look.mu * look.push) <= least:
            return None
    elif spring.velocity(look) is not None:
        return look
    return spring.slide(look, previous.velocity)


def _touch(spring: SpringOnSurface, look: Look) -> Touch:
    """Return the contact at a point where friction holds; at rest if it cannot slide steadily."""
    velocity = spring.velocity(look) or REST
    d = spring.d
    return Touch(
        look.place,
        np.array(velocity[:d]),
        np.array(look.force[:d]),
        np.array(spring.force_rate(velocity)[:d]),
        np.array(look.n[:d]),
        SLIP if any(velocity) else STICK,
    )


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
    """A compliant gripper at a rigid surface with friction (section 5.2.1).

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
    belong to the nominal motion of the same time. ``contact``, shape (3d + 1,): the
    contact point, m, its velocity, m/s, the normal, zeros while free, and the mode, :data:`FREE`,
    :data:`STICK` or :data:`SLIP`.

    Discrete state: ``contact`` of the last step, shape (3d + 1,), from which the contact goes on;
    free before the first.

    Raises:
        ParameterError: if the stiffness is not of the surface's dimension; while running, if the
            nominal motion is not finite, or too deep in the material when contact is made.
    """

    def __init__(self, surface: Surface, params: SlidingContactParams) -> None:
        super().__init__()
        d = surface.dimension
        if len(params.stiffness) != d:
            raise ParameterError("stiffness", params.stiffness, f"{d} rows, as the surface has")
        self.surface, self.params, self._d = surface, params, d
        self._stiffness = np.array(params.stiffness, dtype=float)
        self.nominal_motion = self.DeclareVectorInputPort("nominal_motion", 2 * d)
        self._stored = self.DeclareDiscreteState(3 * d + 1)
        # One solution for all ports and the update.
        self._solution = self.DeclareCacheEntry(
            "contact",
            ValueProducer(allocate=lambda: AbstractValue.Make(None), calc=self._solve),
            {self.nominal_motion.ticket(), self.discrete_state_ticket(self._stored)},
        )
        for name, size, part in (
            ("contact_force", d, lambda touch: touch.force),
            ("contact_force_rate", d, lambda touch: touch.force_rate),
            ("contact", 3 * d + 1, _packed),
        ):

            def calc(
                context: Context, vector: BasicVector, part: Callable[[Touch], Array] = part
            ) -> None:
                vector.SetFromVector(part(self.touch(context)))

            self.DeclareVectorOutputPort(name, size, calc, {self._solution.ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(params.step, 0.0, self._store)

    def touch(self, context: Context) -> Touch:
        """Return the contact now."""
        touch: Touch = self._solution.Eval(context)
        return touch

    def _solve(self, context: Context, value: AbstractValue) -> None:
        d, motion = self._d, finite_input(self.nominal_motion, context)
        stored = context.get_discrete_state(self._stored).value()
        mode = int(stored[-1])
        previous = None
        if mode != FREE:
            x, v, n = stored[:d].copy(), stored[d : 2 * d].copy(), stored[2 * d : 3 * d].copy()
            previous = Touch(x, v, np.zeros(d), np.zeros(d), n, mode)
        now = advance(
            self.surface, self.params.friction, self._stiffness, previous, motion[:d], motion[d:]
        )
        value.set_value(now)

    def _store(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(self._stored, _packed(self.touch(context)))


def _packed(touch: Touch) -> Array:
    return np.concatenate((touch.point, touch.velocity, touch.normal, [touch.mode]))
