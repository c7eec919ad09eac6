"""Assesses whether a cell inserts: tightest link, verdict, and simulated insertions."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Literal

import numpy as np
import scipy  # whose submodules are imported where they are used

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import CONFIDENCE, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, drawn_design, target_of
from chamfer.analysis.design.detection import Sight, sight, sight_links
from chamfer.analysis.design.feed_path import path_links
from chamfer.analysis.design.insertion_links import (
    MODEL_ERROR,
    Starts,
    depth_link,
    edge_forces,
    force_links,
    region_links,
    start_link,
    time_link,
    turn_link,
)
from chamfer.analysis.design.link import Link, supposed, tightest
from chamfer.analysis.design.position_errors import drawn_touches
from chamfer.analysis.design.position_links import (
    goes_in,
    passed,
    position_links,
    position_warnings,
)
from chamfer.analysis.design.remaining_errors import (
    DrawnErrors,
    drawn_cells,
    loop_links,
    settling_links,
)
from chamfer.analysis.insertion.cell_runs import (
    ending,
    insertion_metrics,
    run_cell_insertion,
    touch_row,
)
from chamfer.analysis.scenario.experiment import Progress
from chamfer.models.peg_theory.fed_insertion import largest_push, limits

Verdict = Literal["certain", "likely", "no"]

_PLANAR: Final = ("chamfer", "wedging", "jamming", "push", "edge")  # within which all goes in
_SELDOM: Final = 0.05  # share of the drawn errors that could go in, below which it does not


@dataclass(frozen=True, kw_only=True)
class Bound:
    """A tolerance bound: a share of all cells is within it, with a confidence."""

    bound: float
    unit: str
    coverage: float  # share of the cells that the model draws, by order statistics
    confidence: float = 0.95


@dataclass(frozen=True, kw_only=True)
class Design:
    """The assessment of a cell."""

    links: tuple[Link, ...]  # in the order of the chain
    verdict: Verdict
    draws: int  # errors that were drawn
    share: float  # of them that go in
    share_low: float  # 95 % interval of Clopper and Pearson
    share_high: float
    bounds: Mapping[str, Bound] = field(default_factory=dict)
    # by name, of what is begun; those beyond the touch only where it is certain
    warnings: tuple[str, ...] = ()

    @property
    def limiting_link(self) -> str:
        """The name of the link with the smallest margin."""
        return tightest(self.links).name

    @property
    def margin(self) -> float:
        """The smallest margin, as a share of what is allowed."""
        return tightest(self.links).share


def assess(scenario: ResolvedDesignScenario, seed: int = 0, *, draws: int | None = None) -> Design:
    """Return the theory's assessment of an insertion, without simulation.

    Certain: every link's bound is within its limit, and so are all random errors. No: less than 5
    % of the random errors could go in, by their interval. Else likely, with the share of the
    random errors within the limits. None ``draws``: the scenario's number.
    """
    count = draws or scenario.draws
    if scenario.servo:
        drawn = drawn_touches(scenario, seed, count)
        links = position_links(scenario, drawn)
        kept = all(link.margin >= 0 for link in links if link.supposed)
        could = int(goes_in(scenario, Starts.of(drawn)).sum() * passed(scenario)) if kept else 0
        safe = could
    else:
        drawn = drawn_cells(scenario, seen := sight(scenario), seed, count)
        links = chain(scenario, seen, drawn)
        safe, could = _inside(scenario, seen, links, drawn)
    low, high = interval(safe, count)
    verdict: Verdict = "likely"
    if min(link.margin for link in links) >= 0 and safe == count:
        verdict = "certain"
    elif interval(could, count)[1] < _SELDOM:
        verdict = "no"
    return Design(
        links=links,
        verdict=verdict,
        draws=count,
        share=safe / count,
        share_low=low,
        share_high=high,
        bounds=_bounds(scenario, links, drawn, certain=verdict == "certain"),
        warnings=_warnings(scenario, drawn),
    )


def _bounds(
    scenario: ResolvedDesignScenario,
    links: tuple[Link, ...],
    drawn: DrawnErrors,
    *,
    certain: bool,
) -> dict[str, Bound]:
    """Return the bounds at the touch and of the insertion: of n cells the worst, p^n = 5 %."""
    starts, named = Starts.of(drawn), {link.name: link.bound for link in links}
    count = len(starts.lateral)
    if not count or any(link.supposed and link.margin < 0 for link in links):
        return {}
    slowest = MODEL_ERROR["time"] * float(drawn.time[drawn.decided].max())
    if drawn.exact:
        slowest = named["time"]
    elif scenario.decide.kind == "margin":
        slowest = min(slowest, scenario.decide.timeout)
    found = {
        "lateral": (float(starts.lateral.max()), "m"),
        "tilt": (float(np.abs(starts.tilt).max()), "rad"),
        "time": (slowest, "s"),
    }
    if certain:
        more = max(named.get(name, 0.0) for name in ("turn", "touch"))
        found |= {
            "push": (max(named["push"], more), "N"),
            "force": (max(named["force"], more), "N"),
            "depth": (target_of(scenario) - named["depth"], "m"),
            "attempts": (named.get("attempts", 1.0), ""),
        }
    coverage = (1 - CONFIDENCE) ** (1 / count)
    return {
        name: Bound(bound=bound, unit=unit, coverage=coverage)
        for name, (bound, unit) in found.items()
        if np.isfinite(bound)
    }


def _warnings(scenario: ResolvedDesignScenario, drawn: DrawnErrors) -> tuple[str, ...]:
    if scenario.servo:
        return position_warnings(scenario, drawn)
    if not drawn.growth < 1 < drawn.delayed:
        return ()
    return (
        "with torques that come one period late the sampled impedance loop grows, by "
        f"{100 * (drawn.delayed - 1):.3g} % a period",
    )


def chain(scenario: ResolvedDesignScenario, seen: Sight, drawn: DrawnErrors) -> tuple[Link, ...]:
    """Return the links from the cameras to the seated peg, of a resolved scenario.

    The chain ends early where no random errors become small enough to insert.
    """
    loop, saturated = loop_links(scenario, drawn)
    looks = sight_links(scenario, seen)
    links = [
        *(looks if seen.seen else supposed(looks)),
        *supposed([*path_links(scenario), loop]),
        saturated,
        start_link(scenario),
        *settling_links(scenario, drawn),
        *time_link(scenario, drawn),
    ]
    tilt = 0.0
    if drawn.decided.any():
        starts = Starts.of(drawn)
        tilt = float(np.abs(starts.tilt).max())
        links += [*region_links(scenario, starts), *turn_link(scenario, drawn)]
        links += force_links(scenario, starts)
    return (*links, depth_link(scenario, seen, tilt))


def interval(inside: int, count: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a share."""
    found = scipy.stats.binomtest(inside, count).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


def _inside(
    scenario: ResolvedDesignScenario, seen: Sight, links: tuple[Link, ...], drawn: DrawnErrors
) -> tuple[int, int]:
    """Return how many random cells go in, and how many could.

    A cell goes in if it starts, meets the mouth, needs less push than is available by exact
    statics, and does not sit on the bore's edge. Some that sit there could go in. The worst places
    on the way count.
    """
    begun = (drawn.force <= scenario.insert.force_limit) & drawn.decided
    kept = all(link.margin >= 0 for link in links if link.supposed)
    if not (seen.seen and begun.any() and kept):
        return 0, 0
    starts = Starts(drawn.lateral[begun], drawn.tilt[begun])
    parts, push = scenario.there.parts, scenario.insert.push
    could = np.ones(len(starts.lateral), dtype=np.bool_)
    edge = np.zeros(len(could))
    if min(link.margin for link in links if link.name in _PLANAR) < 0:
        could = ~limits(parts, scenario.support_at, *starts).misses
        depth = target_of(scenario)
        needed = largest_push(parts, scenario.support_at, *starts, depth=depth)
        could &= needed + drawn.push[begun] < push
        edge = edge_forces(scenario, starts)
    return int(np.sum(could & (edge <= push)) * seen.share), int(could.sum())


MOST_TRIALS: Final = 10_000


@dataclass(frozen=True, kw_only=True)
class Verified:
    """The outcomes of simulated insertions of a design."""

    trials: int  # that finished
    seated: int  # of them, as the chart says and as is true
    success: float  # share
    low: float  # of its interval by Clopper and Pearson, 95 %
    high: float
    failed_trials: int  # that ended with an error, and count neither way
    endings: Mapping[str, int]  # how insertions ended that were not seated, most often first
    outside: Mapping[str, int]  # how many were outside of a bound, by its name
    largest_force: float  # N, of contact, of all trials; medians of 10 ms
    warning: str  # that the prediction is contradicted, in a sentence; "": it is not


# What bounds are promised of.
BOUNDED: Final = ("lateral", "tilt", "time", "push", "force", "depth", "attempts")
AT_LEAST: Final = ("depth",)  # the others at most


def is_within(name: str, value: float, bound: float) -> bool:
    """Return whether a simulated value keeps a bound."""
    return value >= bound if name in AT_LEAST else value <= bound


def insert_drawn(scenario: ResolvedDesignScenario, seed: int, trial: int) -> Row:
    """Simulate one insertion with random errors; it depends on its arguments alone.

    It is seated if the state machine reports it and the peg really is seated. Of the values that
    :data:`BOUNDED` names, those at the touch are of the first attempt; None if the run did not
    reach them.
    """
    one = drawn_design(scenario, seed, trial)
    done = run_cell_insertion(one, trial_seed(seed, trial))
    metrics, traces = insertion_metrics(done, one), done.traces
    seated = metrics["seated"] == metrics["said_seated"] == 1
    began, touch = done.began(first=True), touch_row(done, first=True)
    time = None if began is None else began - one.begin
    return {
        "seated": float(seated),
        "lateral": None if touch is None else float(traces["lateral_error"][touch]),
        "tilt": None if touch is None else float(traces["rotational_error"][touch]),
        "time": metrics["time_to_seated"] if scenario.servo else time,
        "push": metrics["force.axial"],
        "force": metrics["force.contact"],
        "depth": float(traces["depth"][-1]) if seated else None,
        "attempts": metrics["attempts"],
        "simulated_seconds": float(traces["time"][-1]),
        "ending": ending(done, one),
    }


def verify(
    scenario: ResolvedDesignScenario, design: Design, trials: int, seed: int, progress: Progress
) -> Verified:
    """Simulate insertions with random errors, and compare them with the prediction."""
    found = run_each(partial(insert_drawn, scenario, seed), range(trials), progress)
    seated = int(found.column("seated").sum())
    low, high = interval(seated, len(found))
    ends = Counter(row["ending"] for row in found.rows if not row["seated"])
    outside = {
        name: sum(
            row[name] is not None and not is_within(name, row[name], one.bound)
            for row in found.rows
        )
        for name, one in design.bounds.items()
    }
    return Verified(
        trials=len(found),
        seated=seated,
        success=seated / len(found),
        low=low,
        high=high,
        failed_trials=len(found.failed),
        endings=dict(ends.most_common()),
        outside={name: count for name, count in outside.items() if count},
        largest_force=float(found.column("force").max()),
        warning=contradiction(design, seated, len(found)),
    )


def contradiction(design: Design, seated: int, trials: int) -> str:
    """Return in a sentence how simulated insertions contradict a design, "" if they do not.

    A single failure contradicts "certain", and a single success contradicts "no". Where a design
    is likely, the intervals of the predicted and the simulated share have to overlap.
    """
    said = f"the design is called {design.verdict!r}"
    if design.verdict == "certain" and seated < trials:
        return f"{said}, but {trials - seated} of {trials} simulated insertions were not seated"
    if design.verdict == "no" and seated:
        return f"{said}, but {seated} of {trials} simulated insertions were seated"
    if design.verdict == "likely":
        low, high = interval(seated, trials)
        if high < design.share_low or design.share_high < low:
            return (
                f"{said} with {100 * design.share_low:.3g} to {100 * design.share_high:.3g} % of "
                f"the errors inside, but {100 * low:.3g} to {100 * high:.3g} % of the insertions "
                "are seated"
            )
    return ""
