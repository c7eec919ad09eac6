from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from chamfer.diagrams.contact.contact_scenarios import (
    PumaNuggetHoldScenario,
    PumaNuggetMotionScenario,
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
    PumaScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.systems.sensing.force_sensor import LoadCellParams

ALL = (
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
    PumaNuggetHoldScenario,
    PumaNuggetMotionScenario,
)


@pytest.mark.parametrize(
    ("make", "distance", "contact"),
    [
        (PumaRollerHoldScenario, 0.05, 1.5),
        (PumaRollerMotionScenario, 0.05, 1.5),
        (PumaNuggetHoldScenario, 0.03, 0.5),
        (PumaNuggetMotionScenario, 0.03, 1.0),
    ],
)
def test_distances_and_contact_times_of_section_3_1_3(
    make: Callable[[], PumaScenario], distance: float, contact: float
) -> None:
    task = make().task
    assert task.distance == distance
    assert task.approached(contact) == pytest.approx(distance, rel=0.01)
    assert task.force == 5.0


@pytest.mark.parametrize(
    ("make", "frequency"), [(PumaRollerMotionScenario, 0.25), (PumaNuggetMotionScenario, 0.1)]
)
def test_motions_of_section_3_1_3(make: Callable[[], PumaScenario], frequency: float) -> None:
    scenario = make()
    assert scenario.task.amplitude == 0.04
    assert scenario.task.frequency == pytest.approx(2 * np.pi * frequency)
    assert scenario.duration - scenario.measure_after > 1 / frequency


@pytest.mark.parametrize("make", ALL)
def test_the_load_cell_points_at_the_surface(make: Callable[[], PumaScenario]) -> None:
    scenario = make()
    assert isinstance(scenario.sensor, LoadCellParams)
    q = scenario.joint_positions(scenario.touching)
    R_WE = scenario.dynamics().evaluate(q, np.zeros(3)).R_WE
    # Within 20 degrees of the push.
    assert R_WE @ scenario.sensor.axis @ scenario.direction > np.cos(np.radians(20))


@pytest.mark.parametrize("make", ALL)
def test_noise_does_not_trigger_contact(make: Callable[[], PumaScenario]) -> None:
    for sensing in ("ideal", "realistic"):
        found = resolve(replace(make(), sensing=sensing))
        assert found.detection.detect is not None
        assert 0 < found.sensor.rest_noise < found.detection.detect
        assert found.detection.samples == 1
    assert make().trials > 1
