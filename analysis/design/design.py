"""Whether a cell inserts: the links of the chain, the tightest one, and a verdict."""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import scipy  # whose submodules are imported where they are used

from chamfer.analysis.campaign.trial_metrics import CONFIDENCE
from chamfer.analysis.design.cell_region import target_of
from chamfer.analysis.design.design_scenario import ResolvedDesignScenario
from chamfer.analysis.design.detection import Sight, sight, sight_links
from chamfer.analysis.design.drawn_errors import DrawnErrors, draw_errors
from chamfer.analysis.design.insertion_links import (
    Starts,
    depth_link,
    force_links,
    region_links,
    start_link,
    time_link,
)
from chamfer.analysis.design.link import Link, tightest
from chamfer.analysis.design.settling import settling_links
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
    limiting_link: str  # name of the link with the smallest share of its allowed value left
    draws: int  # errors that were drawn
    share: float  # of them inside all limits
    share_low: float  # 95 % interval of Clopper and Pearson
    share_high: float

    @property
    def limiting(self) -> Link:
        """The link with the smallest margin."""
        return tightest(self.links)

    @property
    def margin(self) -> float:
        """Its margin, as a share of what it is allowed."""
        return self.limiting.share


def assess(scenario: ResolvedDesignScenario, seed: int = 0, *, draws: int | None = None) -> Design:
    """Return what theory says of an insertion; nothing is simulated.

    Certain: every link's bound is within its limit, and so are all drawn errors. No: of the drawn
    errors hardly any could go in, by an interval below 5 %. Else likely, with the share of the
    drawn errors that is inside.

    Args:
        scenario: Resolved.
        seed: Of the draws.
        draws: How many; None: as the scenario says.
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
        limiting_link=tightest(links).name,
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
