"""What the insertion by sight is: the aligned cell, and what is done once it is."""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, Self, TypeVar

from chamfer.diagrams.cell.alignment import resolve as resolve_alignment
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_support import axial_stiffness, support_at, wedging_support
from chamfer.diagrams.cell.resolved_arms import require_strong
from chamfer.models.peg.bore_contact import ContactMaterial, require_resolved_play, resolved_speed
from chamfer.models.peg.peg_and_hole import ColouredParts, Peg
from chamfer.models.peg.support import OpenSupport, Support
from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.strategies.insertion_decision import DecisionParams
from chamfer.systems.strategies.insertion_memory import InsertParams

FEED_SPEED: Final = 0.02  # m/s, of the feed; assumed
_IN: Final = 0.9  # of the peg's length, that goes in at most


@dataclass(frozen=True, kw_only=True)
class _WrongParts(ColouredParts):
    """Parts whose peg is thicker than anybody knows."""

    excess: float = 0.0  # m

    @property
    def peg(self) -> Peg:
        """The peg that is there."""
        peg = super().peg
        return replace(peg, radius=peg.radius + self.excess)


@dataclass(frozen=True, kw_only=True)
class InsertionScenario(AlignmentScenario):
    """The cameras align the parts, and the peg is inserted; many times if it has to be."""

    decide: DecisionParams = field(default_factory=DecisionParams)
    insert: InsertParams = field(default_factory=InsertParams)
    contact: ContactMaterial = field(default_factory=ContactMaterial)
    support: OpenSupport = field(default_factory=OpenSupport)
    # that the decision and theory go by; what is left open: of the arms, at the depth in question
    peg_excess: float = 0.0
    # m, of the peg's radius over that of parts: a wrong part; from 5 % on it is not recognised
    duration: float = 60.0  # s, how long the run may last

    UNUSED_OF_PARTS: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "duration")
        depth = self.insert.depth
        if depth is not None and not depth < self.parts.peg_length:
            allowed = f"less than the peg's length, {self.parts.peg_length:g} m"
            raise ParameterError("insert.depth", depth, allowed)
        if self.insert.speed is not None:
            require_resolved_play(self.parts, self.insert.speed, self.step)
        if not (
            math.isfinite(self.peg_excess)
            and self.parts.peg_chamfer.width
            < self.parts.peg_radius + self.peg_excess
            < self.parts.hole.mouth_radius
        ):
            allowed = "such that the peg's tip still finds the mouth"
            raise ParameterError("peg_excess", self.peg_excess, allowed)

    def support_at(self, depth: float) -> Support:
        """Return what the peg is taken to be held by at a depth of its tip, m."""
        return self.support.over(support_at(self, depth))

    @property
    def wedging_support(self) -> Support:
        """The same where two points decide whether the peg can wedge."""
        return self.support.over(wedging_support(self))

    @property
    def there(self) -> Self:
        """The same with the parts that are there, which only contact and cameras know."""
        if not self.peg_excess:
            return self
        return replace(self, parts=_WrongParts(**vars(self.parts), excess=self.peg_excess))

    @property
    def peg_motion_ends(self) -> float:
        """When the peg is at the gap by its desired motion, s."""
        return max(self.begin, self.motion_time) if self.moves else self.begin


ScenarioT = TypeVar("ScenarioT", bound=InsertionScenario)


def resolve(scenario: ScenarioT) -> ScenarioT:
    """Fill in the contact's facets and the feed, once the parts are in view."""
    scenario = resolve_alignment(scenario)
    require_strong(scenario, scenario.insert.push)
    insert, parts = scenario.insert, scenario.parts
    depth, speed, feed = insert.depth, insert.speed, insert.feed
    if depth is None:
        depth = min(parts.bore_length, _IN * parts.peg_length)
    if speed is None:
        speed = min(FEED_SPEED, resolved_speed(parts, scenario.step))
    if feed is None:
        # Stopped at the mouth the arms' springs take the rest of the way to reach the push.
        feed = scenario.gap + depth + insert.push / axial_stiffness(scenario)
    return replace(
        scenario,
        contact=scenario.contact.over(parts),
        insert=replace(insert, depth=depth, speed=speed, feed=feed),
    )
