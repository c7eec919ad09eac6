"""Parameters, inputs and memory of the charging cycle's chart."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple, Self

from chamfer.models.charging.packing import ItemPlace, Nugget, PlanItem
from chamfer.models.charging.station import StationLayout
from chamfer.models.validation import (
    ParameterError,
    require_all_positive,
    require_between,
    require_not_negative,
    require_positive,
    require_whole,
)
from chamfer.systems.force.contact_detection_law import CONTACT, LOST
from chamfer.systems.trajectory.segment import Segment, Vector3, Vector7

_RARE: Final = 5.0  # standard deviations of the mean that noise alone does not show
_CLEAR: Final = 2.0  # thresholds by one another, at least


@dataclass(frozen=True, kw_only=True)
class TouchDetectionParams:
    """Thresholds for contact with the wall and for its loss."""

    readings: int = 16  # force readings, one each period, whose mean counts
    detect: float | None = None  # N, a larger mean is contact; None: derived from the noise
    release: float = 0.15  # N, a mean not above it is a loss; assumed, an eighth of the force

    def __post_init__(self) -> None:
        require_not_negative(self, "release")
        require_whole(self, "readings")
        if self.detect is not None:
            require_positive(self, "detect")
            if not self.release < self.detect:
                raise ParameterError("release", self.release, f"less than detect, {self.detect:g}")

    def resolved(self, noise: float, bias: float = 0.0) -> "ResolvedTouchDetectionParams":
        """Return the parameters, with open ones derived from noise and bias.

        Args:
            noise: N, half-width of the measured push without contact.
            bias: N, its largest error on average.

        Raises:
            ParameterError: If the bias alone would count as contact.
        """
        detect = self.detect
        if detect is None:
            spread = noise / math.sqrt(3 * self.readings)
            detect = float(f"{bias + max(_CLEAR * self.release, _RARE * spread):.6g}")
        elif detect <= bias:
            raise ParameterError("detect", detect, f"more than the sensor's bias, {bias:g} N")
        return ResolvedTouchDetectionParams(**vars(self) | {"detect": detect})


@dataclass(frozen=True, kw_only=True)
class ResolvedTouchDetectionParams(TouchDetectionParams):
    """The same, with nothing left open."""

    detect: float


# Modes of the hybrid controller beyond those of contact detection: the pressed surfaces.
ON_BOTH: Final = 3  # wall and layer
ON_LAYER: Final = 4
LEVEL: Final = (0.0, 0.0, -1.0)  # into a level layer
_MOST_SPEED: Final = 0.10  # m/s, towards the wall, section 1.1.2


@dataclass(frozen=True, kw_only=True)
class ChargingParams:
    """Parameters of :class:`chamfer.systems.charging.charging_law.ChargingLaw`."""

    descend_speed: float = 0.15  # m/s, onto the nugget in the feeder; section 1.1.2
    lift_speed: float = 0.15  # m/s, with the nugget out of the feeder; section 1.1.2
    scan_speed: float = 0.03  # m/s, constant over the scanner; section 1.1.2
    slew_time: float = 2.5  # s, from the scanner into the crucible; section 1.1.2
    approach_speed: float = 0.08  # m/s, towards the wall; at most 0.10, section 1.1.2
    seek_speed: float = 0.01  # m/s, near the wall's believed place; assumed
    land_speed: float = 0.004  # m/s, near the layer's believed place; assumed
    slide_speed: float = 0.02  # m/s, down the wall; assumed
    travel_speed: float = 0.25  # m/s, between feeder and scanner, and out; assumed
    turn_speed: float = 1.5  # rad/s, of the endpoint's angles; assumed
    acceleration: float = 0.5  # m/s^2, of all straight motions; assumed
    stop_acceleration: float = 5.0  # m/s^2, of the stop at contact; assumed
    wall_force: float = 1.2  # N, on the wall while sliding; less than 2, section 1.1.2
    seat_force: float = 0.7  # N, on the wall at set-down, where the layer may slope; assumed
    touch_force: float = 2.0  # N, down, that detects the nugget in the feeder; assumed
    layer_touch: float = 0.5
    # N, down, beyond friction at the wall, that detects the layer; at least the wall's threshold
    # (``detection``); assumed
    layer_force: float = 0.8  # N, into the layer at set-down, beyond friction likewise; assumed
    wall_friction: float = 0.3  # of a nugget on the wall, as believed; assumed
    force_limit: float = 10.0  # N, at which the cycle stops, except in acquiring; assumed
    grip_limit: float = 20.0  # N, in acquiring; section 1.1.2
    position_limit: float = 0.03  # m, error at which the cycle stops; assumed
    lift_height: float = 0.08  # m, of the nugget over the feeder; assumed
    run_in: float = 0.015  # m, before and after the scan, for acceleration; assumed
    clearance: float = 0.03  # m, over the rim; assumed
    standoff: float = 0.03  # m, of the nugget from the wall before the approach; assumed
    drop: float = 0.03  # m, of the nugget over the layer before it is lowered; assumed
    near: float = 0.01  # m, before the believed place, where the search begins; assumed
    follow: float = 0.005  # m, along the nugget below, to the item's place; assumed
    follow_speed: float = 0.005  # m/s, along it; assumed
    follow_mass: float = 0.05
    # kg, least mass of a nugget that is followed: friction would move a lighter one; assumed
    search: float = 0.025  # m, beyond the believed place, until it counts as missing; assumed
    lean: float = 0.3  # rad, of the gripper's body, off the wall; assumed, for 14 g nuggets
    rest: float = 0.25  # s, for the tare, and before and after the gripper opens; assumed
    most_lost: float = 0.6  # s, longest search for lost contact with the wall; assumed
    most_losses: int = 5  # of contact with the wall, for each item; assumed
    patience: float = 20.0  # s, longest time in a state, halts excluded; assumed
    trouble_readings: int = 5
    # in a row, that show too much force, a dropped part or an arm off its path; assumed
    detection: TouchDetectionParams = TouchDetectionParams()  # of the wall
    period: float = 0.005  # s, between ticks of the chart; section 6.2.1

    def __post_init__(self) -> None:
        require_all_positive(self, "lean", "approach_speed")
        require_positive(self, "most_losses", "trouble_readings")
        require_positive(self, "approach_speed", most=_MOST_SPEED)
        require_between(self, -math.pi / 3, math.pi / 3, "lean")
        if not self.near < self.standoff:
            raise ParameterError("near", self.near, f"less than standoff, {self.standoff:g}")
        if not self.near < self.drop:
            raise ParameterError("near", self.near, f"less than drop, {self.drop:g}")


@dataclass(frozen=True, kw_only=True)
class ResolvedChargingParams(ChargingParams):
    """The same, with nothing left open."""

    detection: ResolvedTouchDetectionParams


class ChargingBeliefs(NamedTuple):
    """The chart's beliefs of the cell, which may differ from the true cell."""

    station: StationLayout
    plan: tuple[PlanItem, ...]
    nuggets: tuple[Nugget, ...]  # of each item, as the scanner shows it
    places: tuple[ItemPlace, ...]  # of each item
    start: Vector7  # endpoint when the arm is switched on, m and rad, by its encoders
    home: Vector7  # endpoint, on the way to which each joint passes its index mark


class ChargingTrouble(IntEnum):
    """The reason why the cycle stopped, as far as the chart knows it: a number, and words."""

    words: str

    def __new__(cls, value: int, words: str) -> Self:
        """Return a member with its words."""
        member = int.__new__(cls, value)
        member._value_, member.words = value, words
        return member

    NONE = 0, ""
    NOT_HOMED = 1, "not homed: a joint's index mark was not found"
    NO_PART = 2, "no part in the gripper"
    DROPPED = 3, "part dropped"
    NO_WALL = 4, "the wall is not there"
    NO_LAYER = 5, "the layer below is not there"
    CONTACT_LOST = 6, "contact lost for too long"
    TOO_MUCH_FORCE = 7, "too much force"
    SENSOR_DEAD = 8, "the force sensor is dead"
    OFF_PATH = 9, "position error too large"
    LATE = 10, "timed out"
    LOST_OFTEN = 11, "contact lost too often"
    ABORTED = 12, "aborted"


class ChargingInputs(NamedTuple):
    """Inputs of the chart: sensors, the operator, and the path follower's command."""

    endpoint_motion: tuple[float, ...]
    # (14,), endpoint vector, m and rad, then its rate, by the encoders
    desired_position: tuple[float, ...]  # (7,), commanded now
    desired_velocity: tuple[float, ...]  # (7,)
    progress: tuple[float, ...]  # 1 at the segment's goal
    measured_force: tuple[float, ...]
    # (3,), N, of the nugget on its environment, world axes, tared
    mean_force: tuple[float, ...]  # (3,), N, the same, the mean of the last readings
    held: tuple[float, ...]  # 1: the gripper's part sensor sees a part
    homed: tuple[float, ...] | None  # 1: the encoders' zeros are known; None: they always are
    alive: tuple[float, ...] | None  # 1: the force sensor works; None: it always does
    halt: tuple[float, ...] | None  # 1: the operator wants all to stand still
    layer_normal: tuple[float, ...] | None = None
    # (3,), of what lies below, out of it, as it is estimated; None: it is taken to be level


class ChargingMemory(NamedTuple):
    """Memory of the chart from tick to tick."""

    segment: Segment
    at: str  # the current state
    left: str = ""  # the state that a halt, or a loss of contact, goes back to
    lost_from: str = ""  # the state that a loss of contact goes back to
    item: int = 0  # in the plan
    losses: int = 0  # of contact with the wall, of this item
    mode: int = 0  # of the hybrid controller
    normal: Vector3 = (1.0, 0.0, 0.0)  # into the wall, world axes
    below: Vector3 = LEVEL  # into the layer, as believed or estimated
    hold: bool = False  # the path follower stands still
    grip: bool = False  # the gripper is closed
    carries: bool = False  # a part was seen in it
    above_limit: int = 0  # readings in a row, up to now, with too much force
    dead: bool = False  # the force sensor reports it
    dropped: int = 0  # without the part that was there
    off_path: int = 0  # too far from the command
    trouble: ChargingTrouble = ChargingTrouble.NONE
    trouble_at: str = ""  # the state in which it was met

    def said(self) -> str:
        """Return the reason why the cycle stopped, in words; "" if it did not."""
        words = self.trouble.words
        return f"{words}, in {self.trouble_at}, item {self.item}" if words else ""

    @property
    def on_layer(self) -> bool:
        """Whether the nugget presses on the layer."""
        return self.mode in (ON_BOTH, ON_LAYER)

    @property
    def wall(self) -> Vector3:
        """The direction into the wall, if it is pressed together with the layer; else zeros."""
        return self.normal if self.mode == ON_BOTH else (0.0, 0.0, 0.0)

    def into_layer(self, normal: tuple[float, ...]) -> Vector3:
        """Return the direction into the layer by its normal, in the wall's tangent plane."""
        along = sum(n * w for n, w in zip(normal, self.wall, strict=True))
        x, y, z = (along * w - n for n, w in zip(normal, self.wall, strict=True))
        length = math.hypot(x, y, z)
        return x / length, y / length, z / length

    @property
    def pressed(self) -> tuple[Vector3, ...]:
        """The directions under force control: into the touched surfaces, at right angles."""
        on_wall, on_layer = self.mode in (CONTACT, LOST, ON_BOTH), self.mode in (ON_BOTH, ON_LAYER)
        return (self.normal,) * on_wall + (self.below,) * on_layer

    def desired_force(self, params: ChargingParams) -> Vector7:
        """Return the desired force on the environment, N, shape (7,)."""
        into_wall, into_layer = params.wall_force, params.layer_force
        if self.mode == ON_BOTH:  # as it came sliding, the wall holds it up
            into_wall = params.seat_force
            into_layer += params.wall_friction * into_wall
        pushes = {self.normal: into_wall, self.below: into_layer}
        x, y, z = (sum(pushes[one] * one[i] for one in self.pressed) for i in range(3))
        return x, y, z, 0.0, 0.0, 0.0, 0.0
