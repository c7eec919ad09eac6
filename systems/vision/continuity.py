"""Whether something can be the part that was seen a moment ago: parts don't jump.

What is elsewhere than the part can have got to is refused, but not for good: if it stays, it was
the last belief that was wrong.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.vision.part_detection import Detection, Status


@dataclass(frozen=True, kw_only=True)
class ContinuityParams:
    """How fast what is seen can change."""

    speed: float = 2000.0  # pixels/s, at most; 1 m/s at 0.5 mm a pixel, assumed
    turning: float = 10.0  # rad/s, at most, of an axis in the image; assumed
    most_jumps: int = 2  # in a row that are refused; what is still there then is believed; assumed

    def __post_init__(self) -> None:
        require_positive(self, "speed", "turning")
        if not 0 <= self.most_jumps <= 1000:
            raise ParameterError("most_jumps", self.most_jumps, "a whole number from 0 to 1000")

    def jumps(self, moved: float, turned: float, seconds: float) -> bool:
        """Return whether a change is too large for the time that it took.

        Args:
            moved: Pixels.
            turned: rad.
            seconds: Since it was last seen.
        """
        return moved > self.speed * seconds or abs(turned) > self.turning * seconds


class LastSeen(NamedTuple):
    """What is remembered of a part."""

    detection: Detection | None = None  # that was last believed; None: none yet
    time: float = -math.inf  # s, of that
    refused: int = 0  # in a row since then, for being too far off


def follow(
    last: LastSeen, found: Detection, time: float, params: ContinuityParams
) -> tuple[LastSeen, Detection]:
    """Return what to remember of a part, and what to believe of it.

    Args:
        last: What was remembered.
        found: What is found now.
        time: Of the image, s.
        params: How fast the part can move.

    Returns:
        What to remember next; what was found, or that it has jumped.
    """
    if found.status.lost:
        return last, found
    before = last.detection
    if before is not None and last.refused < params.most_jumps:
        turned = math.remainder(found.angle - before.angle, math.tau)
        if params.jumps(_moved(before, found), turned, time - last.time):
            refused = LastSeen(before, last.time, last.refused + 1)
            return refused, Detection(status=Status.JUMPED)
    return LastSeen(found, time), found


def _moved(before: Detection, now: Detection) -> float:
    """Return how far a part has moved, pixels; across its axis if a tip is not known."""
    if before.status == now.status == Status.VALID:
        return math.dist(before.tip, now.tip)
    du, dv = np.subtract(now.point, before.point)
    return abs(float(math.cos(before.angle) * dv - math.sin(before.angle) * du))
