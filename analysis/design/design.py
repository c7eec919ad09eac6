"""Whether a cell inserts: its chain's tightest link, a verdict, and simulations beside it."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final, Literal

import numpy as np
import scipy  # whose submodules are imported where they are used

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import CONFIDENCE, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario, drawn_design, target_of
from chamfer.analysis.design.detection import Sight, sight, sight_links
from chamfer.analysis.design.insertion_links import (
    Starts,
    depth_link,
    force_links,
    region_links,
    start_link,
    time_link,
)
from chamfer.analysis.design.link import Link, tightest
from chamfer.analysis.design.remaining_errors import DrawnErrors, draw_errors, settling_links
from chamfer.analysis.insertion.cell_runs import ending, insertion_metrics, run_cell_insertion
from chamfer.analysis.scenario.experiment import Progress
from chamfer.models.peg_theory.fed_insertion import FeedVerdict as Planar
from chamfer.models.peg_theory.fed_insertion import largest_push, limits

Verdict = Literal["certain", "likely", "no"]

_PLANAR: Final = ("chamfer", "wedging", "jamming", "push")  # links within which all goes in
_SELDOM: Final = 0.05  # share of the drawn errors that could go in, below which it does not


@dataclass(frozen=True, kw_only=True)
class Design:
    """What is said of a cell."""

    links: tuple[Link, ...]  # in the order of the chain
    verdict: Verdict
    draws: int  # errors that were drawn
    share: float  # of them inside all limits
    share_low: float  # 95 % interval of Clopper and Pearson
    share_high: float

    @property
    def limiting_link(self) -> str:
        """The name of the link with the smallest margin."""
        return tightest(self.links).name

    @property
    def margin(self) -> float:
        """The smallest margin, as a share of what is allowed."""
        return tightest(self.links).share


def assess(scenario: ResolvedDesignScenario, seed: int = 0, *, draws: int | None = None) -> Design:
    """Return what theory says of an insertion; nothing is simulated.

    Certain: every link's bound is within its limit, and so are all drawn errors. No: of the drawn
    errors hardly any could go in, by an interval below 5 %. Else likely, with the share of the
    drawn errors that is inside. None ``draws``: as many as the scenario says.
    """
    drawn = draw_errors(scenario, seen := sight(scenario), seed, draws or scenario.draws)
    links = chain(scenario, seen, drawn)
    count = len(drawn.time)
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
    )


def chain(scenario: ResolvedDesignScenario, seen: Sight, drawn: DrawnErrors) -> tuple[Link, ...]:
    """Return the links from the cameras to the seated peg, of a resolved scenario.

    Where no drawn errors become small enough to insert, the chain ends there.
    """
    links = [
        *sight_links(scenario, seen),
        start_link(scenario),
        *settling_links(scenario, seen),
        *time_link(scenario, drawn),
    ]
    of = drawn.decided
    if of.any():
        starts = Starts(drawn.lateral[of], drawn.tilt[of])
        links += [*region_links(scenario, starts), *force_links(scenario, starts)]
    return (*links, depth_link(scenario, seen))


def interval(inside: int, count: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a share."""
    found = scipy.stats.binomtest(inside, count).proportion_ci(CONFIDENCE, method="exact")
    return float(found.low), float(found.high)


def _inside(
    scenario: ResolvedDesignScenario, seen: Sight, links: tuple[Link, ...], drawn: DrawnErrors
) -> tuple[int, int]:
    """Return how many draws are inside all limits, and how many could go in."""
    begun = (drawn.force <= scenario.insert.force_limit) & drawn.decided
    if not (seen.seen and begun.any()):
        return 0, 0
    named = {link.name: link for link in links}
    if min(named[name].margin for name in _PLANAR) >= 0 and not named["edge"].bound:
        return int(begun.sum()), int(begun.sum())
    lateral, tilt = drawn.lateral[begun], drawn.tilt[begun]
    parts = scenario.there.parts
    verdict = limits(parts, scenario.support_at, lateral, tilt).verdict
    if named["push"].margin < 0:
        push = scenario.insert.push
        needed = largest_push(parts, scenario.support_at, lateral, tilt, depth=target_of(scenario))
        verdict = np.where(needed < push, verdict, Planar.STOPPED)
    return int(np.sum(verdict == Planar.SAFE)), int(np.sum(verdict != Planar.STOPPED))


MOST_TRIALS: Final = 10_000


@dataclass(frozen=True, kw_only=True)
class Verified:
    """What became of simulated insertions of a design."""

    trials: int  # that finished
    seated: int
    success: float  # share
    low: float  # of its interval by Clopper and Pearson, 95 %
    high: float
    failed_trials: int  # that ended with an error, and count neither way
    endings: Mapping[str, int]  # how insertions ended that were not seated, most often first
    largest_force: float  # N, of contact, of all trials; medians of 10 ms
    warning: str  # that the prediction is contradicted, in a sentence; "": it is not


def insert_drawn(scenario: ResolvedDesignScenario, seed: int, trial: int) -> Row:
    """Simulate one insertion with drawn errors; it depends on its arguments alone."""
    one = drawn_design(scenario, seed, trial)
    done = run_cell_insertion(one, trial_seed(seed, trial))
    metrics = insertion_metrics(done, one)
    return {
        "seated": metrics["seated"],
        "force": metrics["force.contact"],
        "simulated_seconds": float(done.traces["time"][-1]),
        "ending": ending(done, one),
    }


def verify(
    scenario: ResolvedDesignScenario, design: Design, trials: int, seed: int, progress: Progress
) -> Verified:
    """Simulate insertions with drawn errors, and put them beside the prediction."""
    found = run_each(partial(insert_drawn, scenario, seed), range(trials), progress)
    seated = int(found.column("seated").sum())
    low, high = interval(seated, len(found))
    ends = Counter(row["ending"] for row in found.rows if not row["seated"])
    return Verified(
        trials=len(found),
        seated=seated,
        success=seated / len(found),
        low=low,
        high=high,
        failed_trials=len(found.failed),
        endings=dict(ends.most_common()),
        largest_force=float(found.column("force").max()),
        warning=contradiction(design, seated, len(found)),
    )


def contradiction(design: Design, seated: int, trials: int) -> str:
    """Return in a sentence how simulated insertions contradict a design, "" if they do not.

    A certain design has no error within its bounds that doesn't go in, and one that is not to go
    in none that does: a single one says otherwise. Where it is likely, the intervals of the
    predicted and the simulated share have to overlap.
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
