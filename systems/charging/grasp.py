"""What the gripper holds: whether a nugget is between the fingers when they close."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, require_positive


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
        state = self.DeclareDiscreteState(3)
        ticket = {self.discrete_state_ticket(state)}
        for name, index in (("scene", 2), ("held", 0)):
            self.DeclareVectorOutputPort(name, 1, self._reader(index), ticket)
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    @staticmethod
    def _reader(index: int) -> Callable[[Context, BasicVector], None]:
        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetAtIndex(0, context.get_discrete_state(0).value()[index])

        return calc

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        held, before, _ = context.get_discrete_state(0).value()
        grip = self._grip.Eval(context)[0] > 0.5
        item = round(float(self._item.Eval(context)[0]))
        if grip and not before:
            near = self._contact.Eval(context)[0] <= self._reach
            held = float(near and self._present[min(item, len(self._present) - 1)])
        dropped = self._drop.HasValue(context) and self._drop.Eval(context)[0] > 0.5
        if not grip or dropped:
            held = 0.0
        item = min(item, len(self._present) - 1)
        values.set_value(0, np.array([held, float(grip), 2 * item + held]))
