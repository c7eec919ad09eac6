"""Desired motions of an arm that touches: up to a surface, along a known or an estimated one."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, ValueProducer

from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.compiled import compiled
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT
from chamfer.systems.force.projection import position_selection, unit
from chamfer.systems.ports import finite_input

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ApproachParams:
    """An approach, after which the position is held; m is the endpoint vector's size."""

    start: tuple[float, ...]  # m or rad, the endpoint at the start
    direction: tuple[float, ...]  # of the approach, in endpoint coordinates, of any length
    along: tuple[float, ...]  # of the motion in contact, in endpoint coordinates, of any length
    speed: float  # m/s, of the approach
    acceleration: float = 10.0  # m/s^2, with which the approach begins

    def __post_init__(self) -> None:
        require_positive(self, "speed", "acceleration")
        if not all(math.isfinite(value) for value in self.start):
            raise ParameterError("start", self.start, "finite numbers")
        for name in ("direction", "along"):
            vector = getattr(self, name)
            if len(vector) != len(self.start):
                raise ParameterError(name, vector, f"{len(self.start)} numbers")
            unit(np.array(vector), name)

    @property
    def period(self) -> float | None:
        """Period of the motion in contact, s; None if the position is held."""
        return None

    @property
    def code(self) -> "GuardedCode":
        """The same for :func:`guarded_position`."""
        direction = unit(np.array(self.direction), "direction")
        along, start = unit(np.array(self.along), "along"), np.array(self.start, np.float64)
        ramp = float(self.speed), float(self.acceleration)
        return GuardedCode(start, direction, along, *ramp, 0.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class GuardedMotionParams(ApproachParams):
    """An approach, after which the arm moves to and fro along the surface."""

    amplitude: float = 0.0  # m, of the sinusoid in contact; 0 holds the position
    frequency: float = 1.0  # rad/s, of the sinusoid
    blend: float = 0.5  # s, in which the sinusoid grows to its amplitude

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "frequency", "blend")
        require_not_negative(self, "amplitude")

    @property
    def period(self) -> float | None:
        """Period of the motion in contact, s; None if the position is held."""
        return 2 * math.pi / self.frequency if self.amplitude else None

    @property
    def code(self) -> "GuardedCode":
        """The same for :func:`guarded_position`."""
        numbers = float(self.amplitude), float(self.frequency), float(self.blend)
        return GuardedCode(*super().code[:5], *numbers)


class GuardedCode(NamedTuple):
    """A guarded motion for machine code."""

    start: Array  # (m,), m or rad
    direction: Array  # (m,), unit, of the approach
    along: Array  # (m,), unit, of the motion in contact
    speed: float
    acceleration: float
    amplitude: float
    frequency: float
    blend: float


@compiled
def approached(time: float, speed: float, acceleration: float) -> float:
    """Return the distance covered in an approach, m, at a time >= 0, s."""
    ramp = speed / acceleration
    if time < ramp:
        return 0.5 * acceleration * time**2
    return speed * (time - 0.5 * ramp)


@compiled
def swung(time: float, amplitude: float, frequency: float, blend: float) -> float:
    """Return the sinusoid, m, at a time after contact, s; it starts with zero velocity."""
    part = min(time / blend, 1.0)
    grown = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    return amplitude * grown * math.sin(frequency * time)


@compiled
def guarded_position(task: GuardedCode, time: float, contact_time: float) -> Array:
    """Return the desired position, shape (m,), at a time, s; the contact's is < 0 before it."""
    touched = contact_time >= 0.0
    into = approached(contact_time if touched else time, task.speed, task.acceleration)
    sideways = 0.0
    if touched:
        sideways = swung(time - contact_time, task.amplitude, task.frequency, task.blend)
    position = np.empty(len(task.start))
    for i in range(len(position)):
        position[i] = task.start[i] + task.direction[i] * into + task.along[i] * sideways
    return position


class GuardedMotion(LeafSystem):
    """Moves towards the surface, and along it after the first contact.

    .. pydrake_system::

        name: GuardedMotion
        input_ports:
        - contact_time
        output_ports:
        - desired_position

    The start of the approach, and the growing motion along the surface, have continuous velocity
    and finite acceleration (section 6.2.2). At contact the approach stops at once; its direction
    is then under force control.

    ``contact_time``, size 1, s, negative before contact. ``desired_position``, shape (m,).
    """

    def __init__(self, params: ApproachParams) -> None:
        super().__init__()
        task = params.code
        contact_time = self.DeclareVectorInputPort("contact_time", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            contact = float(contact_time.Eval(context)[0])
            vector.SetFromVector(guarded_position(task, context.get_time(), contact))

        depends = {self.time_ticket(), contact_time.ticket()}
        self.DeclareVectorOutputPort("desired_position", len(task.start), calc, depends)


_TOLERANCE: Final = 1e-6  # of the normal's length, and of the sine between it and the axis


@dataclass(frozen=True, kw_only=True)
class SurfaceMotionParams:
    """Parameters of :class:`SurfaceMotion`."""

    force: float = 5.0  # N, F_d of (5-6), with which the arm pushes, section 5.3.4
    speed: float = 0.5  # m/s, V_d of (5-6); the sign is that of n x axis, section 5.3.4
    acceleration: float | None = None  # m/s^2, with which the speed is reached; None: at once

    def __post_init__(self) -> None:
        require_positive(self, "force", "acceleration")
        require_finite(self, "speed")


class SurfaceTask(NamedTuple):
    """A motion along a surface for machine code, in d dimensions."""

    turn: Array  # (d, d), what turns n to n x axis
    speed: float  # m/s
    growth: float  # m/s, of the speed in a period at most
    period: float  # s


@compiled
def moved_along(task: SurfaceTask, n: Array, x: Array, held: Array, touches: bool) -> Array:
    """Return the desired position, m, and speed, m/s, of the next period, shape (m + 1,).

    Args:
        task: The motion.
        n: The normal, shape (m,), unit.
        x: Where the endpoint is, m, shape (m,).
        held: What this returned for the period before, shape (m + 1,).
        touches: Whether there is contact; without it the desired position stands still.

    Raises:
        ArithmeticError: If the normal is along the axis.
    """
    m, d, ahead = len(x), len(task.turn), held.copy()
    along = task.turn @ n[:d]
    length = math.sqrt(along @ along)
    if length < _TOLERANCE:
        raise ArithmeticError("the normal is along the axis")
    reached = min(abs(held[m]) + task.growth, abs(task.speed)) if touches else 0.0
    ahead[m] = math.copysign(reached, task.speed)
    ahead[:m] -= x
    ahead[:d] += ahead[m] * task.period / length * along
    ahead[:m] += x - (n @ ahead[:m]) * n
    return ahead


class SurfaceMotion(LeafSystem):
    """Turns an estimate of the surface's normal into a task for the hybrid controller.

    .. pydrake_system::

        name: SurfaceMotion
        input_ports:
        - endpoint_motion
        - normal
        - mode
        - approach
        output_ports:
        - selection
        - desired_force
        - desired_position

    Section 5.3.2. The unit normal n points from the surface to the arm. The position domain is
    ``P = I - n n^T``, the desired force ``-F_d n``, and the desired velocity ``V_d t``. Here t is
    the unit vector along ``n x axis``; in the plane and about z that is (n_y, -n_x). The block
    integrates the desired position over every period T. In the force domain it follows the arm's
    position x: ``x_d <- x + P (x_d + V_d t T - x)``. If the endpoint vector is longer than the
    normal, the further coordinates are held.

    Before contact the position domain is everything, and the desired position is that of the
    approach. The motion along the surface continues from there. It stops while contact is lost,
    and begins again afterwards.

    * ``endpoint_motion``, shape (2m,), is the endpoint vector, m (rad), then its rate, which is
      not used.
    * ``normal``, shape (d,).
    * ``mode``, size 1, of :class:`chamfer.systems.force.contact_detection.ContactDetection`. If it
      is left unconnected, the arm is assumed to be always in contact.
    * ``approach``, shape (m,), is the desired position before contact.
    * ``selection``, shape (m * m,), is P row by row.
    * ``desired_force``, shape (m,), N, is of the arm on its environment.
    * ``desired_position``, shape (m,), m.

    The outputs follow the inputs directly, so a controller with the same ticks receives the values
    of the period that begins. Between the ticks the desired position is that of the next one.

    Discrete state: the last period's desired position, shape (m,), m, and speed, m/s.

    ``start``, m, shape (m,), is the desired position before the first period, s. ``axis`` is z of
    (5-6), of any length, along z in the plane. ``dimension`` is d, 2 or 3, by default m.

    Raises:
        ParameterError: If start or axis is none; while running, if an input is not finite, the
            normal not of unit length, or, in three dimensions, the normal along the axis.
    """

    def __init__(
        self,
        params: SurfaceMotionParams,
        *,
        start: tuple[float, ...],
        axis: tuple[float, float, float] = (0.0, 0.0, 1.0),
        dimension: int | None = None,
        period: float,
    ) -> None:
        super().__init__()
        m = len(start)
        d = m if dimension is None else dimension
        if d not in (2, 3) or m < d or not all(map(math.isfinite, start)):
            allowed = "2 or 3 finite numbers" if dimension is None else f"{d} or more of them"
            raise ParameterError("start", start, allowed)
        x, y, z = unit(np.array(axis), "axis").tolist()
        if d == 2 and (x or y):
            raise ParameterError("axis", axis, "along z in two dimensions")
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])[:d, :d]
        growth = math.inf if params.acceleration is None else params.acceleration * period
        self.task = task = SurfaceTask(turn.copy(), float(params.speed), growth, period)
        motion = self.DeclareVectorInputPort("endpoint_motion", 2 * m)
        normal = self.DeclareVectorInputPort("normal", d)
        mode = self.DeclareVectorInputPort("mode", 1)
        approach = self.DeclareVectorInputPort("approach", m)
        held = self.DeclareDiscreteState(np.array([*start, 0.0]))

        def domain(context: Context) -> int:
            return int(mode.Eval(context)[0]) if mode.HasValue(context) else CONTACT

        def full_normal(context: Context) -> Array:
            return np.append(_unit_normal(normal, context), np.zeros(m - d))

        def calc_selection(context: Context, vector: BasicVector) -> None:
            n = full_normal(context)
            free = domain(context) == APPROACH
            vector.SetFromVector((np.eye(m) if free else position_selection(n)).ravel())

        def calc_force(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(-params.force * full_normal(context))

        def step(context: Context) -> Array:
            if domain(context) == APPROACH:
                return np.append(finite_input(approach, context), 0.0)
            n, position = full_normal(context), finite_input(motion, context)[:m].copy()
            before = context.get_discrete_state(held).value().copy()
            try:
                return moved_along(task, n, position, before, domain(context) == CONTACT)
            except ArithmeticError as error:
                allowed = f"a direction other than that of the axis {axis}"
                raise ParameterError("normal", n[:d].tolist(), allowed) from error

        tickets = {normal.ticket(), mode.ticket()}
        self.DeclareVectorOutputPort("selection", m * m, calc_selection, tickets)
        self.DeclareVectorOutputPort("desired_force", m, calc_force, {normal.ticket()})
        tickets |= {motion.ticket(), approach.ticket(), self.discrete_state_ticket(held)}
        following = self.DeclareCacheEntry(
            "step",
            ValueProducer(
                lambda: AbstractValue.Make(None),
                lambda context, value: value.set_value(step(context)),
            ),
            tickets,
        )
        self.DeclareVectorOutputPort(
            "desired_position",
            m,
            lambda context, vector: vector.SetFromVector(following.Eval(context)[:m]),
            {following.ticket()},
        )
        # The controller's own update has the same context: it sees this value, not the next.
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period,
            0.0,
            lambda context, state: state.get_mutable_discrete_state().set_value(
                held, following.Eval(context)
            ),
        )


def _unit_normal(port: InputPort, context: Context) -> Array:
    normal = finite_input(port, context)
    length = math.hypot(*normal.tolist())
    if abs(length - 1) > _TOLERANCE:
        allowed = f"a vector of length 1 within {_TOLERANCE:g}"
        raise ParameterError(port.get_name(), normal.tolist(), allowed)
    # The rest of the deviation would make P no projection.
    return normal / length
