"""A sprung peg fed into its hole: Chamfer in Drake, ``fullseye`` in MuJoCo, and exact statics.

Part, spring, speed and cap are the same for all. The peg of ``fullseye`` has its chamfer on the
hole alone, and its carriage in series with its wrist. So a stiffness of 521.7 N/m holds for both
directions. The benchmark uses the scene of ``fullseye`` with the project's feed, without its
cameras.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from chamfer.analysis.benchmarks.peers import missing
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.insertion.insertion_runs import insert, measure, median
from chamfer.analysis.insertion.insertion_runs import predict as statics
from chamfer.diagrams.insertion.peg_insertion import (
    FeedSupport,
    PegInsertionScenario,
    resolve_peg_insertion,
)
from chamfer.models.peg.peg_and_hole import SEATED, PegAndHole
from chamfer.models.peg_theory.insertion_statics import two_point_onset

Cell = tuple[float, float]  # lateral error, mm, and tilt, degrees

# Of the reference table, and the grid of the peer's own.
TABLE: Final = ((0.0, 3.0), (0.0, 5.0), (1.0, 5.0), (0.0, 7.0), (0.0, 9.0))
GRID: Final = tuple((x, t) for x in (0.0, 1.0, 2.0, 3.0) for t in (1.0, 2.0, 3.0))
CELLS: Final = {"table": TABLE, "all": (*TABLE, *GRID)}
STATICS: Final = "statics"
CHAMFER: Final = "Chamfer, Drake"
PEER: Final = "fullseye, MuJoCo"
_WRIST, _SERVO = 600.0, 4000.0  # N/m, of the peer, in series
_SETTLE: Final = 0.3  # s, until the peer's peg hangs at rest on its springs
_DOUBT: Final = (0.9, 1.0, 1.1)  # of the tilt
_NEAR_TIP: Final = 1.5e-3  # m along the peg: closer contacts are the tip's, as the peer has it


class Result(NamedTuple):
    """The result of an engine for a cell."""

    seated: bool
    onset: float  # l, m; NaN: two points never touch
    force: float  # N, the largest 10 ms median along the axis
    seconds: float  # of the process


Insertions = dict[str, dict[Cell, Result]]  # by engine, exact statics among them


def cell(lateral: float, degrees: float) -> PegInsertionScenario:
    """Return a cell as an insertion of Chamfer's: mm and degrees."""
    return resolve_peg_insertion(
        PegInsertionScenario(
            parts=PegAndHole(
                hole_radius=0.0052,
                peg_radius=0.005,
                friction=0.3,
                chamfer_width=0.001,
                peg_chamfer_share=0.0,
                peg_length=0.04,
                hole_length=0.02,
                outer_radius=0.012,
            ),
            support=FeedSupport(
                lateral_stiffness=1 / (1 / _WRIST + 1 / _SERVO),
                angular_stiffness=1.5,
                centre_distance=0.04,
            ),
            lateral=1e-3 * lateral,
            tilt=math.radians(degrees),
            speed=0.012,
            depth=0.015,
            gap=0.002,
            step=0.002,  # forces are within 0.5 % or 0.03 N of those of a quarter of it
        )
    )


def measure_cells(found: Insertions, cells: Sequence[Cell]) -> None:
    """Run every engine that is installed on every cell."""
    engines = {STATICS: predict, CHAMFER: insert_in_drake, PEER: insert_in_mujoco}
    if "fullseye" in missing():
        del engines[PEER]
    for name, run in engines.items():
        results = found.setdefault(name, {})
        run(cell(*cells[0]))  # once, for what is loaded and compiled then
        for one in cells:
            results[one] = run(cell(*one))


def insert_in_drake(scenario: PegInsertionScenario) -> Result:
    """Run an insertion of Chamfer's."""
    started = time.process_time()
    run = insert(scenario, withdraw=False)
    seconds = time.process_time() - started
    names = "seated", "two_point.onset", "force.axial"
    seated, onset, force = (metric_value(measure(scenario, run), name) for name in names)
    return Result(seated == 1.0, onset, force, seconds)


def insert_in_mujoco(scenario: PegInsertionScenario) -> Result:
    """Run the same insertion in the peer's scene, without gravity."""
    import mujoco
    import pegsim

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
    force, onset, depth = [], math.nan, 0.0
    for k in range(math.ceil(way / scenario.speed / step)):
        data.ctrl[feed] = start[2] - scenario.speed * step * (k + 1)
        mujoco.mj_step(model, data)
        depth = -float(tip[2])
        up, two = _mujoco_contacts(scene)
        force.append(up)
        if two and math.isnan(onset):
            onset = depth - parts.chamfer_height
        if depth >= scenario.depth:
            break
    seconds = time.process_time() - started
    peak = float(median(np.array(force), step).max())
    return Result(depth >= SEATED * scenario.depth, onset, peak, seconds)


def _mujoco_contacts(scene: dict[str, Any]) -> tuple[float, bool]:
    """Return the force up on the peg, N, and whether it touches at the mouth and across."""
    import mujoco

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


def predict(scenario: PegInsertionScenario) -> Result:
    """Return the prediction of exact statics; infinite force if no push slides the peg."""
    started = time.process_time()
    said = statics(scenario)
    seconds = time.process_time() - started
    names = "seated", "two_point.onset", "force.axial"
    seated, onset, force = (metric_value(said, f"predicted.{name}") for name in names)
    enters = abs(scenario.lateral) < scenario.parts.chamfer_limit
    if not (enters and onset < scenario.depth - scenario.parts.chamfer_height):
        onset = math.nan
    return Result(seated == 1.0, onset, math.inf if math.isnan(force) else force, seconds)


def sure(one: Cell) -> bool:
    """Return whether the statics are unambiguous: a tenth more or less tilt changes nothing."""
    scenario = cell(*one)
    return len({predict(replace(scenario, tilt=by * scenario.tilt)).seated for by in _DOUBT}) == 1


# What follows is NaN where nothing was measured.


def agreement(found: Insertions) -> float:
    """Return the share of unambiguous cells in which Chamfer agrees with the statics, %."""
    right = [
        result.seated == found[STATICS][one].seated
        for one, result in found.get(CHAMFER, {}).items()
        if sure(one)
    ]
    return 100 * sum(right) / len(right) if right else math.nan


def slowest(found: Insertions) -> float:
    """Return Chamfer's largest share of MuJoCo's time in a cell."""
    of_peer, ours = found.get(PEER, {}), found.get(CHAMFER, {})
    shares = [ours[one].seconds / of.seconds for one, of in of_peer.items() if one in ours]
    return max(shares, default=math.nan)


def worst_onset(found: Insertions) -> float:
    """Return the largest difference of Chamfer's onsets from Whitney's closed form, mm."""
    differences = []
    for one, result in found.get(CHAMFER, {}).items():
        if not math.isnan(result.onset):
            of = cell(*one)
            said = two_point_onset(of.parts, of.support, of.lateral, of.tilt)
            differences.append(1e3 * abs(result.onset - float(said)))
    return max(differences, default=math.nan)


def worst_force(found: Insertions) -> float:
    """Return the largest difference of Chamfer's peaks at 3 to 5 degrees from statics, %."""
    differences = [
        100 * abs(result.force / found[STATICS][one].force - 1)
        for one, result in found.get(CHAMFER, {}).items()
        if 3.0 <= one[1] <= 5.0 and found[STATICS][one].seated
    ]
    return max(differences, default=math.nan)
