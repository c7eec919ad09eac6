"""Observers with a wrong model: the gripper's stiffness, the sensor's bias, its delay.

By default a surface gets few draws, so that it runs within minutes; conclusions want ``trials=8``.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import metric_value, name_rows
from chamfer.analysis.drawing.figure_style import (
    OBSERVER_LOOKS,
    PUBLISHED,
    dress,
    legend_below,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.analysis.surface.normal_trials import (
    Contender,
    Slide,
    contender,
    run_trial,
    sensed,
    slide,
    table_of_observers,
)
from chamfer.analysis.surface.observer_slides import CASES, SlideCase
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LeadSettings,
    ResolvedEstimationScenario,
)
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, SurfaceSettings
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
    require_same,
)
from chamfer.systems.estimation.model_error import ModelErrorParams
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

Array = NDArray[np.float64]

_WINDOW: Final = (2.0, 15.0)  # s, of the motion along x
_HOVER: Final = 1.0  # s
_PRESS: Final = 3.0  # s
_MOST_TRIALS: Final = 1000

SURFACES: Final[Mapping[str, SlideCase]] = {
    **CASES,
    "space_ball": SlideCase(
        SurfaceSettings(shape="sphere", radius=1.0, inside=False),
        SurfaceFriction(coefficient=0.4),
        True,
        LeadSettings(depth=0.2, speed=0.1, sideways=0.1),
    ),
    "space_saddle": SlideCase(
        SurfaceSettings(shape="paraboloid", coefficients=(0.2, -0.2)),
        SurfaceFriction(coefficient=0.4),
        False,
        LeadSettings(sideways=0.1),
    ),
}


@dataclass(frozen=True, kw_only=True)
class ModelErrorScenario:
    """Errors of the model, and the adaptive observer's bounds on them."""

    surfaces: tuple[str, ...] = tuple(SURFACES)  # of the slides
    trials: int = 2  # random errors on each surface, and seeds at each corner
    smallest_radius: float = 0.75  # m, rho_min: the surface bends no sharper; section 5.2.2
    sensor: ForceRateSensorParams = ForceRateSensorParams()
    rate: ForceRateParams = ForceRateParams(time_constant=0.2)  # of the differenced force
    stiffness_error: float = 0.3  # relative, bound on the error of the K that is set
    bias: float = 2.0  # N, bound on the force's bias
    latest: int = 2  # samples, largest delay of the force, from one on
    model_error: ModelErrorParams = ModelErrorParams(
        stiffness=0.3, bias=1.5, delay=0.05, delay_deviation=0.05, tare=_HOVER, press=_PRESS
    )

    def __post_init__(self) -> None:
        allowed = tuple(SURFACES)
        if not self.surfaces or set(self.surfaces) - set(allowed):
            raise ParameterError("surfaces", self.surfaces, f"some of {', '.join(allowed)}")
        require_positive(self, "smallest_radius")
        require_same(self.sensor, ForceRateSensorParams, "sensor", "bias", why="drawn")
        require_not_negative(self, "bias")
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")
        if not 0 <= self.stiffness_error < 1:
            raise ParameterError("stiffness_error", self.stiffness_error, "a part below 1")
        if not 1 <= self.latest <= 10:
            raise ParameterError("latest", self.latest, "1 to 10")
        for name, most in (("tare", _HOVER), ("press", _PRESS)):
            if not getattr(self.model_error, name) <= most:
                given = getattr(self.model_error, name)
                raise ParameterError(f"model_error.{name}", given, f"at most {most:g} s")


MODEL_ERROR: Final = ModelErrorScenario()
# thesis, and the adaptive observer as it is told nothing of errors, and as it is.
OBSERVERS: Final = ("thesis", "trusting", "adaptive")


class Wrong(NamedTuple):
    """Model errors of a run."""

    told: float = 1.0  # stiffness over the true one
    bias: tuple[float, ...] | None = None  # N
    late: int = 0  # samples
    differenced: bool = False


def corners(scenario: ModelErrorScenario, dimension: int) -> tuple[Wrong, ...]:
    """Return all errors at their bounds; the bias is sideways, where it matters most."""
    error, side = scenario.stiffness_error, 1
    shifts = [
        tuple(float(sign * scenario.bias * (i == side)) for i in range(dimension))
        for sign in (-1, 1)
    ]
    return tuple(
        Wrong(told, bias, late, differenced=True)
        for told, bias, late in product(
            (1 - error, 1 + error), shifts, sorted({1, scenario.latest})
        )
    )


def drawn(scenario: ModelErrorScenario, dimension: int, random: np.random.Generator) -> Wrong:
    """Return random errors: uniform, the bias in any direction."""
    direction = random.standard_normal(dimension)
    bias = scenario.bias * random.uniform() * direction / np.linalg.norm(direction)
    return Wrong(
        1 + scenario.stiffness_error * random.uniform(-1, 1),
        tuple(bias.tolist()),
        int(random.integers(1, scenario.latest + 1)),
        differenced=True,
    )


def _estimation(scenario: ModelErrorScenario, name: str) -> ResolvedEstimationScenario:
    return SURFACES[name].estimation(scenario.sensor, _WINDOW[1], hover=_HOVER, press=_PRESS)


@cache
def _prepared(scenario: ModelErrorScenario, name: str) -> tuple[ResolvedEstimationScenario, Slide]:
    """Return a surface's slide; a process makes it once."""
    estimation = _estimation(scenario, name)
    return estimation, slide(estimation)


def _contenders(
    scenario: ModelErrorScenario, estimation: EstimationScenario, on: Slide, wrong: Wrong
) -> list[Contender]:
    true = np.array(estimation.gripper.matrix(estimation.dimension))
    sensor = scenario.sensor
    noise = sensor.force_rate_noise
    lag = 0.0
    if wrong.differenced:
        lag = scenario.rate.time_constant
        noise = sensor.force_noise * scenario.rate.noise_gain(estimation.observer.period)
    thesis = ObserverSettings(
        kind="thesis",
        stiffness=tuple(map(tuple, (wrong.told * true).tolist())),
        force_rate_noise=noise,
        smallest_radius=scenario.smallest_radius,
    )
    trusting = replace(thesis, kind="adaptive", rate_lag=lag)
    adaptive = replace(trusting, model_error=scenario.model_error)
    return [contender(estimation, one, on) for one in (thesis, trusting, adaptive)]


class ModelErrorTrial(NamedTuple):
    """One of the runs on a surface: right, drawn, or at a corner."""

    surface: str
    kind: int  # 0 right, 1 drawn, from 2 on the corners
    trial: int


_MEASURED: Final = {"rms": "error.rms", "coverage": "coverage", "nees": "nees"}


def _observe(scenario: ModelErrorScenario, seed: int, task: ModelErrorTrial) -> Row:
    """Return each observer's results on a slide, an array of shape (observers,) each."""
    estimation, on = _prepared(scenario, task.surface)
    d = estimation.dimension
    random = np.random.default_rng([seed, tuple(SURFACES).index(task.surface), *task[1:]])
    wrong = Wrong()
    if task.kind == 1:
        wrong = drawn(scenario, d, random)
    elif task.kind > 1:
        wrong = corners(scenario, d)[task.kind - 2]
    sensor = replace(scenario.sensor, bias=wrong.bias)
    rate = scenario.rate if wrong.differenced else None
    begins = estimation.lead.begins
    return run_trial(
        on,
        _contenders(scenario, estimation, on, wrong),
        _MEASURED,
        sensed(on, sensor, random, late=wrong.late, differenced=rate),
        up=estimation.up,
        window=(begins + _WINDOW[0], begins + _WINDOW[1]),
    )


def run_model_error(scenario: ModelErrorScenario, seed: int, progress: Progress) -> Outcome:
    """Run all observers on all surfaces, with a right model, random errors, and every corner."""
    tasks = [
        ModelErrorTrial(surface, kind, trial)
        for surface in scenario.surfaces
        for kind in range(2 + len(corners(scenario, SURFACES[surface].surface.dimension)))
        for trial in range(scenario.trials)
    ]
    finished = run_each(partial(_observe, scenario, seed), tasks, progress)
    finished.split(scenario.surfaces, lambda task: task.surface)  # none may be without
    names = scenario.surfaces
    traces = table_of_observers(
        finished,
        len(OBSERVERS),
        surface=[names.index(task.surface) for task in finished.tasks],
        kind=[task.kind for task in finished.tasks],
        trial=[task.trial for task in finished.tasks],
    )
    return Outcome(
        metrics=_metrics(traces, names),
        traces=traces,
        simulated_seconds=len(finished) * (_HOVER + _PRESS + _WINDOW[1]),
    )


# Where what it is told is right, wrong by chance, and at the worst corner.
_KINDS: Final = {
    "right": ("right model", "|", "full"),
    "drawn": ("random errors", "o", "full"),
    "corner": ("worst corner", "D", "none"),
}


def _metrics(traces: Mapping[str, Array], surfaces: tuple[str, ...]) -> dict[str, Metric]:
    metrics: dict[str, Metric] = {}
    kinds = range(int(traces["kind"].max()) + 1)
    measures = (("rms", "deg", np.max), ("coverage", "%", np.min), ("nees", "", np.max))
    for (i, surface), (j, observer), (name, unit, worst) in product(
        enumerate(surfaces), enumerate(OBSERVERS), measures
    ):
        here = (traces["surface"] == i) & (traces["observer"] == j)
        of_kind = [traces[name][here & (traces["kind"] == kind)] for kind in kinds]
        power = 2 if name == "rms" else 1
        means = [float(np.nanmean(v**power) ** (1 / power)) for v in of_kind if len(v)]
        values = (means[0], means[1], float(worst(means[2:])))
        for kind, value in zip(_KINDS, values, strict=True):
            note = "of the corners the worst" if kind == "corner" else ""
            key = f"{surface}.{observer}.{kind}.{name}"
            metrics[key] = Metric(value=value, unit=unit, note=note)
    for observer in OBSERVERS:
        metrics |= _worst(metrics, observer, surfaces)
    return metrics


def _worst(
    metrics: Mapping[str, Metric], observer: str, surfaces: tuple[str, ...]
) -> dict[str, Metric]:
    """Return an observer's mean and worst over the surfaces."""

    def of(name: str, other: str = observer) -> dict[str, float]:
        return {one: metrics[f"{one}.{other}.{name}"].value or 0.0 for one in surfaces}

    def extreme(
        values: Mapping[str, float], pick: Callable[..., str], unit: str, note: str = ""
    ) -> Metric:
        surface = pick(values, key=values.__getitem__)
        return Metric(value=values[surface], unit=unit, note=f"{note}{surface}")

    squares = of("drawn.nees")
    found = {
        f"{observer}.drawn.nees": Metric(
            value=math.fsum(squares.values()) / len(squares), unit="", note="mean over surfaces"
        )
    }
    for kind in ("right", "drawn", "corner"):
        found[f"{observer}.{kind}.coverage.worst"] = extreme(of(f"{kind}.coverage"), min, "%")
        found[f"{observer}.{kind}.nees.worst"] = extreme(of(f"{kind}.nees"), max, "")
    today = of("right.rms", "trusting")
    ratios = {one: rms / today[one] for one, rms in of("right.rms").items()}
    found[f"{observer}.rms_ratio.worst"] = extreme(
        ratios, max, "", "with a right model, over the trusting one's: "
    )
    return found


def resolve_model_error(scenario: ModelErrorScenario) -> ModelErrorScenario:
    """Return the scenario with its open fields filled in, and checked."""
    for surface in scenario.surfaces:
        _estimation(scenario, surface)
    return scenario


_COVERAGE: Final = 99.0  # %
_SQUARES: Final = (0.5, 1.5)


def figures(scenario: ModelErrorScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw rms, coverage and normalised error squared of each observer on each surface."""
    figure = new_figure(
        height=0.24 * len(scenario.surfaces) + 3.4,
        caption="Error, coverage and consistency of each observer on each surface, with a correct "
        "model and with model errors; the shaded range is the required one.",
    )
    panels = figure.subplots(1, 3, sharey=True, width_ratios=(3, 2, 3))
    rows = np.arange(len(scenario.surfaces))
    offsets = np.linspace(-0.26, 0.26, len(OBSERVERS))
    for axes, quantity in zip(panels, ("rms", "coverage", "nees"), strict=True):
        for observer, offset in zip(OBSERVERS, offsets, strict=True):
            label, color, _ = OBSERVER_LOOKS[observer]
            for kind, (name, marker, fill) in _KINDS.items():
                values = [
                    metric_value(outcome.metrics, f"{one}.{observer}.{kind}.{quantity}")
                    for one in scenario.surfaces
                ]
                size = 7 if marker == "|" else 5
                style = {"marker": marker, "fillstyle": fill, "color": color, "markersize": size}
                label_here = f"{label}: {name}"
                axes.plot(values, rows + offset, linestyle="", label=label_here, **style)
    errors, coverage, squares = panels
    for axes in (errors, squares):
        axes.set_xscale("log")
    coverage.axvline(_COVERAGE, label=f"required, {_COVERAGE:g} %", **PUBLISHED)
    low, high = _SQUARES
    label = f"required, {low:g} to {high:g}"
    squares.axvspan(low, high, color="#cccccc", alpha=0.5, linewidth=0, label=label)
    dress(errors, title="(a) Error of the normal", x="rms error / °", y="")
    dress(coverage, title="(b) Within 3 deviations", x="coverage / %", y="")
    dress(squares, title="(c) Normalised error squared", x="error squared / variance", y="")
    coverage.set_xlim(0, 102)
    name_rows(errors, [one.replace("_", " ") for one in scenario.surfaces], apart=panels)
    legend_below(figure, squares, coverage)
    return {"observer-model-error": figure}
