"""Alignment by touch: a plug lies down beside its socket, and stays turned as it is then.

A plug that is tilted in its gripper, beside a hole that it nearly fills, tips into it. So it lies
down where there is nothing but face, until accommodation has laid it flat; from there on, until
it has found its socket, it is turned by nothing. The strategies of the peg and of the RJ45 plug
begin so. They are not of the paper; their primitives are.
"""

import math
from dataclasses import dataclass
from typing import Final

from chamfer.models.validation import require_positive
from chamfer.systems.primitives.skill import SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.strategies.face_feeling import FaceFeelingParams

# Damping of accommodation, 0 for its own: it is laid down; gives way to forces alone; goes its way
# along the face in spite of friction.
_LYING: Final = (0.0,) * 6
UNTURNED: Final = (math.inf, math.inf, math.inf, 0.0, 0.0, 0.0)
ALONG: Final = (math.inf, math.inf, math.inf, 1500.0, 1500.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class TouchParams(FaceFeelingParams):
    """Parameters of an insertion that begins with an alignment by touch; all are assumed."""

    maintained: float = 0.008  # m/s, towards the face, of what keeps contact
    lie_time: float = 4.0  # s, in which the plug lies down on the face
    entered: float = 0.001  # m, below the face, of a plug that went into its socket at once
    drop: float  # m, of a plug that has found its socket
    push_speed: float  # m/s, of the push at first; D times it is its force at rest
    end: float = 0.001  # m, before the mated depth, from which on a stop counts as the end
    short: float = 0.00025  # m, that what is mated may seem to lack of its depth

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "lie_time", "entered", "drop", "push_speed", "end", "short")

    def laid_flat(self, *, then: str) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on until the plug is flat, above its socket.

        Args:
            then: State that follows.
        """
        return self.feel_face(
            MoveDx(duration=self.lie_time),
            timeout=2 * self.lie_time,
            damping=_LYING,
            then=then,
        )

    def touched(self, *, search: str, found: str) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on until the plug is on the face over its socket.

        Args:
            search: State that follows where the plug stands on the face.
            found: State that follows where it has gone into its socket at once.
        """
        return (
            *self.laid_flat(then="down"),
            SkillState(
                name="down",
                from_mark=True,
                run=[self.guarded(self.entered)],
                on={"contact": search, "lost": found},
                damping=UNTURNED,
                timeout=2.0,
            ),
        )
