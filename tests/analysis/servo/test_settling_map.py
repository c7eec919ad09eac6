import numpy as np
import pytest

from chamfer.analysis.servo.settling_map import (
    CYCLES,
    REVERSES,
    SETTLES,
    UNFINISHED,
    classify,
    oscillation,
)
from chamfer.diagrams.servo.servo_scenario import (
    CameraParams,
    StepScenario,
    fsm_axis,
    settling_plant,
)
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.settling import allowed_large_error

SCENARIO = StepScenario()


def axis(share: float) -> AxisParams:
    """An axis whose small increment is that share of the theorem's bound."""
    plant = settling_plant(SCENARIO, "position")
    increment = share * 5 * 2 * (0.01 - 0.0025) / (1 + plant.total)
    large_error = allowed_large_error(
        plant, dead_zone=0.01, measurement_error=0.0025, increment=increment
    )
    return AxisParams(dead_zone=0.01, large_error=large_error, increment=increment)


def test_settings_on_both_sides_of_the_bound() -> None:
    axes = [axis(share) for share in (0.5, 0.95, 1.6, 4.0)]
    done = classify(axes, SCENARIO, trials=8, seed=0)
    assert done.tolist() == [SETTLES, SETTLES, REVERSES, CYCLES]


def test_the_seed_decides_the_initial_errors() -> None:
    first, again = (classify([axis(1.3)] * 20, SCENARIO, trials=1, seed=2) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert len(set(first.tolist())) > 1  # not every offset reverses


def test_an_increment_too_small_for_the_trial_counts_as_unfinished() -> None:
    slow = AxisParams(dead_zone=0.01, large_error=1.0, increment=1e-4)
    done = classify([slow], SCENARIO, trials=3, seed=0)
    assert done.tolist() == [UNFINISHED]


def test_a_bounded_noise_is_covered_by_the_theorem() -> None:
    noisy = StepScenario(camera=CameraParams(resolution=0.0, noise=0.005))
    setting = fsm_axis(noisy, "position")
    done = classify([setting], noisy, trials=40, seed=1)
    assert done.tolist() == [SETTLES]


def test_oscillation_is_measured_where_there_is_one() -> None:
    found = oscillation([axis(0.9), axis(4.0)], SCENARIO)
    assert np.isnan(found.frequency[0])
    # The plant lags by half a turn more than the accumulator near its natural frequency.
    assert found.frequency[1] == pytest.approx(18.0, rel=0.05)
    assert 0.01 < found.amplitude[1] < 0.1
