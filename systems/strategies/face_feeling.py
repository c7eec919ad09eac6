"""What all strategies share: the sensor's zero, the face that is felt first, and the way out.

Source: Morrow, Nelson and Khosla, section 4; all numbers are assumed.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.primitives.force_primitives import GuardedMove, Stick
from chamfer.systems.primitives.position_primitives import Place
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx

# Damping of accommodation: where nothing is touched nothing has to give way, so that neither bias
# nor noise moves the tool.
STIFF: Final = (math.inf,) * 6


@dataclass(frozen=True, kw_only=True)
class FaceFeelingParams:
    """Parameters of any insertion that feels the face first."""

    tare_time: float = 0.5  # s, in which the force sensor takes its zero
    approach_speed: float = 0.01  # m/s, of guarded moves
    contact_force: float = 4.0  # N, at which guarded moves end
    approach_limit: float = 0.02  # m, way without contact at which the approach has failed
    beside: float  # m, along y, of where the face is felt, from where the plug goes in
    clearance: float = 0.0025  # m, over the face, of motions along it
    maintained: float = 0.006  # m/s, towards the socket, of what keeps contact (stick)
    limit_share: float = 2.5
    # of the believed mating force, at which a push that moves nothing ends: jammed; no cap
    free_share: float = 0.68
    # of the believed mating force, that it pushes with whether or not anything moves: 1.36 times
    # the true one if that is half of what is believed
    retries: int = 3  # how often a state is tried again
    out_speed: float = 0.1  # m/s, of a plug that is pulled out: D times it overcomes what holds it
    retract: float = 0.03  # m, back from the socket after a failure

    def __post_init__(self) -> None:
        require_positive(self, "tare_time", "approach_speed", "contact_force", "approach_limit")
        require_positive(self, "beside", "clearance", "maintained", "limit_share")
        require_positive(self, "free_share")
        require_positive(self, "out_speed", "retract")
        if not self.limit_share >= 1:
            allowed = "a number >= 1: with less than its mating force nothing mates"
            raise ParameterError("limit_share", self.limit_share, allowed)
        if not self.free_share <= self.limit_share:
            allowed = f"at most limit_share, {self.limit_share:g}"
            raise ParameterError("free_share", self.free_share, allowed)
        if not (isinstance(self.retries, int) and self.retries >= 1):
            raise ParameterError("retries", self.retries, "a whole number >= 1")

    @property
    def hold(self) -> Stick:
        """Keeps contact, whatever happens."""
        return Stick(speed=self.maintained, threshold=math.inf)

    def guarded(self, limit: float) -> GuardedMove:
        """Return a guarded move downwards."""
        return GuardedMove(speed=self.approach_speed, threshold=self.contact_force, limit=limit)

    def feel_face(
        self, *lie: Primitive, timeout: float, damping: tuple[float, ...], then: str
    ) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on that feel the face, beside where the plug goes in.

        There nothing can drop in: how high the plug is on it, with the force that is maintained,
        is the mark. They end over where the plug goes in, with a new zero of the force sensor.

        Args:
            lie: What runs while the plug lies on the face, until it is done.
            timeout: s, of that.
            damping: Of accommodation on the face.
            then: The state that follows.
        """
        way = (0.0, 0.0, 0.0, 0.0, self.beside, 0.0)
        return (
            self._tare("tare", "beside"),
            SkillState(
                name="beside",
                run=[MoveDx(displacement=way, duration=0.5)],
                on={"done": "touch"},
                timeout=1.0,
                damping=STIFF,
            ),
            SkillState(
                name="touch",
                run=[self.guarded(self.approach_limit)],
                on={"contact": "lie"},
                timeout=2 * self.approach_limit / self.approach_speed,
                damping=damping,
            ),
            SkillState(
                name="lie",
                run=[self.hold, *lie],
                on={"done": "above"},
                timeout=timeout,
                damping=damping,
            ),
            SkillState(
                name="above",
                marks=True,
                from_mark=True,
                run=[self._above],
                on={"done": "tare again"},
                timeout=3.0,
                damping=STIFF,
            ),
            SkillState(
                name="out",
                from_mark=True,
                run=[replace(self._above, speed=self.out_speed)],
                on={"done": "tare again"},
                timeout=3.0,
            ),
            self._tare("tare again", then),
        )

    @property
    def _above(self) -> Place:
        """Goes over where the plug goes in, from the mark."""
        return Place(offset=(0.0, -self.beside, self.clearance))

    def _tare(self, name: str, then: str) -> SkillState:
        return SkillState(
            name=name,
            run=[MoveDx(duration=self.tare_time)],
            on={"done": then},
            timeout=2 * self.tare_time,
            tares=True,
            damping=STIFF,
        )

    @property
    def out(self) -> Place:
        """Pulls the plug out of the socket, and away from it."""
        return Place(offset=(0.0, 0.0, self.retract), speed=self.out_speed)
