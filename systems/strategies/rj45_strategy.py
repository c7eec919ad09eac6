"""The strategy that inserts an RJ45 plug: alignment by contact, a search, a push, and a pull.

It is not in the paper; its primitives are, and so is the sequence of the D connector's insertion:
dithers find the cavity, small turns settle the plug, a push seats it. The alignment by contact is
added, and the test that the latch holds when the plug is pulled.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.force_primitives import Stick
from chamfer.systems.primitives.skill import DONE, Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx, Spiral
from chamfer.systems.strategies.face_and_search import (
    ALONG,
    TouchParams,
    pull_test,
    settled,
    shaking,
)

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.rj45_connector import Rj45Connector

_LONG: Final = 10.0  # s, that a push may take


@dataclass(frozen=True, kw_only=True)
class Rj45ConnectorSkillParams(TouchParams):
    """Parameters of the insertion; all of them are assumed."""

    beside: float = 0.0125  # m, to the side of the contacts, on the plate
    search: Spiral = Spiral(speed=0.004, pitch=0.0006, radius=0.0045)
    # m/s, m and m: slow and with a small pitch, because the clearance is small
    drop: float = 0.0005  # m, of a plug that has found the cavity
    settle_amplitude: float = 0.01  # rad, about x and y, of the dithers that settle the plug
    settle_cycles: float = 2.0  # of the dithers that settle the plug
    push_speed: float = 0.008  # m/s, of the push at first; D times it is its force at rest
    shake_amplitude: float = 0.01  # rad, about x and y, of dithers that ease the push
    shake_frequency: float = 4.0  # Hz, of the one about x
    push_growth: float = 1.1  # of the push's speed, per window in which nothing moves
    push_still: float = 2e-5  # m, per window: less is no motion; a latch's ramp gives way slowly
    limit_share: float = 3.4  # a push that only the wrist makes appear to move ends there
    contacts_share: float = 1.05
    # of the believed mating force, push where the contacts are bent, moved or not: the contacts of
    # a plug that needs much more than believed
    around: float = 0.0007  # m, range around the depth of the contacts
    pull_speed: float = 0.006  # m/s, of the pull that tests the latch
    pull_force: float = 4.0  # N, that the latch has to withstand
    pull_limit: float = 0.001  # m, pull after which the latch doesn't hold
    rest_time: float = 0.3  # s, in which the plug goes back to its stop

    NAME: ClassVar[str] = "RJ45 connector"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 < self.push_growth < math.inf:
            raise ParameterError("push_growth", self.push_growth, "a finite number > 1")

    def states(self, connector: "Rj45Connector", period: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on."""
        stick = Stick(speed=self.maintained, threshold=self.drop)
        depth, contacts = connector.mated_depth, connector.contact_depth
        again = self.again
        rate = self.shake_frequency

        return (
            *self.touched(search="search", found="settle"),
            SkillState(
                name="search",
                run=[stick, self.search],
                on={"lost": "settle", "done": again},
                damping=(math.inf, math.inf, 0.0, *ALONG[3:]),  # turned into the cavity by it
                timeout=2 * self.search.duration,
            ),
            settled(self.hold, self.settle_amplitude, self.settle_cycles, then="push"),
            SkillState(
                name="push",
                from_mark=True,
                run=[
                    self.seat(
                        connector.mating_force,
                        stands=connector.largest_force,
                        speed=self.push_speed,
                        growth=self.push_growth,
                        still=self.push_still,
                        distance=depth - self.end,
                        steep=(contacts - self.around, contacts + self.around),
                        through=self.contacts_share * connector.mating_force,
                    ),
                    shaking("x", self.shake_amplitude, rate, longer_than=_LONG),
                    shaking("y", self.shake_amplitude, 1.25 * rate, longer_than=_LONG),
                ],
                on={
                    "done": "depth",
                    "jammed": again,
                    "tilted": Retry("loosen", 1, then=again),
                    "timed out": again,
                },
                timeout=_LONG,
            ),
            *self.straightened("push"),
            self.at_depth(depth, "pull"),
            pull_test(
                {"contact": "rest", "lost": again},
                speed=self.pull_speed,
                force=self.pull_force,
                limit=self.pull_limit,
            ),
            SkillState(
                name="rest",
                run=[self.hold, MoveDx(duration=self.rest_time)],
                on={"done": DONE},
                timeout=2 * self.rest_time,
            ),
        )
