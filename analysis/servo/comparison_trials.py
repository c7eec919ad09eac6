"""Steps undone by the two controllers that are designed for one plant: drawn, run, measured."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row, with_table
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Progress
from chamfer.diagrams.servo.comparison_loop import (
    ComparedLoopScenario,
    ControllerKind,
    ResolvedComparedLoopScenario,
    make_compared_diagram,
    resolve_compared,
)
from chamfer.models.plants.servo_plant import ServoPlantParams, transfer_function
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.sampled_pid import PidGains

Array = NDArray[np.float64]

CONTROLLERS: Final[tuple[ControllerKind, ...]] = ("fsm", "pid")
CONDITIONS: Final = {
    "nominal": "no disturbance",
    "noise": "more noise",
    "friction": "dry friction",
    "lost": "lost frames",
    "plant": "another plant",
    "all": "all of it",
}
_MOST: Final = 10_000  # trials
_SAMPLES: Final = 8  # of a trace, between two frames
_LATE: Final = 2 / 3  # of a run, after which it should be at rest
_NOISE: Final = 3.0  # times the camera's largest error
_FRICTION: Final = 2.0  # tolerances


class Criterion(NamedTuple):
    """What controllers are compared by; less is better."""

    unit: str
    says: str


CRITERIA: Final = {
    "settling_time": Criterion("s", "settling time"),
    "error": Criterion("m", "error at rest"),
    "overshoot": Criterion("%", "overshoot"),
    "travel": Criterion("m", "travel of the command"),
}


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """What controllers meet that they are not designed for, one at a time and all together."""

    noise: float | None = None
    # m, half-width of the camera's noise instead of its own; None: three times its largest error
    friction: float | None = None
    # m of the command, by which it goes ahead of the plant, either way; None: twice the tolerance
    lost: float = 0.3  # share of frames in which nothing is found
    plant: float = 0.3  # share, by which gain and all times of the plant are off, either way

    def __post_init__(self) -> None:
        for name in ("noise", "friction"):
            value = getattr(self, name)
            if value is not None and not 0 <= value < math.inf:
                raise ParameterError(name, value, "a finite number >= 0")
        for name in ("lost", "plant"):
            value = getattr(self, name)
            if not 0 <= value < 1:
                raise ParameterError(name, value, "0 <= share < 1")


@dataclass(frozen=True, kw_only=True)
class StepSpread:
    """By how much trials differ, beside their noise."""

    step: float = 0.25  # share, of the step's height, uniform within plus and minus it

    def __post_init__(self) -> None:
        if not 0 <= self.step < 1:
            raise ParameterError("step", self.step, "0 <= share < 1")


@dataclass(frozen=True, kw_only=True)
class ServoComparisonScenario(ComparedLoopScenario):
    """Many steps, with each controller under each disturbance."""

    disturbance: Disturbances = field(default_factory=Disturbances)
    spread: StepSpread = field(default_factory=StepSpread)
    trials: int = 20  # steps, each with every controller under every disturbance

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.trials <= _MOST:
            raise ParameterError("trials", self.trials, f"1 to {_MOST}")


COMPARISON: Final = ServoComparisonScenario()


@dataclass(frozen=True, kw_only=True)
class ResolvedDisturbances(Disturbances):
    """What controllers meet, with nothing left open."""

    noise: float = field()
    friction: float = field()


@dataclass(frozen=True, kw_only=True)
class ResolvedServoComparisonScenario(ServoComparisonScenario):
    """Many steps, with both controllers designed."""

    tolerance: float = field()
    fsm: AxisParams = field()
    pid: PidGains = field()
    duration: float = field()
    disturbance: ResolvedDisturbances = field()

    @property
    def loop(self) -> ResolvedComparedLoopScenario:
        """One loop, without disturbance."""
        names = (one.name for one in fields(ResolvedComparedLoopScenario))
        return ResolvedComparedLoopScenario(**{name: getattr(self, name) for name in names})


def resolve_comparison(scenario: ServoComparisonScenario) -> ResolvedServoComparisonScenario:
    """Return the scenario with both controllers, and what they meet."""
    loop, disturbance = resolve_compared(scenario), scenario.disturbance
    bound = scenario.camera.measurement.bound
    noise, friction = disturbance.noise, disturbance.friction
    if noise is None:
        noise = _NOISE * (bound or loop.tolerance / 10)
    if friction is None:
        friction = _FRICTION * loop.tolerance
    met = ResolvedDisturbances(**vars(disturbance) | {"noise": noise, "friction": friction})
    return ResolvedServoComparisonScenario(
        **vars(loop), disturbance=met, spread=scenario.spread, trials=scenario.trials
    )


def drawn(
    scenario: ResolvedServoComparisonScenario, seed: int, trial: int
) -> dict[str, ResolvedComparedLoopScenario]:
    """Return what a trial runs, by :data:`CONDITIONS`.

    A plant that was identified is another one in every trial, one that may as well be behind the
    measurement. The controllers stay those that are designed for the scenario's own plant.
    """
    generator = np.random.default_rng([seed, trial])
    height, gain, time = generator.uniform(-1.0, 1.0, 3).tolist()
    plant = scenario.plant
    if plant.identified is not None:
        plant = replace(plant, identified=plant.identified.drawn(generator))
    amplitude = scenario.desired.amplitude * (1 + scenario.spread.step * height)
    nominal = replace(
        scenario.loop, plant=plant, desired=replace(scenario.desired, amplitude=amplitude)
    )
    off = scenario.disturbance
    model = transfer_function(plant).scaled(
        gain=1 + math.copysign(off.plant, gain), time=1 + math.copysign(off.plant, time)
    )
    another = ServoPlantParams(**model._asdict())
    noisy = replace(scenario.camera, noise=off.noise)
    blind = replace(scenario.camera, lost=off.lost)
    return {
        "nominal": nominal,
        "noise": replace(nominal, camera=noisy),
        "friction": replace(nominal, friction=off.friction),
        "lost": replace(nominal, camera=blind),
        "plant": replace(nominal, plant=another),
        "all": replace(
            nominal, plant=another, friction=off.friction, camera=replace(noisy, lost=off.lost)
        ),
    }


def compare_all(
    scenario: ResolvedServoComparisonScenario, seed: int, progress: Progress
) -> Trials[int]:
    """Run every trial."""
    return run_each(partial(_compare, scenario, seed), range(scenario.trials), progress)


def _compare(scenario: ResolvedServoComparisonScenario, seed: int, trial: int) -> Row:
    row: dict[str, float | None] = {}
    courses: dict[str, list[Array]] = {"condition": [], "controller": [], "time": [], "error": []}
    for i, (condition, world) in enumerate(drawn(scenario, seed, trial).items()):
        for j, controller in enumerate(CONTROLLERS):
            run = simulate(
                make_compared_diagram(world, controller),
                duration=world.duration,
                step=world.camera.period / _SAMPLES,
                seed=trial_seed(seed, trial),
            )
            error = world.desired.amplitude - run.outputs["position"]
            measured = measure(
                run.time,
                error,
                run.outputs["command"],
                height=world.desired.amplitude,
                tolerance=world.tolerance,
            )
            row |= {f"{condition}.{controller}.{name}": one for name, one in measured.items()}
            seen = slice(None, None, _SAMPLES)
            count = len(run.time[seen])
            for name, values in (
                ("condition", np.full(count, float(i))),
                ("controller", np.full(count, float(j))),
                ("time", run.time[seen]),
                ("error", error[seen]),
            ):
                courses[name].append(values)
    return with_table(row, {name: np.concatenate(values) for name, values in courses.items()})


def measure(
    time: Array, error: Array, command: Array, *, height: float, tolerance: float
) -> Mapping[str, float | None]:
    """Return the criteria of a run.

    Args:
        time: s, shape (n,).
        error: m, desired minus actual position, shape (n,).
        command: m, of the controller, shape (n,).
        height: m, of the step.
        tolerance: m, within which it is settled.

    Returns:
        ``settling_time`` s, None where the error is outside in the last third of the run;
        ``error`` m, root mean square in that third; ``overshoot`` %, beyond the step;
        ``travel`` m, which the command goes in that third.
    """
    late = time >= _LATE * time[-1]
    outside = np.flatnonzero(np.abs(error) > tolerance)
    last = int(outside[-1]) if len(outside) else -1
    settled = not late[max(last, 0)]
    return {
        "settling_time": float(time[last + 1]) if settled else None,
        "error": float(np.sqrt(np.mean(error[late] ** 2))),
        "overshoot": 100.0 * max(0.0, float((-error / height).max())),
        "travel": float(np.abs(np.diff(command[late])).sum()),
    }
