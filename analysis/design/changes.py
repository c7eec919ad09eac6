"""What to change: how the tightest margin goes with each field, and what makes a cell certain."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Final

from chamfer.analysis.design.design import assess, chain
from chamfer.analysis.design.design_scenario import (
    FEWEST,
    DesignScenario,
    ResolvedDesignScenario,
    resolve_design,
)
from chamfer.analysis.design.detection import sight
from chamfer.analysis.design.link import Link, tightest
from chamfer.analysis.design.remaining_errors import drawn_cells
from chamfer.analysis.scenario.experiment import Progress
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.models.validation import ParameterError


@dataclass(frozen=True)
class DesignField:
    """A field, and the range in which it is looked for a change."""

    path: str
    unit: str
    meaning: str
    low: float = 0.1  # least factor of its value that is tried
    high: float = 10.0  # largest factor
    read: Callable[[DesignScenario], float] | None = None  # None: the field of that path
    write: Callable[[DesignScenario, float], DesignScenario] | None = None  # likewise

    def get(self, scenario: DesignScenario) -> float:
        """Return its value in a resolved scenario."""
        return float((self.read or attrgetter(self.path))(scenario))

    def set(self, scenario: DesignScenario, value: float) -> DesignScenario:
        """Return a scenario whose open fields are open still with another value of it."""
        if self.write is not None:
            return self.write(scenario, value)
        return _with(scenario, self.path, value)


def _with(scenario: DesignScenario, path: str, value: object) -> DesignScenario:
    owner, _, name = path.rpartition(".")
    if not owner:
        return replace(scenario, **{name: value})  # type: ignore[arg-type]
    return _with(scenario, owner, replace(attrgetter(owner)(scenario), **{name: value}))


def _third(path: str, unit: str, meaning: str) -> DesignField:
    """Return the third of three stiffnesses, which scales the others with it."""

    def read(scenario: DesignScenario) -> float:
        return float(attrgetter(path)(scenario)[2])

    def write(scenario: DesignScenario, value: float) -> DesignScenario:
        x, y, z = attrgetter(path)(scenario)
        return _with(scenario, path, (x * value / z, y * value / z, value))

    return DesignField(path, unit, meaning, read=read, write=write)


def _with_clearance(scenario: DesignScenario, value: float) -> DesignScenario:
    radius = scenario.parts.hole_radius - value
    if not radius > 0:
        raise ParameterError("parts.peg_radius", radius, "> 0")
    return _with(scenario, "parts.peg_radius", radius)


def _joint_friction(scenario: DesignScenario) -> float:
    return max(scenario.peg.arm.dry_friction)


def _with_joint_friction(scenario: DesignScenario, value: float) -> DesignScenario:
    """Scale the dry friction of all joints so that the largest of the peg's arm is a value."""
    factor = value / _joint_friction(scenario)
    for name in scenario.arms:
        friction = tuple(factor * one for one in getattr(scenario, name).arm.dry_friction)
        scenario = _with(scenario, f"{name}.joint_friction", friction)
    return scenario


_FIELDS: Final = (
    _third("impedance.stiffness", "N/m", "stiffness of the arms"),
    _third("impedance.rotational_stiffness", "N m/rad", "rotational stiffness of the arms"),
    DesignField(
        "support.centre_distance",
        "m",
        "centre of compliance above the tip",
        read=lambda scenario: scenario.wedging_support.centre_distance,
    ),
    DesignField(
        "compensator.lateral.dead_zone", "pixels", "dead zone of the lateral compensation"
    ),
    DesignField("compensator.lateral.increment", "m", "increment of the lateral compensation"),
    DesignField(
        "compensator.rotational.dead_zone", "rad", "dead zone of the rotational compensation"
    ),
    DesignField(
        "compensator.rotational.increment", "rad", "increment of the rotational compensation"
    ),
    DesignField("cameras.pixel_size", "m", "size of a pixel", 0.2, 5.0),
    DesignField("cameras.distance", "m", "distance, and with it the focal length", 0.2, 5.0),
    DesignField("cameras.frames.noise", "grey levels", "noise of the images"),
    DesignField("parts.chamfer_width", "m", "width of the chamfers"),
    DesignField("parts.clearance", "m", "clearance, by the peg's radius", write=_with_clearance),
    DesignField("parts.friction", "", "friction of the parts"),
    DesignField("insert.speed", "m/s", "speed of the feed"),
    DesignField("insert.push", "N", "hardest push"),
    DesignField("insert.force_limit", "N", "force that stops all"),
    DesignField("spread.lateral", "m", "lateral error of the starts"),
    DesignField("spread.rotational", "rad", "tilt of the starts"),
    DesignField("peg.payload_error", "kg", "unknown payload of the peg's arm"),
    DesignField(
        "peg.joint_friction",
        "N m",
        "dry friction of the joints",
        read=_joint_friction,
        write=_with_joint_friction,
    ),
)
FIELDS: Final = {field.path: field for field in _FIELDS}

_STEP: Final = 0.1  # of a field, to either side, for the sensitivity
_LOOKS: Final = 5  # factors to either side at which a field is tried
_HALVINGS: Final = 3
_SAME: Final = 1e-6  # of a margin, below which a field does nothing to it

Links = Mapping[str, Link]  # by name


@dataclass(frozen=True, kw_only=True)
class Change:
    """What a field does to a design."""

    path: str
    unit: str
    value: float  # of the field as it is
    sensitivity: float  # change of the smallest margin, as a share of its limit, for +10 %
    to: float | None
    # value nearest to it that makes the design certain alone; None: none does, or it is certain
    meaning: str
    settings: tuple[str, ...] = ()  # path=value, that set it to that


def changes(
    scenario: DesignScenario, seed: int = 0, progress: Progress | None = None
) -> tuple[Change, ...]:
    """Return what every field does to a design, not resolved, the largest sensitivity first.

    What is left open in the scenario follows each change: increments are designed anew for other
    arms and cameras.
    """
    resolved = resolve_design(scenario)
    certain = assess(resolved, seed).verdict == "certain"
    here = _of(resolved, seed)
    usual = tightest(here.values()).name
    found = []
    for k, field in enumerate(FIELDS.values()):
        if progress is not None:
            progress(k / len(FIELDS), field.path)
        value = field.get(resolved)
        if not value:
            continue
        less, more = (
            _links(scenario, field, factor * value, seed) for factor in (1 - _STEP, 1 + _STEP)
        )
        to = None
        if not certain and _helps(here, less, more):
            to = _to_certain(scenario, field, value, _ends(field, here, less, more), seed)
        change = Change(
            path=field.path,
            unit=field.unit,
            value=value,
            sensitivity=_sensitivity(usual, less, here, more),
            to=to,
            meaning=field.meaning,
        )
        if to is not None:
            settings = overrides(field.set(scenario, to), scenario, lambda given: given)
            change = replace(change, settings=tuple(settings))
        found.append(change)
    return tuple(sorted(found, key=lambda one: -abs(one.sensitivity)))


def smallest_change(found: Sequence[Change]) -> Change | None:
    """Return the change that makes the design certain by the smallest factor, if any does."""
    able = [(abs(math.log(one.to / one.value)), one) for one in found if one.to is not None]
    return min(able, key=lambda pair: pair[0])[1] if able else None


def _of(resolved: ResolvedDesignScenario, seed: int) -> Links:
    """Return the chain with as few drawn errors as say something."""
    seen = sight(resolved)
    found = chain(resolved, seen, drawn_cells(resolved, seen, seed, FEWEST))
    return {link.name: link for link in found}


def _links(scenario: DesignScenario, field: DesignField, value: float, seed: int) -> Links | None:
    """Return the chain with another value of a field; None where it is refused."""
    try:
        return _of(resolve_design(field.set(scenario, value)), seed)
    except ParameterError:
        return None


def _sensitivity(name: str, less: Links | None, here: Links, more: Links | None) -> float:
    """Return how a link's margin changes for a tenth more, from all sides that have the link."""
    known = [
        (side, links[name].share)
        for side, links in ((-1, less), (0, here), (1, more))
        if links is not None and name in links and math.isfinite(links[name].share)
    ]
    if len(known) < 2:
        return 0.0
    (first, low), (last, high) = known[0], known[-1]
    return (high - low) / (last - first)


def _helps(here: Links, *others: Links | None) -> bool:
    """Return whether a field does anything to a link that is beyond its limit, or to none is."""
    beyond = [link for link in here.values() if link.margin < 0]

    def same(links: Links, link: Link, name: str) -> bool:
        value = getattr(link, name)
        return bool(abs(getattr(links[link.name], name) - value) <= _SAME * abs(value))

    return any(
        not beyond
        or links.keys() != here.keys()
        or not all(same(links, link, name) for link in beyond for name in ("bound", "allowed"))
        for links in others
        if links is not None
    )


def _ends(
    field: DesignField, here: Links, less: Links | None, more: Links | None
) -> tuple[float, ...]:
    """Return the ends of the range, as logarithms, towards which the tightest link gets wider."""
    name = tightest(here.values()).name
    ends = [
        math.log(end)
        for end, links in ((field.low, less), (field.high, more))
        if links is not None and name in links and links[name].share > here[name].share + _SAME
    ]
    return tuple(ends) if ends else (math.log(field.low), math.log(field.high))


def _to_certain(
    scenario: DesignScenario,
    field: DesignField,
    value: float,
    ends: tuple[float, ...],
    seed: int,
) -> float | None:
    """Return the value nearest to a field's own that makes the design certain.

    A few factors up to the ends are tried, then halves; and it has to be certain with all draws.
    """

    def holds(way: float) -> bool:
        links = _links(scenario, field, math.exp(way) * value, seed)
        return links is not None and min(link.margin for link in links.values()) >= 0

    best: float | None = None
    for end in ends:
        inner = 0.0
        for k in range(1, _LOOKS + 1):
            outer = end * (k / _LOOKS) ** 1.5
            if best is not None and abs(outer) >= abs(best):
                break
            if not holds(outer):
                inner = outer
                continue
            widest = outer
            for _ in range(_HALVINGS):
                middle = (inner + outer) / 2
                inner, outer = (inner, middle) if holds(middle) else (middle, outer)
            for way in (outer, widest):
                other = resolve_design(field.set(scenario, math.exp(way) * value))
                if assess(other, seed).verdict == "certain":
                    best = way
                    break
            break
    return None if best is None else value * math.exp(best)
