"""Any system or diagram of Drake as a linear system of python-control."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias

import control
import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, InitializeAutoDiff
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, InputPort, OutputPort, System

from chamfer.analysis.linear.period_map import (
    Period,
    PeriodMap,
    fix,
    outputs_of,
    set_states,
    states_of,
    values_of,
)
from chamfer.analysis.linear.ports import Port, find_ports, own_ports, source_of, state_labels
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]
Ports: TypeAlias = str | InputPort | OutputPort | Sequence[str | InputPort | OutputPort] | None

_STEP: Final = 1e-6  # of the differences
_CLOSES: Final = 1e-4  # by which a loop that is closed again may differ from the diagram's


class _Matrices(NamedTuple):
    A: Array
    B: Array
    C: Array
    D: Array


def to_control(
    system: System,
    *,
    input: Ports = None,  # noqa: A002
    output: Ports = None,
    at: Context | float | None = None,
    period: float | None = None,
    step: float = _STEP,
    whole: bool = False,
) -> "control.StateSpace":
    """Return what a system does to small changes, as a linear system of python-control.

    Without discrete states it is continuous: exact, by automatic differentiation, where all blocks
    are C++ of Drake's, by central differences where a Python block is in the way. With discrete
    states it is sampled, with inputs held over a period: exact likewise for a diagram of such
    blocks of one rate, by differences of a simulation over a period for any other, which may have
    continuous states too, several rates, delays and offsets. Abstract states and random numbers
    are left as they are. States are x(k) just before what happens at the k-th tick, named after
    their blocks, and outputs are seen then.

    An input inside of a diagram opens the loop there: what is connected to it is replaced. If no
    output is named then, the result is the loop's return ratio, what comes back with the opposite
    sign, as python-control takes it. It is seen as the block sees it, at a tick or held after it;
    which of the two is told by closing the loop again.

    Args:
        system: A diagram or a block.
        input: A port or several: objects, or names, ``port`` of the system, ``block::port`` of a
            block in it, ``block`` if that is its only one. None: all vector inputs of the system.
        output: Likewise.
        at: Where: a context of the system; a time, s, until which it is simulated from its
            default; None, its default. Inputs without a value are 0.
        period: s, of the whole diagram. None: known, for continuous systems and such of one rate
            in C++.
        step: Of the differences, relative to a state or input where it exceeds 1.
        whole: Keeps the states too that the inputs can't move or the outputs don't show, such as
            a desired trajectory's.

    Raises:
        ParameterError: If a port or the period is not one of the system's, a continuous state is
            too fast to be simulated, or what returns to an opened loop changes within a period.
    """
    context = _context(system, at)
    inputs = find_ports(system, "input", input)
    source = source_of(system, inputs[0]) if output is None and len(inputs) == 1 else None
    outputs = [source] if source is not None else find_ports(system, "output", output)
    sampled = bool(context.num_discrete_state_groups() or context.num_abstract_states())
    dt, known = _period(system, period, sampled=sampled)
    if not np.isfinite(states := states_of(context)).all():
        labels = state_labels(system, context)
        first = labels[int(np.argmin(np.isfinite(states)))]
        raise ParameterError("at", at, f"where all states are finite, {first} is not")
    if not sampled or (known and not context.num_continuous_states()):
        found = _linearised(system, context, inputs, outputs, step, sampled=sampled)
    else:
        found = _over_a_period(system, context, inputs, outputs, dt, step, returns=source)
    if source is not None:
        found = found._replace(C=-found.C, D=-found.D)
    labels = state_labels(system, context)
    if not whole:
        kept = _between(found)
        found = _Matrices(found.A[np.ix_(kept, kept)], found.B[kept], found.C[:, kept], found.D)
        labels = [label for label, keep in zip(labels, kept, strict=True) if keep]
    return control.ss(
        *found,
        dt,
        name=system.get_name(),
        states=labels,
        inputs=[label for port in inputs for label in port.labels],
        outputs=[label for port in outputs for label in port.labels],
        remove_useless_states=False,
    )


def _context(system: System, at: Context | float | None) -> Context:
    """Return a context of one's own, with a value for every vector input of the system."""
    context = at.Clone() if isinstance(at, Context) else system.CreateDefaultContext()
    for port in own_ports(system, "input"):
        if not port.of(system).HasValue(context):
            fix(system, context, [port], np.zeros(port.size))
    if isinstance(at, Context) or at is None:
        return context
    if not 0 <= at < math.inf:
        raise ParameterError("at", at, "a context, or a finite time >= 0 s")
    simulator = Simulator(system, context)
    simulator.AdvanceTo(at)
    return context


def _period(system: System, period: float | None, *, sampled: bool) -> tuple[float, bool]:
    """Return a system's period, s, and whether it is that of a single update in C++."""
    if not sampled:
        if period is not None:
            raise ParameterError("period", period, "None, there are no discrete states")
        return 0.0, True
    if period is not None and not 0 < period < math.inf:
        raise ParameterError("period", period, "a finite number > 0, s")
    own = None
    if system.ToAutoDiffXdMaybe() is not None:  # a Python block's updates may be hidden
        attribute = system.GetUniquePeriodicDiscreteUpdateAttribute()
        own = None if attribute is None else attribute.period_sec()
    if period is None and own is None:
        raise ParameterError("period", None, "the diagram's, s: it has several rates, or Python")
    if own is None or (period is not None and not math.isclose(period, own)):
        return float(period or 0.0), False
    return own, True


def _linearised(
    system: System,
    context: Context,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    step: float,
    *,
    sampled: bool,
) -> _Matrices:
    """Return the derivatives of rates, or of updates, and outputs in states and inputs."""
    states, values = states_of(context), values_of(system, context, inputs)
    point = np.concatenate([states, values])

    def calc(system: System, context: Context, point: Any) -> Any:
        set_states(context, point[: len(states)])
        fix(system, context, inputs, point[len(states) :])
        rates = [np.zeros(0)]
        if sampled:
            updated = system.EvalUniquePeriodicDiscreteUpdate(context)
            rates = [updated.value(i) for i in range(updated.num_groups())]
        elif len(states):
            rates = [system.EvalTimeDerivatives(context).CopyToVector()]
        return np.concatenate([*rates, outputs_of(system, context, outputs)])

    exact = system.ToAutoDiffXdMaybe()
    if exact is not None:
        own = exact.CreateDefaultContext()
        own.SetTimeStateAndParametersFrom(context)
        for port in own_ports(system, "input"):
            value = np.array([AutoDiffXd(one) for one in values_of(system, context, [port])])
            fix(exact, own, [port], value)
        gradient = _gradient(calc(exact, own, InitializeAutoDiff(point)[:, 0]), len(point))
    else:
        gradient = _differences(partial(calc, system, context), point, step)
    s = len(states)
    return _Matrices(gradient[:s, :s], gradient[:s, s:], gradient[s:, :s], gradient[s:, s:])


def _gradient(values: Any, count: int) -> Array:
    gradient = np.zeros((len(values), count))
    for row, value in zip(gradient, values, strict=True):
        if len(value.derivatives()):  # a constant has none
            row[:] = value.derivatives()
    return gradient


def _differences(function: Any, point: Array, step: float) -> Array:
    columns = []
    for i, value in enumerate(point):
        moved = np.zeros_like(point)
        moved[i] = step * max(1.0, abs(value))
        columns.append((function(point + moved) - function(point - moved)) / (2 * moved[i]))
    return np.reshape(columns, (len(point), -1)).T


def _over_a_period(
    system: System,
    context: Context,
    inputs: Sequence[Port],
    outputs: Sequence[Port],
    period: float,
    step: float,
    *,
    returns: Port | None,
) -> _Matrices:
    found = Period(system, context, inputs, outputs, period).map(step)
    s = len(found.after)
    A, B = found.after[:, :s], found.after[:, s:]
    seen = found.before_tick
    if returns is not None:
        seen = _returning(system, context, found, inputs[0], period, step)
    return _Matrices(A, B, seen[:, :s], seen[:, s:])


def _returning(
    system: System, context: Context, found: PeriodMap, port: Port, period: float, step: float
) -> Array:
    """Return the derivatives of what returns to an opened loop, as the block sees it.

    Closed with it the loop has to be the diagram's.
    """
    s = len(found.after)
    A, B = found.after[:, :s], found.after[:, s:]
    expected = Period(system, context, [], [], period).map(step).after
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    for seen in (found.before_tick, found.behind_tick):
        C, D = seen[:, :s], seen[:, s:]
        through = np.eye(len(D)) - D
        if np.linalg.matrix_rank(through) < len(D):
            continue
        if (
            np.abs(A + B @ np.linalg.solve(through, C) - expected).max(initial=0.0)
            < _CLOSES * scale
        ):
            return seen
    allowed = "an input whose signal is held over a period, or read at ticks only"
    raise ParameterError("input", port.name, allowed)


def _between(found: _Matrices) -> NDArray[np.bool_]:
    """Return which states the inputs move, if there are any, and the outputs show, likewise."""

    def reached(start: NDArray[np.bool_], flow: NDArray[np.bool_]) -> NDArray[np.bool_]:
        for _ in range(len(start)):
            start = start | flow @ start
        return start

    moves, shows = found.A != 0, np.ones(len(found.A), dtype=bool)
    if found.B.shape[1]:
        shows &= reached((found.B != 0).any(axis=1), moves)
    if len(found.C):
        shows &= reached((found.C != 0).any(axis=0), moves.T)
    return shows
