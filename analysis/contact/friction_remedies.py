"""Sections 3.2.4 and 3.3: what the remedies that the thesis proposes would buy."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import prefixed, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.contact.contact_runs import measure, run_contact
from chamfer.analysis.contact.friction_remedies_figures import plot_remedies
from chamfer.analysis.contact.loop_metrics import stability_metrics
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.adept_scenarios import (
    AdeptLoop,
    AdeptNuggetMotion,
    AdeptRollerMotion,
)
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.diagrams.contact.hybrid_resolve import resolve
from chamfer.models.validation import ParameterError, within
from chamfer.systems.force.friction_compensation import FrictionCompensationParams

_MOST_TRIALS: Final = 1000
_RUBBER: Final = 10.0  # by which a rubber cover lowers the contact's stiffness and damping


@dataclass(frozen=True, kw_only=True)
class RemediesScenario:
    """The two motion tests of the Adept."""

    roller: AdeptRollerMotion = field(default_factory=lambda: AdeptRollerMotion(duration=12.0))
    nugget: AdeptNuggetMotion = field(default_factory=lambda: AdeptNuggetMotion(duration=17.0))
    # of the remedies that compensate
    friction_compensation: FrictionCompensationParams = FrictionCompensationParams(bandwidth=20.0)
    trials: int = 2  # seeds over which the metrics of each remedy are averaged

    def __post_init__(self) -> None:
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")


Change = Callable[[AdeptLoop, RemediesScenario], AdeptLoop]


def _decouple(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    return replace(test, sensor=replace(test.sensor, decoupling=True))


def _compensate(test: AdeptLoop, scenario: RemediesScenario) -> AdeptLoop:
    return replace(test, friction_compensation=scenario.friction_compensation)


def _full_dynamics(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    return replace(test, controller=replace(test.controller, full_dynamics=True))


def _halve_friction(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    return _with_friction(test, 0.5)


def _no_friction(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    return _with_friction(test, 0.0)


def _with_friction(test: AdeptLoop, part: float) -> AdeptLoop:
    friction = test.arm.joint_friction
    coulomb = tuple(part * value for value in friction.coulomb)
    return replace(test, arm=replace(test.arm, joint_friction=replace(friction, coulomb=coulomb)))


def _rubber(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    """Cover the surface. The nugget's force then swings but for the joints that stick."""
    surface = test.surface
    return replace(
        test,
        surface=replace(
            surface,
            stiffness=surface.stiffness / _RUBBER,
            damping=surface.damping / _RUBBER,
        ),
        controller=replace(test.controller, allow_unstable=True),
    )


REMEDIES: Final[dict[str, tuple[Change, ...]]] = {
    "none": (),
    "rubber_cover": (_rubber,),
    "decoupling": (_decouple,),
    "full_dynamics": (_full_dynamics,),
    "half_friction": (_halve_friction,),
    "compensation": (_compensate,),
    "compensation_decoupling": (_compensate, _decouple),
    "all": (_compensate, _decouple, _full_dynamics),
    "no_friction": (_no_friction,),
    "no_friction_decoupling": (_no_friction, _decouple),
}
_MEASURED: Final = ("measured", "true", "position", "impact_share", "scratch_time")
TESTS: Final = ("roller", "nugget")


class Task(NamedTuple):
    """One of the seeds of a test with a remedy."""

    test: str
    remedy: str
    trial: int


def run_remedies(scenario: RemediesScenario, seed: int, progress: Progress) -> Outcome:
    """Run both tests with each remedy and each seed."""
    tasks = [
        Task(test, remedy, trial)
        for test in TESTS
        for remedy in REMEDIES
        for trial in range(scenario.trials)
    ]
    finished = run_each(partial(_run_task, scenario, seed), tasks, progress)
    finished.split(product(TESTS, REMEDIES), lambda task: task[:2])  # none may be without
    traces = {
        "test": column([TESTS.index(task.test) for task in finished.tasks]),
        "remedy": column([tuple(REMEDIES).index(task.remedy) for task in finished.tasks]),
        "trial": column([task.trial for task in finished.tasks]),
        **{name: finished.column(name) for name in _MEASURED},
    }
    seconds = sum(_test(scenario, task.test).duration for task in finished.tasks)
    metrics = _metrics(traces)
    for test in TESTS:
        metrics |= prefixed(test, stability_metrics(stability(_test(scenario, test))))
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=seconds)


def _run_task(scenario: RemediesScenario, seed: int, task: Task) -> Row:
    remedied = _remedied(_test(scenario, task.test), REMEDIES[task.remedy], scenario)
    traces = run_contact(remedied, trial_seed(seed, task.trial))
    measured = measure(remedied, traces)
    return {
        "measured": measured["force.deviation"],
        "true": measured["force.true_deviation"],
        "position": measured["position.lag_error"],
        "impact_share": measured["damage.impact_share"],
        "scratch_time": measured["damage.scratch_time"],
    }


def _test(scenario: RemediesScenario, name: str) -> AdeptLoop:
    tests: dict[str, AdeptLoop] = {"roller": scenario.roller, "nugget": scenario.nugget}
    return tests[name]


def _metrics(traces: Mapping[str, np.ndarray]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    kinds = (
        ("measured", "force.deviation", "N"),
        ("true", "force.true_deviation", "N"),
        ("position", "position.lag_error", "m"),
        ("impact_share", "damage.impact_share", "%"),
        ("scratch_time", "damage.scratch_time", "s"),
    )
    for i, test in enumerate(TESTS):
        for j, remedy in enumerate(REMEDIES):
            of = (traces["test"] == i) & (traces["remedy"] == j)
            for name, metric, unit in kinds:
                values = traces[name][of]
                known = bool(np.all(np.isfinite(values)))
                metrics[f"{test}.{remedy}.{metric}"] = Metric(
                    value=float(values.mean()) if known else None,
                    unit=unit,
                    note=f"mean of {len(values)} seeds, {values.min():.4g} to {values.max():.4g}"
                    if known
                    else "no contact",
                )
        base = metrics[f"{test}.none.force.true_deviation"].value
        cured = metrics[f"{test}.no_friction_decoupling.force.true_deviation"].value
        metrics[f"{test}.gain_without_friction"] = Metric(
            value=base / cured if base and cured else None,
            unit="",
            note="true deviation with joint friction and cross-talk over that without",
        )
    rubber = metrics["roller.rubber_cover.force.deviation"].value
    plain = metrics["roller.none.force.deviation"].value
    metrics["roller.rubber_ratio"] = Metric(
        value=rubber / plain if rubber and plain else None,
        unit="",
        note="deviation on the rubber-covered plate over that on the bare one",
    )
    return metrics


def _remedied(test: AdeptLoop, changes: Sequence[Change], scenario: RemediesScenario) -> AdeptLoop:
    for change in changes:
        test = change(test, scenario)
    return test


def resolve_friction_remedies(scenario: RemediesScenario) -> RemediesScenario:
    """Return the scenario with what it leaves open filled in, and checked."""
    for name, test in (("roller", scenario.roller), ("nugget", scenario.nugget)):
        for changes in REMEDIES.values():
            with within(name):
                resolve(_remedied(test, changes, scenario))
    return replace(scenario, roller=resolve(scenario.roller), nugget=resolve(scenario.nugget))


def figures(scenario: RemediesScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"friction-remedies": plot_remedies(TESTS, tuple(REMEDIES), outcome)}
