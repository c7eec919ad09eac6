"""``fullseye``'s peg in MuJoCo: its scene, a feed of ours, no cameras."""

import math
import time
from typing import Any

import mujoco
import numpy as np
import pegsim

from chamfer.analysis.benchmarks.insertion import Result
from chamfer.analysis.insertion.insertion_runs import median
from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario
from chamfer.systems.contact.peg_hole_contact_monitor import SEATED

_SETTLE = 0.3  # s, until the peg hangs at rest on its springs
_NEAR_TIP = (
    1.5e-3  # m, along the peg: contacts closer to the tip are the tip's, as the peer has it
)


def insert_in_mujoco(scenario: PegInsertionScenario) -> Result:
    """Run the same insertion in the peer's scene, without gravity."""
    parts, support = scenario.parts, scenario.support
    started = time.process_time()
    dimensions = pegsim.peg_params(
        r=parts.peg_radius,
        R=parts.hole_radius,
        hole_depth=parts.hole_length,
        chamfer=parts.chamfer_width,
        peg_length=parts.peg_length,
        mu=parts.friction,
        k_rot=support.angular_stiffness,
    )
    scene = pegsim.peg_scene_build(dimensions, lg=support.centre_distance)
    model, data, ids = scene["model"], scene["data"], scene["ids"]
    model.opt.gravity[:] = 0.0
    feed = ids["act"]["az"]
    model.actuator_forcelimited[feed] = 1
    model.actuator_forcerange[feed] = (-scenario.force_cap, scenario.force_cap)
    model.qpos_spring[ids["qadr"]["wry"]] = scenario.tilt
    data.qpos[ids["qadr"]["wry"]] = scenario.tilt
    mujoco.mj_forward(model, data)
    tip = data.site_xpos[ids["tip"]]
    step = float(model.opt.timestep)
    start = np.array([scenario.lateral - tip[0], 0.0, scenario.gap - tip[2]])
    for k, name in enumerate(("cx", "cy", "cz")):
        data.qpos[ids["qadr"][name]] += start[k]
    data.ctrl[:] = start
    for _ in range(round(_SETTLE / step)):
        mujoco.mj_step(model, data)
    way = scenario.gap + scenario.depth + scenario.force_cap / support.lateral_stiffness
    force, onset, depth = [], None, 0.0
    for k in range(math.ceil(way / scenario.speed / step)):
        data.ctrl[feed] = start[2] - scenario.speed * step * (k + 1)
        mujoco.mj_step(model, data)
        depth = -float(tip[2])
        up, two = _contacts(scene)
        force.append(up)
        if two and onset is None:
            onset = depth - parts.chamfer_height
        if depth >= scenario.depth:
            break
    seconds = time.process_time() - started
    return Result(
        depth >= SEATED * scenario.depth,
        onset,
        float(median(np.array(force), step).max()),
        seconds,
    )


def _contacts(scene: dict[str, Any]) -> tuple[float, bool]:
    """Return the force up on the peg, N, and whether it touches at the mouth and across."""
    model, data, ids = scene["model"], scene["data"], scene["ids"]
    tip, top = data.site_xpos[ids["tip"]], data.site_xpos[ids["top"]]
    axis = (top - tip) / np.linalg.norm(top - tip)
    wrench, up = np.zeros(6), 0.0
    sides: dict[bool, float] = {}
    for i in range(data.ncon):
        contact = data.contact[i]
        if ids["peg"] not in (contact.geom1, contact.geom2):
            continue
        mujoco.mj_contactForce(model, data, i, wrench)
        world = contact.frame.reshape(3, 3).T @ wrench[:3]
        up += float(world[2]) * (1.0 if contact.geom2 == ids["peg"] else -1.0)
        at_tip = float((contact.pos - tip) @ axis) < _NEAR_TIP
        if wrench[0] > 0:
            sides[at_tip] = sides.get(at_tip, 0.0) + wrench[0] * float(contact.pos[0])
    return up, len(sides) == 2 and sides[True] * sides[False] < 0
