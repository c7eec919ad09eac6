"""How far each engine is from the exact solution, and what an engineer reads off its result."""

from dataclasses import dataclass

import numpy as np

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName
from chamfer.analysis.benchmarks.exact import exact_fsm, exact_pid
from chamfer.analysis.servo.step_metrics import step_metrics


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


def exact(case: Case, loop: LoopName) -> Samples:
    """Return the exact output of a loop, m."""
    return exact_pid(case) if loop == "pid" else exact_fsm(case)


def agree(engine: Engine, case: Case, loop: LoopName, solution: Samples) -> Agreement:
    """Run an engine once and compare it with the exact solution.

    Another version of a peer may not know the calls made here: that is a finding, not the end.
    """
    time = case.pid_time if loop == "pid" else case.fsm_time
    try:
        output = engine.run(engine.build())
    except Exception as error:
        reason = " ".join(str(error).split()) or "no message"
        return Agreement(
            engine=engine.name,
            accuracy=engine.accuracy,
            failure=f"{type(error).__name__}: {reason}",
        )
    if output.shape != solution.shape:
        return Agreement(
            engine=engine.name,
            accuracy=engine.accuracy,
            failure=f"gave {output.shape[0]} samples instead of {solution.shape[0]}",
        )
    if not np.all(np.isfinite(output)):
        return Agreement(
            engine=engine.name,
            accuracy=engine.accuracy,
            failure="gave a result that is not finite",
        )
    measured = step_metrics(time, output, case.amplitude)
    return Agreement(
        engine=engine.name,
        difference=float(np.abs(output - solution).max()),
        accuracy=engine.accuracy,
        steady_state_error=measured.steady_state_error,
        rise_time=measured.rise_time,
    )
