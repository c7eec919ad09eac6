"""Both controllers settle when they are asked to, within what their theories allow."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.models.plants.servo_plant import SpringMassDamperParams
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.compensator_law import AxisParams
from chamfer.systems.servo.servo_plant import make_spring_mass_damper
from chamfer.systems.servo.settling import guarantee, sample_plant
from chamfer.systems.servo.timed_design import SettlingTask, settled_after, timed_axis, timed_gains

PLANT = sample_plant(
    make_spring_mass_damper(SpringMassDamperParams(), "position"), 1 / 60, delay_samples=2
)
TASK = SettlingTask(
    error=0.02, tolerance=1e-3, settling_time=1.5, measurement_error=2e-4, period=1 / 60
)


@pytest.mark.parametrize("time", [0.8, 1.5, 3.0])
def test_the_state_machine_settles_when_it_should_as_the_theorem_guarantees(time: float) -> None:
    task = replace(TASK, settling_time=time)
    axis = timed_axis(task, PLANT)
    assert settled_after(axis, PLANT, task) == pytest.approx(time, abs=2 / 60)
    said = guarantee(axis, PLANT, TASK.measurement_error)
    assert said.everywhere
    assert axis.dead_zone == pytest.approx(TASK.tolerance - TASK.measurement_error)
    # Less time takes more of what the theorem allows.
    slower = timed_axis(replace(task, settling_time=1.5 * time), PLANT)
    assert guarantee(slower, PLANT, TASK.measurement_error).small_share < said.small_share


def test_the_time_to_settle_is_that_of_the_law_step_by_step() -> None:
    # A plant that settles within a sample: 20 mm in steps of 4 mm and then of 1 mm.
    still = replace(PLANT, gain=1.0, undelivered=np.zeros(1))
    axis = AxisParams(dead_zone=8e-4, large_error=5.5e-3, increment=4e-3, divider=4.0)
    # 20, 16, 12, 8, 4, 3, 2, 1 mm: the last one is within the tolerance.
    task = replace(TASK, tolerance=1.5e-3)
    assert settled_after(axis, still, task) == pytest.approx(7 / 60)


def test_the_least_time_that_is_named_is_enough() -> None:
    for design in (timed_axis, timed_gains):
        with pytest.raises(
            ParameterError, match=r"^settling_time is 0\.1, allowed: at"
        ) as refused:
            design(replace(TASK, settling_time=0.1), PLANT)
        least = float(refused.value.allowed.split()[2])
        design(replace(TASK, settling_time=1.001 * least), PLANT)
