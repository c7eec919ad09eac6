import math

import numpy as np

from chamfer.analysis.servo.compensator_criteria import axis_machine, gore_findings, lap_chart
from chamfer.systems.servo.compensator import (
    AxisParams,
    CompensatorInputs,
    CompensatorParams,
    make_compensator_chart,
)
from chamfer.systems.statechart.finite_machine import storage, tarraf_properties

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
    assert gore_findings(AXIS, run_of_errors(), PERIOD, folded=False) == ()


def test_a_lap_in_one_tick_loses_the_state_that_fig_3_begins_it_with() -> None:
    lost = "next_desired_position"
    assert gore_findings(AXIS, run_of_errors(), PERIOD, folded=True) == (
        f"criterion 2: {lost} not used, no way from aligned to {lost}, "
        f"no way from modify_compensation to {lost}, no way from hold to {lost}",
    )


def test_two_ticks_of_fig_3_as_drawn_do_what_one_tick_of_the_chart_that_runs_does() -> None:
    params = CompensatorParams(axes=(AXIS, AXIS), period=PERIOD, end_time=300 * PERIOD)
    drawn, runs = lap_chart(params), make_compensator_chart(params)
    a, b = drawn.start(), runs.start()
    for i, error in enumerate(run_of_errors()):
        inputs = CompensatorInputs((error, -0.5 * error), (float(i % 7 > 0),), (0.1 * i, 1.0))
        a, _ = drawn.step(a, inputs, i * PERIOD)
        b, _ = runs.step(b, inputs, i * PERIOD)
        assert a.state == b.state
        assert a.memory == b.memory
        a, _ = drawn.step(a, inputs, (i + 0.5) * PERIOD)
        assert a.state == (drawn.initial if i < 300 else "trajectory_ended")
        assert a.memory == b.memory


def test_a_run_that_stays_small_does_not_use_every_state() -> None:
    small = [0.1 * error for error in run_of_errors()]
    assert gore_findings(AXIS, small, PERIOD, folded=False) == (
        "criterion 2: add_large not used, remove_large not used",
    )
