"""What the charging cycle's chart reads and remembers."""

from enum import IntEnum
from typing import Final, NamedTuple

from chamfer.systems.trajectory.segment import Segment, Vector3, Vector7

Reading = tuple[float, ...]


class Trouble(IntEnum):
    """What stopped the cycle, as far as the chart can tell."""

    NONE = 0
    NOT_HOMED = 1
    NO_PART = 2
    DROPPED = 3
    NO_WALL = 4
    NO_LAYER = 5
    CONTACT_LOST = 6
    TOO_MUCH_FORCE = 7
    SENSOR_DEAD = 8
    OFF_PATH = 9
    LATE = 10
    LOST_OFTEN = 11


WORDS: Final = {
    Trouble.NONE: "",
    Trouble.NOT_HOMED: "not homed: a joint's index mark was not found",
    Trouble.NO_PART: "no part in the gripper",
    Trouble.DROPPED: "part dropped",
    Trouble.NO_WALL: "the wall is not there",
    Trouble.NO_LAYER: "the layer below is not there",
    Trouble.CONTACT_LOST: "contact lost for too long",
    Trouble.TOO_MUCH_FORCE: "too much force",
    Trouble.SENSOR_DEAD: "the force sensor is dead",
    Trouble.OFF_PATH: "position error too large",
    Trouble.LATE: "timed out",
    Trouble.LOST_OFTEN: "contact lost too often",
}


class ChargingInputs(NamedTuple):
    """What the chart reads: sensors, the operator, and what the path follower commands."""

    endpoint_motion: Reading  # (14,), endpoint vector, m and rad, then its rate, by the encoders
    desired_position: Reading  # (7,), commanded now
    desired_velocity: Reading  # (7,)
    progress: Reading  # 1 at the segment's goal
    measured_force: Reading  # (3,), N, of the nugget on its environment, world axes, tared
    mean_force: Reading  # (3,), N, the same, the mean of the last readings
    held: Reading  # 1: the gripper's part sensor sees a part
    homed: Reading | None  # 1: the encoders' zeros are known; None: they always are
    alive: Reading | None  # 1: the force sensor works; None: it always does
    halt: Reading | None  # 1: the operator wants all to stand still


class ChargingMemory(NamedTuple):
    """What the chart remembers from tick to tick."""

    segment: Segment
    at: str  # the current state
    left: str = ""  # the state that a halt, or a loss of contact, goes back to
    lost_from: str = ""  # the state that a loss of contact goes back to
    item: int = 0  # in the plan
    losses: int = 0  # of contact with the wall, of this item
    mode: int = 0  # of the hybrid controller
    normal: Vector3 = (1.0, 0.0, 0.0)  # into the wall, world axes
    hold: bool = False  # the path follower stands still
    grip: bool = False  # the gripper is closed
    carries: bool = False  # a part was seen in it
    above_limit: int = 0  # readings in a row, up to now, with too much force
    dead: bool = False  # the force sensor says so itself
    dropped: int = 0  # without the part that was there
    off_path: int = 0  # too far from the command
    trouble: Trouble = Trouble.NONE
    trouble_at: str = ""  # the state in which it was met

    def said(self) -> str:
        """Return what stopped the cycle, in words; "" if nothing did."""
        words = WORDS[self.trouble]
        return f"{words}, in {self.trouble_at}, item {self.item}" if words else ""

    def desired_force(self, force: float) -> Vector7:
        """Return the force on the environment that is wanted, N, shape (7,)."""
        push = force if self.mode else 0.0
        return (*(push * one for one in self.normal), 0.0, 0.0, 0.0, 0.0)
