"""The figures' scenarios have the numbers that the thesis prints."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    ADEPT_NUGGET_MOTION,
    ADEPT_ROLLER_HOLD,
    ADEPT_ROLLER_MOTION,
    CONTACT_RECOVERY,
    PLANAR_HOLD,
    PLANAR_SLIDE,
    PUMA_NUGGET_HOLD,
    PUMA_NUGGET_MOTION,
    PUMA_ROLLER_HOLD,
    PUMA_ROLLER_MOTION,
    WRIST_CONTENTION,
    PlanarScenario,
    PumaScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import ContactDetectionParams


@pytest.mark.parametrize(
    ("scenario", "distance", "contact", "force", "amplitude", "frequency"),
    [
        (PLANAR_HOLD, 1.5, 4.5, 15.0, 0.0, None),  # section 2.2
        (PLANAR_SLIDE, 1.5, 4.5, 15.0, 0.02, 1.0),
        (PUMA_ROLLER_HOLD, 0.05, 1.5, 5.0, 0.0, None),  # section 3.1.3
        (PUMA_ROLLER_MOTION, 0.05, 1.5, 5.0, 0.04, 2 * np.pi * 0.25),
        (PUMA_NUGGET_HOLD, 0.03, 0.5, 5.0, 0.0, None),
        (PUMA_NUGGET_MOTION, 0.03, 1.0, 5.0, 0.04, 2 * np.pi * 0.1),
        (ADEPT_ROLLER_HOLD, 0.07, 6.0, 20.0, 0.0, None),  # section 3.2.3
        (ADEPT_ROLLER_MOTION, 0.01, 1.8, 20.0, 0.03, 2 * np.pi / 4.0),
        (ADEPT_NUGGET_HOLD, 0.01, 1.0, 5.0, 0.0, None),
        (ADEPT_NUGGET_MOTION, 0.01, 1.0, 5.0, 0.01, 2 * np.pi / 10.0),
    ],
)
def test_distances_contact_times_forces_and_motions(
    scenario: HybridScenario,
    distance: float,
    contact: float,
    force: float,
    amplitude: float,
    frequency: float | None,
) -> None:
    task = scenario.task
    assert scenario.distance == distance  # to the bit: it decides where the run begins
    assert task.approached(contact) == pytest.approx(distance, rel=0.02)
    assert (task.force, task.amplitude) == (force, amplitude)
    if frequency is not None:
        assert task.frequency == pytest.approx(frequency)
        assert scenario.duration - scenario.measure_after > 2 * np.pi / frequency


def test_chapter_2() -> None:
    for scenario in (PLANAR_HOLD, PLANAR_SLIDE, CONTACT_RECOVERY):
        assert (scenario.task.start, scenario.task.speed) == ((1.0, 0.0), 0.33)
        np.testing.assert_allclose(scenario.touching, [1.0, -1.5])
        assert scenario.controller.period == 0.005
        assert scenario.make_surface() == Crucible(centre=(1.0, -0.75), radius=0.75)
    assert (PLANAR_HOLD.task.kick_time, CONTACT_RECOVERY.task.kick_time) == (None, 8.0)
    assert (fill(PLANAR_HOLD).sensor.noise, PLANAR_HOLD.trials) == (0, 1)


def test_the_wall_lies_ahead_of_the_start() -> None:
    def starting(*start: float, direction: tuple[float, float] = (0.0, -1.0)) -> PlanarScenario:
        task = replace(PLANAR_HOLD.task, start=start, direction=direction)
        return replace(PLANAR_HOLD, task=task)

    assert starting(1.0, -1.4).distance == pytest.approx(0.1)
    aside = starting(1.2, -0.6, direction=(3.0, -4.0))
    gap = locate(aside.make_surface(), np.array([*aside.touching, 0.0])).gap
    assert gap == pytest.approx(0.0, abs=1e-12)
    assert aside.distance > 0.3
    allowed = r"inside of the circle of 0\.75 m about \(1\.0, -0\.75\)"
    for start in ((1.9, 0.0), (1.0, 0.01), (1.0, -1.5)):
        with pytest.raises(ParameterError, match=rf"^task\.start is \(.*\), allowed: {allowed}$"):
            resolve(starting(*start))


@pytest.mark.parametrize("scenario", [PUMA_ROLLER_HOLD, PUMA_NUGGET_HOLD])
def test_the_pumas_load_cell_points_at_the_surface(scenario: PumaScenario) -> None:
    q = scenario.joint_positions(scenario.touching)
    R_WE = scenario.dynamics().evaluate(q, np.zeros(3)).R_WE
    # Within 20 degrees of the push.
    assert R_WE @ scenario.sensor.axis @ scenario.direction > np.cos(np.radians(20))


@pytest.mark.parametrize("scenario", [PUMA_ROLLER_HOLD, ADEPT_NUGGET_HOLD, WRIST_CONTENTION])
@pytest.mark.parametrize("sensing", ["ideal", "realistic"])
def test_noise_is_not_taken_for_contact(scenario: HybridScenario, sensing: str) -> None:
    found = fill(replace(scenario, sensing=sensing))  # type: ignore[arg-type]
    assert found.detection.detect is not None
    assert 0 < found.sensor.rest_noise < found.detection.detect
    if scenario is ADEPT_NUGGET_HOLD:
        assert found.sensor.noise == 0.5  # section 3.2.3
        if sensing == "ideal":
            expected = ContactDetectionParams(detect=0.8, release=0.2, samples=1)
            assert found.detection == expected


def test_the_wrists_lever_turns_the_push_into_a_torque() -> None:
    # Beside the axis by 5 cm, 5 N are 0.25 N m; on the axis they are none.
    for scenario, torque in ((WRIST_CONTENTION, 0.25), (ADEPT_NUGGET_HOLD, 0.0)):
        q = scenario.joint_positions(scenario.touching)
        J = scenario.dynamics().evaluate(q, np.zeros(4)).J_v_WC
        push = scenario.task.force * scenario.direction[:3]
        assert abs((J.T @ push)[3]) == pytest.approx(torque, rel=1e-9, abs=1e-12)
