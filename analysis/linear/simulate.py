"""Runs a diagram and returns the signals of its output ports."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import DiscreteTimeApproximation, Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import LinearSystem, LogVectorOutput, Multiplexer

from chamfer.analysis.scenario.experiment import Progress
from chamfer.models.plants.linear_response import free_response
from chamfer.models.validation import ParameterError
from chamfer.systems.exact_discretisation import count_samples, fuse, is_linear

_SLICES = 20  # of a run, between which progress is reported
_MOST_STEPS = 5_000_000  # between log entries, as of the servo loops
_LOOKS = 10  # log entries, between which a run is asked whether it is over


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run."""

    time: NDArray[np.float64]  # s, shape (n,)
    outputs: dict[str, NDArray[np.float64]]  # by port name, shape (n,), or (n, size)
    final: Context | None = None  # of the root at the end; None if it was solved exactly


def simulate(
    system: System,
    *,
    duration: float,
    step: float,
    seed: int = 0,
    progress: Progress | None = None,
    ended: Callable[[Context], bool] | None = None,
    rate: float = 0.0,
) -> Run:
    """Simulate a system from its default state and log its vector outputs.

    A linear time-invariant system without input, such as a PID loop with its trajectory, is solved
    exactly. Drake's simulator steps everything else.

    Args:
        system: All its outputs are logged; the call uses it up.
        duration: s.
        step: s, time between log entries; the first is at t = 0.
        seed: For the system's random sources.
        progress: Receives the progress of the run.
        ended: Called with the root's context between log entries; returns whether the run is over
            before its duration.
        rate: Largest simulated time per second of real time; 0: no limit.

    Raises:
        ParameterError: If the run would be too long to be stored, or an output is not finite,
            naming the port.
    """
    if not duration / step <= _MOST_STEPS:
        allowed = f"at most {_MOST_STEPS} steps of {step:g} s, {_MOST_STEPS * step:g} s"
        raise ParameterError("duration", duration, allowed)
    ports = [system.get_output_port(i) for i in range(system.num_output_ports())]
    if system.num_input_ports() == 0 and is_linear(system):
        time: NDArray[np.float64] = step * np.arange(count_samples(duration, step), dtype=float)
        rows = _solve(system if isinstance(system, LinearSystem) else fuse(system), time)
        final = None
        if progress is not None:
            progress(1.0)
    else:
        time, rows, final = _step(system, ports, duration, step, seed, progress, ended, rate)
    outputs = {}
    first = 0
    for port in ports:
        values = rows[first : first + port.size()]
        first += port.size()
        if not np.all(np.isfinite(values)):
            raise ParameterError(
                f"output {port.get_name()} of {system.get_name()}",
                float(values[~np.isfinite(values)][0]),
                "finite numbers, these parameters make it overflow",
            )
        outputs[port.get_name()] = values[0] if port.size() == 1 else values.T
    return Run(time=time, outputs=outputs, final=final)


def _solve(system: LinearSystem, time: NDArray[np.float64]) -> NDArray[np.float64]:
    initial = system.CreateDefaultContext().get_continuous_state_vector().CopyToVector()
    step = float(time[-1]) / max(1, len(time) - 1)
    sampled = DiscreteTimeApproximation(system, step or 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        response: NDArray[np.float64] = system.C() @ free_response(sampled.A(), initial, len(time))
    return response


def _step(
    system: System,
    ports: list[OutputPort],
    duration: float,
    step: float,
    seed: int,
    progress: Progress | None,
    ended: Callable[[Context], bool] | None,
    rate: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], Context]:
    builder = DiagramBuilder()
    builder.AddSystem(system)
    bus = builder.AddSystem(Multiplexer([port.size() for port in ports]))
    for i, port in enumerate(ports):
        builder.Connect(port, bus.get_input_port(i))
    logger = LogVectorOutput(bus.get_output_port(), builder, publish_period=step)
    root = builder.Build()
    context = root.CreateDefaultContext()
    root.SetRandomContext(context, RandomGenerator(seed))
    simulator = Simulator(root, context)
    simulator.set_target_realtime_rate(rate)
    for one in system.GetSystems() if isinstance(system, Diagram) else []:
        if after_steps := getattr(one, "after_steps", None):  # of one block at most
            simulator.set_monitor(after_steps(context))
    simulator.Initialize()
    count = _SLICES if ended is None else max(1, math.ceil(duration / (_LOOKS * step)))
    for i in range(count):
        # The whole duration to its last digit, so that what happens then is not missed.
        simulator.AdvanceTo(duration if i + 1 == count else duration * (i + 1) / count)
        over = ended is not None and ended(context)
        if progress is not None:
            progress(1.0 if over else (i + 1) / count)
        if over:
            break
    log = logger.FindLog(context)
    return log.sample_times().copy(), log.data().copy(), context
