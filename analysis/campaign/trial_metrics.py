"""From the measurements of several trials to metrics with their spread."""

import math
from collections.abc import Mapping, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
import scipy  # whose submodules are imported where they are used
from numpy.typing import NDArray

from chamfer.analysis.scenario.experiment import Metric

CONFIDENCE: Final = 0.95  # of intervals

Trial = Mapping[str, float | None]  # measured values by metric; None where undefined


class Quantity(NamedTuple):
    """The unit of a metric, and the way to combine its values over trials."""

    unit: str
    pooled: Literal["mean", "rms", "least", "most"] = "mean"


def trial_seed(seed: int, trial: int) -> int:
    """Return the seed of one of several trials."""
    return 1000 * seed + trial


def metrics_of(
    rows: Mapping[str, tuple[float | None, str] | tuple[float | None, str, str]],
) -> dict[str, Metric]:
    """Return metrics from their values, units and notes."""
    found = {}
    for name, (value, unit, *note) in rows.items():
        found[name] = Metric(value=value, unit=unit, note="".join(note))
    return found


def prefixed(name: str, metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return metrics with a name in front of theirs."""
    return {f"{name}.{key}": metric for key, metric in metrics.items()}


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return a mean and half of its 95 % interval by Student's t, NaN for one value alone."""
    n = len(values)
    if n < 2:
        return float(np.mean(values)), math.nan
    quantile = float(scipy.stats.t.ppf(0.5 + CONFIDENCE / 2, n - 1))
    return float(np.mean(values)), quantile * float(np.std(values, ddof=1)) / math.sqrt(n)


def bootstrap_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of a mean's 95 % interval, NaN for one value alone.

    By the bias-corrected and accelerated bootstrap (Efron 1987), always of the same resamples.
    Unlike Student's it is within the range of the values: for a size it never reaches below zero.
    """
    if len(values) < 2:
        return math.nan, math.nan
    if np.ptp(values) == 0:
        return float(values[0]), float(values[0])
    random = np.random.default_rng(0)
    found = scipy.stats.bootstrap((values,), np.mean, confidence_level=CONFIDENCE, rng=random)
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def rate(name: str, good: int, count: int, note: str) -> dict[str, Metric]:
    """Return the share of trials that are good, %, with its exact 95 % interval."""
    interval = scipy.stats.binomtest(good, count).proportion_ci(CONFIDENCE, method="exact")
    exact = "95 % interval of Clopper and Pearson"
    return {
        name: Metric(value=100 * good / count, unit="%", note=note),
        f"{name}.low": Metric(value=100 * float(interval.low), unit="%", note=exact),
        f"{name}.high": Metric(value=100 * float(interval.high), unit="%", note=exact),
    }


def over_trials(trials: Sequence[Trial], quantities: Mapping[str, Quantity]) -> dict[str, Metric]:
    """Return each quantity over the trials, and its range in the note if there are several."""
    return {
        name: _metric([trial[name] for trial in trials], quantity)
        for name, quantity in quantities.items()
    }


def _metric(values: Sequence[float | None], quantity: Quantity) -> Metric:
    known = [value for value in values if value is not None]
    each = tuple(values) if len(values) > 1 else ()
    if not known:
        note = "does not occur, or settle, in the run"
        return Metric(value=None, unit=quantity.unit, note=note, trials=each)
    notes = []
    if len(values) > 1:
        notes.append(
            f"{quantity.pooled} of {len(known)} seeds, {min(known):.4g} to {max(known):.4g}"
        )
    if len(known) < len(values):
        notes.append(f"undefined in {len(values) - len(known)}")
    if quantity.pooled == "rms":
        value = math.sqrt(math.fsum(one * one for one in known) / len(known))
    elif quantity.pooled == "mean":
        value = math.fsum(known) / len(known)
    else:
        value = min(known) if quantity.pooled == "least" else max(known)
    return Metric(value=value, unit=quantity.unit, note=", ".join(notes), trials=each)
