"""The replay: each nugget waits, goes with the gripper, and stays where it was left."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.charging.charging_replay import nugget_poses, replay_charging
from chamfer.analysis.report.replay import open_meshcat
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario, FaultParams
from chamfer.diagrams.charging.charging_view import waiting_pose
from chamfer.models.arms.adept_wrist import joint_positions
from chamfer.models.charging.packing import PlanItem, places

SCENARIO = CrucibleChargingScenario(plan=(PlanItem(azimuth=0.3), PlanItem(mass=0.05, azimuth=0.3)))
STATION = SCENARIO.station.true
GOAL = places(SCENARIO.plan, STATION, believed=False)[1]
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


def test_a_nugget_waits_is_carried_and_falls() -> None:
    found = nugget_poses(SCENARIO, traces())
    height, other = (item.true_nugget.height for item in SCENARIO.plan)
    first, second = found[:, 0], found[:, 1]
    np.testing.assert_array_equal(first[0], waiting_pose(STATION, height, 0))
    np.testing.assert_allclose(first[1], [0.0, 0.0, 0.1, 0.41, 0.1, 0.5])
    # Let go over the bed: 20 ms later it is 2 mm lower.
    np.testing.assert_allclose(first[2:, :5], np.tile([0.0, 0.0, 0.2, 0.42, 0.1], (6, 1)))
    np.testing.assert_allclose(first[2:5, 5], [0.5, 0.498038, 0.492152])
    np.testing.assert_array_equal(second[3], waiting_pose(STATION, other, 1))
    np.testing.assert_array_equal(second[4], waiting_pose(STATION, other, 0))
    np.testing.assert_allclose(second[-1], [0.0, 0.0, 0.7, 0.47, 0.1, 0.5])


@pytest.mark.parametrize(
    ("place", "below"),
    [
        (STATION.crucible_centre, STATION.bed_height),
        (STATION.feeder[:2], STATION.feeder[2]),
        ((0.45, -0.1), 0.0),  # beside crucible and feeder: the floor
        (GOAL.position, GOAL.layer),  # on the first one
    ],
)
def test_what_was_let_go_comes_to_rest_on_what_is_below(
    place: tuple[float, float], below: float
) -> None:
    columns = traces() | {
        "time": np.arange(float(STEPS)),
        "item": np.array([0] + [1] * 7),
        "held": np.array([0, 1, 1, 0, 0, 0, 0, 0]),
        "nugget_x": np.full(STEPS, place[0]),
        "nugget_y": np.full(STEPS, place[1]),
    }
    found = nugget_poses(SCENARIO, columns)
    height = SCENARIO.plan[1].true_nugget.height
    np.testing.assert_allclose(found[3:, 1, 5], below + height)


def test_the_queue_moves_up_while_the_arm_is_away() -> None:
    columns = traces() | {
        "time": 0.5 * np.arange(float(STEPS)),
        "item": np.zeros(STEPS),
        "held": np.array([0, 1, 1, 1, 1, 1, 1, 1]),
    }
    ahead = nugget_poses(SCENARIO, columns)[:, 1, 3]
    begin, end = (waiting_pose(STATION, 0.0, one)[3] for one in (1, 0))
    np.testing.assert_allclose(ahead[:5], begin)  # gripped at 0.5 s
    np.testing.assert_allclose(ahead[5:], [(begin + end) / 2, end, end])


def test_a_part_that_the_feeder_lacks_is_not_there() -> None:
    without = replace(SCENARIO, fault=FaultParams(kind="part_missing", item=1))
    columns = traces() | {"held": np.array([0, 1, 1, 0, 0, 0, 0, 0])}
    found = nugget_poses(without, columns)
    assert found[:, 1, 5].max() < -1.0
    assert found[:, 0, 5].min() > 0.0


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
