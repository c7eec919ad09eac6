from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
    AdeptScenario,
    WristContentionScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.systems.force.contact_detection import ContactDetectionParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

ALL = (
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    WristContentionScenario,
)


@pytest.mark.parametrize(
    ("make", "distance", "contact", "force"),
    [
        (AdeptRollerHoldScenario, 0.07, 6.0, 20.0),
        (AdeptRollerMotionScenario, 0.01, 1.8, 20.0),
        (AdeptNuggetHoldScenario, 0.01, 1.0, 5.0),
        (AdeptNuggetMotionScenario, 0.01, 1.0, 5.0),
    ],
)
def test_distances_contact_times_and_forces_of_section_3_2_3(
    make: Callable[[], AdeptScenario], distance: float, contact: float, force: float
) -> None:
    task = make().task
    assert task.distance == distance
    assert task.approached(contact) == pytest.approx(distance, rel=0.01)
    assert task.force == force


@pytest.mark.parametrize(
    ("make", "amplitude", "period"),
    [(AdeptRollerMotionScenario, 0.03, 4.0), (AdeptNuggetMotionScenario, 0.01, 10.0)],
)
def test_motions_of_section_3_2_3(
    make: Callable[[], AdeptScenario], amplitude: float, period: float
) -> None:
    scenario = make()
    assert scenario.task.amplitude == amplitude
    assert scenario.task.frequency == pytest.approx(2 * np.pi / period)
    assert scenario.duration - scenario.measure_after > period


@pytest.mark.parametrize("make", ALL)
def test_one_arm_one_set_of_gains_and_one_sensor(make: Callable[[], AdeptScenario]) -> None:
    scenario, other = make(), AdeptNuggetHoldScenario()
    assert scenario.controller == other.controller
    assert scenario.sensor == other.sensor
    for sensing in ("ideal", "realistic"):
        found = resolve(replace(scenario, sensing=sensing))
        assert isinstance(found.sensor, ForceSensorParams)
        assert found.sensor.noise == 0.5  # section 3.2.3
        assert found.detection.detect is not None
        assert found.sensor.noise < found.detection.detect
    assert resolve(scenario).detection == ContactDetectionParams(
        detect=0.8, release=0.2, samples=1
    )
    assert scenario.arm.joint_friction.coulomb[:3] == other.arm.joint_friction.coulomb[:3]


def test_the_wrists_lever_turns_the_push_into_a_torque() -> None:
    scenario = WristContentionScenario()
    q = scenario.joint_positions(scenario.touching)
    J = scenario.dynamics().evaluate(q, np.zeros(4)).J_v_WC
    push = scenario.task.force * scenario.direction[:3]
    # Beside the axis by 5 cm, 5 N are 0.25 N m; on the axis they are none.
    assert abs((J.T @ push)[3]) == pytest.approx(0.25, rel=1e-9)
    plain = AdeptNuggetHoldScenario()
    J = plain.dynamics().evaluate(plain.joint_positions(plain.touching), np.zeros(4)).J_v_WC
    assert abs((J.T @ push)[3]) == pytest.approx(0, abs=1e-12)
