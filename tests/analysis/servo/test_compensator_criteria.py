import math

import numpy as np

from analysis.servo.compensator_criteria import axis_machine, gore_findings
from systems.servo.compensator import AxisParams
from systems.statechart.finite_machine import storage, tarraf_properties

AXIS = AxisParams(dead_zone=0.01, large_error=0.1, increment=0.01)
PERIOD = 1 / 80


def test_the_increment_has_all_of_tarrafs_properties() -> None:
    machine = axis_machine(AXIS, accumulated=False)
    found = tarraf_properties(machine)
    assert found.count == 3
    # One small increment per dead zone: 1/0.01; five per large error of 0.1 is less.
    assert math.isclose(found.gain, 100.0, rel_tol=1e-9)
    assert storage(machine, 99.0) is None


def test_the_accumulated_compensation_has_none() -> None:
    machine = axis_machine(AXIS, accumulated=True)
    assert tarraf_properties(machine).count == 0
    assert np.abs(machine.output).max() == 20  # four large increments of five small ones


def run_of_errors() -> list[float]:
    return (0.3 * np.sin(np.linspace(0, 4 * np.pi, 400))).tolist()


def test_the_compensator_meets_gores_criteria_on_a_run_that_uses_all_of_it() -> None:
    assert gore_findings(AXIS, run_of_errors(), PERIOD) == ()


def test_a_run_that_stays_small_does_not_use_every_state() -> None:
    small = [0.1 * error for error in run_of_errors()]
    assert gore_findings(AXIS, small, PERIOD) == (
        "criterion 2: add_large not used, remove_large not used",
    )
