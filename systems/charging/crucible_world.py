"""The charging cycle's environment: the gripper, the layer below, and faults."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, require_not_negative, require_positive
from chamfer.systems.contact.arm_dynamics import GRAVITY
from chamfer.systems.contact.arm_in_contact import ContactParams

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class GraspParams:
    """Parameters of :class:`Grasp`."""

    reach: float = 0.002  # m, gap to the nugget's top at which closing fingers hold it
    period: float = 0.005  # s, between readings of the gripper's command

    def __post_init__(self) -> None:
        require_positive(self, "reach", "period")


class Grasp(LeafSystem):
    """Selects the arm's scene: empty over the feeder, or with an item in the gripper.

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

    The gripper holds an item from the tick in which the grip closes with the item's top within
    reach, if the feeder has it. It holds it until the grip opens or a fault drops it. Fingers that
    close beside an item hold nothing until they open and close again.

    * ``grip``, size 1: 1 to close.
    * ``contact``, from :class:`chamfer.systems.contact.arm_in_contact.ArmInContact` for the scene;
      the first number is the gap to the item in the feeder, m.
    * ``item``, size 1, index in the plan.
    * ``drop``, size 1, 1: the gripper loses its item (may be left unconnected).
    * ``scene``, size 1: 2 item, and 1 more with the item held.
    * ``held``, size 1, the reading of the gripper's part sensor.

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


@dataclass(frozen=True, kw_only=True)
class LaidContact(ContactParams):
    """Contact of a nugget with one that lies loose on others.

    Two dry frictions are in series, of which the weaker gives: that between both, and that of the
    lower nugget on its bed (:func:`chamfer.systems.contact.arm_motion.coefficient`). The
    lower nugget's inertia is left out.
    """

    mass: float  # kg, of the lower nugget
    slip_friction: float  # of it on its bed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "mass")
        require_not_negative(self, "slip_friction")

    @property
    def loose(self) -> tuple[float, float]:
        """Mass and slip friction of the lower nugget."""
        return self.mass, self.slip_friction

    def slips(self, force: Array) -> bool:
        """Return whether the lower nugget gives way to its force on the upper one, N, (3,)."""
        x, y, up = force.tolist()
        holds = self.slip_friction * (self.mass * GRAVITY + max(up, 0.0))
        return bool(up > 0 and math.hypot(x, y) > _NEARLY * holds)


_NEARLY: Final = 0.98  # of what holds: it is taken for the push of an update before


class LayerMotion(LeafSystem):
    """Tracks the shift of the nugget below, which moves with the one above once it slips.

    .. pydrake_system::

        name: LayerMotion
        input_ports:
        - force
        - tip
        - item
        output_ports:
        - shift

    The slip itself is that of the arm's tip, found by the stick-slip of
    :class:`chamfer.systems.contact.arm_in_contact.ArmInContact` with :class:`LaidContact`.

    ``force``, shape (3,), N, is of the layer on the arm, world frame; ``tip``, shape (3,), m, is
    the point that touches. ``item``, size 1: with a new item the shift starts at 0. ``shift``,
    shape (3,), m, is the displacement from the first place.

    Discrete state: shift (3), the tip a period ago (3), item.
    """

    def __init__(self, contact: LaidContact, *, period: float) -> None:
        super().__init__()
        force, tip = (self.DeclareVectorInputPort(name, 3) for name in ("force", "tip"))
        number = self.DeclareVectorInputPort("item", 1)
        moved, before = self.DeclareDiscreteState(3), self.DeclareDiscreteState(4)
        self.DeclareStateOutputPort("shift", moved)

        def step(context: Context, values: DiscreteValues) -> None:
            now = np.array([*tip.Eval(context), *number.Eval(context)])
            last = context.get_discrete_state(before).value()
            shift = context.get_discrete_state(moved).value().copy()
            if now[3] != last[3]:
                shift[:] = 0.0
            elif contact.slips(force.Eval(context)):
                shift += now[:3] - last[:3]
            values.set_value(before, now)
            values.set_value(moved, shift)

        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, step)


class FaultTrigger(LeafSystem):
    """Triggers a fault once, some time after the chart enters a state.

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
    """Passes a sensor's signal to the computer; a cut line reads 0 and reports the cut.

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
