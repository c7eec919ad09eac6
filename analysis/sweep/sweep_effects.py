"""Which metrics depend on which varied field, beyond rounding and the scatter of seeds."""

import math
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Final, NamedTuple

import numpy as np
import scipy  # whose submodules are imported where they are used
from numpy.typing import NDArray

from chamfer.analysis.sweep.sweep import SweepResult

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_ROUNDING: Final = 1e-6  # share of a metric that numbers and simulation don't resolve
_SMALLEST: Final = 1e-9  # in the metric's unit, 1e-7 in %: smaller values are rounded zeros
_CLOCKS: Final = ("real_time_factor", "cost", "cost_slope")  # which the machine decides
_CHANCE: Final = 0.01  # that scatter alone looks like an effect
MOST_LEVELS: Final = 8  # of a field's values, or intervals of more of them
_IN_A_BIN: Final = 8  # points, at least


class Effect(NamedTuple):
    """How a metric changes with a field."""

    size: float  # range of the means over the metric's scale; 0: nothing beyond rounding
    real: bool  # beyond scatter too
    means: Array  # at the field's values in ascending order, or in intervals of them

    @property
    def word(self) -> str:
        """Return ``rises``, ``falls`` or ``varies``."""
        steps = np.diff(self.means[np.isfinite(self.means)])
        least = _ROUNDING * float(np.max(np.abs(steps), initial=0.0))
        falls, rises = bool((steps < -least).any()), bool((steps > least).any())
        return "varies" if rises and falls else "rises" if rises else "falls"


Effects = Mapping[str, Mapping[str, Effect]]  # by the metric's column and the field's path


def sweep_effects(result: SweepResult, places: Mapping[str, Array]) -> Effects:
    """Return the effect of each field on each metric.

    An effect is the range of the metric's means over the field's values, relative to the
    tolerance of the metric's published value or else to its largest magnitude or range; points
    at which the metric is undefined count as if it had no effect there. It is 0 where the range
    is rounding, for a metric that repeats the field and for clocks. It is real where seeds
    scatter less (analysis of variance, 1 %). Where several fields are drawn at once, the means
    are those of intervals, and the scatter is that within them.

    Args:
        result: Of the sweep.
        places: Where each point is along each field, a number for each value.
    """
    published = result.plan.job.published
    tolerances = {one.metric: one.tolerance for one in published if one.tolerance}
    found: dict[str, dict[str, Effect]] = {}
    for metric, column in result.metrics.items():
        values, unit = result.table[column], result.table.units.get(column, "")
        largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
        least = max(_ROUNDING * largest, _SMALLEST * (100 if unit == "%" else 1))
        known = np.isfinite(values)
        width = float(np.ptp(values[known])) if known.any() else 0.0
        scale = (tolerances.get(metric) or max(largest, width)) / max(float(known.mean()), 1e-9)
        found[column] = {}
        for path, at in places.items():
            others = [place for one, place in places.items() if one != path]
            with np.errstate(all="ignore"):  # for values near the largest number there is
                means, real = _means(result, column, at, others)
            size = float(np.ptp(means[np.isfinite(means)])) if np.isfinite(means).any() else 0.0
            clock = metric.rpartition(".")[2] in _CLOCKS
            if size <= least or clock or np.array_equal(values, result.table[path]):
                size = 0.0
            found[column][path] = Effect(size / scale if size else 0.0, real and size > 0, means)
    return found


def ranked(effects: Effects) -> list[str]:
    """Return the metrics that depend on a field, the largest effects first.

    The fields take turns, so that each one has a metric among the first. If no effect is larger
    than scatter, the metrics that scatter are returned.
    """
    every = [effect for of in effects.values() for effect in of.values()]
    some = any(effect.real for effect in every)
    orders = [
        sorted(
            (name for name, of in effects.items() if (of[path].real if some else of[path].size)),
            key=lambda name: -effects[name][path].size,
        )
        for path in dict.fromkeys(path for of in effects.values() for path in of)
    ]
    turns = (name for turn in zip_longest(*orders) for name in turn if name is not None)
    return list(dict.fromkeys(turns))


def intervals(at: Array) -> tuple[Array, Indices]:
    """Return the edges of intervals along a field, and the number of the one each point is in."""
    count = min(MOST_LEVELS, max(2, len(at) // _IN_A_BIN))
    edges = np.linspace(at.min(), at.max(), count + 1)
    return edges, np.clip(np.digitize(at, edges) - 1, 0, count - 1)


def _means(
    result: SweepResult, column: str, at: Array, others: Sequence[Array]
) -> tuple[Array, bool]:
    """Return a metric's means over a field, and whether more than scatter makes them differ."""
    values = result.table[column]
    known = np.isfinite(values)
    if not known.any():
        return np.full(1, math.nan), False
    level = np.unique(at, return_inverse=True)[1]
    fixed = np.array([*others, np.zeros(len(at))])  # of the other fields
    line = np.unique(fixed, axis=1, return_inverse=True)[1].ravel()
    if np.bincount(line[known]).max() > 1:
        values = values - _group_means(values, line)[line] + values[known].mean()
        variance, left = _variance_of_seeds(result, column)
    else:
        if level.max() >= MOST_LEVELS:
            level = intervals(at)[1]
        within = (values - _group_means(values, level)[level])[known]
        left = len(within) - len(np.unique(level[known]))
        variance = float(np.sum(within**2)) / max(left, 1)
    means = _group_means(values, level)
    counts = np.bincount(level[known], minlength=len(means))
    there = counts > 0
    apart = counts[there] @ (means[there] - values[known].mean()) ** 2
    degrees = int(there.sum()) - 1
    if degrees < 1 or left < 1:
        return means, False
    ratio = scipy.stats.f.isf(_CHANCE, degrees, left)
    return means, bool(apart > degrees * ratio * variance)


def _group_means(values: Array, group: Indices) -> Array:
    """Return the mean of the known values of each group, NaN where there are none."""
    known = np.isfinite(values)
    counts = np.bincount(group[known], minlength=int(group.max()) + 1)
    sums = np.bincount(group[known], values[known], minlength=len(counts))
    return np.where(counts > 0, sums / np.maximum(counts, 1), math.nan)


def _variance_of_seeds(result: SweepResult, column: str) -> tuple[float, int]:
    """Return the variance of a point's mean, of what seeds don't do alike at all points.

    With its degrees of freedom; one seed alone has no scatter.
    """
    trials = result.plan.trials
    if trials == 1:
        return 0.0, 1
    every = result.trials[column]
    point, seed = np.divmod(np.arange(len(every)), trials)
    left = every - _group_means(every, point)[point]
    left -= _group_means(left, seed)[seed]
    known = np.isfinite(every)
    degrees = int(known.sum()) - len(np.unique(point[known])) - trials + 1
    return float(np.sum(left[known] ** 2)) / max(degrees, 1) / trials, degrees
