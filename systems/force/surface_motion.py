"""Motion along a surface whose normal is estimated, while pushing on it: eqs. (5-5), (5-6)."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem
from pydrake.systems.framework import State as DrakeState

from models.validation import ParameterError, require_finite, require_positive
from systems.force.selection import position_selection, unit

Array = NDArray[np.float64]

_TOLERANCE: Final = 1e-6  # of the normal's length, and of the sine between it and the axis


@dataclass(frozen=True, kw_only=True)
class SurfaceMotionParams:
    """Parameters of :class:`SurfaceMotion`."""

    force: float = 5.0  # N, F_d of (5-6), with which the arm pushes, section 5.3.4
    speed: float = 0.5  # m/s, V_d of (5-6); the sign is that of n x axis, section 5.3.4

    def __post_init__(self) -> None:
        require_positive(self, "force")
        require_finite(self, "speed")


class SurfaceMotion(LeafSystem):
    """Turns an estimate of the surface's normal into a task for the hybrid controller.

    .. pydrake_system::

        name: SurfaceMotion
        input_ports:
        - encoders
        - normal
        output_ports:
        - selection
        - desired_force
        - desired_position

    Section 5.3.2. With the unit normal n, which points from the surface to the arm, the position
    domain is ``P = I - n n^T``, the desired force ``-F_d n`` and the desired velocity ``V_d t``,
    where t is the unit vector along ``n x axis``; in the plane and about z that is (n_y, -n_x).
    The desired position is integrated over every period T, and in the force domain it follows
    the arm's position x: ``x_d <- x + P (x_d + V_d t T - x)``.

    ``encoders``, shape (2d,), position (m), then velocity, of which only the position is used;
    ``normal``, shape (d,). ``selection``, shape (d * d,), is P row by row; ``desired_force``,
    shape (d,), N, of the arm on its environment; ``desired_position``, shape (d,), m. The outputs
    follow the inputs at once, so that a controller which ticks with this block is given the
    period that begins; looked at between the ticks, the desired position is that of the next one.

    Discrete state: the desired position of the last period, shape (d,), m.

    Args:
        params: The task.
        start: m, shape (d,), d = 2 or 3: desired position before the first period.
        axis: z of (5-6), of any length; along z in the plane.
        period: s.

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
        period: float,
    ) -> None:
        super().__init__()
        d = len(start)
        if d not in (2, 3) or not all(map(math.isfinite, start)):
            raise ParameterError("start", start, "2 or 3 finite numbers")
        x, y, z = unit(np.array(axis), "axis").tolist()
        if d == 2 and (x or y):
            raise ParameterError("axis", axis, "along z in two dimensions")
        turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])[:d, :d]  # n to n x axis
        stride = params.speed * period
        encoders = self.DeclareVectorInputPort("encoders", 2 * d)
        normal = self.DeclareVectorInputPort("normal", d)
        held = self.DeclareDiscreteState(np.array(start, dtype=np.float64))

        def calc_selection(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(position_selection(_unit_normal(normal, context)).ravel())

        def calc_force(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(-params.force * _unit_normal(normal, context))

        def calc_position(context: Context, vector: BasicVector) -> None:
            n = _unit_normal(normal, context)
            along = turn @ n
            length = math.hypot(*along.tolist())
            if length < _TOLERANCE:
                allowed = f"a direction other than that of the axis {axis}"
                raise ParameterError("normal", n.tolist(), allowed)
            position = _finite(encoders, context)[:d]
            ahead = context.get_discrete_state(held).value() + stride / length * along - position
            vector.SetFromVector(position + ahead - (n @ ahead) * n)

        self.DeclareVectorOutputPort("selection", d * d, calc_selection, {normal.ticket()})
        self.DeclareVectorOutputPort("desired_force", d, calc_force, {normal.ticket()})
        desired = self.DeclareVectorOutputPort(
            "desired_position",
            d,
            calc_position,
            {encoders.ticket(), normal.ticket(), self.discrete_state_ticket(held)},
        )

        def tick(context: Context, state: DrakeState) -> None:
            # The controller's own update has the same context: it sees this value, not the next.
            state.get_mutable_discrete_state().set_value(held, desired.Eval(context))

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, tick)


def _finite(port: InputPort, context: Context) -> Array:
    value: Array = port.Eval(context)
    if not all(map(math.isfinite, value.tolist())):
        raise ParameterError(port.get_name(), value.tolist(), "finite numbers")
    return value


def _unit_normal(port: InputPort, context: Context) -> Array:
    normal = _finite(port, context)
    length = math.hypot(*normal.tolist())
    if abs(length - 1) > _TOLERANCE:
        raise ParameterError(
            port.get_name(), normal.tolist(), f"a vector of length 1 within {_TOLERANCE:g}"
        )
    # The rest of the deviation would make P no projection.
    return normal / length
