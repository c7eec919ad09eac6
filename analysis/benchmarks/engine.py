"""The two loops of the first paper as numbers, their exact solution, and a timer of solvers.

Another simulator is a :class:`LoopEngine`: it builds a model of a loop and runs it. Its result is
compared with the exact one before any time is taken.
"""

import gc
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from time import perf_counter
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from chamfer.analysis.servo.response_metrics import step_metrics
from chamfer.diagrams.servo.compiled_loop import compensate
from chamfer.diagrams.servo.servo_scenario import STEP, ResolvedServoScenario, fsm_axis, resolve

Samples = NDArray[np.float64]
LoopName = Literal["pid", "fsm"]

_DURATION: Final = 2.5  # s, section 5
_PID_STEP: Final = 1e-3  # s, of the output of the PID loop


class LoopCase:
    """The default step scenario over a duration, s, as the plain numbers that models take."""

    def __init__(self, loop: LoopName, duration: float = _DURATION) -> None:
        self.loop = loop
        self.duration = duration
        self.scenario: ResolvedServoScenario = resolve(replace(STEP, duration=duration))
        plant, pid = self.scenario.plant, self.scenario.pid
        self.amplitude = self.scenario.desired.amplitude  # m, of the step
        self.step = _PID_STEP if loop == "pid" else self.scenario.fsm.period  # s, of the output
        steps = np.arange(round(duration / self.step) + 1, dtype=np.float64)
        self.time: Samples = steps * self.step
        self.mass_damping_stiffness = plant.mass, plant.damping, plant.stiffness  # kg, N s/m, N/m
        self.gains = pid.proportional, pid.integral, pid.derivative, pid.filter  # of eq. (2)
        m, b, k = self.mass_damping_stiffness
        # Of the mass on spring and damper, state (position m, velocity m/s).
        self.dynamics: Samples = np.array([[0.0, 1.0], [-k / m, -b / m]])

    @cached_property
    def compensate(self) -> Callable[[float, float], float]:
        """Return the compensation, m, after a tick, from the last one and the true error, m.

        The camera rounds the error to its resolution; the decision of Fig. 4 uses the rounded
        error.
        """
        axis, resolution = fsm_axis(self.scenario, "position"), self.scenario.camera.resolution
        law = (axis.dead_zone, axis.large_error, axis.increment, axis.divider, axis.limit)

        def tick(compensation: float, error: float) -> float:
            seen = resolution * math.floor(error / resolution + 0.5)
            return float(compensate(compensation, seen, *law)[0])

        return tick


def exact(case: LoopCase) -> Samples:
    """Return the exact output of a loop, m, by matrix exponentials over one output step."""
    m, b, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    if case.loop == "pid":  # position, velocity, integral of the error, filtered error, step
        shown, state = 1, np.array([0.0, 0.0, 0.0, 0.0, case.amplitude])
        rates = [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-k / m, -(b + p + d * n) / m, i / m, -d * n / m, (p + d * n) / m],
            [0.0, -1.0, 0.0, 0.0, 1.0],
            [0.0, -n, 0.0, -n, n],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    else:  # position, velocity, compensation
        shown, state = 0, np.zeros(3)
        rates = [[0.0, 1.0, 0.0], [-k / m, -b / m, k / m], [0.0, 0.0, 0.0]]
    step = expm(np.array(rates) * case.step)
    output = np.empty_like(case.time)
    for row in range(len(output)):
        output[row] = state[shown]
        if case.loop == "fsm":
            state[2] = case.compensate(float(state[2]), case.amplitude - float(state[0]))
        state = step @ state
    return output


@dataclass(kw_only=True)
class LoopEngine:
    """A simulator with one of the loops, and its results."""

    name: str
    build: Callable[[], Any] = lambda: None  # returns a model that is good for one run
    run: Callable[[Any], Samples]  # from a built model to the output at the wanted times, m
    accuracy: float  # m, largest difference from the exact solution that the settings promise
    note: str  # the settings
    trials: int = 1  # that a run makes at once; its time is shared among them

    difference: float = math.nan  # m, from the exact solution, the largest
    steady_state_error: float | None = None  # m
    rise_time: float | None = None  # s
    failure: str = ""  # why there is no result
    building: list[float] = field(default_factory=list)  # s, a value per round
    running: list[float] = field(default_factory=list)  # s, from the model to arrays, per trial

    @property
    def ok(self) -> bool:
        """Whether the engine keeps what it promises."""
        return self.difference <= self.accuracy


def agree(engine: LoopEngine, case: LoopCase, solution: Samples) -> None:
    """Run an engine once and compare it with the exact solution.

    Another version of a peer may not have the functions called here: that is a finding, no abort.
    """
    try:
        output = engine.run(engine.build())
    except Exception as error:
        reason = " ".join(str(error).split()) or "no message"
        engine.failure = f"{type(error).__name__}: {reason}"
        return
    if output.shape != solution.shape:
        engine.failure = f"gave {output.shape[0]} samples instead of {solution.shape[0]}"
    elif not np.all(np.isfinite(output)):
        engine.failure = "gave a result that is not finite"
    else:
        measured = step_metrics(case.time, output, case.amplitude)
        engine.difference = float(np.abs(output - solution).max())
        engine.steady_state_error = measured.steady_state_error
        engine.rise_time = measured.rise_time


def interleave(
    engines: Sequence[LoopEngine],
    *,
    rounds: int,
    share: float,
    clock: Callable[[], float] = perf_counter,
) -> None:
    """Time the engines in turns, so that a busy machine affects all of them.

    Every round begins with another engine, so that none always follows the same one. An engine
    that would exceed its ``share`` of the time, s, skips the rest, after one round at least. An
    interrupt keeps the results so far.
    """
    for number in range(rounds):
        first = number % len(engines)
        for engine in (*engines[first:], *engines[:first]):
            spent = sum(engine.building) + engine.trials * sum(engine.running)
            if engine.running and spent * (1 + 1 / len(engine.running)) > share:
                continue
            gc.collect()
            start = clock()
            model = engine.build()
            built = clock()
            engine.run(model)
            end = clock()
            engine.building.append(built - start)
            engine.running.append((end - built) / engine.trials)


def median(values: Sequence[float]) -> float:
    """Return the median, NaN of nothing."""
    return statistics.median(values) if values else math.nan
