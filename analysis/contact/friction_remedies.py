"""Sections 3.2.4 and 3.3: benefit of the remedies that the thesis proposes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import prefixed, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.contact.contact_metrics import mean_over_seeds, stability_metrics
from chamfer.analysis.contact.contact_runs import measure, run_contact
from chamfer.analysis.drawing.figure_kit import draw_means, metric_value, name_rows
from chamfer.analysis.drawing.figure_style import (
    FORCE,
    POSITION,
    Style,
    dress,
    legend_below,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_MOTION,
    ADEPT_ROLLER_MOTION,
    AdeptLoop,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve, stability
from chamfer.diagrams.contact.hybrid_scenario import fill
from chamfer.models.validation import ParameterError, within
from chamfer.systems.force.friction_compensation import FrictionCompensationParams

_MOST_TRIALS: Final = 1000
_RUBBER: Final = 10.0  # by which a rubber cover lowers the contact's stiffness and damping


@dataclass(frozen=True, kw_only=True)
class RemediesScenario:
    """The two motion tests of the Adept."""

    roller: AdeptLoop = AdeptLoop(
        surface=ADEPT_ROLLER_MOTION.surface, task=ADEPT_ROLLER_MOTION.task, duration=12.0
    )
    nugget: AdeptLoop = AdeptLoop(task=ADEPT_NUGGET_MOTION.task, duration=17.0)
    # of the remedies that compensate
    friction_compensation: FrictionCompensationParams = FrictionCompensationParams(bandwidth=20.0)
    trials: int = 2  # seeds over which the metrics of each remedy are averaged

    def __post_init__(self) -> None:
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")


FRICTION_REMEDIES: Final = RemediesScenario()
Change = Callable[[AdeptLoop, RemediesScenario], AdeptLoop]


def _decouple(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    return replace(test, sensor=replace(test.sensor, decoupling=True))


def _compensate(test: AdeptLoop, scenario: RemediesScenario) -> AdeptLoop:
    return replace(test, friction_compensation=scenario.friction_compensation)


def _full_dynamics(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    return replace(test, controller=replace(test.controller, full_dynamics=True))


def _with_friction(part: float, test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    friction = test.arm.joint_friction
    coulomb = tuple(part * value for value in friction.coulomb)
    return replace(test, arm=replace(test.arm, joint_friction=replace(friction, coulomb=coulomb)))


def _rubber(test: AdeptLoop, _: RemediesScenario) -> AdeptLoop:
    """Cover the surface. The nugget's force then oscillates, except where joints stick."""
    stiffness, damping = test.surface.stiffness / _RUBBER, test.surface.damping / _RUBBER
    return replace(
        test,
        surface=replace(test.surface, stiffness=stiffness, damping=damping),
        controller=replace(test.controller, allow_unstable=True),
    )


REMEDIES: Final[dict[str, tuple[Change, ...]]] = {
    "none": (),
    "rubber_cover": (_rubber,),
    "decoupling": (_decouple,),
    "full_dynamics": (_full_dynamics,),
    "half_friction": (partial(_with_friction, 0.5),),
    "compensation": (_compensate,),
    "compensation_decoupling": (_compensate, _decouple),
    "all": (_compensate, _decouple, _full_dynamics),
    "no_friction": (partial(_with_friction, 0.0),),
    "no_friction_decoupling": (partial(_with_friction, 0.0), _decouple),
}
_MEASURED: Final = {  # metric and unit
    "measured": ("force.deviation", "N"),
    "true": ("force.true_deviation", "N"),
    "position": ("position.lag_error", "m"),
    "impact_share": ("damage.impact_share", "%"),
    "scratch_time": ("damage.scratch_time", "s"),
}
TESTS: Final = ("roller", "nugget")


class RemedyTrial(NamedTuple):
    """One of the seeds of a test with a remedy."""

    test: str
    remedy: str
    trial: int


def run_remedies(scenario: RemediesScenario, seed: int, progress: Progress) -> Outcome:
    """Run both tests with each remedy and each seed."""
    tasks = [
        RemedyTrial(test, remedy, trial)
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
    seconds = sum(getattr(scenario, task.test).duration for task in finished.tasks)
    metrics = _metrics(traces)
    for test in TESTS:
        metrics |= prefixed(test, stability_metrics(stability(getattr(scenario, test))))
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=seconds)


def _run_task(scenario: RemediesScenario, seed: int, task: RemedyTrial) -> Row:
    remedied = fill(_remedied(getattr(scenario, task.test), REMEDIES[task.remedy], scenario))
    measured = measure(remedied, run_contact(remedied, trial_seed(seed, task.trial)))
    return {name: measured[metric] for name, (metric, _) in _MEASURED.items()}


def _metrics(traces: Mapping[str, np.ndarray]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for i, test in enumerate(TESTS):
        for j, remedy in enumerate(REMEDIES):
            of = (traces["test"] == i) & (traces["remedy"] == j)
            for name, (metric, unit) in _MEASURED.items():
                mean = mean_over_seeds(traces[name][of], unit, "no contact")
                metrics[f"{test}.{remedy}.{metric}"] = mean
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
    """Return the scenario with its open fields filled in, and checked."""
    for name, test in (("roller", scenario.roller), ("nugget", scenario.nugget)):
        for changes in REMEDIES.values():
            with within(name):
                resolve(_remedied(test, changes, scenario))
    return replace(scenario, roller=resolve(scenario.roller), nugget=resolve(scenario.nugget))


_LABELS: Final = {
    "none": "no remedy",
    "rubber_cover": "rubber cover",
    "decoupling": "sensor decoupled",
    "full_dynamics": "full dynamics",
    "half_friction": "half the friction",
    "compensation": "friction compensated",
    "compensation_decoupling": "compensated, decoupled",
    "all": "all three",
    "no_friction": "no friction",
    "no_friction_decoupling": "no friction, decoupled",
}


def figures(_: RemediesScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw force deviation and position error for each test and remedy, a dot for each seed."""
    gain = [metric_value(outcome.metrics, f"{test}.none.force.true_deviation") for test in TESTS]
    figure = new_figure(
        height=7.6,
        caption="Largest true deviation of the force without any remedy: "
        + ", ".join(f"{one:.2g} N ({test})" for one, test in zip(gain, TESTS, strict=True))
        + ". Bars are means over the seeds with each remedy, dots are single seeds.",
    )
    panels = figure.subplots(2, 2, sharey=True, width_ratios=(3, 2))
    traces = outcome.traces
    for i, test in enumerate(TESTS):
        of = traces["test"] == i
        remedy = traces["remedy"][of]
        force, position = panels[i]
        for name, label, offset, color in (
            ("measured", "measured (noise, cross-talk)", -0.2, FORCE["color"]),
            ("true", "true", 0.2, POSITION["color"]),
        ):
            look: Style = {"offset": offset, "height": 0.36, "label": label}
            draw_means(force, traces[name][of], remedy, color, **look)
        draw_means(position, 1e3 * traces["position"][of], remedy, "#777777", height=0.5)
        dress(force, title=f"{test}: force deviation", x="largest deviation / N", y="")
        dress(position, title=f"{test}: position error", x="largest error / mm", y="")
        name_rows(force, [_LABELS[name] for name in REMEDIES])
    legend_below(figure, panels[0, 0])
    return {"friction-remedies": figure}
