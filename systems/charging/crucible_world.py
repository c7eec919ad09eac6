"""What answers the charging cycle: the gripper, the layer below, and what goes wrong."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.contact.arm_dynamics import GRAVITY


@dataclass(frozen=True, kw_only=True)
class GraspParams:
    """Parameters of :class:`Grasp`."""

    reach: float = 0.002  # m, gap to the nugget's top at which closing fingers get hold of it
    period: float = 0.005  # s, between looks at the gripper's command

    def __post_init__(self) -> None:
        require_positive(self, "reach", "period")


class Grasp(LeafSystem):
    """Says which scene the arm is in: empty over the feeder, or with an item in the gripper.

    .. pydrake_system::

        name: Grasp
        input_ports:
        - grip
        - contact
        - item
        - drop
        output_ports:
        - scene
        - held

    An item is held from the tick on in which the grip closes with the item's top within reach,
    if it is there at all, until the grip opens or it is dropped. Closing the fingers beside it
    gets hold of nothing, until they are opened and closed again.

    ``grip``, size 1: 1 to close; ``contact``, as
    :class:`chamfer.systems.contact.arm_in_contact.ArmInContact` gives it for the scene, the first
    number the gap to the item in the feeder, m; ``item``, size 1, index in the plan; ``drop``,
    size 1, 1: the gripper loses what it holds (may be left unconnected). ``scene``, size 1: 2
    item, and 1 more with the item held; ``held``, size 1, what the gripper's part sensor shows.

    Discrete state: held, grip of the tick before, scene.

    Args:
        params: Reach and period.
        present: Of each item of the plan, whether the feeder has it.
        contacts: Size of ``contact``.
    """

    def __init__(self, params: GraspParams, present: tuple[bool, ...], *, contacts: int) -> None:
        super().__init__()
        if not present:
            raise ParameterError("present", present, "at least one item")
        self._reach, self._present = params.reach, present
        self._grip = self.DeclareVectorInputPort("grip", 1)
        self._contact = self.DeclareVectorInputPort("contact", contacts)
        self._item = self.DeclareVectorInputPort("item", 1)
        self._drop = self.DeclareVectorInputPort("drop", 1)
        self._held, self._before, self._scene = (self.DeclareDiscreteState(1) for _ in range(3))
        self.DeclareStateOutputPort("scene", self._scene)
        self.DeclareStateOutputPort("held", self._held)
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        held = float(context.get_discrete_state(self._held)[0])
        grip = self._grip.Eval(context)[0] > 0.5
        item = min(round(float(self._item.Eval(context)[0])), len(self._present) - 1)
        if grip and not context.get_discrete_state(self._before)[0]:
            near = self._contact.Eval(context)[0] <= self._reach
            held = float(near and self._present[item])
        dropped = self._drop.HasValue(context) and self._drop.Eval(context)[0] > 0.5
        if not grip or dropped:
            held = 0.0
        values.set_value(self._held, [held])
        values.set_value(self._before, [float(grip)])
        values.set_value(self._scene, [2 * item + held])


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
        stiffness: N/m, of the layer; that of the contact with it.
        mass: kg, of the nugget beneath.
        friction: Of it on what it lies on.
        period: s.
    """

    def __init__(self, *, stiffness: float, mass: float, friction: float, period: float) -> None:
        super().__init__()
        self._stiffness, self._mass, self._friction = stiffness, mass, friction
        self._period = period
        self._force = self.DeclareVectorInputPort("force", 3)
        self._item = self.DeclareVectorInputPort("item", 1)
        self._slip, self._shift = self.DeclareDiscreteState(5), self.DeclareDiscreteState(3)
        self.DeclareStateOutputPort("shift", self._shift)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._step)

    def _step(self, context: Context, values: DiscreteValues) -> None:
        h, mass, k = self._period, self._mass, self._stiffness
        sx, sy, vx, vy, before = context.get_discrete_state(self._slip).value().tolist()
        item = float(self._item.Eval(context)[0])
        if item != before:
            sx = sy = vx = vy = 0.0
        fx, fy, fz = (-self._force.Eval(context)).tolist()
        holds = self._friction * max(mass * GRAVITY - fz, 0.0)
        # Free velocity, less what friction can take off it in a step: an implicit projection.
        vx, vy = vx + h * fx / mass, vy + h * fy / mass
        speed = math.hypot(vx, vy)
        left = max(speed - h * holds / mass, 0.0) / speed if speed else 0.0
        vx, vy = left * vx, left * vy
        sx, sy = sx + h * vx, sy + h * vy
        values.set_value(self._slip, [sx, sy, vx, vy, item])
        values.set_value(self._shift, [sx + fx / k, sy + fy / k, fz / k])


class FaultTrigger(LeafSystem):
    """Says when a fault acts: once, a while after a state is entered.

    .. pydrake_system::

        name: FaultTrigger
        input_ports:
        - state
        - item
        output_ports:
        - active

    ``state`` and ``item``, size 1, of the chart; ``active``, size 1, 1 while the fault acts.

    Discrete state: time since the state was entered with the item, s, -1 before; active.

    Args:
        at: Index of the chart's state, and of the item in the plan.
        delay: s, after the state is entered with that item.
        lasting: s; may be infinite.
        period: s.
    """

    def __init__(
        self, at: tuple[int, int], *, delay: float, lasting: float, period: float
    ) -> None:
        super().__init__()
        state = self.DeclareVectorInputPort("state", 1)
        item = self.DeclareVectorInputPort("item", 1)
        timer, active = self.DeclareDiscreteState([-1.0]), self.DeclareDiscreteState(1)
        self.DeclareStateOutputPort("active", active)

        def tick(context: Context, values: DiscreteValues) -> None:
            since = float(context.get_discrete_state(timer)[0])
            if since >= 0:
                since += period
            elif (state.Eval(context)[0], item.Eval(context)[0]) == at:
                since = 0.0
            late = since - delay + 1e-9
            values.set_value(timer, [since])
            values.set_value(active, [float(since >= 0 and 0 <= late < lasting)])

        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)


class CutOff(LeafSystem):
    """A sensor's line to the computer, which may be cut: it reads 0 then, and is known to.

    .. pydrake_system::

        name: CutOff
        input_ports:
        - signal
        - cut
        output_ports:
        - reading
        - alive

    ``signal`` and ``reading``, shape (k,); ``cut``, size 1; ``alive``, size 1, 0 while it is cut.

    Args:
        size: k.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        signal = self.DeclareVectorInputPort("signal", size)
        cut = self.DeclareVectorInputPort("cut", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            whole = cut.Eval(context)[0] < 0.5
            vector.SetFromVector(signal.Eval(context) if whole else np.zeros(size))

        self.DeclareVectorOutputPort("reading", size, calc, {signal.ticket(), cut.ticket()})

        def show(context: Context, vector: BasicVector) -> None:
            vector.SetAtIndex(0, float(cut.Eval(context)[0] < 0.5))

        self.DeclareVectorOutputPort("alive", 1, show, {cut.ticket()})
