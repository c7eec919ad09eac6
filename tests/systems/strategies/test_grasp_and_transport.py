"""Grasp and transport, the front of all strategies, driven without Drake."""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import pytest

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.systems.primitives.position_primitives import Held
from chamfer.systems.primitives.primitive import STILL
from chamfer.systems.primitives.skill import DONE, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import MoveDx
from chamfer.systems.primitives.visual_servoing import Servoing, StaticCameras
from chamfer.systems.strategies.grasp_and_transport import (
    GRIPPER,
    PARTS,
    PLUG,
    PLUG_TOP,
    SOCKET,
    ResolvedGraspAndTransportParams,
    make_grasp_and_transport,
)
from chamfer.systems.vision.part_detection import Detection, Status
from chamfer.systems.vision.part_detector import pack_detections

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


def seen(**parts: tuple[float, float, float]) -> dict[str, Any]:
    """What the cameras see of parts whose tips are at these places, m; others are hidden."""
    places = {"plug": PLUG, "socket": SOCKET, "gripper": GRIPPER, "top": PLUG_TOP}
    if "plug" in parts:
        x, y, z = parts["plug"]
        parts["top"] = (x, y, z + TOP)
    found = {}
    for view in ("xz", "yz"):
        camera: Any = getattr(CAMERAS, view)
        all_parts = [Detection(status=Status.NO_COLOUR)] * PARTS
        for name, p_WT in parts.items():
            tip = camera.project(np.array(p_WT)).tolist()
            all_parts[places[name]] = Detection(status=Status.VALID, tip=tuple(tip))
        found[f"{view}_detections"] = tuple(pack_detections(*all_parts).tolist())
    return found


def settle(drive: Any, sensed: dict[str, Any]) -> str:
    """Tick with what is seen until the state is left."""
    state = drive.state
    while drive.memory.event is None:
        drive.tick(**sensed)
    drive.tick(**sensed)
    assert drive.state != state
    return str(drive.state)


def test_the_gripper_goes_by_its_mark_to_the_plug_and_carries_it(
    skill: Skill, make_drive: Any
) -> None:
    drive = make_drive(skill)
    plug = (0.01, 0.0, 0.0)
    x, y, z = plug
    drive.tick(**seen(plug=plug, gripper=(x - 0.006, y, z + PARAMS.mark + 0.008)))
    direction = np.array(drive.memory.velocity) / np.linalg.norm(drive.memory.velocity)
    np.testing.assert_allclose(direction, [0, 0, 0, 0.6, 0, -0.8], atol=0.03)
    assert settle(drive, seen(plug=plug, gripper=(x, y, z + PARAMS.mark))) == "close in"
    drive.tick(**seen(plug=plug, gripper=(x, y + 0.03, z + PARAMS.mark)))
    assert drive.memory.velocity[4] == pytest.approx(-PARAMS.speed, rel=0.01)
    assert settle(drive, seen(plug=plug, gripper=(x, y, z + PARAMS.mark))) == "grasp"
    drive.tick(holding=(0.0,))
    assert settle(drive, {"holding": (1.0,)}) == "lift"
    while drive.state == "lift":
        way = drive.way()
        drive.tick(**seen(plug=(0.0, 0.0, 0.02), socket=(0.0, 0.0, 0.0)))
    np.testing.assert_allclose(way, [0, 0, 0, 0, 0, PARAMS.lift], atol=1e-12)
    assert drive.state == "transport"
    assert drive.memory.velocity != STILL
    assert settle(drive, seen(plug=ABOVE, socket=(0.0, 0.0, 0.0))) == "on"


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
