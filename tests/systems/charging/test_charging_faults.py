"""What stops the charging cycle, in each mode, and a halt at any instant."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from chamfer.models.charging.packing import ItemKind, PlanItem
from chamfer.systems.charging.charging_params import Trouble
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST

Cells = Callable[..., Any]

FASTEST = 2.0  # m/s or rad/s: a command that goes faster has jumped
SUDDEN = 30.0  # m/s^2 or rad/s^2, likewise of its velocity
PERIOD = 0.01  # s, of the cell


def require_smooth(cell: Any) -> None:
    """Fail if the command jumps, or its velocity."""
    commands = np.array(cell.commands)
    rates = np.diff(commands, axis=0) / PERIOD
    assert np.abs(rates).max() < FASTEST
    assert np.abs(np.diff(rates, axis=0)).max() / PERIOD < SUDDEN


def require_safe(cell: Any, trouble: Trouble, state: str, words: str) -> None:
    """Fail unless the cell has stopped for a reason, at rest, with what it held."""
    assert cell.state == "stopped"
    assert cell.memory.trouble is trouble
    assert cell.memory.trouble_at == state
    assert cell.memory.said() == f"{words}, in {state}, item 0"
    assert cell.memory.mode == APPROACH
    for _ in range(50):
        cell.tick()
    assert cell.commands[-1] == pytest.approx(cell.commands[-20], abs=1e-12)
    assert cell.memory.grip == cell.held
    require_smooth(cell)


EVERYWHERE = [
    *("home.out", "acquire.descend", "acquire.grip", "scan.pass", "slew.over"),
    *("wall.approach", "wall.slide", "halted"),
]


@pytest.mark.parametrize("state", EVERYWHERE)
def test_a_dead_sensor_stops_all_modes(cell_with: Cells, state: str) -> None:
    cell = cell_with([PlanItem()])
    if state == "halted":
        cell.to("slew.over").halt = True
    cell.to(state).faults.alive = False
    at = "slew.over" if state == "halted" else state
    require_safe(cell.end(), Trouble.SENSOR_DEAD, at, "the force sensor is dead")


@pytest.mark.parametrize("state", ["acquire.lift", "scan.pass", "slew.over", "wall.slide"])
def test_a_dropped_part_stops_it(cell_with: Cells, state: str) -> None:
    cell = cell_with([PlanItem()]).to(state)
    cell.faults.drops = True
    cell.end()
    assert cell.memory.grip
    assert cell.memory.said() == f"part dropped, in {state}, item 0"


@pytest.mark.parametrize("state", ["acquire.above", "slew.over", "wall.lower", "wall.land"])
def test_too_much_force_stops_it(cell_with: Cells, state: str) -> None:
    cell = cell_with([PlanItem()]).to(state)
    cell.tick()
    cell.faults.extra_force = (0.0, 25.0, 0.0)
    require_safe(cell.end(), Trouble.TOO_MUCH_FORCE, state, "too much force")


def test_only_acquiring_may_push_hard(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()])
    cell.faults.extra_force = (0.0, 15.0, 0.0)  # 10 N elsewhere, 20 N at the feeder
    cell.run(lambda cell: cell.state == "scan.run_in" or cell.memory.trouble)
    assert cell.memory.trouble_at == "home.out"
    cell = cell_with([PlanItem()]).to("acquire.descend")
    cell.faults.extra_force = (0.0, 15.0, 0.0)
    assert cell.to("scan.run_in").state == "scan.run_in"


@pytest.mark.parametrize("state", ["acquire.above", "scan.pass", "slew.over", "wall.slide"])
def test_an_arm_off_its_command_is_left_where_it_is(cell_with: Cells, state: str) -> None:
    cell = cell_with([PlanItem()]).to(state)
    cell.faults.off = (0.0, 0.04, 0.0)
    require_safe(cell.end(), Trouble.OFF_PATH, state, "position error too large")
    assert "back_off.away" not in cell.states


def test_no_part_in_the_feeder(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()])
    cell.faults.part = False
    require_safe(cell.end(), Trouble.NO_PART, "acquire.descend", "no part in the gripper")


def test_a_part_that_slips_out_of_the_fingers(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()]).to("acquire.touch")
    cell.faults.part = False
    cell.end()
    assert cell.memory.said() == "no part in the gripper, in acquire.grip, item 0"


def test_no_wall(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()])
    cell.faults.wall = False
    require_safe(cell.end(), Trouble.NO_WALL, "wall.seek", "the wall is not there")


@pytest.mark.parametrize(("kind", "state"), [("wall", "wall.land"), ("crown", "crown.land")])
def test_no_layer(cell_with: Cells, kind: ItemKind, state: str) -> None:
    cell = cell_with([PlanItem(kind=kind)])
    cell.faults.layer = False
    require_safe(cell.end(), Trouble.NO_LAYER, state, "the layer below is not there")


def test_not_homed(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()])
    cell.faults.homed = False
    words = "not homed: a joint's index mark was not found"
    require_safe(cell.end(), Trouble.NOT_HOMED, "home.settle", words)


def test_lost_contact_is_sought_and_found(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()]).to("wall.slide")
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


def test_contact_lost_for_too_long(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()]).to("wall.land")
    cell.faults.wall = False
    require_safe(cell.end(), Trouble.CONTACT_LOST, "wall.lost", "contact lost for too long")


def test_contact_lost_too_often(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()]).to("wall.slide")
    while cell.state not in ("done", "stopped"):
        # It is away as soon as it is found, and back as soon as that is seen.
        cell.faults.wall = cell.state != "wall.slide"
        cell.tick()
    require_safe(cell, Trouble.LOST_OFTEN, "wall.lost", "contact lost too often")
    assert cell.way().count("wall.lost") == 6


def test_friction_at_the_wall_is_not_the_layer(cell_with: Cells) -> None:
    # As the nugget hits the wall again: 8 N on it, and friction of 0.3 times that.
    cell = cell_with([PlanItem()]).to("wall.slide")
    cell.faults.extra_force = (7.0, 0.0, -2.4)
    for _ in range(10):
        cell.tick()
    assert cell.state == "wall.slide"
    cell.faults.extra_force = (0.0, 0.0, -2.4)
    for _ in range(10):
        cell.tick()
    assert cell.state != "wall.slide"


def test_it_backs_off_the_wall(cell_with: Cells) -> None:
    cell = cell_with([PlanItem(azimuth=0.5)]).to("wall.land")
    cell.faults.alive = False
    at = np.array(cell.commands[-1])
    cell.end()
    moved = np.array(cell.commands[-1]) - at
    into = np.array([math.cos(0.5), math.sin(0.5), 0.0])
    assert moved[:3] @ into < -0.008
    assert abs(moved[2]) < 0.003


def test_halt_at_the_touch_stops_at_the_touch(cell_with: Cells) -> None:
    # The halt's braking must not press on into what is found meanwhile.
    cell = cell_with([PlanItem()]).to("acquire.descend")
    over = cell.beliefs.station.feeder[2] + cell.beliefs.nuggets[0].height
    cell.run(lambda cell: cell.commands[-1][2] < over + 0.002)
    cell.halt = True
    at = cell.ticks
    cell.run(lambda cell: cell.ticks == at + 100)
    assert cell.state == "halted"
    assert over - min(z for _, _, z, *_ in cell.commands) < 0.008
    cell.halt = False
    assert cell.end().state == "done"


def test_contact_lost_in_a_halt_is_sought_in_the_halt(cell_with: Cells) -> None:
    cell = cell_with([PlanItem()]).to("wall.slide")
    cell.halt = True
    cell.to("halted")
    cell.faults.wall = False
    cell.run(lambda cell: cell.memory.mode == LOST)
    cell.faults.wall = True
    cell.run(lambda cell: cell.memory.mode == CONTACT)
    cell.halt = False
    assert cell.end().state == "done"


PLAN = [PlanItem(azimuth=-0.8), PlanItem(kind="crown", azimuth=0.8), PlanItem(kind="bulk")]


@settings(
    max_examples=2,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # it only makes cells
)
@given(halts=st.lists(st.tuples(st.integers(1, 2500), st.integers(1, 80)), min_size=1, max_size=8))
def test_halts_at_any_instant_change_nothing_but_the_time(
    cell_with: Cells, halts: list[tuple[int, int]]
) -> None:
    cell = cell_with(PLAN)
    while cell.state not in ("done", "stopped"):
        cell.halt = any(begin <= cell.ticks < begin + length for begin, length in halts)
        cell.tick()
    assert cell.memory.said() == ""
    assert cell.state == "done"
    require_smooth(cell)
    moved = [state for state in cell.way() if state != "halted"]
    once = [a for a, b in zip(moved, [None, *moved], strict=False) if a != b]
    assert once == cell_with(PLAN).end().way()
