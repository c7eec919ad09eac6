"""Grasp and transport, the front of all strategies, driven without Drake."""

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.systems.primitives.position_primitives import Held
from chamfer.systems.primitives.skill import DONE, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.primitives.visual_servoing import Servoing, StaticCameras
from chamfer.systems.strategies.grasp_and_transport import (
    GRIPPER,
    PLUG,
    PLUG_TOP,
    SOCKET,
    ResolvedGraspAndTransportParams,
    make_grasp_and_transport,
)

CAMERAS: Final = StaticCameras(
    xz=CameraPlacement(view="xz").camera, yz=CameraPlacement(view="yz").camera
)
ABOVE: Final = (0.001, -0.002, 0.005)
TOP: Final = 0.022
PARAMS: Final = ResolvedGraspAndTransportParams(lift=0.02, mark=0.03, top=TOP, weight=0.0)


def states(**fields: Any) -> tuple[SkillState, ...]:
    return make_grasp_and_transport(
        PARAMS, CAMERAS, Servoing(), **{"above": ABOVE, "then": "on", **fields}
    )


@pytest.fixture
def skill() -> Skill:
    on = SkillState(name="on", run=[MoveDx()], on={"done": DONE}, timeout=2.0)
    return Skill(name="grasp", states=[*states(), on], retract=[MoveDx(duration=0.1)])


def test_sight_brings_the_mark_to_the_plug_and_the_plug_above_the_socket() -> None:
    run: dict[str, Any] = {state.name: state.run for state in states()}
    ((reach,), (approach, keep), (lift, _), (carry, watched)) = (
        run[name] for name in ("reach", "close in", "lift", "transport")
    )
    assert (reach.axes, reach.moved, reach.target) == (("x", "z"), GRIPPER, PLUG_TOP)
    assert reach.offset == (0.0, 0.0, PARAMS.mark - TOP)
    assert replace(reach, axes=("y",)) == approach
    assert keep == replace(reach, servoing=Servoing(ends=False))
    assert (carry.axes, carry.moved, carry.target) == (("x", "y", "z"), PLUG, SOCKET)
    assert (carry.offset, carry.speed, reach.speed) == (ABOVE, PARAMS.speed, PARAMS.speed)
    assert (lift.displacement[5], lift.duration) == (PARAMS.lift, PARAMS.lift / PARAMS.speed)
    assert watched == Held(time=math.inf)


def test_fingers_that_hold_nothing_close_again_all_around(skill: Skill, make_drive: Any) -> None:
    drive = make_drive(skill)
    for outcome in ("done", "done"):
        drive.make(outcome)
    there = drive.carriage[3:].copy()
    tried = [np.zeros(3)]
    while drive.make("lost") != "retract":
        assert not drive.memory.closed
        assert drive.make("done") == "grasp"
        assert drive.memory.closed
        tried.append(drive.carriage[3:] - there)
    assert drive.memory.reason == "grasp: lost"
    ways = np.array(tried) / PARAMS.around
    np.testing.assert_allclose(ways.sum(axis=0), 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(ways[1:]).sum(axis=1), 1)
    assert len(np.unique(ways.round(3), axis=0)) == 7


def test_a_part_is_weighed_against_the_zero_before_it_is_gripped() -> None:
    params = replace(PARAMS, weight=0.3, weighing_time=1.5)
    given = {
        state.name: state
        for state in make_grasp_and_transport(params, CAMERAS, Servoing(), above=ABOVE, then="on")
    }
    way = [given["close in"].on["done"]]
    while way[-1] != "transport":
        way.append(given[way[-1]].on["done"])
    assert way == ["zero", "grasp", "lift", "weigh", "transport"]
    assert [name for name, state in given.items() if state.tares] == ["zero"]
    assert given["zero"].run == (MoveDx(duration=1.5),)
    assert given["weigh"].run == (Held(wait=params.closing_time, time=1.5, weight=0.3),)
    assert {"zero", "weigh"}.isdisjoint(state.name for state in states())
