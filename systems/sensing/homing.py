"""Incremental encoders that have to find their zeros (section 6.2.2)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, require_positive

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class HomingParams:
    """Parameters of :class:`Homing`."""

    zero_error: tuple[float, ...] = ()
    # rad or m, of each joint: what its encoder reads too much when it is switched on; empty: 0
    mark_distance: tuple[float, ...] = ()
    # rad or m, of each joint: from where it is switched on to its index mark; empty or 0: the zero
    # is known
    settle: float = 0.5  # s, in which a zero that was found is taken over; assumed

    def __post_init__(self) -> None:
        require_positive(self, "settle")
        for name in ("zero_error", "mark_distance"):
            if not all(map(math.isfinite, getattr(self, name))):
                raise ParameterError(name, getattr(self, name), "finite numbers")

    def for_joints(self, n: int) -> tuple[Array, Array]:
        """Return zero errors and marks' distances of n joints, shape (n,) each.

        Raises:
            ParameterError: If they are for more or fewer of them, or one has an error and no mark.
        """
        for name in ("zero_error", "mark_distance"):
            if len(getattr(self, name)) not in (0, n):
                raise ParameterError(name, getattr(self, name), f"{n} numbers, or none")
        error = np.array(self.zero_error or [0.0] * n)
        distance = np.array(self.mark_distance or [0.0] * n)
        if np.any((error != 0) & (distance == 0)):
            raise ParameterError("zero_error", self.zero_error, "0 where mark_distance is 0")
        return error, distance


class Homing(LeafSystem):
    """Counts from an unknown zero until each joint has passed its index mark.

    .. pydrake_system::

        name: Homing
        input_ports:
        - motion
        output_ports:
        - encoders
        - homed

    Behind its mark a joint's zero is known to a count. It is taken over gradually, so that an arm
    under position control follows smoothly to where it is meant to be; velocities are differences
    of counts, and never wrong.

    ``motion``, shape (2n,), joint positions (rad or m) from the true zero, then velocities, as
    encoders with a known zero give them; ``encoders``, shape (2n,), as they are shown; ``homed``,
    size 1, 1 once all zeros are known and taken over.

    Discrete states: side of the mark on which a joint was, and time since its mark was passed, s,
    -1 before, shape (n,) each.

    Args:
        params: Errors and marks.
        q: Joint positions at the start, shape (n,).
        period: s, of the computer.

    Raises:
        ParameterError: If parameters are for another number of joints.
    """

    def __init__(self, params: HomingParams, q: Array, *, period: float) -> None:
        super().__init__()
        n = len(q)
        error, distance = params.for_joints(n)
        marks = q + distance
        self._motion = self.DeclareVectorInputPort("motion", 2 * n)
        side = self.DeclareDiscreteState(np.sign(-distance))
        since = self.DeclareDiscreteState(np.where(distance == 0, params.settle, -1.0))

        def left(context: Context) -> Array:
            """Return how much of each joint's error is still shown, 1 to 0."""
            u = np.clip(context.get_discrete_state(since).value() / params.settle, 0.0, 1.0)
            share: Array = 1 - u**3 * (10 - 15 * u + 6 * u**2)
            return share

        def calc(context: Context, vector: BasicVector) -> None:
            motion = self._motion.Eval(context)
            vector.SetFromVector([*(motion[:n] + error * left(context)), *motion[n:]])

        def calc_homed(context: Context, vector: BasicVector) -> None:
            vector.SetAtIndex(0, float(not left(context).any()))

        def tick(context: Context, values: DiscreteValues) -> None:
            now = np.sign(self._motion.Eval(context)[:n] - marks)
            before = context.get_discrete_state(since).value()
            passed = (now != context.get_discrete_state(side).value()) | (before >= 0)
            values.set_value(side, now)
            values.set_value(since, np.where(passed, np.maximum(before, 0.0) + period, -1.0))

        known = self.discrete_state_ticket(since)
        self.DeclareVectorOutputPort("encoders", 2 * n, calc, {self._motion.ticket(), known})
        self.DeclareVectorOutputPort("homed", 1, calc_homed, {known})
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)
