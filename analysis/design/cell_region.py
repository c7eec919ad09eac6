"""The region and the depth that the chart of an insertion goes by, made once for a cell."""

import math
from functools import lru_cache

from chamfer.diagrams.insertion.insertion import ResolvedInsertionScenario
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.systems.strategies.insertion_decision import InsertionRegion


def region_of(scenario: ResolvedInsertionScenario) -> InsertionRegion:
    """Return the errors with which the peg finds its hole and does not wedge, as is believed."""
    return _region(scenario.parts, scenario.wedging_support)


def target_of(scenario: ResolvedInsertionScenario) -> float:
    """Return how deep the tip is to be, m."""
    bore = scenario.parts.bore_depth
    return min(scenario.insert.depth, math.inf if bore is None else bore)


@lru_cache(maxsize=64)
def _region(parts: PegHoleGeometry, support: Support) -> InsertionRegion:
    return InsertionRegion(parts, support)
