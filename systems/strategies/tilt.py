"""The search by a tilted peg, beside dithers and a spiral.

One point of the rim of a peg that leans is lowest, and for that point the opening is the whole
hole, not the play: it is in the hole even where the axis is off by much of the radius. The peg
slides that way until the point meets the wall, which is its place along that axis; a dither across
lets it go to the middle of the wall, which is its place along the other; then it is stood up,
pressed to the wall and down all the while.

Known of old: Bruyninckx, Dutre and De Schutter, "Peg-on-hole", ICRA 1995; Chhatpar and Branicky,
"Search strategies for peg-in-hole assemblies with position uncertainty", IROS 2001. All numbers
are assumed.
"""

import math
from dataclasses import dataclass

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.primitives.force_primitives import GuardedMove, Stick
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.skill import Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.strategies.face_feeling import STIFF
from chamfer.systems.strategies.touch import ALONG, UNTURNED, TouchParams


@dataclass(frozen=True, kw_only=True)
class Tilt:
    """Parameters of the search by a tilted peg."""

    angle: float = math.radians(12)  # rad, about x
    back: float = 0.004  # m, from where the hole is believed: more than the peg is off
    lean_time: float = 0.6  # s, in which it leans over, in free space
    speed: float = 0.008  # m/s, along the face, towards the point that is lowest
    threshold: float = 8.0  # N, along the face, of a wall; more than friction
    press: float = 0.005  # m/s, against the wall, of what keeps contact
    amplitude: float = 0.0016  # m, of the dither across
    cycles: float = 2.0  # of it
    frequency: float = 1.0  # Hz, of it
    stand_time: float = 1.5  # s, in which it is stood up

    def __post_init__(self) -> None:
        require_positive(
            self, "back", "lean_time", "speed", "threshold", "press", "amplitude", "cycles"
        )
        require_positive(self, "frequency", "stand_time")
        if not 0 < self.angle < math.pi / 6:
            raise ParameterError("angle", self.angle, "0 < angle < pi/6 rad")

    @property
    def dither(self) -> Dither:
        """Across the way that it slides."""
        return Dither(
            axis="x", amplitude=self.amplitude, frequency=self.frequency, cycles=self.cycles
        )

    def states(
        self, touch: TouchParams, radius: float, *, found: str, again: Retry
    ) -> tuple[SkillState, ...]:
        """Return the states from ``lean`` on, which begins over the hole, in free space.

        Args:
            touch: How it touches.
            radius: Of the peg, m.
            found: State that follows a peg in the hole.
            again: What follows where it is not.
        """
        low = radius * math.sin(self.angle)  # of the rim, below its middle
        lean = (self.angle, 0.0, 0.0, 0.0, self.back, low)
        wall = Stick(direction="-y", speed=self.press, threshold=math.inf)
        return (
            SkillState(
                name="lean",
                run=[MoveDx(displacement=lean, duration=self.lean_time)],
                on={"done": "lower"},
                damping=STIFF,
                timeout=2 * self.lean_time,
            ),
            SkillState(
                name="lower",
                from_mark=True,
                run=[touch.guarded(low)],
                on={"contact": "slide", "lost": again},
                damping=UNTURNED,
                timeout=2 * (touch.clearance + 2 * low) / touch.approach_speed,
            ),
            SkillState(
                name="slide",
                run=[
                    touch.hold,
                    GuardedMove(
                        direction="-y",
                        speed=self.speed,
                        threshold=self.threshold,
                        limit=3 * self.back,
                    ),
                ],
                on={"contact": "across", "lost": again},
                damping=ALONG,
                timeout=6 * self.back / self.speed,
            ),
            SkillState(
                name="across",
                run=[touch.hold, wall, self.dither],
                on={"done": "stand"},
                damping=ALONG,
                timeout=2 * self.dither.duration,
            ),
            SkillState(
                name="stand",
                run=[
                    touch.hold,
                    wall,
                    MoveDx(
                        displacement=(-self.angle, 0.0, 0.0, 0.0, 0.0, 0.0),
                        duration=self.stand_time,
                    ),
                ],
                on={"done": "sink"},
                damping=ALONG,
                timeout=2 * self.stand_time,
            ),
            SkillState(
                name="sink",
                from_mark=True,
                run=[touch.hold, Way(least=touch.entered)],
                on={"done": found, "jammed": again},
                damping=UNTURNED,
                timeout=2.0,
            ),
        )
