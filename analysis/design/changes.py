"""What to change: how the tightest margin goes with each field, and what makes a cell certain."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from analysis.design.design import assess, chain
from analysis.design.design_scenario import FEWEST, DesignScenario, resolve_design
from analysis.design.drawn_errors import draw_errors
from analysis.design.fields import FIELDS, DesignField
from analysis.design.link import Link, tightest
from analysis.design.sight import sight
from analysis.run.experiment import Progress
from models.validation import ParameterError

_STEP: Final = 0.1  # of a field, to either side, for the sensitivity
_LOOKS: Final = 6  # factors to either side at which a field is tried
_HALVINGS: Final = 5


@dataclass(frozen=True, kw_only=True)
class Change:
    """What a field does to a design."""

    path: str
    unit: str
    value: float  # of the field as it is
    sensitivity: float  # change of the smallest margin, as a share of its limit, for +10 %
    to: float | None  # value nearest to it that makes the design certain; None: none, or it is
    meaning: str


def changes(
    scenario: DesignScenario, seed: int = 0, progress: Progress | None = None
) -> tuple[Change, ...]:
    """Return what every field does, the largest sensitivity first.

    What is left open in the scenario follows each change: increments are designed anew for other
    arms and cameras.

    Args:
        scenario: Not resolved.
        seed: Of the draws that a certain design is inside of.
        progress: Told how far it is.
    """
    resolved = resolve_design(scenario)
    certain = assess(resolved, seed).verdict == "certain"
    usual = tightest(_chain(resolved, seed)).name
    found = []
    for k, field in enumerate(FIELDS):
        if progress is not None:
            progress(k / len(FIELDS), field.path)
        value = field.get(resolved)
        if not value:
            continue
        found.append(
            Change(
                path=field.path,
                unit=field.unit,
                value=value,
                sensitivity=_sensitivity(scenario, field, value, usual, seed),
                to=None if certain else _to_certain(scenario, field, value, seed),
                meaning=field.meaning,
            )
        )
    return tuple(sorted(found, key=lambda one: -abs(one.sensitivity)))


def smallest_change(found: Sequence[Change]) -> Change | None:
    """Return the change that makes the design certain by the smallest factor, if any does."""
    able = [(abs(math.log(one.to / one.value)), one) for one in found if one.to is not None]
    return min(able, key=lambda pair: pair[0])[1] if able else None


def changed(scenario: DesignScenario, path: str, value: float) -> DesignScenario:
    """Return a scenario, not resolved, with another value of one of :data:`FIELDS`."""
    for field in FIELDS:
        if field.path == path:
            return field.set(scenario, value)
    raise ParameterError("path", path, ", ".join(field.path for field in FIELDS))


def margin_of(scenario: DesignScenario) -> float:
    """Return the smallest share that is left of a limit; minus infinity where it is refused."""
    found = _links(scenario, 0)
    return -math.inf if found is None else tightest(found).share


def _chain(resolved: DesignScenario, seed: int) -> tuple[Link, ...]:
    """Return the chain with as few drawn errors as say something."""
    seen = sight(resolved)
    return chain(resolved, seen, draw_errors(resolved, seen, seed, FEWEST))


def _links(scenario: DesignScenario, seed: int) -> tuple[Link, ...] | None:
    try:
        return _chain(resolve_design(scenario), seed)
    except ParameterError:
        return None


def _sensitivity(
    scenario: DesignScenario, field: DesignField, value: float, usual: str, seed: int
) -> float:
    """Return how the smallest margin changes for a tenth more, by a difference to both sides.

    To one side where the other one is refused.
    """
    sides = []
    for factor in (1 - _STEP, 1.0, 1 + _STEP):
        try:
            links = _links(scenario if factor == 1 else field.set(scenario, factor * value), seed)
        except ParameterError:
            links = None
        sides.append(math.nan if links is None else _share(links, usual))
    less, here, more = sides
    if math.isfinite(less) and math.isfinite(more):
        return (more - less) / 2
    if math.isfinite(more):
        return more - here
    return here - less if math.isfinite(less) else 0.0


def _share(links: Sequence[Link], name: str) -> float:
    return next((link.share for link in links if link.name == name), math.nan)


def _to_certain(
    scenario: DesignScenario, field: DesignField, value: float, seed: int
) -> float | None:
    """Return the value nearest to a field's own that makes the design certain."""

    def certain(factor: float) -> bool:
        try:
            changed = field.set(scenario, factor * value)
        except ParameterError:
            return False
        links = _links(changed, seed)
        if links is None or min(link.margin for link in links) < 0:
            return False
        return assess(resolve_design(changed), seed).verdict == "certain"

    best: float | None = None
    for end in (math.log(field.low), math.log(field.high)):
        inner = 0.0
        for k in range(1, _LOOKS + 1):
            outer = end * (k / _LOOKS) ** 1.5
            if best is not None and abs(outer) >= abs(best):
                break
            if certain(math.exp(outer)):
                for _ in range(_HALVINGS):
                    middle = (inner + outer) / 2
                    inner, outer = (
                        (inner, middle) if certain(math.exp(middle)) else (middle, outer)
                    )
                best = outer
                break
            inner = outer
    return None if best is None else value * math.exp(best)
