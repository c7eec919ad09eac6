"""Linear models in python-control of any Drake system or diagram."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import control
import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd, InitializeAutoDiff
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import InitializeParams, ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import (
    Context,
    Diagram,
    InputPort,
    InputPortIndex,
    OutputPort,
    OutputPortIndex,
    PortDataType,
    System,
)

from chamfer.models.validation import ParameterError
from chamfer.systems.recording import recording

SEPARATOR: Final = "::"  # between the names of blocks and ports, as in Drake's own paths

Array = NDArray[np.float64]
Way = Literal["input", "output"]
Ports: TypeAlias = str | InputPort | OutputPort | Sequence[str | InputPort | OutputPort] | None


class Port(NamedTuple):
    """A vector port, of a system or of a block somewhere in it."""

    way: Way
    path: tuple[int, ...]  # to the block: which subsystem, from the outside in
    number: int
    name: str  # with the names of the blocks in front
    size: int

    @property
    def labels(self) -> list[str]:
        """A name for each element."""
        if self.size == 1:
            return [self.name]
        return [f"{self.name}[{i}]" for i in range(self.size)]

    def of(self, system: System) -> Any:
        """Return Drake's port, in a system of any scalar type."""
        block = _block(system, self.path)
        if self.way == "input":
            return block.get_input_port(InputPortIndex(self.number))
        return block.get_output_port(OutputPortIndex(self.number))

    def context(self, system: System, context: Context) -> Context:
        """Return the context of its block, in that of the whole."""
        for i in self.path:
            block = system.GetSystems()[i]
            context = system.GetMutableSubsystemContext(block, context)
            system = block
        return context


def _blocks(
    system: System, path: tuple[int, ...] = (), name: str = ""
) -> Iterator[tuple[tuple[int, ...], str, System]]:
    """Return path, name and system of the whole, and of all in it in the states' order."""
    yield path, name, system
    if isinstance(system, Diagram):
        for i, inner in enumerate(system.GetSystems()):
            yield from _blocks(inner, (*path, i), _joined(name, inner.get_name()))


def _ports(system: System, way: Way) -> Iterator[Port]:
    """Return the ports of the whole and of all in it; an abstract one has the size 0."""
    for path, name, block in _blocks(system):
        count = block.num_input_ports() if way == "input" else block.num_output_ports()
        for i in range(count):
            port = Port(way, path, i, name, 0).of(system)
            size = port.size() if port.get_data_type() == PortDataType.kVectorValued else 0
            yield Port(way, path, i, _joined(name, port.get_name()), size)


def own_ports(system: System, way: Way) -> list[Port]:
    """Return a system's own vector ports."""
    return [port for port in _ports(system, way) if port.size and not port.path]


def find_ports(system: System, way: Way, wanted: Ports) -> list[Port]:
    """Return the named ports, as :func:`to_control` describes them.

    Raises:
        ParameterError: If there is none of that name, or it has no vector.
    """
    if wanted is None:
        return own_ports(system, way)
    each = [wanted] if isinstance(wanted, str | InputPort | OutputPort) else list(wanted)
    everywhere = list(_ports(system, way))
    found = []
    for one in each:
        if isinstance(one, InputPort | OutputPort):
            shown, meant = one.get_name(), [port for port in everywhere if port.of(system) is one]
        else:
            shown, ahead = one, f"{one}{SEPARATOR}"
            meant = [port for port in everywhere if port.name == one] or [
                port
                for port in everywhere
                if port.name.startswith(ahead) and SEPARATOR not in port.name[len(ahead) :]
            ]
        if len(meant) != 1 or not meant[0].size:
            names = dict.fromkeys(port.name for port in meant or everywhere if port.size)
            allowed = f"one of the vector ports: {', '.join(names) or 'there is none'}"
            raise ParameterError(way, shown, allowed)
        found += meant
    return found


def source_of(system: System, port: Port) -> Port | None:
    """Return the output that is connected to a block's input, None if there is none."""
    if not port.path:
        return None
    entrance, diagram = port.of(system), _block(system, port.path[:-1])
    connected = diagram.connection_map().get((entrance.get_system(), entrance.get_index()))
    if connected is None:
        return None
    output = connected[0].get_output_port(connected[1])
    return next(one for one in _ports(system, "output") if one.of(system) is output)


def state_labels(system: System, context: Context) -> list[str]:
    """Return a name for each state: continuous ones, then discrete ones, block by block."""
    continuous, discrete = [], []
    for path, name, block in _blocks(system):
        if isinstance(block, Diagram):
            continue
        own = Port("input", path, 0, name, 0).context(system, context)
        groups = own.get_discrete_state()
        sizes = [len(groups.value(i)) for i in range(groups.num_groups())]
        counts = own.num_continuous_states(), sum(sizes)
        names = [f"x{i}" for i in range(sum(counts))]
        if isinstance(block, MultibodyPlant) and block.num_multibody_states() == sum(counts):
            names = block.GetStateNames()
        named = [_joined(name, one) for one in names]
        continuous += named[: counts[0]]
        discrete += named[counts[0] :]
    return continuous + discrete


def _block(system: System, path: tuple[int, ...]) -> System:
    for i in path:
        system = system.GetSystems()[i]
    return system


def _joined(name: str, inner: str) -> str:
    return f"{name}{SEPARATOR}{inner}" if name else inner


_EARLY: Final = 1e-6  # periods, by which a period begins before its tick, for there to be one
_RADIANS: Final = 0.1  # of the fastest continuous mode in a step of the integrator
_MOST_STEPS: Final = 20_000  # of the integrator in a period
_LOOKED_AT: Final = 16  # periods, for as many events in each
_COMPARED: Final = 8  # columns of the map, with those of the next period
_SAME: Final = 0.01  # of the map's largest number, by which they may differ


_STEP: Final = 1e-6  # of the differences, relative to a state or input where it exceeds 1
_CLOSES: Final = 1e-4  # by which a loop that is closed again may differ from the diagram's


class _Matrices(NamedTuple):
    A: Array
    B: Array
    C: Array
    D: Array


@recording(None)
def to_control(
    system: System,
    *,
    input: Ports = None,  # noqa: A002
    output: Ports = None,
    at: Context | float | None = None,
    period: float | None = None,
    whole: bool = False,
) -> "control.StateSpace":
    """Return the linearisation of a system, as a linear system of python-control.

    Without discrete states it is continuous: exact, by automatic differentiation, if all blocks
    are Drake's in C++, by central differences with a Python block.

    With discrete states it is sampled, with inputs held over a period. A diagram of C++ blocks of
    one rate is exact too. Any other is done by differences of a simulation over a period. It may
    have continuous states too, several rates, delays and offsets. Abstract states and random
    numbers stay constant. States are x(k) just before the events of the k-th tick, named after
    their blocks, and outputs are read then.

    An input inside a diagram opens the loop there: it replaces the connection. If you name no
    output, the result is the loop's return ratio: the signal that returns, with the opposite sign,
    as python-control takes it. It is the signal that the block reads, at a tick or held after it.
    Closing the loop again decides which of the two.

    Args:
        system: A diagram or a block.
        input: A port or several: objects, or names, ``port`` of the system, ``block::port`` of a
            block in it, ``block`` if that is its only one. None: all vector inputs of the system.
        output: Likewise.
        at: Operating point: a context of the system; a time, s, until which it is simulated from
            its default; None, its default. Inputs without a value are 0.
        period: s, of the whole diagram. None: derived, for continuous systems and C++ systems of
            one rate.
        whole: Keeps the states too that the inputs can't move or the outputs don't show, such as
            a desired trajectory's.

    Raises:
        ParameterError: If a port or the period is not one of the system's, a continuous state is
            too fast to be simulated, or the signal that returns to an opened loop changes within a
            period.
    """
    context = _context(system, at)
    inputs = find_ports(system, "input", input)
    source = source_of(system, inputs[0]) if output is None and len(inputs) == 1 else None
    outputs = [source] if source is not None else find_ports(system, "output", output)
    sampled = bool(context.num_discrete_state_groups() or context.num_abstract_states())
    dt, known = _period(system, period, sampled=sampled)
    if not np.isfinite(states := _states_of(context)).all():
        labels = state_labels(system, context)
        first = labels[int(np.argmin(np.isfinite(states)))]
        raise ParameterError("at", at, f"where all states are finite, {first} is not")
    model = _Model(system, context, inputs, outputs)
    if not sampled or (known and not context.num_continuous_states()):
        found = model.linearised(sampled=sampled)
    else:
        at_tick, behind_tick = model.over_a_period(dt)
        found = at_tick
        if source is not None:
            closed, _ = _Model(system, context, [], []).over_a_period(dt)
            found = _returning(at_tick, behind_tick, closed.A, inputs[0])
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
    """Return a new context, with a value for every vector input of the system."""
    context = at.Clone() if isinstance(at, Context) else system.CreateDefaultContext()
    for port in own_ports(system, "input"):
        if not port.of(system).HasValue(context):
            _fix(system, context, [port], np.zeros(port.size))
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


def _states_of(context: Context) -> Array:
    """Return continuous states, then discrete ones, shape (s,)."""
    discrete = context.get_discrete_state()
    groups = [discrete.value(i) for i in range(discrete.num_groups())]
    return np.concatenate([context.get_continuous_state_vector().CopyToVector(), *groups])


def _set_states(context: Context, states: Array) -> None:
    """Set the states that :func:`_states_of` returns."""
    first = context.num_continuous_states()
    if first:
        context.SetContinuousState(states[:first])
    discrete = context.get_discrete_state()
    for i in range(discrete.num_groups()):
        last = first + len(discrete.value(i))
        context.get_mutable_discrete_state().set_value(i, states[first:last])
        first = last


def _fix(system: System, context: Context, ports: Sequence[Port], values: Array) -> None:
    """Give inputs their values, shape (m,), and override their connections."""
    first = 0
    for port in ports:
        port.of(system).FixValue(port.context(system, context), values[first : first + port.size])
        first += port.size


@dataclass(frozen=True)
class _Model:
    """A system at a context, whose inputs and outputs may be inside it."""

    system: System
    context: Context
    inputs: Sequence[Port]
    outputs: Sequence[Port]

    @property
    def point(self) -> Array:
        """States and inputs, shape (s + m,); inputs are 0 where there is no value."""
        values = [_states_of(self.context)]
        for port in self.inputs:
            own, drake = port.context(self.system, self.context), port.of(self.system)
            values.append(drake.Eval(own) if drake.HasValue(own) else np.zeros(port.size))
        return np.concatenate(values)

    def seen(self, system: System, context: Context) -> Array:
        """Return the outputs' values, shape (p,)."""
        each = [port.of(system).Eval(port.context(system, context)) for port in self.outputs]
        return np.array(np.concatenate([np.zeros(0), *each]))

    def split(self, after: Array, seen: Array) -> _Matrices:
        s = len(after)
        return _Matrices(after[:, :s], after[:, s:], seen[:, :s], seen[:, s:])

    def linearised(self, *, sampled: bool) -> _Matrices:
        """Return the derivatives of rates, or of updates, and outputs in states and inputs."""
        point, s = self.point, len(_states_of(self.context))

        def calc(system: System, context: Context, point: Any) -> Any:
            _set_states(context, point[:s])
            _fix(system, context, self.inputs, point[s:])
            rates = [np.zeros(0)]
            if sampled:
                updated = system.EvalUniquePeriodicDiscreteUpdate(context)
                rates = [updated.value(i) for i in range(updated.num_groups())]
            elif s:
                rates = [system.EvalTimeDerivatives(context).CopyToVector()]
            return np.concatenate([*rates, self.seen(system, context)])

        exact = self.system.ToAutoDiffXdMaybe()
        if exact is None:
            gradient = _differences(partial(calc, self.system, self.context), point)
            return self.split(gradient[:s], gradient[s:])
        own = exact.CreateDefaultContext()
        own.SetTimeStateAndParametersFrom(self.context)
        for port in own_ports(self.system, "input"):
            values = _Model(self.system, self.context, [port], []).point[s:]
            _fix(exact, own, [port], np.array([AutoDiffXd(one) for one in values]))
        values = calc(exact, own, InitializeAutoDiff(point)[:, 0])
        gradient = np.zeros((len(values), len(point)))
        for row, value in zip(gradient, values, strict=True):
            if len(value.derivatives()):  # a constant has none
                row[:] = value.derivatives()
        return self.split(gradient[:s], gradient[s:])

    def over_a_period(self, period: float) -> tuple[_Matrices, _Matrices]:
        """Return the derivatives over a period with inputs held, by central differences.

        The period begins a little before the context's time. So the events of that time are within
        it, and those of its end belong to the next one.

        Returns:
            With outputs just before the events at the period's start, and just after them.

        Raises:
            ParameterError: If the continuous states are too fast to be integrated over the
                period, or the next period differs from this one: it is not that of the whole
                system.
        """
        point, s = self.point, len(_states_of(self.context))
        found = _differences(self._run(period), point)
        after = found[:s]
        # The next period in some columns, and how much happens in each.
        own = self.context.Clone()
        _fix(self.system, own, self.inputs, point[s:])
        simulator = self._begin(own, period, self._longest_step(period))
        start, before, counts = own.get_time(), 0, set()
        following = self
        for i in range(_LOOKED_AT):
            simulator.AdvanceTo(start + (i + 1) * period)
            if i == 0:
                following = replace(self, context=own.Clone())
                following.context.SetTime(self.context.get_time() + period)
            acted = simulator.get_num_discrete_updates() + simulator.get_num_unrestricted_updates()
            counts.add(acted - before)
            before = acted
        axes = slice(None, None, max(1, len(point) // _COMPARED))
        again = _differences(following._run(period), following.point, axes=axes)[:s]
        apart = np.abs(again - after[:, axes]).max(initial=0.0)
        if len(counts) > 1 or apart > _SAME * np.abs(after).max(initial=0.0):
            allowed = "one of the whole diagram, whose next period is as this one"
            raise ParameterError("period", period, allowed)
        at_tick, behind_tick = np.split(found[s:], 2)
        return self.split(after, at_tick), self.split(after, behind_tick)

    def _run(self, period: float) -> Callable[[Array], Array]:
        """Return the function that gives states after a period, and outputs around its tick."""
        longest = self._longest_step(period)

        def run(point: Array) -> Array:
            own = self.context.Clone()
            count = len(_states_of(own))
            _set_states(own, point[:count])
            _fix(self.system, own, self.inputs, point[count:])
            before = self.seen(self.system, own)
            simulator = self._begin(own, period, longest)
            start = own.get_time()
            simulator.AdvanceTo(start + 2 * _EARLY * period)
            behind = self.seen(self.system, own)
            simulator.AdvanceTo(start + period)
            return np.concatenate([_states_of(own), before, behind])

        return run

    def _begin(self, context: Context, period: float, step: float) -> Simulator:
        context.SetTime(context.get_time() - _EARLY * period)
        simulator = Simulator(self.system, context)
        if step:
            integrator = ResetIntegratorFromFlags(simulator, "runge_kutta5", step)
            integrator.set_fixed_step_mode(True)
        simulator.Initialize(InitializeParams(suppress_initialization_events=True))
        return simulator

    def _longest_step(self, period: float) -> float:
        """Return a step of the integrator, s, 0 without continuous states."""
        count = self.context.num_continuous_states()
        if not count:
            return 0.0
        own = self.context.Clone()
        states = own.get_continuous_state_vector().CopyToVector()

        def rates(moved: Array) -> Array:
            own.SetContinuousState(states + moved)
            return np.array(self.system.EvalTimeDerivatives(own).CopyToVector())

        flow = _differences(rates, np.zeros(count), step=1.0)
        fastest = float(np.abs(np.linalg.eigvals(flow)).max())
        if not fastest * period <= _RADIANS * _MOST_STEPS:
            most = _RADIANS * _MOST_STEPS / period
            raise ParameterError("fastest continuous mode", fastest, f"at most {most:g} 1/s")
        return min(period, _RADIANS / fastest) if fastest else period


def _returning(
    at_tick: _Matrices, behind_tick: _Matrices, expected: Array, port: Port
) -> _Matrices:
    """Return which of the two returns to an opened loop, as the block reads it.

    Closed with it, the loop has to be the diagram's.
    """
    scale = max(1.0, np.abs(expected).max(initial=0.0))
    for found in (at_tick, behind_tick):
        through = np.eye(len(found.D)) - found.D
        if np.linalg.matrix_rank(through) < len(through):
            continue
        closed = found.A + found.B @ np.linalg.solve(through, found.C)
        if np.abs(closed - expected).max(initial=0.0) < _CLOSES * scale:
            return found
    allowed = "an input whose signal is held over a period, or read at ticks only"
    raise ParameterError("input", port.name, allowed)


def _differences(
    function: Callable[[Array], Array],
    point: Array,
    *,
    step: float = _STEP,
    axes: slice = slice(None),
) -> Array:
    """Return the derivative at a point, or some of its columns, by central differences."""
    columns = [
        (function(point + moved) - function(point - moved)) / (2 * moved.sum())
        for moved in np.diag(step * np.maximum(1.0, np.abs(point)))[axes]
    ]
    return np.reshape(columns, (len(columns), -1)).T


def _between(found: _Matrices) -> NDArray[np.bool_]:
    """Return which states the inputs, if any, move and which the outputs, if any, show."""

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
