"""Section 4.5: the thesis' observer, its corrections and replacements, on the same data."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import draw_intervals, metric_value, name_rows
from chamfer.analysis.drawing.figure_style import (
    OBSERVER_LOOKS,
    PUBLISHED,
    Style,
    dress,
    legend_below,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, part_of
from chamfer.analysis.surface.normal_trials import (
    Contender,
    Slide,
    contender,
    cost,
    observer_of,
    run_trial,
    sensed,
    slide,
    table_of_observers,
)
from chamfer.analysis.surface.observer_band import BandSuite, band_figure, band_metrics, run_suite
from chamfer.analysis.surface.observer_slides import CASES, SlideCase
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, SurfaceSettings
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.estimation.normal_filter import KINDS, ObserverKind
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.sensing.force_rate import ForceRateSensorParams

_WINDOW: Final = (2.0, 15.0)  # s
_MOST_TRIALS: Final = 10_000
_TIMED: Final = 3000  # updates


@dataclass(frozen=True, kw_only=True)
class ObserverComparisonScenario:
    """Settings of all observers, and the number of seeds of each case."""

    trials: int = 200  # seeds that each case gets
    smallest_radius: float = 0.75  # m, rho_min: the surface bends no sharper; section 5.2.2
    sensor: ForceRateSensorParams = ForceRateSensorParams()
    vision_error: float = 0.2  # relative, of the surface's shape as the camera sees it
    vision_radius: float = 3.0  # m, least radius of the camera's error
    suite: BandSuite = BandSuite()

    def __post_init__(self) -> None:
        require_positive(self, "smallest_radius", "vision_radius")
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")
        if not 0 <= self.vision_error < 1:
            raise ParameterError("vision_error", self.vision_error, "at least 0 and below 1")


OBSERVER_COMPARISON: Final = ObserverComparisonScenario()
OBSERVERS: Final = (
    "thesis",
    "gated",
    "prior_weights",
    "vision",
    "curvature",
    "friction",
    "adaptive",
    "adaptive_vision",
)
_WITH_CAMERA: Final[Mapping[str, ObserverKind]] = {
    "vision": "prior_weights",
    "adaptive_vision": "adaptive",
}


def _settings(
    scenario: ObserverComparisonScenario, case: SlideCase, name: str
) -> ObserverSettings:
    if name in _WITH_CAMERA:
        return ObserverSettings(
            kind=_WITH_CAMERA[name],
            smallest_radius=scenario.vision_radius,
            prediction=flattened(case.surface, scenario.vision_error),
        )
    (kind,) = (one for one in KINDS if one == name)
    return ObserverSettings(kind=kind, smallest_radius=scenario.smallest_radius)


def flattened(surface: SurfaceSettings, part: float) -> SurfaceSettings:
    """Return a surface that bends less, by a part of its curvature."""
    kept, given = 1 - part, surface.resolved()
    return replace(
        given,
        coefficients=tuple(kept * a for a in given.coefficients) if given.coefficients else None,
        curvatures=tuple(kept * a for a in given.curvatures) if given.curvatures else None,
        amplitudes=tuple(kept * a for a in given.amplitudes) if given.amplitudes else None,
        radius=given.radius / kept if given.radius else None,
    )


@cache
def _prepared(
    scenario: ObserverComparisonScenario, name: str
) -> tuple[Slide, tuple[Contender, ...], np.ndarray]:
    """Return a case's slide, observers and first normal; a process makes them once."""
    case = CASES[name]
    estimation = case.estimation(scenario.sensor, _WINDOW[1])
    on = slide(estimation)
    settings = (_settings(scenario, case, observer) for observer in OBSERVERS)
    return on, tuple(contender(estimation, one, on) for one in settings), estimation.up


class SlideTrial(NamedTuple):
    """One of the seeds in one of the cases."""

    case: str
    trial: int


_MEASURED: Final = {
    "rms": "error.rms",
    "bias": "error.bias",
    "coverage": "coverage",
    "largest": "error.max",
}


def _observe(scenario: ObserverComparisonScenario, seed: int, task: SlideTrial) -> Row:
    """Return each observer's results on a noisy slide, an array of shape (observers,) each."""
    on, contenders, up = _prepared(scenario, task.case)
    random = np.random.default_rng([seed, tuple(CASES).index(task.case), task.trial])
    shown = sensed(on, scenario.sensor, random)
    return run_trial(on, contenders, _MEASURED, shown, up=up, window=_WINDOW)


def run_comparison(scenario: ObserverComparisonScenario, seed: int, progress: Progress) -> Outcome:
    """Run all observers on all cases, each seed's noise the same for all."""
    tasks = [SlideTrial(case, trial) for case in CASES for trial in range(scenario.trials)]
    first = part_of(progress, 0.0, 0.5)
    finished = run_each(partial(_observe, scenario, seed), tasks, first)
    finished.split(CASES, lambda task: task.case)  # none may be without
    traces = table_of_observers(
        finished,
        len(OBSERVERS),
        case=[tuple(CASES).index(task.case) for task in finished.tasks],
        trial=[task.trial for task in finished.tasks],
    )
    metrics = _metrics(traces)
    known, suite = (scenario.sensor, scenario.smallest_radius), scenario.suite
    band = run_suite(suite, *known, seed, part_of(progress, 0.5, 1.0))
    metrics |= band_metrics(suite, band)
    on, contenders, up = _prepared(scenario, next(iter(CASES)))
    for observer, one in zip(OBSERVERS, contenders, strict=True):
        took = 1e6 * cost(one, on, up=up, updates=_TIMED)
        note = "of an update, on this machine"
        metrics[f"{observer}.cost"] = Metric(value=took, unit="us", note=note)
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=len(finished) * _WINDOW[1],
        tables={"band": band},
    )


def _metrics(traces: Mapping[str, np.ndarray]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    for i, case in enumerate(CASES):
        for j, observer in enumerate(OBSERVERS):
            of = (traces["case"] == i) & (traces["observer"] == j)
            rms, bias, covered = (traces[name][of] for name in ("rms", "bias", "coverage"))
            name = f"{case}.{observer}"
            note = f"of {len(rms)} seeds, {rms.min():.3g} to {rms.max():.3g}"
            value = math.sqrt(float(np.mean(rms**2)))
            metrics[f"{name}.rms"] = Metric(value=value, unit="deg", note=note)
            planar = CASES[case].surface.dimension == 2
            metrics[f"{name}.bias"] = Metric(
                value=float(np.mean(bias)) if planar else None,
                unit="deg",
                note="" if planar else "an angle in space has no sign",
            )
            metrics[f"{name}.coverage"] = Metric(value=float(np.mean(covered)), unit="%")
    for observer in OBSERVERS[1:]:
        ratio = {
            case: (metrics[f"{case}.{observer}.rms"].value or 0.0)
            / (metrics[f"{case}.thesis.rms"].value or math.nan)
            for case in CASES
        }
        groups = {
            "worst": tuple(CASES),
            "worst_constant": tuple(case for case in CASES if CASES[case].constant),
            "worst_reported": tuple(case for case in CASES if not CASES[case].tuned),
        }
        for group, cases in groups.items():
            worst = max(cases, key=ratio.__getitem__)
            metrics[f"{observer}.rms_ratio.{group}"] = Metric(
                value=ratio[worst], unit="", note=f"rms over the thesis filter's, {worst}"
            )
        covers = {case: metrics[f"{case}.{observer}.coverage"].value or 0.0 for case in CASES}
        least = min(covers, key=covers.__getitem__)
        metrics[f"{observer}.coverage.worst"] = Metric(value=covers[least], unit="%", note=least)
    return metrics


def resolve_comparison(scenario: ObserverComparisonScenario) -> ObserverComparisonScenario:
    """Return the scenario with its open fields filled in, and checked."""
    for case in CASES.values():
        estimation = case.estimation(scenario.sensor, _WINDOW[1])
        for observer in OBSERVERS:
            make_filter(observer_of(estimation, _settings(scenario, case, observer)))
    return scenario


_TARGET: Final = 99.0  # %


def _rms(outcome: Outcome, case: str, observer: str) -> float:
    return float(
        np.nan_to_num(metric_value(outcome.metrics, f"{case}.{observer}.rms"), nan=np.inf)
    )


def figures(scenario: ObserverComparisonScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw rms and coverage of each observer in each case, with the spread over the seeds."""
    least = {case: min(OBSERVERS, key=lambda one: _rms(outcome, case, one)) for case in CASES}
    best = max(OBSERVERS, key=list(least.values()).count)
    figure = new_figure(
        height=8.5,
        caption=f"Least rms error in {list(least.values()).count(best)} of {len(CASES)} cases: "
        f"{OBSERVER_LOOKS[best][0]}. Lines: 5 to 95 % of the seeds.",
    )
    errors, coverage = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(CASES))
    offsets = np.linspace(-0.33, 0.33, len(OBSERVERS))
    for j, observer in enumerate(OBSERVERS):
        label, color, marker = OBSERVER_LOOKS[observer]
        style: Style = {"color": color, "marker": marker, "markersize": 5, "clip_on": False}
        of = outcome.traces["observer"] == j
        spread = [
            np.percentile(outcome.traces["rms"][of & (outcome.traces["case"] == i)], [5, 95])
            for i in range(len(CASES))
        ]
        rms, covered = (
            [metric_value(outcome.metrics, f"{case}.{observer}.{name}") for case in CASES]
            for name in ("rms", "coverage")
        )
        low, high = np.transpose(spread)
        draw_intervals(errors, rows + offsets[j], rms, low, high, style, label)
        coverage.plot(covered, rows + offsets[j], label=label, **style | {"linestyle": ""})
    coverage.axvline(_TARGET, label=f"required, {_TARGET:g} %", **PUBLISHED)
    dress(errors, title="(a) RMS error of the normal", x="rms error / °", y="")
    title = "(b) Errors within 3 standard deviations"
    dress(coverage, title=title, x="coverage / %", y="")
    errors.set_xlim(left=0)
    coverage.set_xlim(0, 101)
    names = [
        f"{name.replace('_', ' ')}\n({'tuned on' if case.tuned else 'reported'})"
        for name, case in CASES.items()
    ]
    name_rows(errors, names, apart=(errors, coverage))
    legend_below(figure, coverage)
    return {
        "observer-comparison": figure,
        "observer-band": band_figure(scenario.suite, outcome.metrics),
    }
