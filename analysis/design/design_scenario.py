"""The scenario of a design: the cell, the spread of its errors, and its region of success."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Final, TypeVar

from chamfer.analysis.cell.alignment_runs import Spread, drawn, require_starts
from chamfer.analysis.cell.camera_error_runs import with_drawn_errors
from chamfer.diagrams.insertion.cells import CELLS, Cells
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    resolve_as,
)
from chamfer.models.validation import ParameterError

FEWEST: Final = 72  # draws, of which none inside says with 95 % that less than 5 % are
_MOST_DRAWS: Final = 100_000
_MOST_PICTURES: Final = 1000
OFF_AXIS: Final = 0.02  # m, from the optical axes to the parts, at most; as of camera-errors


@dataclass(frozen=True, kw_only=True)
class DesignSpread(Spread):
    """The variation between the cells of a design: uniform within plus and minus each range."""

    cameras: float = 0.0
    # share of the plausible errors of uncalibrated cameras; 0: the cameras are as believed

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.cameras <= 1:
            raise ParameterError("cameras", self.cameras, "a share, from 0 to 1")


@dataclass(frozen=True, kw_only=True)
class DesignScenario(InsertionScenario):
    """The insertion with its cell, and the spread of errors about the given values."""

    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the middle of the starts
    spread: DesignSpread = field(default_factory=DesignSpread)
    draws: int = 200  # random cells, for the share that goes in
    pictures: int = 4
    # with noise, to find the parts: at the gap, at two starts, at 15 places of the way

    WHOLE: ClassVar[Mapping[str, Cells]] = {"cell": CELLS}

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, least, most in (("draws", FEWEST, _MOST_DRAWS), ("pictures", 1, _MOST_PICTURES)):
            if not least <= getattr(self, name) <= most:
                raise ParameterError(name, getattr(self, name), f"{least} to {most}")


@dataclass(frozen=True, kw_only=True)
class ResolvedDesignScenario(ResolvedInsertionScenario, DesignScenario):
    """A design's scenario without open fields."""


ScenarioT = TypeVar("ScenarioT", bound=DesignScenario)


def resolve_design(scenario: DesignScenario) -> ResolvedDesignScenario:
    """Resolve the insertion, once every start is certain to show the parts.

    Raises:
        ParameterError: If a part is out of an image at a start, or the cell can't be built.
    """
    if scenario.servo is not None and scenario.cameras.kind == "pair":
        allowed = "hand or none of an arm that takes positions: a pair is not predicted yet"
        raise ParameterError("cameras.kind", scenario.cameras.kind, allowed)
    resolved = resolve_as(ResolvedDesignScenario, scenario)
    require_starts(resolved, resolved.spread)
    return resolved


def drawn_design(scenario: ScenarioT, seed: int, trial: int) -> ScenarioT:
    """Return a resolved scenario with the errors of one of a seed's trials, to be simulated.

    Its controllers are those designed for the believed values.
    """
    one = drawn(scenario, scenario.spread, seed, trial)
    share = scenario.spread.cameras
    return with_drawn_errors(one, seed, trial, share, OFF_AXIS) if share else one


def target_of(scenario: ResolvedInsertionScenario) -> float:
    """Return the target depth of the tip, m."""
    bore = scenario.parts.bore_depth
    return min(scenario.insert.depth, math.inf if bore is None else bore)
