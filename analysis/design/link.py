"""A link of the chain from the cameras to the seated peg: its bound and its allowed value."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Link:
    """One link; its two numbers in its own unit."""

    name: str
    bound: float  # what it comes to at the worst
    allowed: float  # what it may come to
    margin: float  # what is left between them, >= 0 inside
    unit: str
    source: str  # where the numbers come from
    by_design: bool = False  # whether the margin is what the controllers are designed to keep
    supposed: bool = (
        False  # whether the other links suppose that it is kept, as that an arm reaches
    )

    @property
    def share(self) -> float:
        """The margin as a share of the allowed value, by which links are compared."""
        if math.isinf(self.bound):
            return -math.inf
        if math.isinf(self.allowed):
            return 1.0
        scale = abs(self.allowed) or abs(self.bound) or 1.0
        return self.margin / scale


def at_most(
    name: str, bound: float, allowed: float, unit: str, source: str, *, by_design: bool = False
) -> Link:
    """Return a link whose bound has to be below the allowed value."""
    margin = -math.inf if math.isinf(bound) else float(allowed - bound)
    bound, allowed = float(bound), float(allowed)
    return Link(name, bound, allowed, margin, unit, source, by_design)


def at_least(
    name: str, bound: float, allowed: float, unit: str, source: str, *, by_design: bool = False
) -> Link:
    """Return a link whose bound has to be above the required value."""
    bound, allowed = float(bound), float(allowed)
    return Link(name, bound, allowed, bound - allowed, unit, source, by_design)


def supposed(links: Iterable[Link]) -> list[Link]:
    """Return links marked as kept by design, which the others suppose."""
    return [replace(link, supposed=True) for link in links]


def tightest(links: Iterable[Link]) -> Link:
    """Return the link with the smallest share left, of those that are not kept by design.

    An infinite bound is a symptom: if upstream links are beyond their limits, the one that fails
    most is the tightest. A link that the others suppose to be kept comes first if it is beyond its
    limit.
    """
    chain = list(links)
    chain = [link for link in chain if link.supposed and link.margin < 0] or chain
    least = min(chain, key=_rank)
    if math.isinf(least.bound):
        causes = [link for link in chain[: chain.index(least)] if -math.inf < link.share < 0]
        least = min(causes, key=_rank, default=least)
    return least


def _rank(link: Link) -> tuple[bool, float]:
    return link.by_design, link.share
