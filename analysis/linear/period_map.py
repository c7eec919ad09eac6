"""What a period makes of a system's states and inputs, by differences of its simulation."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import InitializeParams, ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context, System

from chamfer.analysis.linear.ports import Port
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_EARLY: Final = 1e-6  # periods, by which a period begins before its tick, for there to be one
_RADIANS: Final = 0.1  # of the fastest continuous mode in a step of the integrator
_MOST_STEPS: Final = 20_000  # of the integrator in a period
_LOOKED_AT: Final = 16  # periods, for as many events in each
_COMPARED: Final = 8  # columns of the map, with those of the next period
_SAME: Final = 0.01  # of the map's largest number, by which they may differ


class PeriodMap(NamedTuple):
    """The derivative of what is after a period, in states and inputs before it."""

    after: Array  # states, shape (s, s + m)
    before_tick: Array  # outputs just before what happens at the period's begin, (p, s + m)
    behind_tick: Array  # outputs just after it, (p, s + m)


class Period:
    """A period of a system from a context on, with inputs held.

    It begins a little before the context's time, so that whatever happens at that time does so
    within the period, and what happens at its end belongs to the next one.

    Args:
        system: With continuous states, discrete ones, or both; abstract ones stay as they are.
        context: Where it begins; its ports have their values.
        inputs: Of the system, or inside it, where the values take the place of what is connected.
        outputs: Of the system, or inside it.
        period: s.

    Raises:
        ParameterError: If the continuous states are too fast to be integrated over the period.
    """

    def __init__(
        self,
        system: System,
        context: Context,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        period: float,
    ) -> None:
        self._system = system
        self._context = context
        self._inputs = inputs
        self._outputs = outputs
        self._period = period
        self._step = self._longest_step()

    def map(self, step: float) -> PeriodMap:
        """Return the derivatives by central differences.

        Args:
            step: Of the differences, relative to a state or input where it exceeds 1.

        Raises:
            ParameterError: If the next period is not as this one: it is none of the whole system.
        """
        point = self._point()
        columns = [self._column(axis, step) for axis in range(len(point))]
        self._require_another(columns, step)
        after, before, behind = (
            np.reshape([column[i] for column in columns], (len(point), -1)).T for i in range(3)
        )
        return PeriodMap(after, before, behind)

    def _point(self) -> Array:
        """Return states and inputs, shape (s + m,)."""
        values = values_of(self._system, self._context, self._inputs)
        return np.concatenate([states_of(self._context), values])

    def _column(self, axis: int, step: float) -> tuple[Array, Array, Array]:
        """Return the derivatives in a state or input."""
        point = self._point()
        moved = np.zeros_like(point)
        moved[axis] = step * max(1.0, abs(point[axis]))
        ahead, back = self._run(point + moved), self._run(point - moved)
        after, before, behind = (
            (a - b) / (2 * moved[axis]) for a, b in zip(ahead, back, strict=True)
        )
        return after, before, behind

    def _require_another(self, columns: Sequence[tuple[Array, Array, Array]], step: float) -> None:
        """Compare with the next period in some columns, and in how much happens in each."""
        own = self._context.Clone()
        fix(self._system, own, self._inputs, self._point()[len(states_of(own)) :])
        simulator = self._begin(own)
        start, before, counts = own.get_time(), 0, set()
        following = self
        for i in range(_LOOKED_AT):
            simulator.AdvanceTo(start + (i + 1) * self._period)
            if i == 0:
                next_one = own.Clone()
                next_one.SetTime(self._context.get_time() + self._period)
                following = Period(
                    self._system, next_one, self._inputs, self._outputs, self._period
                )
            acted = simulator.get_num_discrete_updates() + simulator.get_num_unrestricted_updates()
            counts.add(acted - before)
            before = acted
        axes = range(0, len(columns), max(1, len(columns) // _COMPARED))
        apart = [np.abs(following._column(i, step)[0] - columns[i][0]).max() for i in axes]
        largest = max((np.abs(after).max(initial=0.0) for after, *_ in columns), default=0.0)
        if len(counts) > 1 or max(apart, default=0.0) > _SAME * largest:
            allowed = "one of the whole diagram, whose next period is as this one"
            raise ParameterError("period", self._period, allowed)

    def _run(self, point: Array) -> tuple[Array, Array, Array]:
        """Return the states after a period, and the outputs before and behind its tick."""
        own = self._context.Clone()
        count = len(states_of(own))
        set_states(own, point[:count])
        fix(self._system, own, self._inputs, point[count:])
        before = outputs_of(self._system, own, self._outputs)
        simulator = self._begin(own)
        start = own.get_time()
        simulator.AdvanceTo(start + 2 * _EARLY * self._period)
        behind = outputs_of(self._system, own, self._outputs)
        simulator.AdvanceTo(start + self._period)
        return states_of(own), before, behind

    def _begin(self, context: Context) -> Simulator:
        context.SetTime(context.get_time() - _EARLY * self._period)
        simulator = Simulator(self._system, context)
        if self._step:
            integrator = ResetIntegratorFromFlags(simulator, "runge_kutta5", self._step)
            integrator.set_fixed_step_mode(True)
        simulator.Initialize(InitializeParams(suppress_initialization_events=True))
        return simulator

    def _longest_step(self) -> float:
        """Return a step of the integrator, s, 0 without continuous states."""
        count = self._context.num_continuous_states()
        if not count:
            return 0.0
        own = self._context.Clone()
        states = own.get_continuous_state_vector().CopyToVector()
        flow = np.empty((count, count))
        for i, axis in enumerate(np.eye(count)):
            own.SetContinuousState(states + axis)
            ahead = self._system.EvalTimeDerivatives(own).CopyToVector()
            own.SetContinuousState(states - axis)
            flow[:, i] = (ahead - self._system.EvalTimeDerivatives(own).CopyToVector()) / 2
        fastest = float(np.abs(np.linalg.eigvals(flow)).max())
        if not fastest * self._period <= _RADIANS * _MOST_STEPS:
            most = _RADIANS * _MOST_STEPS / self._period
            raise ParameterError("fastest continuous mode", fastest, f"at most {most:g} 1/s")
        return min(self._period, _RADIANS / fastest) if fastest else self._period


def states_of(context: Context) -> Array:
    """Return continuous states, then discrete ones, shape (s,)."""
    discrete = context.get_discrete_state()
    groups = [discrete.value(i) for i in range(discrete.num_groups())]
    return np.concatenate([context.get_continuous_state_vector().CopyToVector(), *groups])


def set_states(context: Context, states: Array) -> None:
    """Set what :func:`states_of` returns."""
    first = context.num_continuous_states()
    if first:
        context.SetContinuousState(states[:first])
    discrete = context.get_discrete_state()
    for i in range(discrete.num_groups()):
        last = first + len(discrete.value(i))
        context.get_mutable_discrete_state().set_value(i, states[first:last])
        first = last


def fix(system: System, context: Context, ports: Sequence[Port], values: Array) -> None:
    """Give inputs their values, shape (m,), whatever is connected to them."""
    first = 0
    for port in ports:
        port.of(system).FixValue(port.context(system, context), values[first : first + port.size])
        first += port.size


def values_of(system: System, context: Context, ports: Sequence[Port]) -> Array:
    """Return the values of inputs, shape (m,), 0 where there is none."""
    values = [np.zeros(0)]
    for port in ports:
        own, drake = port.context(system, context), port.of(system)
        values.append(drake.Eval(own) if drake.HasValue(own) else np.zeros(port.size))
    return np.concatenate(values)


def outputs_of(system: System, context: Context, ports: Sequence[Port]) -> Array:
    """Return the values of outputs, shape (p,)."""
    each = [port.of(system).Eval(port.context(system, context)) for port in ports]
    return np.array(np.concatenate([np.zeros(0), *each]))
