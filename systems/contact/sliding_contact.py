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

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.nearest import nearest
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.contact.spring_on_surface import REST, ROUNDING, Look, SpringOnSurface

Array = NDArray[np.float64]

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

    Args:
        surface: d = 2 or 3.
        friction: of the surface.
        stiffness: N/m, symmetric positive definite, shape (d, d).
        previous: the contact before, of which the point, the velocity's direction and the mode
            matter; free if None.
        nominal_position: m, shape (d,), now.
        nominal_velocity: m/s, shape (d,), now. It decides the rates, not the point.

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
        self.surface = surface
        self.params = params
        self._d = d
        self._stiffness = np.array(params.stiffness, dtype=float)
        self.nominal_motion = self.DeclareVectorInputPort("nominal_motion", 2 * d)
        self._stored = self.DeclareDiscreteState(3 * d + 1)
        sources = {self.nominal_motion.ticket(), self.discrete_state_ticket(self._stored)}
        # One solution for all ports and the update.
        self._solution = self.DeclareCacheEntry(
            "contact",
            ValueProducer(allocate=lambda: AbstractValue.Make(None), calc=self._solve),
            sources,
        )
        solved = {self._solution.ticket()}
        for name, size, calc in (
            ("contact_force", d, self._calc_force),
            ("contact_force_rate", d, self._calc_force_rate),
            ("contact", 3 * d + 1, self._calc_contact),
        ):
            self.DeclareVectorOutputPort(name, size, calc, solved)
        self.DeclarePeriodicDiscreteUpdateEvent(params.step, 0.0, self._store)

    def touch(self, context: Context) -> Touch:
        """Return the contact now."""
        touch: Touch = self._solution.Eval(context)
        return touch

    def _solve(self, context: Context, value: AbstractValue) -> None:
        d, motion = self._d, self.nominal_motion.Eval(context)
        if not all(map(math.isfinite, motion.tolist())):
            raise ParameterError("nominal_motion", motion.tolist(), "finite numbers")
        stored = context.get_discrete_state(self._stored).value()
        mode = int(stored[-1])
        previous = None
        if mode != FREE:
            x, v, n = stored[:d].copy(), stored[d : 2 * d].copy(), stored[2 * d : 3 * d].copy()
            previous = Touch(x, v, np.zeros(d), np.zeros(d), n, mode)
        value.set_value(
            advance(
                self.surface,
                self.params.friction,
                self._stiffness,
                previous,
                motion[:d],
                motion[d:],
            )
        )

    def _calc_force(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self.touch(context).force)

    def _calc_force_rate(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self.touch(context).force_rate)

    def _calc_contact(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(self._packed(context))

    def _store(self, context: Context, values: DiscreteValues) -> None:
        values.get_mutable_vector(self._stored).SetFromVector(self._packed(context))

    def _packed(self, context: Context) -> Array:
        touch = self.touch(context)
        return np.concatenate((touch.point, touch.velocity, touch.normal, [touch.mode]))
