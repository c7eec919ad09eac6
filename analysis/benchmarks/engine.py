"""The two loops of the first paper as numbers, what solves them exactly, and what times a solver.

Another simulator is an :class:`LoopEngine`: it builds a model of a loop and runs it. Its result is
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


@dataclass(frozen=True, kw_only=True)
class LoopCase:
    """A resolved step scenario as the plain numbers that the other engines' models take."""

    scenario: ResolvedServoScenario
    duration: float  # s

    @property
    def amplitude(self) -> float:
        """Height of the step, m."""
        return self.scenario.desired.amplitude

    @property
    def period(self) -> float:
        """Time between the state machine's ticks, s."""
        return self.scenario.fsm.period

    def time(self, loop: LoopName) -> Samples:
        """Return the times, s, at which a loop's output is wanted: every 1 ms, or the ticks."""
        step = _PID_STEP if loop == "pid" else self.period
        return np.arange(round(self.duration / step) + 1, dtype=np.float64) * step

    @cached_property
    def dynamics(self) -> Samples:
        """Matrix of the mass on spring and damper, state (position m, velocity m/s)."""
        m, b, k = self.mass_damping_stiffness
        return np.array([[0.0, 1.0], [-k / m, -b / m]])

    @property
    def mass_damping_stiffness(self) -> tuple[float, float, float]:
        """The plant's m kg, b N s/m and k N/m."""
        plant = self.scenario.plant
        return plant.mass, plant.damping, plant.stiffness

    @property
    def gains(self) -> tuple[float, float, float, float]:
        """P, I, D and N of eq. (2)."""
        pid = self.scenario.pid
        return pid.proportional, pid.integral, pid.derivative, pid.filter

    @cached_property
    def compensate(self) -> Callable[[float, float], float]:
        """A tick: from the compensation and the true error, m, to the compensation, m.

        The camera rounds the error to its resolution; Fig. 4 decides by what it shows.
        """
        axis, resolution = fsm_axis(self.scenario, "position"), self.scenario.camera.resolution
        law = (axis.dead_zone, axis.large_error, axis.increment, axis.divider, axis.limit)

        def tick(compensation: float, error: float) -> float:
            seen = resolution * math.floor(error / resolution + 0.5)
            return float(compensate(compensation, seen, *law)[0])

        return tick


def make_case(duration: float = _DURATION) -> LoopCase:
    """Return the default step scenario over a duration, s."""
    scenario = resolve(replace(STEP, duration=duration))
    return LoopCase(scenario=scenario, duration=duration)


def exact(case: LoopCase, loop: LoopName) -> Samples:
    """Return the exact output of a loop, m, by matrix exponentials over one output step."""
    return _exact_pid(case) if loop == "pid" else _exact_fsm(case)


def _exact_pid(case: LoopCase) -> Samples:
    """The state is position, velocity, integral of the error, filtered error and the step."""
    m, b, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    loop = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-k / m, -(b + p + d * n) / m, i / m, -d * n / m, (p + d * n) / m],
            [0.0, -1.0, 0.0, 0.0, 1.0],
            [0.0, -n, 0.0, -n, n],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    step = expm(loop * _PID_STEP)
    state = np.array([0.0, 0.0, 0.0, 0.0, case.amplitude])
    output = np.empty_like(case.time("pid"))
    for row in range(len(output)):
        output[row] = state[1]
        state = step @ state
    return output


def _exact_fsm(case: LoopCase) -> Samples:
    m, _, k = case.mass_damping_stiffness
    held = np.zeros((3, 3))
    held[:2, :2] = case.dynamics
    held[1, 2] = k / m
    step = expm(held * case.period)
    state = np.zeros(3)
    output = np.empty_like(case.time("fsm"))
    for row in range(len(output)):
        output[row] = state[0]
        state[2] = case.compensate(float(state[2]), case.amplitude - float(state[0]))
        state = step @ state
    return output


@dataclass(frozen=True, kw_only=True)
class LoopEngine:
    """A simulator with one of the loops."""

    name: str
    build: Callable[[], Any]  # returns a model that is good for one run
    run: Callable[[Any], Samples]  # from a built model to the output at the wanted times, m
    accuracy: float  # m, largest difference from the exact solution that the settings promise
    note: str  # the settings
    trials: int = 1  # that a run makes at once; its time is shared among them


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """An engine's result against the exact one, or the reason why there is none."""

    engine: str
    difference: float | None = None  # m, the largest at the common times
    accuracy: float  # m, what the engine promises
    steady_state_error: float | None = None  # m
    rise_time: float | None = None  # s
    failure: str = ""

    @property
    def ok(self) -> bool:
        """Whether the engine keeps what it promises."""
        return self.difference is not None and self.difference <= self.accuracy


def agree(engine: LoopEngine, case: LoopCase, loop: LoopName, solution: Samples) -> Agreement:
    """Run an engine once and compare it with the exact solution.

    Another version of a peer may not know the calls made here: that is a finding, not the end.
    """
    none = Agreement(engine=engine.name, accuracy=engine.accuracy)
    try:
        output = engine.run(engine.build())
    except Exception as error:
        reason = " ".join(str(error).split()) or "no message"
        return replace(none, failure=f"{type(error).__name__}: {reason}")
    if output.shape != solution.shape:
        said = f"gave {output.shape[0]} samples instead of {solution.shape[0]}"
        return replace(none, failure=said)
    if not np.all(np.isfinite(output)):
        return replace(none, failure="gave a result that is not finite")
    measured = step_metrics(case.time(loop), output, case.amplitude)
    return replace(
        none,
        difference=float(np.abs(output - solution).max()),
        steady_state_error=measured.steady_state_error,
        rise_time=measured.rise_time,
    )


@dataclass
class Times:
    """What was measured of one engine, s, a value per round."""

    trials: int = 1  # of a round
    building: list[float] = field(default_factory=list)
    running: list[float] = field(default_factory=list)

    @property
    def rounds(self) -> int:
        """How many rounds have been measured."""
        return len(self.running)

    @property
    def build(self) -> float | None:
        """Median time of building the model, s, or None before the first round."""
        return median(self.building)

    @property
    def run(self) -> float | None:
        """Median time of a trial from the model to the arrays of results, s."""
        return statistics.median(self.running) / self.trials if self.running else None

    @property
    def least(self) -> float | None:
        """Least time of a trial from the model to the arrays of results, s."""
        return min(self.running) / self.trials if self.running else None

    @property
    def spent(self) -> float:
        """Time spent so far, s."""
        return sum(self.building) + sum(self.running)


def interleave(
    engines: Sequence[LoopEngine],
    times: dict[str, Times],
    *,
    rounds: int,
    share: float,
    clock: Callable[[], float] = perf_counter,
) -> None:
    """Run the engines in turns, so that a busy machine is busy for all of them.

    Every round begins with another engine, so that none always follows the same one. An engine
    that would exceed its share of the time sits the rest out, after one round at least.

    Args:
        engines: Which ones; their names are the keys of ``times``.
        times: Is filled as the rounds go, so that an interrupt leaves what there is.
        rounds: How many.
        share: s, for each engine.
        clock: Gives the time, s.
    """
    for engine in engines:
        times.setdefault(engine.name, Times(trials=engine.trials))
    for number in range(rounds):
        first = number % len(engines)
        for engine in (*engines[first:], *engines[:first]):
            taken = times[engine.name]
            if taken.rounds and taken.spent * (1 + 1 / taken.rounds) > share:
                continue
            gc.collect()
            start = clock()
            model = engine.build()
            built = clock()
            engine.run(model)
            end = clock()
            taken.building.append(built - start)
            taken.running.append(end - built)


def median(values: Sequence[float] | None) -> float | None:
    """Return the median, or None of nothing."""
    return statistics.median(values) if values else None


def ratio(time: float | None, reference: float | None) -> float | None:
    """Return how many times longer than the reference, or None if one is missing."""
    return None if time is None or not reference else time / reference
