"""Finds fields and choices that make a cell certain, alone or in pairs.

The search uses few random cells and pictures; all of them confirm an answer of "certain".
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product
from operator import attrgetter
from typing import Any, Final

import numpy as np

from chamfer.analysis.campaign.campaign import try_each
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.design.design import Design, assess
from chamfer.analysis.design.design_scenario import (
    FEWEST,
    DesignScenario,
    ResolvedDesignScenario,
    ScenarioT,
    resolve_design,
)
from chamfer.analysis.design.feed_path import path_links
from chamfer.analysis.design.link import Link
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Progress, part_of, quiet
from chamfer.analysis.scenario.scenario_io import make_scenario, value_text
from chamfer.analysis.scenario.scenario_overrides import overrides
from chamfer.models.validation import ParameterError


@dataclass(frozen=True)
class DesignField:
    """A field, and the range in which a change is searched."""

    path: str
    unit: str
    meaning: str
    low: float = 0.1  # least factor of its value that is tried; 1: less is no help, or no choice
    high: float = 10.0  # largest factor, likewise
    read: Callable[[DesignScenario], float] | None = None  # None: the field of that path
    write: Callable[[DesignScenario, float], DesignScenario] | None = None  # likewise

    def get(self, scenario: DesignScenario) -> float:
        """Return its value in a resolved scenario."""
        return float((self.read or attrgetter(self.path))(scenario) or 0.0)

    def set(self, scenario: DesignScenario, value: float) -> DesignScenario:
        """Return a scenario whose open fields are open still with another value of it."""
        if self.write is not None:
            return self.write(scenario, value)
        return _with(scenario, self.path, value)


def _with(scenario: ScenarioT, path: str, value: object) -> ScenarioT:
    owner, _, name = path.rpartition(".")
    if not owner:
        return replace(scenario, **{name: value})  # type: ignore[arg-type]
    return _with(scenario, owner, replace(attrgetter(owner)(scenario), **{name: value}))


def _last(path: str, unit: str, meaning: str) -> DesignField:
    """Return the last of several stiffnesses or dampings, which scales the others with it."""

    def read(scenario: DesignScenario) -> float:
        return float((attrgetter(path)(scenario) or (0.0,))[-1])

    def write(scenario: DesignScenario, value: float) -> DesignScenario:
        values = attrgetter(path)(scenario) or attrgetter(path)(resolve_design(scenario))
        return _with(scenario, path, tuple(one * value / values[-1] for one in values))

    return DesignField(path, unit, meaning, read=read, write=write)


def _with_clearance(scenario: DesignScenario, value: float) -> DesignScenario:
    radius = round(scenario.parts.hole_radius - value, 12)
    if not radius > 0:
        raise ParameterError("parts.peg_radius", radius, "> 0")
    return _with(scenario, "parts.peg_radius", radius)


def _with_pixels(scenario: DesignScenario, value: float) -> DesignScenario:
    """Return cameras with the same field of view and another pixel size."""
    if not value > 0:
        raise ParameterError("cameras.pixel_size", value, "> 0")
    cameras = scenario.cameras
    more = cameras.pixel_size / value
    width, height = (round(more * count) for count in (cameras.width, cameras.height))
    return _with(
        scenario, "cameras", replace(cameras, pixel_size=value, width=width, height=height)
    )


def _joint_friction(scenario: DesignScenario) -> float:
    return max(scenario.peg.arm.dry_friction)


def _with_joint_friction(scenario: DesignScenario, value: float) -> DesignScenario:
    """Scale the dry friction of all joints so that the largest of the peg's arm is a value."""
    factor = value / _joint_friction(scenario)
    for name in scenario.arms:
        scenario = _with(scenario, name, getattr(scenario, name).with_friction(factor))
    return scenario


_FIELDS: Final = (
    _last("impedance.stiffness", "N/m", "stiffness of the arms"),
    _last("impedance.rotational_stiffness", "N m/rad", "rotational stiffness of the arms"),
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
    DesignField(
        "cameras.pixel_size",
        "m",
        "size of a pixel, with the same field of view",
        low=0.5,
        high=2.0,
        write=_with_pixels,
    ),
    DesignField("cameras.distance", "m", "distance, and with it the focal length", 0.2, 5.0),
    DesignField("cameras.frames.noise", "grey levels", "noise of the images", high=1.0),
    _last("admittance.spring", "N/m", "what takes back what the arm gave way"),
    _last("admittance.damping", "N s/m", "damping of what the arm gives way"),
    DesignField("compliance.axial", "N/m", "stiffness of sensor and tool or RCC along the peg"),
    DesignField("compliance.lateral", "N/m", "the same across"),
    DesignField("compliance.angular", "N m/rad", "the same of tilt"),
    DesignField("compliance.centre_distance", "m", "centre of the compliance above the tip"),
    DesignField("search.radius", "m", "how far a spiral goes"),
    DesignField("search.pitch", "m", "between the turns of a spiral", high=1.0),
    DesignField("parts.chamfer_width", "m", "width of the chamfers", low=1.0),
    DesignField(
        "parts.clearance",
        "m",
        "clearance, by the peg's radius",
        low=1.0,
        write=_with_clearance,
    ),
    DesignField("parts.friction", "", "friction of the parts"),
    DesignField("insert.speed", "m/s", "speed of the feed"),
    DesignField("insert.push", "N", "hardest push"),
    DesignField("insert.force_limit", "N", "force that stops all"),
    DesignField("spread.lateral", "m", "lateral error of the starts", high=1.0),
    DesignField("spread.rotational", "rad", "tilt of the starts", high=1.0),
    DesignField("peg.payload_error", "kg", "unknown payload of the peg's arm", high=1.0),
    DesignField(
        "peg.joint_friction",
        "N m",
        "dry friction of the joints",
        high=1.0,
        read=_joint_friction,
        write=_with_joint_friction,
    ),
)
FIELDS: Final = {field.path: field for field in _FIELDS}
_OF_TORQUES: Final = ("impedance.", "support.", "peg.joint_friction")  # what moves no other arm
_OF_POSITIONS: Final = ("admittance.", "compliance.")  # likewise


def has_field(scenario: ResolvedDesignScenario, path: str) -> bool:
    """Return whether a cell has a field; other kinds of cells may not."""
    others: tuple[str, ...] = _OF_POSITIONS if scenario.servo is None else _OF_TORQUES
    if scenario.cameras.kind == "none":
        others += ("compensator.", "cameras.", "controller.", "insert.compensation")
    return not path.startswith(others)


Value = float | str  # of a field, or of a choice as --set takes it
Move = tuple[str, Value]  # a path, and the value that it gets

_SHIFTS: Final = (-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3)  # m, of the base, back and forth and up
_BASES: Final = 4  # of the nearest ones that are good for the feed
_CHAMFERS: Final = (0.05, 0.1, 0.2)  # of the peg's radius, where there are none


@dataclass(frozen=True)
class DesignChoice:
    """A choice, and its other values."""

    path: str
    unit: str
    meaning: str
    others: Callable[[ResolvedDesignScenario], Sequence[Value]]


def _bases(scenario: ResolvedDesignScenario) -> list[Value]:
    """Return the nearest bases of the peg's arm that allow the feed, if its own does not.

    The search moves them along the line between the arms, and up and down.
    """

    def good(scenario: ResolvedDesignScenario) -> bool:
        try:
            return min(link.margin for link in path_links(scenario)) >= 0
        except ParameterError:
            return False

    if good(scenario):
        return []
    x, y, z = scenario.peg.base.position
    found: list[Value] = []
    for dx, dz in sorted(product(_SHIFTS, _SHIFTS), key=lambda shift: math.hypot(*shift)):
        position = (round(x + dx, 9), y, round(z + dz, 9))
        if good(_with(scenario, "peg.base.position", position)):
            found.append(value_text(position))
        if len(found) == _BASES:
            break
    return found


def _either(path: str, meaning: str, *kinds: str) -> DesignChoice:
    now = attrgetter(path)
    return DesignChoice(path, "", meaning, lambda of: [kind for kind in kinds if kind != now(of)])


def _chamfers(scenario: ResolvedDesignScenario) -> list[Value]:
    parts = scenario.parts
    return [] if parts.chamfer_width else [share * parts.peg_radius for share in _CHAMFERS]


def _searches(scenario: ResolvedDesignScenario) -> list[Value]:
    """Return the other searches; the chain has none for torque-controlled arms."""
    kinds = [] if scenario.servo is None else ["spiral", "tilt"]
    return [kind for kind in kinds if kind != scenario.search.kind]


_CHOICES: Final = (
    _either("controller.kind", "state machine or PID", "fsm", "pid"),
    _either("insert.compensation", "compensation during the feed", "running", "frozen"),
    DesignChoice("search.kind", "", "search by contact", _searches),
    DesignChoice("parts.chamfer_width", "m", "width of the chamfers", _chamfers),
    DesignChoice("peg.base.position", "", "place of the peg's arm", _bases),
)
CHOICES: Final = {choice.path: choice for choice in _CHOICES}


@dataclass(frozen=True, kw_only=True)
class Change:
    """The effect of a field or a choice on a design."""

    path: str
    unit: str
    value: Value  # as it is
    sensitivity: float | None
    # change of the smallest margin, as a share of its limit, for +10 %; None: of a choice
    to: Value | None
    # value nearest to it that makes the design certain alone; None: none does, or it is certain
    meaning: str
    best: Value | None = None  # to, or else the value that helps most of those tried, if any does
    share: float | None = None  # of the drawn errors that are inside with it
    settings: tuple[str, ...] = ()  # path=value, that set it


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two changes together, of which neither makes the design certain alone."""

    changes: tuple[Change, ...]  # to their best values
    share: float  # of the drawn errors that are inside with both
    certain: bool
    settings: tuple[str, ...]  # path=value, that set both


@dataclass(frozen=True, kw_only=True)
class Advice:
    """The changes that make a design certain or better."""

    changes: tuple[Change, ...]  # what makes it certain, what helps, what has a large sensitivity
    pairs: tuple[Pair, ...] = ()  # that help more than both alone, likewise

    @property
    def smallest(self) -> Change | Pair | None:
        """The smallest change, or pair of changes, that makes the design certain, if any does."""
        able: list[Change | Pair] = [one for one in self.changes if one.to is not None]
        able += [one for one in self.pairs if one.certain]
        return min(able, key=size, default=None)


def size(of: Change | Pair) -> float:
    """Return the size of a change: log of its factor, ln 2 for a choice; the sum for a pair."""
    if isinstance(of, Pair):
        return sum(map(size, of.changes))
    return _OF_CHOICE if of.best is None else _distance(of.value, of.best)


_STEP: Final = 0.1  # of a field, for the sensitivity
_LOOKS: Final = 3  # factors to a side at which a field is tried
_HALVINGS: Final = 3
_PICTURES: Final = 2  # while looking
_SAME: Final = 0.01  # of a link, by which a tenth of a field has to move it
_COARSE: Final = 10  # steps of a share, within which the nearer value is as good
_OF_CHOICE: Final = math.log(2)
_PAIRED: Final = 5  # of the changes that help most

Asked = tuple[str, Value, tuple[Value, ...]]  # a path, its value, and a choice's other ones


def advise(scenario: DesignScenario, seed: int = 0, progress: Progress = quiet) -> Advice:
    """Return the effects of fields and choices on an unresolved design, alone and in pairs.

    Open fields of the scenario follow each change: increments are designed again for other arms
    and cameras. Pairs are tried where no single change by a factor of two makes the design
    certain.
    """
    resolved = resolve_design(scenario)
    found = assess(resolved, seed)
    certain = found.verdict == "certain"
    asked: list[Asked] = [
        (path, value, ())
        for path, one in FIELDS.items()
        if has_field(resolved, path) and (value := one.get(resolved))
    ]
    for path, choice in ({} if certain else CHOICES).items():
        if has_field(resolved, path) and (others := choice.others(resolved)):
            value = attrgetter(path)(resolved)
            said = value if isinstance(value, float) else value_text(value)
            asked.append((path, said, tuple(others)))
    here = _looked_at(scenario, seed) or found
    search = partial(_searched, scenario, seed, here, certain)
    rows = _rows(search, asked, part_of(progress, 0.0, 0.75))
    ranked = sorted(
        zip(rows, asked, strict=True), key=lambda one: one[0]["merit"].tolist(), reverse=True
    )
    alone = tuple(_change(scenario, path, value, row) for row, (path, value, _) in ranked)
    least = Advice(changes=alone).smallest
    if certain or (least is not None and size(least) <= _OF_CHOICE):
        return Advice(changes=alone)
    helps = [one for one in alone if one.best is not None and one.to is None]
    both = list(combinations(helps[:_PAIRED], 2))
    return Advice(changes=alone, pairs=_pairs(scenario, seed, both, part_of(progress, 0.75, 1.0)))


def _change(scenario: DesignScenario, path: str, value: Value, row: Row) -> Change:
    of = FIELDS.get(path) or CHOICES[path]
    best = row["best"]
    return Change(
        path=path,
        unit=of.unit,
        value=value,
        meaning=of.meaning,
        settings=() if best is None else _settings(scenario, (path, best)),
        **{name: row[name] for name in ("sensitivity", "to", "best", "share")},
    )


def _pairs(
    scenario: DesignScenario,
    seed: int,
    both: Sequence[tuple[Change, Change]],
    progress: Progress,
) -> tuple[Pair, ...]:
    moves = [tuple((one.path, one.best) for one in pair if one.best is not None) for pair in both]
    rows = _rows(partial(_together, scenario, seed), moves, progress)
    found = [
        Pair(changes=pair, settings=_settings(scenario, *of), **row)
        for pair, of, row in zip(both, moves, rows, strict=True)
        if row["certain"] or row["share"] > max(one.share or 0.0 for one in pair)
    ]
    return tuple(sorted(found, key=lambda one: (not one.certain, -one.share, size(one))))


def _rows(
    function: Callable[[Any], Row], tasks: Sequence[Any], progress: Progress
) -> Sequence[Row]:
    done = try_each(function, tasks, progress)
    if done.failed:
        raise ExperimentError(f"what to change, {done.failed[0][0]}: {done.failed[0][1].reason}")
    return done.rows


def _moved(scenario: DesignScenario, *moves: Move) -> DesignScenario:
    for path, value in moves:
        if isinstance(value, str):
            scenario = make_scenario(scenario, settings=[f"{path}={value}"])
        else:
            scenario = FIELDS[path].set(scenario, value)
    return scenario


def _settings(scenario: DesignScenario, *moves: Move) -> tuple[str, ...]:
    return tuple(overrides(_moved(scenario, *moves), scenario, lambda given: given))


def _looked_at(scenario: DesignScenario, seed: int, *moves: Move) -> Design | None:
    """Return the results of changes with few draws and pictures; None where one is refused."""
    try:
        moved = _moved(scenario, *moves)
        few = replace(moved, pictures=min(moved.pictures, _PICTURES))
        return assess(resolve_design(few), seed, draws=FEWEST)
    except (ParameterError, UserError):
        return None


def _confirmed(scenario: DesignScenario, seed: int, *moves: Move) -> Design:
    """Return the results of changes with all draws and pictures."""
    return assess(resolve_design(_moved(scenario, *moves)), seed)


def _together(scenario: DesignScenario, seed: int, moves: Sequence[Move]) -> Row:
    found = _looked_at(scenario, seed, *moves)
    if found is None:
        return {"share": 0.0, "certain": False}
    if found.verdict == "certain":
        found = _confirmed(scenario, seed, *moves)
    return {"share": found.share, "certain": found.verdict == "certain"}


def _distance(value: Value, other: Value) -> float:
    if isinstance(value, str) or isinstance(other, str) or not value:
        return _OF_CHOICE
    return abs(math.log(other / value))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _merit(design: Design, distance: float) -> tuple[float, ...]:
    """Return the merit of a change: near and certain; or share, few links beyond, and margin."""
    if design.verdict == "certain":
        return 1.0, -distance, 0.0, 0.0
    beyond = sum(link.margin < 0 for link in design.links)
    return 0.0, math.floor(_COARSE * design.share) / _COARSE, -beyond, design.margin


def _searched(
    scenario: DesignScenario, seed: int, here: Design, certain: bool, asked: Asked
) -> Row:
    """Return the effect of a field or a choice, and its best value."""
    path, value, others = asked
    sensitivity, ways = None, [others]
    if not others and isinstance(value, float):
        sensitivity, ways = _scaled(scenario, seed, here, path, value)
    row: dict[str, Any] = {"sensitivity": sensitivity, "to": None, "best": None, "share": None}
    row["merit"] = np.array([-1.0, abs(sensitivity or 0.0), 0.0, 0.0])
    best = _merit(here, 0.0)
    for way in () if certain else ways:
        for found, one in _along(scenario, seed, asked, way):
            merit = _merit(found, _distance(value, one))
            by_more = found.share > here.share_high or merit[2] > best[2] or not here.share
            better = merit[:3] > best[:3] or (not here.share and merit > best)
            if better and (merit[0] or by_more):  # than by chance
                best, to = merit, one if found.verdict == "certain" else None
                row |= {"to": to, "best": one, "share": found.share, "merit": np.array(merit)}
    return row


def _scaled(
    scenario: DesignScenario, seed: int, here: Design, path: str, value: float
) -> tuple[float, list[tuple[Value, ...]]]:
    """Return a number's sensitivity, and its values to try in the directions that may help."""
    side, near = 1, _looked_at(scenario, seed, (path, (1 + _STEP) * value))
    if near is None:
        side, near = -1, _looked_at(scenario, seed, (path, (1 - _STEP) * value))
    if near is None:
        return 0.0, []
    name = here.limiting_link
    links, moved = ({link.name: link for link in of.links} for of in (here, near))
    gain = moved[name].share - links[name].share if name in moved else 0.0
    sensitivity = side * gain if math.isfinite(gain) else 0.0
    if not _bears(links, moved):
        return sensitivity, []
    field, before, after = FIELDS[path], _merit(here, 0.0), _merit(near, 0.0)
    ends = {1: field.high, -1: field.low}
    return sensitivity, [
        tuple(_rounded(value * end ** ((k / _LOOKS) ** 1.5)) for k in range(1, _LOOKS + 1))
        for way, end in ends.items()
        if end != 1 and ((after > before) == (way == side) or after == before)
    ]


def _bears(links: Mapping[str, Link], moved: Mapping[str, Link]) -> bool:
    """Return whether a field affects a link beyond its limit, or no link is beyond."""
    beyond = [link for link in links.values() if link.margin < 0]
    return (
        not beyond
        or links.keys() != moved.keys()
        or not all(
            math.isclose(getattr(link, name), getattr(moved[link.name], name), rel_tol=_SAME)
            for link in beyond
            for name in ("bound", "allowed")
        )
    )


def _along(
    scenario: DesignScenario, seed: int, asked: Asked, way: Sequence[Value]
) -> Iterator[tuple[Design, Value]]:
    """Yield designs with values further and further from a field's own, while they improve."""
    path, inner, others = asked
    last: tuple[float, ...] = ()
    for outer in way:
        found = _looked_at(scenario, seed, (path, outer))
        if found is not None and found.verdict == "certain":
            yield _nearest(scenario, seed, path, inner, outer)
            return
        merit = () if found is None else _merit(found, 0.0)
        if not others and merit < last:
            return
        if found is not None:
            yield found, outer
        inner, last = outer, merit


def _nearest(
    scenario: DesignScenario, seed: int, path: str, inner: Value, outer: Value
) -> tuple[Design, Value]:
    """Return the nearest value that is certain, at most the outer one, and its design."""
    widest = outer
    if isinstance(inner, float) and isinstance(outer, float) and inner:
        for _ in range(_HALVINGS):
            middle = _rounded(math.sqrt(inner * outer))
            found = _looked_at(scenario, seed, (path, middle))
            if found is not None and found.verdict == "certain":
                outer = middle
            else:
                inner = middle
    found = _confirmed(scenario, seed, (path, outer))
    if found.verdict != "certain" and widest != outer:
        outer, found = widest, _confirmed(scenario, seed, (path, widest))
    return found, outer
