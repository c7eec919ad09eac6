"""The region and the depth that the chart of an insertion goes by, made once for a cell."""

import math
from functools import lru_cache

from chamfer.diagrams.insertion.insertion import InsertionScenario
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.validation import known
from chamfer.systems.strategies.insertion_decision import InsertionRegion


def region_of(scenario: InsertionScenario) -> InsertionRegion:
    """Return the errors with which the peg finds its hole and does not wedge, as is believed."""
    return _region(scenario.parts, scenario.wedging_support)


def target_of(scenario: InsertionScenario) -> float:
    """Return how deep the tip is to be, m."""
    bore = scenario.parts.bore_depth
    return min(known("insert.depth", scenario.insert.depth), math.inf if bore is None else bore)


@lru_cache(maxsize=64)
def _region(parts: PegHoleGeometry, support: Support) -> InsertionRegion:
    return InsertionRegion(parts, support)
