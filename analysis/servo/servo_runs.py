"""Runs of the servo loops, unstable ones for as long as they are small."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.run.experiment import Progress
from analysis.run.simulate import simulate
from diagrams.servo.servo_loops import LOOPS, make_pid_loop, make_servo_diagram
from diagrams.servo.servo_scenario import ServoScenario
from systems.exact_discretisation import fuse

SIGNALS = ("desired_trajectory", "controller", "actual_trajectory")
_LARGEST_GROWTH = 6.0  # e-foldings of an unstable loop that are simulated


@dataclass(frozen=True, kw_only=True)
class ServoRun:
    """What the loops did."""

    traces: dict[str, NDArray[np.float64]]  # time, desired_trajectory and <loop>.<signal>
    growth: dict[str, float]  # 1/s, of each unstable loop


def run_loops(
    scenario: ServoScenario, loops: Sequence[str], *, seed: int, progress: Progress | None = None
) -> ServoRun:
    """Simulate loops of a resolved scenario, exactly and on the same times.

    The FSM loops run side by side in one diagram, the PID loops, linear as they are, each on its
    own. The traces of an unstable loop end, with NaN, after at most six e-foldings.
    """
    duration, step = scenario.duration or 0.0, scenario.step or 0.0
    machines = [name for name in loops if LOOPS[name].controller == "FSM"]
    stepped = simulate(
        make_servo_diagram(scenario, loops=machines, signals=SIGNALS, step=step),
        duration=duration,
        step=step,
        seed=seed,
        progress=progress,
    )
    traces = {
        "time": stepped.time,
        "desired_trajectory": stepped.outputs[f"{machines[0]}.desired_trajectory"],
    }
    growth = {}
    for name in loops:
        if name in machines:
            outputs = {signal: stepped.outputs[f"{name}.{signal}"] for signal in SIGNALS}
        else:
            rate = growth_rate(scenario, name)
            if rate > 0:
                growth[name] = rate
            lasts = duration if rate == 0 else min(duration, _LARGEST_GROWTH / rate)
            loop = make_pid_loop(scenario, LOOPS[name].form or scenario.plant.form)
            outputs = simulate(loop, duration=lasts, step=step).outputs
        for signal in SIGNALS[1:]:
            missing = np.full(len(stepped.time) - len(outputs[signal]), math.nan)
            traces[f"{name}.{signal}"] = np.concatenate([outputs[signal], missing])
    return ServoRun(traces=traces, growth=growth)


def growth_rate(scenario: ServoScenario, name: str) -> float:
    """Return the largest real part of a PID loop's poles, 1/s, or 0 for a stable loop.

    The poles on the imaginary axis are those of the desired trajectory. The FSM's output is
    bounded, so that its loops count as stable here.
    """
    loop = LOOPS[name]
    if loop.controller == "FSM" or loop.form is None:
        return 0.0
    poles = np.linalg.eigvals(fuse(make_pid_loop(scenario, loop.form)).A())
    largest = float(poles.real.max())
    return largest if largest > 1e-9 * float(np.abs(poles).max()) else 0.0
