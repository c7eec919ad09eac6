"""Runs of the servo loops, unstable ones for as long as they are small."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.primitives import LinearSystem

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Progress
from chamfer.diagrams.servo.servo_loops import LOOPS, make_pid_loop, make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import RADIANS_PER_STEP, ResolvedServoScenario
from chamfer.models.plants.linear_response import fastest_mode
from chamfer.models.plants.servo_plant import Form
from chamfer.models.validation import ParameterError
from chamfer.systems.exact_discretisation import fuse

SIGNALS = ("desired_trajectory", "controller", "actual_trajectory")
_MOST_STEPS = 5_000_000
_LARGEST_ROUNDING = 1e-2  # of a loop, of the exponents of its response at its end
_LARGEST_GROWTH = 6.0  # e-foldings of an unstable loop that are simulated


@dataclass(frozen=True, kw_only=True)
class ServoRun:
    """What the loops did."""

    traces: dict[str, NDArray[np.float64]]  # time, desired_trajectory and <loop>.<signal>
    growth: dict[str, float]  # 1/s, of each unstable loop
    pid_loops: dict[str, LinearSystem]  # each as one block


def run_loops(
    scenario: ResolvedServoScenario,
    loops: Sequence[str],
    *,
    seed: int,
    progress: Progress | None = None,
) -> ServoRun:
    """Simulate loops, exactly and on the same times.

    Each runs on its own, so that all FSM loops see the same noise of the camera. The traces of an
    unstable loop end, with NaN, after at most six e-foldings.
    """
    duration, step = scenario.duration, scenario.step
    machines: dict[str, NDArray[np.float64]] = {}
    names = [name for name in loops if LOOPS[name].controller == "FSM"]
    for i, name in enumerate(names):
        run = simulate(
            make_servo_diagram(scenario, loops=(name,), signals=SIGNALS, step=step),
            duration=duration,
            step=step,
            seed=seed,
        )
        machines |= {"time": run.time, **run.outputs}
        machines["desired_trajectory"] = run.outputs[f"{name}.desired_trajectory"]
        if progress is not None:
            progress((i + 1) / len(names))
    return _with_pid_loops(
        scenario, loops, machines, lambda form: fuse(make_pid_loop(scenario, form))
    )


def run_compiled_loops(
    scenario: ResolvedServoScenario, loops: Sequence[str], *, seed: int
) -> ServoRun:
    """Do what :func:`run_loops` does, without Drake's simulator: for the points of a sweep."""
    # Loading the compiler takes longer than one run, which has no use for it.
    from chamfer.diagrams.servo.compiled_loop import fuse_pid_loop, run_fsm_trials

    machines: dict[str, NDArray[np.float64]] = {}
    for name in loops:
        loop = LOOPS[name]
        if loop.controller == "FSM":
            run = run_fsm_trials(
                scenario,
                loop.form or scenario.plant.form,
                duration=scenario.duration,
                step=scenario.step,
                feedforward=loop.feedforward,
                seed=seed,
            )
            machines["time"] = run.time
            machines["desired_trajectory"] = run.desired_trajectory[0]
            machines[f"{name}.controller"] = run.controller[0]
            machines[f"{name}.actual_trajectory"] = run.actual_trajectory[0]
    return _with_pid_loops(scenario, loops, machines, partial(fuse_pid_loop, scenario))


def _with_pid_loops(
    scenario: ResolvedServoScenario,
    loops: Sequence[str],
    machines: Mapping[str, NDArray[np.float64]],
    fused: Callable[[Form], LinearSystem],
) -> ServoRun:
    """Solve the PID loops among the loops, beside the traces of the FSM loops."""
    duration, step = scenario.duration, scenario.step
    traces = {name: machines[name] for name in ("time", "desired_trajectory")}
    growth = {}
    pid_loops = {}
    for name in loops:
        if LOOPS[name].controller == "FSM":
            traces |= {f"{name}.{signal}": machines[f"{name}.{signal}"] for signal in SIGNALS[1:]}
            continue
        loop = pid_loops[name] = fused(LOOPS[name].form or scenario.plant.form)
        _require_exact(name, loop, duration)
        rate = growth_rate(loop)
        if rate > 0:
            growth[name] = rate
        lasts = duration if rate == 0 else min(duration, _LARGEST_GROWTH / rate)
        outputs = simulate(loop, duration=lasts, step=step).outputs["y0"]
        for signal, values in zip(SIGNALS[1:], outputs.T[1:], strict=True):
            missing = np.full(len(traces["time"]) - len(values), math.nan)
            traces[f"{name}.{signal}"] = np.concatenate([values, missing])
    return ServoRun(traces=traces, growth=growth, pid_loops=pid_loops)


def pid_response(
    scenario: ResolvedServoScenario, run: ServoRun, name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and actual trajectory of a PID loop, fine enough for its fastest mode.

    They are the run's unless the loop is faster than the plant, which the run's steps follow.

    Raises:
        ParameterError: If it takes too many steps.
    """
    duration, step = scenario.duration, scenario.step
    loop = run.pid_loops[name]
    initial = loop.CreateDefaultContext().get_continuous_state_vector().CopyToVector()
    fastest = fastest_mode(loop.A(), loop.C()[-1], initial)
    if step * fastest <= RADIANS_PER_STEP:
        return run.traces["time"], run.traces[f"{name}.actual_trajectory"]
    finer = step / 2.0 ** math.ceil(math.log2(step * fastest / RADIANS_PER_STEP))
    if duration / finer > _MOST_STEPS:
        raise ParameterError(
            f"the fastest mode of {name}",
            fastest,
            f"at most {RADIANS_PER_STEP * _MOST_STEPS / duration:.4g} 1/s in {duration:g} s",
        )
    fine = simulate(loop, duration=duration, step=finer)
    return fine.time, fine.outputs["y0"][:, -1]


def _require_exact(name: str, loop: LinearSystem, duration: float) -> None:
    """Refuse a loop of which rounding leaves nothing: poles and response would be made up."""
    fastest = float(np.abs(loop.A()).max())
    most = _LARGEST_ROUNDING / (np.finfo(np.float64).eps * duration)
    if not fastest <= most:
        raise ParameterError(
            f"the largest coefficient of {name}",
            fastest,
            f"at most {most:.4g}, gains and plant make the loop overflow",
        )


def growth_rate(loop: LinearSystem) -> float:
    """Return the largest real part of a PID loop's poles, 1/s, or 0 for a stable loop.

    The poles on the imaginary axis are those of the desired trajectory.
    """
    poles = np.linalg.eigvals(loop.A())
    largest = float(poles.real.max())
    return largest if largest > 1e-9 * float(np.abs(poles).max()) else 0.0
