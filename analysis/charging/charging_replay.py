"""A charging cycle in three dimensions: the true poses of arm and nuggets."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat
from pydrake.math import RollPitchYaw, RotationMatrix

from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.charging.charging_scenario import ResolvedCrucibleChargingScenario
from chamfer.diagrams.charging.charging_view import POSE, make_charging_view, waiting_pose
from chamfer.models.charging.packing import ItemPlace
from chamfer.models.charging.station import Station
from chamfer.systems.contact.arm_dynamics import GRAVITY

Array = NDArray[np.float64]

GRIP_POSE: Final = ("roll", "pitch", "yaw", "nugget_x", "nugget_y", "nugget_z")

_EYE: Final = np.array([1.05, -0.70, 0.85])  # m; assumed
_TARGET: Final = np.array([0.42, -0.05, 0.47])  # m; assumed
_FLOOR: Final = np.array([0.4, 0.0, 0.0])  # m; assumed
_LEAVES: Final = 1.5  # s, from grip until the next one may move up; by eye, as all that follows
_MOVES_UP: Final = 1.0  # s, in which the queue moves up by a place
_OUT_OF_SIGHT: Final = -10.0  # m, under the floor
_NEAR: Final = 0.01  # m, from its place, where a nugget lies on what the plan says


def replay_charging(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, meshcat: Meshcat
) -> None:
    """Show a cycle as an animation, by the traces of its run.

    Raises:
        ValueError: If a column is missing, or what :func:`chamfer.analysis.report.replay.record`
        raises.
    """
    station, traces = scenario.station.true, outcome.traces
    laid = scenario.places(believed=False)[0].laid
    view = make_charging_view(station, scenario.plan, meshcat, lean=scenario.wall.lean, laid=laid)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    joints = [_column(traces, f"{name}.position") for name in scenario.ARM.joint_names]
    nuggets = nugget_poses(scenario, traces)
    time = _column(traces, "time")
    positions = view.positions(np.column_stack(joints), nuggets)
    record(meshcat, view.diagram, view.plant, time, positions)


def nugget_poses(scenario: ResolvedCrucibleChargingScenario, traces: Table) -> Array:
    """Return the pose of each nugget, shape (rows, items, POSE).

    It waits at the feeder, moves up while the arm is away, goes with the gripper while it is
    held, and falls from where it was let go onto what is below, as it comes to lie there. One that
    the feeder lacks is out of sight.
    """
    time, item, held = (_column(traces, name) for name in ("time", "item", "held"))
    gripped = np.column_stack([_column(traces, name) for name in GRIP_POSE])
    station = scenario.station.true
    goals = scenario.places(believed=False)
    served = _served(time, item, held, len(scenario.plan))
    found = np.empty((len(item), len(scenario.plan), POSE))
    for i, (nugget, goal) in enumerate(zip(scenario.nuggets, goals, strict=True)):
        ahead = np.maximum(i - served, 0.0)
        found[:, i] = [waiting_pose(station, nugget.height, one) for one in ahead]
        if scenario.fault.kind == "part_missing" and scenario.fault.item == i:
            found[:, i, -1] = _OUT_OF_SIGHT
        rows = np.flatnonzero((item == i) & (held > 0))
        if len(rows):
            last = rows[-1]
            found[rows[0] :, i] = gripped[last]
            found[rows, i] = gripped[rows]
            low = _below(station, goal, gripped[last, 3:5]) + nugget.height
            fallen = gripped[last, 5] - GRAVITY / 2 * (time[last:] - time[last]) ** 2
            if goal.lies.tilt:
                lying = RollPitchYaw(RotationMatrix(goal.lies.rotation))
                found[last + 1 :, i, :3] = lying.vector()
            found[last:, i, 5] = np.minimum(gripped[last, 5], np.maximum(fallen, low))
    return found


def _served(time: Array, item: Array, held: Array, items: int) -> Array:
    """Return how many places the queue has moved up at each row, shape (rows,)."""
    moved = np.zeros(len(time))
    for i in range(items):
        rows = np.flatnonzero((item == i) & (held > 0))
        if len(rows):
            moved += np.clip((time - time[rows[0]] - _LEAVES) / _MOVES_UP, 0.0, 1.0)
    # What is to be picked up stands there, however soon that is.
    return np.maximum(moved, item)


def _below(station: Station, goal: ItemPlace, place: Array) -> float:
    """Return the height, m, of the surface below a place in the world, m, shape (2,)."""
    if math.dist(place, goal.position) < _NEAR:
        return goal.layer
    if math.dist(place, station.crucible_centre) < station.crucible_radius:
        return station.bed_height
    if math.dist(place, station.feeder[:2]) < station.feeder_radius:
        return station.feeder[2]
    return 0.0


def _column(traces: Table, name: str) -> Array:
    if name not in traces:
        raise ValueError(f"the traces lack the column {name!r}, which the replay needs")
    return np.asarray(traces[name], dtype=np.float64)
