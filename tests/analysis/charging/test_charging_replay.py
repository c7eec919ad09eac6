"""The replay: each nugget waits, goes with the gripper, and stays where it was left."""

import gc

import numpy as np
import pytest

from analysis.charging.charging_replay import nugget_poses, replay_charging
from analysis.run.experiment import Outcome
from analysis.run.replay import open_meshcat
from diagrams.charging.charging_scenario import CrucibleChargingScenario
from diagrams.charging.charging_view import waiting_pose
from models.arms.adept_wrist import joint_positions
from models.charging.packing import PlanItem

SCENARIO = CrucibleChargingScenario(plan=(PlanItem(azimuth=0.3), PlanItem(azimuth=1.0)))
STEPS = 8


def traces() -> dict[str, np.ndarray]:
    columns = {
        "time": 0.02 * np.arange(STEPS),
        "item": np.array([0, 0, 0, 0, 1, 1, 1, 1]),
        "held": np.array([0, 1, 1, 0, 0, 1, 1, 1]),
        "nugget_x": 0.4 + 0.01 * np.arange(STEPS),
        "nugget_y": np.full(STEPS, 0.1),
        "nugget_z": np.full(STEPS, 0.5),
        "yaw": 0.1 * np.arange(STEPS),
        "pitch": np.zeros(STEPS),
        "roll": np.zeros(STEPS),
    }
    q = joint_positions(np.array([0.4, 0.1, 0.5, 0.0, 0.0, 0.0, 0.2]), "positive")
    joints = zip(SCENARIO.ARM.joint_names, q, strict=True)
    return columns | {f"{name}.position": np.full(STEPS, one) for name, one in joints}


def test_a_nugget_waits_is_carried_and_stays() -> None:
    found = nugget_poses(SCENARIO, traces())
    station, height = SCENARIO.station.true, SCENARIO.plan[0].true_nugget.height
    first, second = found[:, 0], found[:, 1]
    np.testing.assert_array_equal(first[0], waiting_pose(station, height, 0))
    np.testing.assert_allclose(first[1], [0.0, 0.0, 0.1, 0.41, 0.1, 0.5])
    np.testing.assert_allclose(first[2:], np.tile([0.0, 0.0, 0.2, 0.42, 0.1, 0.5], (6, 1)))
    np.testing.assert_array_equal(second[3], waiting_pose(station, height, 1))
    np.testing.assert_array_equal(second[4], waiting_pose(station, height, 0))
    np.testing.assert_allclose(second[-1], [0.0, 0.0, 0.7, 0.47, 0.1, 0.5])


def test_shows_a_run_and_says_what_is_missing() -> None:
    shown = Outcome(metrics={}, traces=traces(), simulated_seconds=0.14)
    meshcat = open_meshcat(0)
    replay_charging(SCENARIO, shown, meshcat)
    assert meshcat.HasPath("charging/nuggets/nugget_2")
    without = {name: one for name, one in traces().items() if name != "held"}
    with pytest.raises(ValueError, match="lack the column 'held'"):
        replay_charging(
            SCENARIO, Outcome(metrics={}, traces=without, simulated_seconds=0.14), meshcat
        )
    del meshcat
    gc.collect()
