"""How far a nugget that is laid pushes what it is laid on."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import require_not_negative, require_positive
from chamfer.systems.contact.arm_dynamics import GRAVITY


@dataclass(frozen=True, kw_only=True)
class LayerMotionParams:
    """Parameters of :class:`LayerMotion`."""

    stiffness: float = 1e4  # N/m, of the layer; that of the contact with it
    mass: float = 0.085  # kg, of the nugget beneath
    friction: float = 0.5  # of it on what it lies on; assumed
    period: float = 0.001  # s

    def __post_init__(self) -> None:
        require_positive(self, "stiffness", "mass", "period")
        require_not_negative(self, "friction")


class LayerMotion(LeafSystem):
    """The layer below as a nugget on dry friction, on an elastic foundation.

    .. pydrake_system::

        name: LayerMotion
        input_ports:
        - force
        - item
        output_ports:
        - shift

    The layer gives by ``F / k``, and the nugget beneath slips while the tangential force is more
    than ``mu (N + m g)`` holds, and until friction has stopped it. The force is that on a layer
    which does not slip: an arm that follows it pushes less, so that the slip is an upper bound.

    ``force``, shape (3,), N, of the layer on the arm, world frame; ``item``, size 1: with a new
    one the layer begins where it is. ``shift``, shape (3,), m, from where it lay.

    Discrete state: slip (2), its speed (2), item, and the shift (3).

    Args:
        params: The layer.
    """

    def __init__(self, params: LayerMotionParams) -> None:
        super().__init__()
        self._params = params
        self._force = self.DeclareVectorInputPort("force", 3)
        self._item = self.DeclareVectorInputPort("item", 1)
        state = self.DeclareDiscreteState(8)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(context.get_discrete_state(state).value()[5:])

        self.DeclareVectorOutputPort("shift", 3, calc, {self.discrete_state_ticket(state)})
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._step)

    def _step(self, context: Context, values: DiscreteValues) -> None:
        params, h = self._params, self._params.period
        sx, sy, vx, vy, before = context.get_discrete_state(0).value()[:5].tolist()
        item = float(self._item.Eval(context)[0])
        if item != before:
            sx = sy = vx = vy = 0.0
        fx, fy, fz = (-self._force.Eval(context)).tolist()
        holds = params.friction * max(params.mass * GRAVITY - fz, 0.0)
        # Free velocity, less what friction can take off it in a step: an implicit projection.
        vx, vy = vx + h * fx / params.mass, vy + h * fy / params.mass
        speed = math.hypot(vx, vy)
        left = max(speed - h * holds / params.mass, 0.0) / speed if speed else 0.0
        vx, vy = left * vx, left * vy
        sx, sy = sx + h * vx, sy + h * vy
        k = params.stiffness
        shift = [sx + fx / k, sy + fy / k, fz / k]
        values.set_value(0, np.array([sx, sy, vx, vy, item, *shift]))
