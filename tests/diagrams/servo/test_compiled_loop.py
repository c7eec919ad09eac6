from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_scenario import (
    STEP,
    CameraParams,
    fsm_axis,
)
from chamfer.systems.servo.compensator_law import AxisParams

SIGNALS = ("desired_trajectory", "controller", "actual_trajectory")
GRID = {"duration": 2.5, "step": 1 / 80}


def test_trials_differ_in_axes_and_amplitudes() -> None:
    axes = [
        AxisParams(dead_zone=0.01, large_error=0.1, increment=increment)
        for increment in (0.01, 0.03)
    ]
    amplitudes = np.array([0.3, -0.8])
    both = run_fsm_trials(STEP, "position", axes=axes, amplitudes=amplitudes, **GRID)
    for i in range(2):
        of = {"axes": axes[i : i + 1], "amplitudes": amplitudes[i : i + 1]}
        alone = run_fsm_trials(STEP, "position", **of, **GRID)  # type: ignore[arg-type]
        for name in (*SIGNALS, "increment"):
            np.testing.assert_array_equal(getattr(both, name)[i], getattr(alone, name)[0])
    assert both.desired_trajectory[:, -1].tolist() == [0.3, -0.8]
    assert set(both.increment[0]) == {0.0, 0.01, 0.002}


def test_noise_is_drawn_for_each_trial() -> None:
    scenario = replace(STEP, camera=CameraParams(noise=0.004, resolution=0.0))
    axes = [fsm_axis(scenario, "position")] * 2
    first, again = (
        run_fsm_trials(scenario, "position", axes=axes, seed=4, **GRID) for _ in range(2)
    )
    np.testing.assert_array_equal(first.actual_trajectory, again.actual_trajectory)
    assert np.any(first.actual_trajectory[0] != first.actual_trajectory[1])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"step": 0.005}, r"step is 0\.005, allowed: the FSM's period"),
        ({"step": 0.1}, r"step is 0\.1, allowed: the FSM's period"),
        ({"amplitudes": np.array([1.0, 2.0])}, "broadcast"),
        (
            {"axes": [AxisParams(dead_zone=0.01, large_error=0.1, increment=1e308)]},
            r"actual_trajectory is -?(inf|nan), allowed: finite",
        ),
    ],
)
def test_trials_that_are_no_grid_or_overflow_are_refused(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        run_fsm_trials(STEP, "position", **GRID | given)
