"""The columns that a charging run puts out, from made-up outputs of the loop."""

import numpy as np
import pytest

from chamfer.analysis.charging.charging_runs import traces_of
from chamfer.analysis.linear.simulate import Run
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.models.arms.adept_wrist import joint_positions
from chamfer.models.charging.packing import PlanItem
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS

AZIMUTH = 0.6
SCENARIO = CrucibleChargingScenario(plan=(PlanItem(), PlanItem(mass=0.14, azimuth=AZIMUTH)))
ENDPOINT = (0.5, 0.1, 0.5, AZIMUTH, 0.0, 0.0, 0.2)  # m and rad
WALL_PUSH, LAYER_PUSH = 1.5, 0.7  # N
SIZE = len(CONTACT_SIGNALS)


@pytest.fixture(scope="module")
def traces() -> dict[str, np.ndarray]:
    """Two rows of the second item: the gripper empty over the feeder, then with the item."""
    n = SCENARIO.ARM.num_joints
    q = joint_positions(np.array(ENDPOINT), "positive")
    inwards = -np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    nugget = SCENARIO.nuggets[1]
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    out, down = nugget.wall_point[0], nugget.wall_point[2]
    wall_point = np.add(ENDPOINT[:3], (c * out, s * out, down))
    ones = {name: np.ones(2) for name in ("state", "mode", "item", "grip", "finished")}
    contact = np.tile(0.01 * np.arange(2.0 * SIZE), (2, 1))
    outputs = ones | {
        "held": np.array([0.0, 1.0]),
        "scene": np.array([2.0, 3.0]),
        "encoders": np.tile([*q, *np.arange(1.0, n + 1)], (2, 1)),
        "torque": np.tile(np.arange(n) + 0.5, (2, 1)),
        "desired_position": np.tile(np.arange(7) + 0.25, (2, 1)),
        "tip": np.array([[*ENDPOINT[:3], 0, 0, 0], [*wall_point, 0, 0, 0]]),
        "contact": contact,
        "contact_force": np.array(
            [[0.7, 0.4, 5.0, *0 * up], [*WALL_PUSH * inwards + 0.4 * up, *LAYER_PUSH * up]]
        ),
        "measured_force": np.tile([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0], (2, 1)),
        "desired_force": np.tile([1.1, 1.2, 1.3, 0.0, 0.0, 0.0, 0.0], (2, 1)),
        "layer_shift": np.array([[0.0, 0.0], [3e-4, 4e-4]]),
    }
    return traces_of(SCENARIO, Run(time=np.array([0.0, 0.005]), outputs=outputs))


def test_forces_are_those_on_what_the_scene_has(traces: dict[str, np.ndarray]) -> None:
    np.testing.assert_allclose(traces["feeder_force"], [5.0, 0.0])
    # Along the wall's normal alone: friction, which carries the item, is none of it.
    np.testing.assert_allclose(traces["wall_force"], [0.0, WALL_PUSH])
    np.testing.assert_allclose(traces["layer_force"], [0.0, LAYER_PUSH])


def test_other_contact_signals_are_of_their_own_point(traces: dict[str, np.ndarray]) -> None:
    peak, gap = CONTACT_SIGNALS.index("peak_force"), CONTACT_SIGNALS.index("gap")
    np.testing.assert_allclose(traces["feeder_peak_force"], [0.01 * peak, 0.0])
    np.testing.assert_allclose(traces["wall_peak_force"], [0.0, 0.01 * peak])
    np.testing.assert_allclose(traces["layer_peak_force"], [0.0, 0.01 * (SIZE + peak)])
    # What is not there is far, not touched.
    assert traces["wall_gap"][0] > 0.5 < traces["layer_gap"][0]
    assert traces["feeder_gap"][1] > 0.5
    np.testing.assert_allclose(traces["layer_gap"][1], 0.01 * (SIZE + gap))


def test_grip_point_is_the_tip_without_its_offset(traces: dict[str, np.ndarray]) -> None:
    found = np.stack([traces[f"nugget_{axis}"] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(found, [ENDPOINT[:3]] * 2, atol=1e-12)


def test_coordinates_joints_and_shift_have_their_columns(traces: dict[str, np.ndarray]) -> None:
    for i, name in enumerate(SCENARIO.ARM.coordinates):
        assert traces[name][0] == pytest.approx(ENDPOINT[i], abs=1e-9)
        assert traces[f"desired_{name}"][0] == i + 0.25
    last = SCENARIO.ARM.joint_names[-1]
    assert traces[f"{last}.velocity"][0] == SCENARIO.ARM.num_joints
    assert traces[f"{last}.torque"][0] == SCENARIO.ARM.num_joints - 0.5
    np.testing.assert_allclose(traces["layer_shift"], [0.0, 5e-4])
    assert (traces["measured_force_z"][0], traces["desired_force_y"][0]) == (0.3, 1.2)
