"""How fast, how hard and how patiently a crucible is charged, and what is believed of it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from chamfer.models.charging.nugget import Nugget
from chamfer.models.charging.packing import Place, PlanItem
from chamfer.models.charging.station import Layout
from chamfer.models.validation import ParameterError, require_between, require_positive
from chamfer.systems.charging.touch_detection import TouchDetectionParams
from chamfer.systems.trajectory.segment import Vector7

_MOST_SPEED = 0.10  # m/s, towards the wall, section 1.1.2


@dataclass(frozen=True, kw_only=True)
class ChargingParams:
    """Parameters of :class:`chamfer.systems.charging.charging_machine.ChargingMachine`."""

    descend_speed: float = 0.15  # m/s, onto the nugget in the feeder; section 1.1.2
    lift_speed: float = 0.15  # m/s, with the nugget out of the feeder; section 1.1.2
    scan_speed: float = 0.03  # m/s, constant over the scanner; section 1.1.2
    slew_time: float = 2.5  # s, from the scanner into the crucible; section 1.1.2
    approach_speed: float = 0.08  # m/s, towards the wall; at most 0.10, section 1.1.2
    seek_speed: float = 0.01  # m/s, near where wall and layer are believed; assumed
    slide_speed: float = 0.02  # m/s, down the wall; assumed
    travel_speed: float = 0.25  # m/s, between feeder and scanner, and out; assumed
    turn_speed: float = 1.5  # rad/s, of the endpoint's angles; assumed
    acceleration: float = 0.5  # m/s^2, of all straight motions; assumed
    stop_acceleration: float = 5.0  # m/s^2, with which it stops where it touches; assumed
    wall_force: float = 1.0  # N, on the wall while sliding; less than 2, section 1.1.2
    touch_force: float = 2.0  # N, down, that tells the nugget in the feeder; assumed
    layer_force: float = 1.2  # N, down, beyond friction at the wall, that tells the layer; assumed
    wall_friction: float = 0.3  # of a nugget on the wall, as it is believed; assumed
    force_limit: float = 10.0  # N, with which all stops but for acquiring; assumed
    grip_limit: float = 20.0  # N, in acquiring; section 1.1.2
    position_limit: float = 0.03  # m, off the command, with which all stops; assumed
    lift_height: float = 0.08  # m, of the nugget over the feeder; assumed
    run_in: float = 0.015  # m, before and behind the scan, to be up to speed; assumed
    clearance: float = 0.03  # m, over the rim; assumed
    standoff: float = 0.03  # m, of the nugget from the wall before the approach; assumed
    drop: float = 0.03  # m, of the nugget over the layer before it is lowered; assumed
    near: float = 0.01  # m, before what is believed, from where on it is sought; assumed
    search: float = 0.025  # m, beyond what is believed, before it is not there; assumed
    lean: float = 0.3  # rad, of the gripper's body, off the wall; assumed, for 14 g nuggets
    rest: float = 0.25  # s, for the tare, and before and after the gripper opens; assumed
    most_lost: float = 0.6  # s, that contact with the wall may be sought again; assumed
    most_losses: int = 5  # of contact with the wall, an item; assumed
    patience: float = 20.0  # s, in any state but while halted; assumed
    trouble_readings: int = 5
    # in a row, that say too much force, a part dropped or an arm off its path; assumed
    detection: TouchDetectionParams = TouchDetectionParams()  # of the wall
    period: float = 0.005  # s, between ticks of the chart; section 6.2.1

    def __post_init__(self) -> None:
        names = [
            name
            for name in ChargingParams.__dataclass_fields__
            if name not in ("detection", "lean", "approach_speed")
        ]
        require_positive(self, *names)
        require_positive(self, "approach_speed", most=_MOST_SPEED)
        require_between(self, -math.pi / 3, math.pi / 3, "lean")
        if not self.near < self.standoff:
            raise ParameterError("near", self.near, f"less than standoff, {self.standoff:g}")
        if not self.near < self.drop:
            raise ParameterError("near", self.near, f"less than drop, {self.drop:g}")


class ChargingBeliefs(NamedTuple):
    """What the chart knows of the cell: nothing of it is the truth."""

    station: Layout
    plan: tuple[PlanItem, ...]
    nuggets: tuple[Nugget, ...]  # of each item, as the scanner shows it
    places: tuple[Place, ...]  # of each item
    start: Vector7  # endpoint when the arm is switched on, m and rad, by its encoders
    home: Vector7  # endpoint, on the way to which each joint passes its index mark
