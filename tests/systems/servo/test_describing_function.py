"""The describing function against python-control, and its limit cycle against simulation."""

import math

import control
import numpy as np
import pytest
from pydrake.systems.primitives import LinearSystem

from chamfer.models.plants.servo_plant import SpringMassDamperParams
from chamfer.systems.servo.compensator_law import AxisParams, make_axis_chart
from chamfer.systems.servo.describing_function import (
    describing_function,
    loop_response,
    predict_limit_cycle,
)
from chamfer.systems.servo.servo_plant import make_spring_mass_damper

PERIOD = 1 / 80
FIVE_LEVELS = AxisParams(dead_zone=0.01, large_error=0.05, increment=0.02, divider=5.0)
LIGHTLY_DAMPED = SpringMassDamperParams(
    mass=1.0, damping=4.0, stiffness=100.0
)  # damping ratio 0.2


def relay(dead_zone: float, increment: float) -> AxisParams:
    """Return an axis with one class of errors only."""
    return AxisParams(dead_zone=dead_zone, large_error=dead_zone, increment=increment, divider=1.0)


def sampled_loop(plant: LinearSystem) -> control.StateSpace:
    """Return hold, plant and accumulator in python-control."""
    continuous = control.ss(plant.A(), plant.B(), plant.C(), plant.D())
    accumulator = control.ss(control.tf([1, 0], [1, -1], PERIOD))
    return control.sample_system(continuous, PERIOD, "zoh") * accumulator


def crossing(plant: LinearSystem) -> tuple[float, float]:
    """Return the loop's gain margin and phase crossover, rad/s, by python-control."""
    gain_margin, _, _, crossover, *_ = control.stability_margins(sampled_loop(plant), method="frd")
    return gain_margin, crossover


@pytest.mark.parametrize("amplitude", [0.011, 0.02, 0.0499, 0.051, 0.08, 0.3, 5.0])
def test_is_the_first_harmonic_of_what_the_chart_does(amplitude: float) -> None:
    chart = make_axis_chart(FIVE_LEVELS)

    def increment(error: float) -> float:
        return chart.step(chart.start(), float(error), 0.0)[0].memory.increment

    harmonic = control.describing_function(increment, amplitude, num_points=6000)
    assert describing_function(FIVE_LEVELS, np.array(amplitude)) == pytest.approx(
        harmonic.real, rel=3e-3
    )
    assert abs(harmonic.imag) < 3e-3 * harmonic.real


@pytest.mark.parametrize("delay", [0, 4])
def test_loop_response_is_that_of_hold_plant_accumulator_and_dead_time(delay: int) -> None:
    plant = make_spring_mass_damper(LIGHTLY_DAMPED, "position")
    frequencies = np.geomspace(0.01, 0.999 * math.pi / PERIOD, 50)
    z = np.exp(1j * frequencies * PERIOD)
    found = loop_response(plant, PERIOD, frequencies, delay_samples=delay)
    np.testing.assert_allclose(found, sampled_loop(plant)(z) * z**-delay, rtol=1e-8)


def test_frequency_is_the_loops_phase_crossover_and_the_amplitude_balances_its_gain() -> None:
    plant = make_spring_mass_damper(LIGHTLY_DAMPED, "position")
    gain_margin, crossover = crossing(plant)
    dead_zone, increment = 0.01, 0.02
    cycle = predict_limit_cycle(plant, relay(dead_zone, increment), PERIOD)
    assert cycle is not None
    assert cycle.frequency == pytest.approx(crossover, rel=1e-5)
    # 4 n sqrt(A^2 - eps^2) / (pi A^2) = 1/|L|, solved for the larger A.
    b = (4 * increment / (math.pi * gain_margin)) ** 2
    amplitude = math.sqrt((b + math.sqrt(b * b - 4 * b * dead_zone**2)) / 2)
    assert cycle.amplitude == pytest.approx(amplitude, rel=1e-3)


def test_none_is_predicted_below_the_threshold() -> None:
    # N is largest, 2 n / (pi eps), at A = sqrt(2) eps.
    plant = make_spring_mass_damper(LIGHTLY_DAMPED, "position")
    gain_margin, _ = crossing(plant)
    dead_zone = 0.01
    threshold = math.pi * dead_zone * gain_margin / 2
    assert predict_limit_cycle(plant, relay(dead_zone, 0.999 * threshold), PERIOD) is None
    cycle = predict_limit_cycle(plant, relay(dead_zone, 1.001 * threshold), PERIOD)
    assert cycle is not None
    assert cycle.amplitude == pytest.approx(math.sqrt(2) * dead_zone, rel=0.05)
