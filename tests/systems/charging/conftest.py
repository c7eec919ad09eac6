"""A cell in a few lines: what the chart asks for happens, and sensors say what is touched."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from chamfer.models.charging.packing import PlanItem, places
from chamfer.models.charging.station import Station
from chamfer.systems.charging.charging_chart import ChargingChart, make_charging_chart, tares
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ResolvedChargingParams,
    ResolvedTouchDetectionParams,
)
from chamfer.systems.statechart.chart import Snapshot, TransitionRecord
from chamfer.systems.trajectory.path_follower import (
    FollowerMemory,
    PathFollower,
    PathFollowerParams,
)
from chamfer.systems.trajectory.segment import COORDINATES, hold

PERIOD = 0.01  # s, twice the real one, half as dear
START = (0.40, -0.20, 0.55, 0.0, 0.0, 0.0, 0.2)
HOME = (0.41, -0.19, 0.56, 0.05, 0.05, 0.05, 0.25)
SOFT = 1500.0  # N/m, of whatever is touched
PARAMS = ResolvedChargingParams(
    period=PERIOD,
    detection=ResolvedTouchDetectionParams(detect=0.3, release=0.1, readings=3),
    trouble_readings=3,
    # Quicker than a real cycle.
    travel_speed=0.5,
    seek_speed=0.02,
    slide_speed=0.05,
    slew_time=1.5,
    rest=0.1,
)


@dataclass
class Faults:
    """What is not as it should be."""

    part: bool = True  # in the feeder
    wall: bool = True
    layer: bool = True
    alive: bool = True
    homed: bool = True
    drops: bool = False  # lets go of the part
    extra_force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    off: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, of the arm from its command


@dataclass
class Cell:
    """The chart over a follower and an ideal arm."""

    chart: ChargingChart
    beliefs: ChargingBeliefs
    snapshot: Snapshot[ChargingMemory] = field(init=False)
    follower: PathFollower = field(init=False)
    path: FollowerMemory = field(init=False)
    faults: Faults = field(default_factory=Faults)
    halt: bool = False
    held: bool = False
    ticks: int = 0
    records: list[TransitionRecord] = field(default_factory=list)
    forces: list[tuple[float, ...]] = field(default_factory=list)
    commands: list[tuple[float, ...]] = field(default_factory=list)
    states: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.snapshot = self.chart.start()
        self.follower = PathFollower(PathFollowerParams(period=PERIOD), np.array(START))
        zero = np.zeros(COORDINATES)
        self.path = FollowerMemory(
            segment=np.array(hold(START, 0.0).vector()),
            path_time=np.zeros(1),
            rate=np.ones(1),
            offset=zero,
            drift=zero,
            settling=np.zeros(1),
            desired_position=np.array(START),
            desired_velocity=zero,
            desired_acceleration=zero,
            progress=np.ones(1),
        )

    @property
    def memory(self) -> ChargingMemory:
        return self.snapshot.memory

    @property
    def state(self) -> str:
        return self.snapshot.state

    def tick(self) -> TransitionRecord | None:
        """Go on by a period; return the transition taken, if any."""
        memory = self.memory
        arm, force = self._arm_and_force()
        if memory.grip and not self.held:
            self.held = self.faults.part and memory.at == "acquire.grip"
        if not memory.grip or self.faults.drops:
            self.held = False
        self.forces = [*self.forces, force][-PARAMS.detection.readings :]
        inputs = ChargingInputs(
            endpoint_motion=(*arm, *self.path.desired_velocity.tolist()),
            desired_position=tuple(self.path.desired_position.tolist()),
            desired_velocity=tuple(self.path.desired_velocity.tolist()),
            progress=tuple(self.path.progress.tolist()),
            measured_force=force,
            mean_force=tuple(np.mean(self.forces, axis=0).tolist()),
            held=(float(self.held),),
            homed=(float(self.faults.homed),),
            alive=(float(self.faults.alive),),
            halt=(float(self.halt),),
        )
        time = self.ticks * PERIOD
        self.snapshot, record = self.chart.step(self.snapshot, inputs, time)
        segment = np.array(self.memory.segment.vector())
        self.path = self.follower.step(self.path, segment, halt=self.memory.hold)
        self.ticks += 1
        self.commands.append(tuple(self.path.desired_position.tolist()))
        self.states.append(self.state)
        if record is not None:
            self.records.append(record)
        return record

    def run(self, until: Callable[["Cell"], bool], most: float = 120.0) -> "Cell":
        """Go on until something is so, at most for some seconds."""
        end = self.ticks + round(most / PERIOD)
        while not until(self):
            assert self.ticks < end, f"still {self.state} after {most} s"
            self.tick()
        return self

    def to(self, state: str) -> "Cell":
        """Go on until a state, or the end."""
        return self.run(lambda cell: cell.state in (state, "done", "stopped"))

    def end(self) -> "Cell":
        """Go on until the end."""
        return self.run(lambda cell: cell.state in ("done", "stopped"))

    def way(self) -> list[str]:
        """Return the states in their order."""
        return [a for a, b in zip(self.states, [None, *self.states], strict=False) if a != b]

    def _arm_and_force(self) -> tuple[tuple[float, ...], tuple[float, float, float]]:
        memory, beliefs = self.memory, self.beliefs
        item, normal = memory.item, np.array(memory.normal)
        arm = self.path.desired_position + np.array([*self.faults.off, 0.0, 0.0, 0.0, 0.0])
        place, nugget = beliefs.places[item], beliefs.nuggets[item]
        force = np.zeros(3)
        beyond = float(normal[:2] @ (arm[:2] - np.array(place.position)))
        if self.held and beliefs.plan[item].kind == "wall":
            if memory.mode:
                arm[:3] -= beyond * normal
                force += PARAMS.wall_force * self.faults.wall * normal
            elif self.faults.wall and arm[2] - nugget.height < beliefs.station.rim_height:
                beyond *= math.dist(arm[:2], beliefs.station.crucible_centre) < 0.2
                force += SOFT * max(beyond, 0.0) * normal
        over_feeder = arm[1] < -0.3
        floor = beliefs.station.feeder[2] if over_feeder else place.layer
        there = (self.faults.part and not self.held) if over_feeder else self.faults.layer
        if there and (self.held or over_feeder):
            force[2] -= SOFT * max(floor + nugget.height - arm[2], 0.0)
        force = force + np.array(self.faults.extra_force)
        if not self.faults.alive or tares(memory.at):
            force = np.zeros(3)
        x, y, z = force.tolist()
        return tuple(arm.tolist()), (x, y, z)


def make_cell(plan: Sequence[PlanItem], params: ResolvedChargingParams = PARAMS) -> Cell:
    station = Station()
    items = tuple(plan)
    beliefs = ChargingBeliefs(
        station=station,
        plan=items,
        nuggets=tuple(item.believed_nugget for item in items),
        places=places(items, station, believed=True),
        start=START,
        home=HOME,
    )
    return Cell(make_charging_chart(params, beliefs), beliefs)


@pytest.fixture
def cell_with() -> Callable[..., Cell]:
    """How to make a cell with a plan."""
    return make_cell
