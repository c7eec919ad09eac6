"""A charging cycle in three dimensions: arm and nuggets as they truly were."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from analysis.run.experiment import Outcome, Table
from analysis.run.replay import record, set_stage
from diagrams.charging.charging_scenario import CrucibleChargingScenario
from diagrams.charging.charging_view import POSE, make_charging_view, waiting_pose

Array = NDArray[np.float64]

GRIP_POSE: Final = ("roll", "pitch", "yaw", "nugget_x", "nugget_y", "nugget_z")

_EYE: Final = np.array([1.05, -0.70, 0.85])  # m; assumed
_TARGET: Final = np.array([0.42, -0.05, 0.47])  # m; assumed
_FLOOR: Final = np.array([0.4, 0.0, 0.0])  # m; assumed


def replay_charging(
    scenario: CrucibleChargingScenario, outcome: Outcome, meshcat: Meshcat
) -> None:
    """Show a cycle as an animation.

    Args:
        scenario: Of the run, resolved.
        outcome: Its traces have the columns ``time``, s, ``item``, ``held``, ``roll``, ``pitch``,
            ``yaw``, rad, ``nugget_x``, ``nugget_y`` and ``nugget_z``, the true grip point, m, and
            ``<joint>.position``, rad and m.
        meshcat: Where.

    Raises:
        ValueError: If a column is missing, or what :func:`analysis.run.replay.record` raises.
    """
    station, traces = scenario.station.true, outcome.traces
    view = make_charging_view(station, scenario.plan, meshcat)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    joints = [_column(traces, f"{name}.position") for name in scenario.ARM.joint_names]
    nuggets = nugget_poses(scenario, traces)
    time = _column(traces, "time")
    positions = view.positions(np.column_stack(joints), nuggets)
    record(meshcat, view.diagram, view.plant, time, positions)


def nugget_poses(scenario: CrucibleChargingScenario, traces: Table) -> Array:
    """Return where each nugget is, shape (rows, items, POSE).

    It waits at the feeder, goes with the gripper while it is held, and stays where it was left.
    """
    item, held = (_column(traces, name) for name in ("item", "held"))
    gripped = np.column_stack([_column(traces, name) for name in GRIP_POSE])
    found = np.empty((len(item), len(scenario.plan), POSE))
    for i, one in enumerate(scenario.plan):
        height = one.true_nugget.height
        queue = np.array(
            [
                waiting_pose(scenario.station.true, height, ahead)
                for ahead in range(len(scenario.plan))
            ]
        )
        # Before it is gripped it is the item's distance in the plan that says where it waits.
        found[:, i] = queue[np.maximum(i - item.astype(int), 0)]
        rows = np.flatnonzero((item == i) & (held > 0))
        if len(rows):
            found[rows[0] :, i] = gripped[rows[-1]]
            found[rows, i] = gripped[rows]
    return found


def _column(traces: Table, name: str) -> Array:
    if name not in traces:
        raise ValueError(f"the traces lack the column {name!r}, which the replay needs")
    return np.asarray(traces[name], dtype=np.float64)
