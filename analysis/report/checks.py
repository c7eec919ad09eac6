"""Published values and specifications, and the checks that put the measured ones beside them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Literal

from chamfer.analysis.scenario.experiment import Catalogue, Metric

Kind = Literal["predicted", "calibrated", "measured", "specification"]
Verdict = Literal["holds", "does_not_hold", "not_reached"]


@dataclass(frozen=True, kw_only=True)
class Published:
    """A number that a paper prints, and how close a simulation has to come.

    ``kind`` is honest: *predicted* follows from published numbers, *calibrated* means that a
    free parameter was chosen to fit. So is ``otherwise``, the verdict on a measured value that
    does not satisfy the relation: our simulation misses the number (*not reached*), or the paper's
    claim fails on its own model (*does not hold*), and then the note says why. A *measured* number
    is compared with a recording of a real robot, and a *specification* is a limit of the task, of
    an arm or of parts.
    """

    experiment: str
    metric: str
    relation: Literal["near", "at_most", "at_least", "between"]
    unit: str
    kind: Kind
    source: str  # section, figure or equation
    value: float | None = None  # for near, at_most, at_least
    tolerance: float | None = None  # for near
    low: float | None = None  # for between
    high: float | None = None
    note: str = ""
    otherwise: Literal["does_not_hold", "not_reached"] = "not_reached"

    def __post_init__(self) -> None:
        if any(map(math.isnan, self.bounds())):
            raise ValueError(f"{self.metric}: relation {self.relation!r} lacks a number")
        if self.otherwise == "does_not_hold" and not self.note:
            raise ValueError(f"{self.metric}: a claim that does not hold lacks a note")

    def bounds(self) -> tuple[float, float]:
        """Return the smallest and the largest value that satisfy the relation."""
        given = (self.value, self.tolerance, self.low, self.high)
        value, tolerance, low, high = (math.nan if one is None else one for one in given)
        return {
            "near": (value - tolerance, value + tolerance),
            "at_most": (-math.inf, value),
            "at_least": (value, math.inf),
            "between": (low, high),
        }[self.relation]

    def holds(self, measured: float | None) -> bool:
        """Say whether the measured value satisfies the relation; an undefined one does not."""
        low, high = self.bounds()
        return measured is not None and low <= measured <= high

    def worst(self, measured: Sequence[float | None]) -> float | None:
        """Return the value that is farthest beyond the bounds, or else nearest to them."""
        low, high = self.bounds()
        known = [value for value in measured if value is not None and math.isfinite(value)]
        if len(known) < len(measured):
            return None
        return max(known, key=lambda value: max(low - value, value - high))


@dataclass(frozen=True, kw_only=True)
class Check:
    """A published value or a limit beside the measured value, of several trials the worst."""

    published: Published
    measured: float | None
    trials: tuple[float | None, ...] = ()  # that a limit is judged on, if there are several

    @property
    def kept(self) -> int:
        """How many of the trials satisfy the relation."""
        return sum(map(self.published.holds, self.trials))

    @property
    def ok(self) -> bool:
        """Whether the measured value satisfies the published relation."""
        return self.published.holds(self.measured)

    @property
    def verdict(self) -> Verdict:
        """Return how the measured value compares with the published one."""
        return "holds" if self.ok else self.published.otherwise


def check(
    published: Iterable[Published], metrics: Mapping[str, Metric], *, default: bool = True
) -> list[Check]:
    """Put published values and limits beside their metrics.

    Limits, and what is compared with a recording, are judged on every run, on the worst of its
    trials. A run without the metric did not have to keep it, such as that of a mode that the plan
    lacks; an undefined one breaks it. A published value is not held either where one of the
    trials has none.

    Args:
        published: Of the experiment.
        metrics: What a run measured.
        default: Whether it is the default scenario, the only one that published values are of.

    Raises:
        KeyError: If a published value names a metric that was not measured.
    """
    checks = []
    for one in published:
        if one.kind not in ("specification", "measured"):
            if default:
                found = metrics[one.metric]
                value = None if None in found.trials else found.value
                checks.append(Check(published=one, measured=value))
        elif metric := metrics.get(one.metric):
            # On another scenario it is not the paper's claim that fails.
            limit = one if default else replace(one, otherwise="not_reached")
            worst = one.worst(metric.trials or (metric.value,))
            checks.append(Check(published=limit, measured=worst, trials=metric.trials))
    return checks


@dataclass(frozen=True, kw_only=True)
class Paper:
    """A paper's title and the numbers that it prints."""

    key: str
    title: str
    published: tuple[Published, ...]


def load_paper(key: str, catalogue: Catalogue) -> Paper:
    """Import a paper's title and published values; a paper without a module has no values."""
    room = catalogue.published
    name = f"{room}.{key.replace('-', '_')}"
    try:
        module = import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in (name, room):
            raise
        return Paper(key=key, title=key, published=())
    return Paper(key=key, title=module.TITLE, published=tuple(module.PUBLISHED))
