"""Coverage of an observer's band at every instant, on surfaces that bend.

By default a gripper of 200 N/m slides over the suite at 0.2 m/s; the whole suite, whose numbers
are in the docs, is ``suite.stiffnesses=[200, 1000, 5000]`` and ``suite.speeds=[0.1, 0.2, 0.4]``.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import chi2

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import metric_value, name_rows
from chamfer.analysis.drawing.figure_style import (
    OBSERVER_LOOKS,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Progress, Table
from chamfer.analysis.surface.normal_metrics import angle_between, normalised_square
from chamfer.analysis.surface.normal_trials import (
    Contender,
    Slide,
    observer_of,
    samples_of,
    sensed,
    slide,
    table_of_observers,
)
from chamfer.analysis.surface.observer_slides import CASES, glide, surfaces
from chamfer.diagrams.surface.surface_estimation import EstimationScenario
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, SurfaceSettings
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.contact_frame_filter import ContactFrameFilter
from chamfer.systems.estimation.normal_filter import NormalFilter
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.sensing.force_rate import ForceRateSensorParams

Array = NDArray[np.float64]

# Squares, over variances. The thesis' uncertainties are of vectors with three axes (4-9), and so
# is the 95 % band; the narrow one is that of a single axis.
_BAND: Final = float(chi2.ppf(0.95, 3))
_NARROW: Final = float(chi2.ppf(0.95, 1))
_MOST_TRIALS: Final = 10_000
_WINDOW: Final = 15.0  # s, of the slides of all observers
_SURFACES: Final = (*surfaces(1.0), *CASES)
# The mixture is the adaptive observer without the model that makes its band, as it once was.
OBSERVERS: Final = ("thesis", "gated", "mixture", "adaptive")


@dataclass(frozen=True, kw_only=True)
class BandSuite:
    """Surfaces that bend as sharply as the observers' setting allows, and their slides."""

    surfaces: tuple[str, ...] = _SURFACES  # and the slides of all observers, unchanged
    stiffnesses: tuple[float, ...] = (200.0,)  # N/m, of the gripper
    speeds: tuple[float, ...] = (0.2,)  # m/s, of the contact point
    trials: int = 200  # seeds that each surface gets at each stiffness and speed

    def __post_init__(self) -> None:
        if not self.surfaces or set(self.surfaces) - set(_SURFACES):
            allowed = f"some of {', '.join(_SURFACES)}"
            raise ParameterError("surfaces", self.surfaces, allowed)
        for name in ("stiffnesses", "speeds"):
            given = getattr(self, name)
            if not given or not all(0 < one < math.inf for one in given):
                raise ParameterError(name, given, "finite numbers > 0")
        if not 1 <= self.trials <= _MOST_TRIALS:
            raise ParameterError("trials", self.trials, f"1 to {_MOST_TRIALS}")


def judge(
    on: Slide,
    filters: Sequence[NormalFilter],
    sensor: ForceRateSensorParams,
    deviation: float,
    randoms: Sequence[np.random.Generator],
) -> dict[str, Array]:
    """Return the filters' results on a slide with noise, an array of shape (filters,) each.

    ``rms``, deg; ``coverage``, %, of all errors within the 95 % band, and ``worst_instant``, of
    those of the instant at which fewest are; the same for the ``narrow`` band; ``nees``, the mean
    normalised square. All samples count, from the first one.

    Args:
        on: The slide.
        filters: The judged filters.
        sensor: Its noise.
        deviation: rad, of the first estimate of the normal on each axis.
        randoms: One for each seed.
    """
    n, d = on.normal.shape
    tangents = np.linalg.svd(on.normal[:1])[2][1:]
    told = Contender(filter=filters[0], predicted=None)
    normals = np.empty((len(filters), len(randoms), n, d))
    covariances = np.empty((*normals.shape, d))
    for i, random in enumerate(randoms):
        samples = samples_of(on, told, sensed(on, sensor, random), 0)
        up = on.normal[0] + np.tan(deviation * random.standard_normal(d - 1)) @ tangents
        for j, one in enumerate(filters):
            memory = one.start(up / math.sqrt(up @ up))
            for k, sample in enumerate(samples):
                found = one.update(memory, sample)
                memory, normals[j, i, k] = found.memory, found.normal
                covariances[j, i, k] = found.covariance
    truth = np.broadcast_to(on.normal, normals.shape[1:]).reshape(-1, d)
    rows = []
    for estimate, covariance in zip(normals, covariances, strict=True):
        error = angle_between(estimate.reshape(-1, d), truth)
        square = normalised_square(estimate.reshape(-1, d), truth, covariance.reshape(-1, d, d))
        total = (d - 1) * square.reshape(-1, n)[:, on.normal.any(axis=1)]
        inside, within = (100 * np.mean(total <= most, axis=0) for most in (_BAND, _NARROW))
        shares = (inside.mean(), inside.min(), within.mean(), within.min())
        rows.append((math.sqrt(float(np.nanmean(error**2))), *shares, float(np.nanmean(square))))
    names = ("rms", "coverage", "worst_instant", "narrow", "narrow_instant", "nees")
    return dict(zip(names, np.array(rows).T, strict=True))


class BandTrial(NamedTuple):
    """A surface of the suite, with all its seeds."""

    surface: str
    stiffness: float  # N/m, and
    speed: float  # m/s, both 0 for a slide of all observers, which has its own


def _slid(
    task: BandTrial, sensor: ForceRateSensorParams, radius: float
) -> tuple[Slide, EstimationScenario]:
    """Return a slide, and the scenario with the observers' gripper and sensor."""
    if task.surface in CASES:
        estimation = CASES[task.surface].estimation(sensor, _WINDOW)
        return slide(estimation), estimation
    surface = surfaces(radius)[task.surface]
    told = EstimationScenario(
        surface=SurfaceSettings(shape="circle" if surface.dimension == 2 else "sphere"),
        gripper=GripperCompliance(stiffness=task.stiffness),
        sensor=sensor,
    )
    return glide(surface, task.stiffness, task.speed, told.observer.period), told


def _judge(
    suite: BandSuite, sensor: ForceRateSensorParams, radius: float, seed: int, task: BandTrial
) -> Row:
    """Return the observers' results on a surface, an array of shape (observers,) each."""
    on, estimation = _slid(task, sensor, radius)
    thesis, gated, adaptive = (
        observer_of(estimation, ObserverSettings(kind=kind, smallest_radius=radius))
        for kind in ("thesis", "gated", "adaptive")
    )
    mixture = ContactFrameFilter(adaptive, banded=False)
    filters = (make_filter(thesis), make_filter(gated), mixture, make_filter(adaptive))
    cell = (int(task.stiffness), round(1000 * task.speed), _SURFACES.index(task.surface))
    randoms = [np.random.default_rng([seed, *cell, trial]) for trial in range(suite.trials)]
    return {**judge(on, filters, sensor, adaptive.initial_deviation, randoms)}


def run_suite(
    suite: BandSuite, sensor: ForceRateSensorParams, radius: float, seed: int, progress: Progress
) -> Table:
    """Return a row of results for each surface, stiffness, speed and observer."""
    grid = list(product(suite.stiffnesses, suite.speeds))
    tasks = [
        BandTrial(surface, *cell)
        for surface in suite.surfaces
        for cell in ([(0.0, 0.0)] if surface in CASES else grid)
    ]
    finished = run_each(partial(_judge, suite, sensor, radius, seed), tasks, progress)
    finished.split(suite.surfaces, lambda task: task.surface)  # none may be without
    at = [suite.surfaces.index(task.surface) for task in finished.tasks]
    cells = {
        name: np.repeat([getattr(task, name) for task in finished.tasks], len(OBSERVERS))
        for name in ("stiffness", "speed")
    }
    return {**table_of_observers(finished, len(OBSERVERS), surface=at), **cells}


# By the name of the metric: column, unit, and which is the worst.
_MEASURED: Final[dict[str, tuple[str, str, Callable[[Array], np.intp]]]] = {
    "coverage.whole_run": ("coverage", "%", np.argmin),
    "coverage.worst_instant": ("worst_instant", "%", np.argmin),
    "nees": ("nees", "", np.argmax),
}
_OF_ALL: Final = _MEASURED | {
    "coverage.narrow.whole_run": ("narrow", "%", np.argmin),
    "coverage.narrow.worst_instant": ("narrow_instant", "%", np.argmin),
    "nees.least": ("nees", "", np.argmin),
}


def band_metrics(suite: BandSuite, band: Table) -> dict[str, Metric]:
    """Return the worst of each surface, and of all of them."""
    metrics: dict[str, Metric] = {}

    def where(row: int) -> str:
        surface = suite.surfaces[int(band["surface"][row])]
        stiffness, speed = band["stiffness"][row], band["speed"][row]
        return f"{surface}, {stiffness:g} N/m, {speed:g} m/s" if speed else surface

    for j, observer in enumerate(OBSERVERS):
        of = np.flatnonzero(band["observer"] == j)
        groups = {observer: (of, _OF_ALL)}
        for i, surface in enumerate(suite.surfaces):
            groups[f"{surface}.{observer}"] = (of[band["surface"][of] == i], _MEASURED)
        for group, (rows, measured) in groups.items():
            for name, (column, unit, worst) in measured.items():
                row = rows[worst(band[column][rows])]
                key = f"{group}.{name}"
                value = float(band[column][row])
                metrics[key] = Metric(value=value, unit=unit, note=where(row))
    before, after = (band["observer"] == OBSERVERS.index(one) for one in ("mixture", "adaptive"))
    ratios = band["rms"][after] / band["rms"][before]
    known = np.array([one in CASES for one in suite.surfaces])[band["surface"][after].astype(int)]
    for group, rows in {"mixture": np.flatnonzero(known), "suite": np.flatnonzero(~known)}.items():
        if len(rows):
            worst = rows[np.argmax(ratios[rows])]
            note = f"rms over the mixture's, {where(int(np.flatnonzero(after)[worst]))}"
            metrics[f"adaptive.rms_ratio.{group}"] = Metric(
                value=float(ratios[worst]), unit="", note=note
            )
    return metrics


_ASKED: Final = 85.0  # %
_SHOWN: Final = ("thesis", "gated", "mixture", "adaptive")


def band_figure(suite: BandSuite, metrics: Mapping[str, Metric]) -> Figure:
    """Draw the share of errors within the band at the worst instant of each surface."""
    of = {
        observer: [
            metric_value(metrics, f"{one}.{observer}.coverage.worst_instant")
            for one in suite.surfaces
        ]
        for observer in _SHOWN
    }
    reach = sum(share >= _ASKED for share in of["adaptive"])
    says = f"Adaptive observer: {reach} of {len(suite.surfaces)} surfaces reach {_ASKED:g} %"
    figure = new_figure(
        height=0.22 * len(suite.surfaces) + 1.9,
        caption=f"{says} (errors within the 95 % band, at the worst instant of a slide).",
    )
    axes = figure.subplots()
    rows = np.arange(len(suite.surfaces))
    for observer, shares in of.items():
        label, color, marker = OBSERVER_LOOKS[observer]
        axes.plot(shares, rows, marker, color=color, markersize=6, label=label, clip_on=False)
    axes.axvline(_ASKED, label=f"required, {_ASKED:g} %", **PUBLISHED)
    dress(axes, title=says, x="errors within the 95 % band / %", y="")
    axes.set_xlim(0, 101)
    name_rows(axes, [one.replace("_", " ") for one in suite.surfaces], apart=(axes,))
    legend(axes, ncols=3)
    return figure
