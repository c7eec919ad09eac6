from dataclasses import replace

import numpy as np
import pytest

from chamfer.diagrams.contact.contact_scenarios import (
    PlanarScenario,
    PlanarSlideScenario,
    RecoveryScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import resolve
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.surfaces.surface import locate
from chamfer.models.validation import ParameterError


def test_the_numbers_of_section_2_2() -> None:
    for make in (PlanarScenario, PlanarSlideScenario, RecoveryScenario):
        task = make().task
        assert task.start == (1.0, 0.0)
        assert (task.speed, task.force) == (0.33, 15.0)
        np.testing.assert_allclose(make().touching, [1.0, -1.5])
        assert make().controller.period == 0.005
        assert make().make_surface() == Crucible(centre=(1.0, -0.75), radius=0.75)
    assert (PlanarSlideScenario().task.amplitude, PlanarSlideScenario().task.frequency) == (
        0.02,
        1.0,
    )


def test_contact_is_planned_for_4_5_seconds() -> None:
    assert PlanarScenario().task.approached(4.5) == pytest.approx(1.5, rel=0.02)


def test_only_the_slide_moves_and_only_the_recovery_is_kicked() -> None:
    assert PlanarScenario().task.amplitude == RecoveryScenario().task.amplitude == 0
    assert PlanarScenario().task.kick_time is None
    assert PlanarSlideScenario().task.kick_time is None
    recovery = RecoveryScenario()
    assert recovery.task.kick_time is not None
    assert 6 < recovery.task.kick_time < recovery.duration - 2


def test_a_whole_period_of_the_slide_is_measured() -> None:
    scenario = PlanarSlideScenario()
    assert scenario.duration - scenario.measure_after > 2 * np.pi / scenario.task.frequency


def test_runs_without_noise_need_one_trial() -> None:
    for make in (PlanarScenario, PlanarSlideScenario):
        assert resolve(make()).sensor.noise == 0
        assert make().trials == 1


def test_the_wall_lies_ahead_of_the_start() -> None:
    def starting(*start: float, direction: tuple[float, float] = (0.0, -1.0)) -> PlanarScenario:
        scenario = PlanarScenario()
        return replace(scenario, task=replace(scenario.task, start=start, direction=direction))

    assert starting(1.0, 0.0).distance == 1.5  # to the bit: it decides where the run begins
    assert starting(1.0, -1.4).distance == pytest.approx(0.1)
    aside = starting(1.2, -0.6, direction=(3.0, -4.0))
    gap = locate(aside.make_surface(), np.array([*aside.touching, 0.0])).gap
    assert gap == pytest.approx(0.0, abs=1e-12)
    assert aside.distance > 0.3


@pytest.mark.parametrize("start", [(1.9, 0.0), (1.0, 0.01), (1.0, -1.5)])
def test_a_start_that_is_not_in_the_crucible_is_refused(start: tuple[float, ...]) -> None:
    scenario = PlanarScenario()
    away = replace(scenario, task=replace(scenario.task, start=start))
    allowed = r"inside of the circle of 0\.75 m about \(1\.0, -0\.75\)"
    with pytest.raises(ParameterError, match=rf"^task\.start is \(.*\), allowed: {allowed}$"):
        resolve(away)
