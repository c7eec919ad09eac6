"""The charging cycle's chart in a cell of a few lines: its way, and what stops it.

The arm is ideal: what the chart asks for happens, and sensors say what is touched.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.models.charging.packing import ItemKind, PlanItem, places
from chamfer.models.charging.station import Station
from chamfer.systems.charging.charging_law import (
    AWAY,
    BRAKE,
    DONE,
    HALTED,
    MODE_OF,
    STOPPED,
    ChargingChart,
    make_charging_chart,
    tares,
)
from chamfer.systems.charging.charging_params import (
    ChargingBeliefs,
    ChargingInputs,
    ChargingMemory,
    ChargingTrouble,
    ResolvedChargingParams,
    ResolvedTouchDetectionParams,
)
from chamfer.systems.force.contact_detection_law import APPROACH, CONTACT, LOST
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
    normal: tuple[float, float, float] | None = None  # of the layer, as it is estimated
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
            layer_normal=self.normal,
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


def cell_with(*items: PlanItem) -> Cell:
    """Return a cell with a plan."""
    station = Station()
    nuggets = tuple(item.believed_nugget for item in items)
    where = places(items, station, believed=True)
    beliefs = ChargingBeliefs(station, items, nuggets, where, START, HOME)
    return Cell(make_charging_chart(PARAMS, beliefs), beliefs)


ACQUIRE = [
    *("acquire.above", "acquire.zero", "acquire.descend", "acquire.touch", "acquire.grip"),
    *("acquire.lift", "acquire.weigh"),
]
SCAN = ["scan.run_in", "scan.pass", "slew.over"]
CARRY = {
    "wall": [*SCAN, "wall.lower", "wall.zero", "wall.approach", "wall.seek", "wall.press"],
    "crown": [*SCAN, "crown.lower", "crown.zero", "crown.descend", "crown.land"],
    "bulk": ["slew.over", "bulk.lower", "bulk.pour"],
}
LAY = {
    "wall": ["wall.slide", "wall.land", "wall.set_down", "release.open"],
    "crown": ["crown.set_down", "release.open"],
    "bulk": [],
}
PLAN = (PlanItem(azimuth=-0.8), PlanItem(kind="crown", azimuth=0.8), PlanItem(kind="bulk"))


ESTIMATED = (0.28, -0.96 * 0.28, 0.96 * 0.96)  # of length 1, out of a sloping nugget


@pytest.mark.parametrize("kind", ["wall", "crown"])
def test_a_nugget_on_a_nugget_follows_it_to_its_place(kind: ItemKind) -> None:
    azimuth = 0.4
    cell = cell_with(PlanItem(azimuth=azimuth), PlanItem(kind=kind, azimuth=azimuth + 0.05))
    cell.normal = ESTIMATED
    cell.run(lambda one: one.memory.item == 1).to(f"{kind}.follow")
    place = cell.beliefs.places[1].position
    start = cell.path.desired_position[:2]
    assert math.dist(start, place) == pytest.approx(PARAMS.follow, rel=0.1)
    cell.tick()
    # Force control is into the nugget as it is estimated; at the wall in its tangent plane.
    into_wall, down = np.array(cell.memory.normal), -np.array(ESTIMATED)
    if kind == "wall":
        down -= (down @ into_wall) * into_wall
        down /= np.linalg.norm(down)
    np.testing.assert_allclose(cell.memory.below, down, atol=1e-12)
    pressed = np.array(cell.memory.pressed)
    np.testing.assert_allclose(pressed @ pressed.T, np.eye(len(pressed)), atol=1e-12)
    force = np.array(cell.memory.desired_force(PARAMS)[:3])
    seated = PARAMS.seat_force if kind == "wall" else 0.0
    assert force @ down == pytest.approx(PARAMS.layer_force + PARAMS.wall_friction * seated)
    cell.to(f"{kind}.set_down")
    along = np.eye(3) - pressed.T @ pressed
    off = along @ np.array([*(cell.path.desired_position[:2] - place), 0.0])
    assert np.linalg.norm(off) < 1e-3
    # The next one is taken to be level again.
    assert cell.end().state == "done"


LIGHT = PlanItem(kind="crown", mass=0.014)  # would be shoved


@pytest.mark.parametrize("plan", [(PlanItem(kind="crown"),), (LIGHT, LIGHT)])
def test_on_the_bed_or_a_light_nugget_nothing_is_followed(plan: tuple[PlanItem, ...]) -> None:
    cell = cell_with(*plan)
    cell.run(lambda one: one.memory.item == len(plan) - 1)
    cell.normal = ESTIMATED
    cell.to("release.open")
    assert cell.memory.below == (0.0, 0.0, -1.0)
    cell.end()
    assert "crown.follow" not in cell.way()


def test_items_go_through_their_modes_one_after_the_other() -> None:
    cell = cell_with(*PLAN)
    way = []
    while cell.state != "done":
        if record := cell.tick():
            way.append((record.target, cell.memory.item))
    assert way == [
        ("home.settle", 0),
        *(
            (state, item)
            for item, kind in enumerate(("wall", "crown", "bulk"))
            for state in (*ACQUIRE, *CARRY[kind], *LAY[kind], "retreat.up", "return.over")
        ),
        ("done", 2),
    ]
    assert cell.memory.said() == ""


def test_a_turned_place_is_approached_along_its_normal() -> None:
    cell = cell_with(PlanItem(azimuth=0.7)).to("wall.seek")
    begin = np.array(cell.commands[-1])
    cell.to("wall.press")
    way = np.array(cell.commands[-2])[:3] - begin[:3]
    assert way / np.linalg.norm(way) == pytest.approx([math.cos(0.7), math.sin(0.7), 0.0])
    assert begin[3] == pytest.approx(0.7)


def test_the_scan_begins_and_ends_beside_the_scanner() -> None:
    cell = cell_with(PlanItem()).to("scan.pass")
    begin = cell.commands[-1][1]
    cell.to("slew.over")
    station = cell.beliefs.station
    far = station.scan_length / 2 + 0.015  # m, run-in
    assert begin == pytest.approx(station.scanner[1] - far, abs=1e-3)
    assert cell.commands[-1][1] == pytest.approx(station.scanner[1] + far, abs=1e-3)


def test_noise_alone_is_no_contact() -> None:
    # As many readings in a row as detection asks for, less one, over and over.
    cell = cell_with(PlanItem()).to("acquire.descend")
    readings = 0
    while cell.state == "acquire.descend" and cell.commands[-1][2] > 0.42:
        readings += 1
        cell.faults.extra_force = (0.0, 0.0, -3.0 if readings % 3 else 0.0)
        cell.tick()
    assert cell.state == "acquire.descend"
    assert readings > 20


FASTEST = 2.0  # m/s or rad/s: a command that goes faster has jumped
SUDDEN = 30.0  # m/s^2 or rad/s^2, likewise of its velocity


def require_smooth(cell: Cell) -> None:
    """Fail if the command jumps, or its velocity."""
    commands = np.array(cell.commands)
    rates = np.diff(commands, axis=0) / PERIOD
    assert np.abs(rates).max() < FASTEST
    assert np.abs(np.diff(rates, axis=0)).max() / PERIOD < SUDDEN


def require_safe(cell: Cell, trouble: ChargingTrouble, state: str) -> None:
    """Fail unless the cell has stopped for a reason, at rest, with what it held."""
    assert cell.state == "stopped"
    assert cell.memory.trouble is trouble
    assert cell.memory.trouble_at == state
    assert cell.memory.said() == f"{trouble.words}, in {state}, item 0"
    assert cell.memory.mode == APPROACH
    for _ in range(50):
        cell.tick()
    assert cell.commands[-1] == pytest.approx(cell.commands[-20], abs=1e-12)
    assert cell.memory.grip or not cell.held
    require_smooth(cell)


@pytest.mark.parametrize(
    ("kind", "begin", "fault", "trouble", "state"),
    [
        ("wall", "wall.slide", {"alive": False}, "SENSOR_DEAD", "wall.slide"),
        ("wall", "slew.over", {"extra_force": (0, 25, 0)}, "TOO_MUCH_FORCE", "slew.over"),
        ("wall", "scan.pass", {"off": (0, 0.04, 0)}, "OFF_PATH", "scan.pass"),
        ("wall", "home.out", {"part": False}, "NO_PART", "acquire.descend"),
        ("wall", "acquire.touch", {"part": False}, "NO_PART", "acquire.grip"),
        ("wall", "home.out", {"wall": False}, "NO_WALL", "wall.seek"),
        ("wall", "home.out", {"layer": False}, "NO_LAYER", "wall.land"),
        ("crown", "home.out", {"layer": False}, "NO_LAYER", "crown.land"),
        ("wall", "home.out", {"homed": False}, "NOT_HOMED", "home.settle"),
        ("wall", "wall.land", {"wall": False}, "CONTACT_LOST", "wall.lost"),
    ],
)
def test_a_fault_stops_the_cycle_safely(
    kind: ItemKind, begin: str, fault: dict[str, Any], trouble: str, state: str
) -> None:
    cell = cell_with(PlanItem(kind=kind))
    if begin != "home.out":
        cell.to(begin).tick()
    for name, value in fault.items():
        setattr(cell.faults, name, value)
    require_safe(cell.end(), ChargingTrouble[trouble], state)
    # What is not understood is left where it is.
    assert ("back_off.away" in cell.states) == (trouble != "OFF_PATH")


def test_only_acquiring_may_push_hard() -> None:
    cell = cell_with(PlanItem())
    cell.faults.extra_force = (0.0, 15.0, 0.0)  # 10 N elsewhere, 20 N at the feeder
    cell.run(lambda cell: cell.state == "scan.run_in" or cell.memory.trouble)
    assert cell.memory.trouble_at == "home.out"
    cell = cell_with(PlanItem()).to("acquire.descend")
    cell.faults.extra_force = (0.0, 15.0, 0.0)
    assert cell.to("scan.run_in").state == "scan.run_in"


def test_lost_contact_is_sought_and_found() -> None:
    cell = cell_with(PlanItem()).to("wall.slide")
    cell.run(lambda cell: cell.forces[0][0] > 0)
    cell.faults.wall = False
    cell.to("wall.lost")
    assert cell.memory.mode == LOST
    at = cell.ticks
    cell.run(lambda cell: cell.ticks == at + 30)
    # It waits on its path.
    assert cell.commands[-1][2] == pytest.approx(cell.commands[-4][2], abs=1e-12)
    cell.faults.wall = True
    cell.to("wall.slide")
    assert cell.memory.mode == CONTACT
    assert cell.end().state == "done"
    require_smooth(cell)


def test_contact_lost_too_often() -> None:
    cell = cell_with(PlanItem()).to("wall.slide")
    while cell.state not in ("done", "stopped"):
        # It is away as soon as it is found, and back as soon as that is seen.
        cell.faults.wall = cell.state != "wall.slide"
        cell.tick()
    require_safe(cell, ChargingTrouble.LOST_OFTEN, "wall.lost")
    assert cell.way().count("wall.lost") == 6


def test_friction_at_the_wall_is_not_the_layer() -> None:
    # As the nugget hits the wall again: 8 N on it, and friction of 0.3 times that.
    cell = cell_with(PlanItem()).to("wall.slide")
    cell.faults.extra_force = (7.0, 0.0, -2.4)
    for _ in range(10):
        cell.tick()
    assert cell.state == "wall.slide"
    cell.faults.extra_force = (0.0, 0.0, -2.4)
    for _ in range(10):
        cell.tick()
    assert cell.state != "wall.slide"


def test_it_backs_off_the_wall() -> None:
    cell = cell_with(PlanItem(azimuth=0.5)).to("wall.land")
    cell.faults.alive = False
    at = np.array(cell.commands[-1])
    cell.end()
    moved = np.array(cell.commands[-1]) - at
    into = np.array([math.cos(0.5), math.sin(0.5), 0.0])
    assert moved[:3] @ into < -0.008
    assert abs(moved[2]) < 0.003


def test_halt_at_the_touch_stops_at_the_touch() -> None:
    # The halt's braking must not press on into what is found meanwhile.
    cell = cell_with(PlanItem()).to("acquire.descend")
    over = cell.beliefs.station.feeder[2] + cell.beliefs.nuggets[0].height
    cell.run(lambda cell: cell.commands[-1][2] < over + 0.002)
    cell.halt = True
    at = cell.ticks
    cell.run(lambda cell: cell.ticks == at + 100)
    assert cell.state == "halted"
    assert over - min(z for _, _, z, *_ in cell.commands) < 0.008
    cell.halt = False
    assert cell.end().state == "done"


def test_contact_lost_in_a_halt_is_sought_in_the_halt() -> None:
    cell = cell_with(PlanItem()).to("wall.slide")
    cell.halt = True
    cell.to("halted")
    cell.faults.wall = False
    cell.run(lambda cell: cell.memory.mode == LOST)
    cell.faults.wall = True
    cell.run(lambda cell: cell.memory.mode == CONTACT)
    cell.halt = False
    assert cell.end().state == "done"


@settings(
    max_examples=2,
    deadline=None,
)
@given(halts=st.lists(st.tuples(st.integers(1, 2500), st.integers(1, 80)), min_size=1, max_size=8))
def test_halts_at_any_instant_change_nothing_but_the_time(halts: list[tuple[int, int]]) -> None:
    cell = cell_with(*PLAN)
    while cell.state not in ("done", "stopped"):
        cell.halt = any(begin <= cell.ticks < begin + length for begin, length in halts)
        cell.tick()
    assert cell.memory.said() == ""
    assert cell.state == "done"
    require_smooth(cell)
    moved = [state for state in cell.way() if state != "halted"]
    once = [a for a, b in zip(moved, [None, *moved], strict=False) if a != b]
    assert once == cell_with(*PLAN).end().way()


RUNNING = [name for name in MODE_OF if name not in (BRAKE, AWAY, DONE, STOPPED)]
QUIET = ChargingInputs(
    endpoint_motion=(*START, *[0.0] * 7),
    desired_position=START,
    desired_velocity=(0.0,) * 7,
    progress=(0.0,),
    measured_force=(0.0,) * 3,
    mean_force=(0.0,) * 3,
    held=(1.0,),
    homed=(1.0,),
    alive=(1.0,),
    halt=(0.0,),
)
FAR = (START[0], START[1] + 0.04, *START[2:], *[0.0] * 7)
TROUBLES = {
    ChargingTrouble.SENSOR_DEAD: QUIET._replace(alive=(0.0,)),
    ChargingTrouble.TOO_MUCH_FORCE: QUIET._replace(measured_force=(0.0, 21.0, 0.0)),
    ChargingTrouble.DROPPED: QUIET._replace(held=(0.0,)),
    ChargingTrouble.OFF_PATH: QUIET._replace(endpoint_motion=FAR),
}

FEELING = {"acquire.descend", "wall.approach", "wall.slide", "wall.land"}
FEELING |= {"wall.seek", "crown.descend", "crown.land"}


def put_in(cell: Cell, state: str, at: float = 0.0) -> Snapshot[Any]:
    """Return the chart in a state since a time, with a part in the gripper; halted: in a slew."""
    begun = cell.chart.start()
    left = "slew.over" if state == HALTED else ""
    memory = begun.memory._replace(at=state, left=left, mode=MODE_OF.get(state, 0), carries=True)
    result: Snapshot[Any] = Snapshot(state, at, memory, True)
    return result


def test_what_lasts_too_long_times_out() -> None:
    cell = cell_with(PlanItem())
    for state in RUNNING:
        after, _ = cell.chart.step(put_in(cell, state), QUIET, 20.0 + PERIOD)
        assert after.state == BRAKE
        assert after.memory.said() == f"timed out, in {state}, item 0"
    for state in (BRAKE, AWAY):
        stopping = put_in(cell, state)
        memory = stopping.memory._replace(trouble=ChargingTrouble.NO_WALL)
        moving = QUIET._replace(desired_velocity=(0.1,) * 7)
        after, _ = cell.chart.step(stopping._replace(memory=memory), moving, 20.0 + PERIOD)
        assert after.state == STOPPED
    after, _ = cell.chart.step(put_in(cell, HALTED), QUIET._replace(halt=(1.0,)), 1e4)
    assert after.state == HALTED  # as long as the operator wants


@pytest.mark.parametrize("trouble", TROUBLES)
def test_trouble_stops_any_state_and_names_it(trouble: ChargingTrouble) -> None:
    cell = cell_with(PlanItem())
    for state in (*RUNNING, HALTED):
        # Nothing else ends a state meanwhile.
        inputs = TROUBLES[trouble]._replace(
            halt=(float(state == HALTED),),
            homed=(float(state != "home.settle"),),
            mean_force=(1.2 * (MODE_OF.get(state) == CONTACT), 0.0, 0.0),
        )
        snapshot = put_in(cell, state)
        for k in range(5):  # the last one finds three readings in a row
            snapshot, _ = cell.chart.step(snapshot, inputs, k * PERIOD)
            if snapshot.memory.trouble:
                break
        assert snapshot.state == BRAKE, state
        assert snapshot.memory.trouble is trouble, state
        assert snapshot.memory.trouble_at == ("slew.over" if state == HALTED else state)
        # It stops on its path in free space alone.
        free = MODE_OF.get(state, APPROACH) == APPROACH
        assert snapshot.memory.hold == (free and state not in FEELING), state
