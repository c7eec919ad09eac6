"""What the servo blocks' parameters may not be, each said in one line with its value."""

import math
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.servo.backlash import Backlash
from chamfer.systems.servo.compensator_law import AxisParams, CompensatorParams
from chamfer.systems.servo.divergence_law import DivergenceParams, Watched
from chamfer.systems.servo.pid_law import SampledPidParams
from chamfer.systems.servo.sampled_pid import tuned_gains
from chamfer.systems.servo.settling import SettlingPlant
from chamfer.systems.servo.timed_design import SettlingTask

AXIS = {"dead_zone": 0.125, "large_error": 1.0, "increment": 0.5}
TASK = {
    "error": 0.02,
    "tolerance": 1e-3,
    "measurement_error": 2e-4,
    "period": 1 / 60,
    "settling_time": 1.5,
}
TUNED = {"plant": SettlingPlant(1.0, np.ones(3)), "closed_loop": 0.1, "period": 0.0125}
CAMERA = {"axes": (AxisParams(**AXIS),)}
NOT_POSITIVE = (0.0, -1.0, math.nan, math.inf)


@pytest.mark.parametrize(
    ("make", "given", "names", "values", "allowed"),
    [
        (AxisParams, AXIS, "large_error", (0.1,), "a finite number >= dead_zone, 0.1"),
        (CompensatorParams, CAMERA, "axes", ((),), "at least one axis"),
        (SampledPidParams, {}, "axes", ((),), "at least one axis"),
        (tuned_gains, TUNED, "closed_loop period", NOT_POSITIVE, "a finite number > 0"),
        (SettlingTask, TASK, "tolerance", (0.0, 3e-4, 0.03), ""),
        (Backlash, {"period": 0.1}, "half_width", (-1.0, math.nan), ""),
    ],
)
def test_a_value_that_cannot_be_is_named(
    make: Callable[..., Any],
    given: dict[str, Any],
    names: str,
    values: tuple[object, ...],
    allowed: str,
) -> None:
    for name, value in product(names.split(), values):
        with pytest.raises(ParameterError) as refused:
            make(**given | {name: value})
        assert str(refused.value).startswith(f"{name} is {value!r}, allowed: {allowed}")


@pytest.mark.parametrize(
    ("watched", "message"),
    [(Watched((3,), 1.0), "watched is"), (Watched((0,), 0.0), r"watched is 0\.0")],
)
def test_what_is_watched_is_there(watched: Watched, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        DivergenceParams(watched=(watched,), size=3)
