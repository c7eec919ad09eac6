"""The computer's delay between sensors and torque."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.validation import ParameterError
from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]


@compiled
def delayed(now: Array, before: Array, late: float, since: float, step: float) -> Array:
    """Return the mean torque over a step that begins a time since the tick, s, shape (n,).

    The previous torque acts until the delay ``late``, s, is over.
    """
    old = min(max((late - since) / step, 0.0), 1.0)
    return now + old * (before - now)


class ComputationDelay(LeafSystem):
    """Delays a torque by a part of the period in which it is computed.

    .. pydrake_system::

        name: ComputationDelay
        input_ports:
        - command
        - jitter
        output_ports:
        - torque

    The torque of a tick takes effect ``delay`` later, plus or minus the jitter. The plant holds
    the output for a step. In the step in which the torque changes, the output is the mean of both
    torques, so that the impulse is exact.

    ``command`` and ``torque``, shape (n,); ``jitter``, size 1, a sample from 0 to 1, new each
    period (Drake's uniform ``RandomSource``), read only if there is jitter. Discrete state: the
    command of the period before, shape (n,).

    ``delay`` is from 0 to a period, s. ``jitter``, s, is the half-width of a uniform distribution
    about it. A torque is held for ``step``, s, a whole part of the period.

    Raises:
        ParameterError: If a torque would be early, or later than a period.
    """

    def __init__(
        self, joints: int, *, delay: float, jitter: float, period: float, step: float
    ) -> None:
        super().__init__()
        require_within_period(delay, jitter, period)
        steps = round(period / step)
        command = self.DeclareVectorInputPort("command", joints)
        noise = self.DeclareVectorInputPort("jitter", 1)
        before = self.DeclareDiscreteState(np.zeros(joints))

        def calc(context: Context, vector: BasicVector) -> None:
            late = delay
            if jitter:
                late += jitter * (2 * float(noise.Eval(context)[0]) - 1)
            since = step * (round(context.get_time() / step) % steps)
            old = context.get_discrete_state(before).value().copy()
            vector.SetFromVector(delayed(command.Eval(context).copy(), old, late, since, step))

        state, time = self.discrete_state_ticket(before), self.time_ticket()
        depends = {command.ticket(), noise.ticket(), state, time}
        self.DeclareVectorOutputPort("torque", joints, calc, depends)

        # Unrestricted, so that it takes the torque that the controller is about to replace.
        def keep(context: Context, state: DrakeState) -> None:
            state.get_mutable_discrete_state().set_value(before, command.Eval(context))

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, keep)


def require_within_period(delay: float, jitter: float, period: float) -> None:
    """Raise :class:`ParameterError` unless a delay with its jitter is from 0 to a period."""
    if not 0 <= delay <= period:
        raise ParameterError("computation_delay", delay, f"0 to the period, {period:g} s")
    if not 0 <= jitter <= min(delay, period - delay) * (1 + 1e-12):
        allowed = f"at most {min(delay, period - delay):g} s, the torque is neither early nor lost"
        raise ParameterError("computation_jitter", jitter, allowed)
