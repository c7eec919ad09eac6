"""What the parameters of sensors are not, each in one line."""

import math
import re
from typing import Any

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.computation_delay import ComputationDelay
from chamfer.systems.sensing.encoders import EncoderParams, Homing, HomingParams
from chamfer.systems.sensing.force_rate import (
    ForceRateSensor,
    ForceRateSensorParams,
    MovingAverage,
)
from chamfer.systems.sensing.force_sensor import (
    ForceSensor,
    ForceSensorParams,
    LoadCellParams,
    Tare,
    WrenchSensorParams,
    gauges,
)

NAN, INF = math.nan, math.inf
NOTHING: dict[str, Any] = dict.fromkeys(
    ("noise", "bias", "drift", "bandwidth", "delay", "resolution", "full_scale", "tare"), 0.0
)
UNIT = tuple(map(tuple, np.eye(6).tolist()))


def delayed(delay: float = 0.001, jitter: float = 0.0) -> Any:
    return ComputationDelay(1, delay=delay, jitter=jitter, period=0.005, step=0.001)


def homing(**values: Any) -> Any:
    return Homing(HomingParams(**values), np.zeros(2), period=0.25)


def rated(**values: Any) -> Any:
    return ForceRateSensor(ForceRateSensorParams(**values), dimension=2)


def average(**values: Any) -> Any:
    return MovingAverage(**{"samples": 2, "period": 0.1, "size": 1, **values})


def wrist(**values: Any) -> Any:
    fine = {**NOTHING, "cross_talk": 0.0, "position": (0.0, 0.0, 0.0)}
    params = ForceSensorParams(**{**fine, **values})
    return ForceSensor(params, gauges(params, (0.0, 0.0, 0.0)), step=0.001, period=0.005)


def six_axes(**values: Any) -> Any:
    fine = {**NOTHING, "cross_talk": UNIT, "origin": (0.0, 0.0, 0.0)}
    return WrenchSensorParams(**{**fine, **values})


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (delayed, {"delay": -0.001}, "computation_delay is -0.001, allowed: 0 to the period, 0."),
        (delayed, {"delay": 0.0051}, "computation_delay is 0.0051, allowed: 0 to the period, 0."),
        (delayed, {"jitter": 0.0011}, "computation_jitter is 0.0011, allowed: at most 0.001 s"),
        (delayed, {"delay": 0.0045, "jitter": 0.001}, "computation_jitter is 0.001, allowed: at"),
        (EncoderParams, {"counts": -1.0}, "counts is -1.0, allowed: finite numbers >= 0"),
        (EncoderParams, {"counts": (1.0, NAN)}, "counts is (1.0, nan), allowed: finite numbers"),
        (EncoderParams, {"velocity": "exact", "bandwidth": 3.0}, "bandwidth is 3.0, allowed: 0 w"),
        (EncoderParams, {"velocity": "tracked", "bandwidth": 0.0}, "bandwidth is 0.0, allowed: m"),
        (homing, {"zero_error": (0.1,)}, "zero_error is (0.1,), allowed: 2 numbers"),
        (homing, {"zero_error": (0.1, 0.0)}, "zero_error is (0.1, 0.0), allowed: 0 where mark_di"),
        (homing, {"mark_distance": (INF,)}, "mark_distance is (inf,), allowed"),
        (rated, {"bias": (NAN, 0.0)}, "bias is (nan, 0.0), allowed: finite numbers"),
        (rated, {"bias": (1.0,)}, "bias is (1.0,), allowed: 2 numbers"),
        (average, {"samples": 0}, "samples is 0, allowed: 1 or more"),
        (average, {"period": 0.0}, "period is 0.0, allowed: a finite number > 0"),
        (Tare, {"period": 0.0}, "period is 0.0, allowed: a finite number > 0"),
        (wrist, {"noise": None}, "noise is None, allowed: a value"),
        (wrist, {"delay": 2.0}, "delay is 2.0, allowed: at most 1 s"),
        (wrist, {"cross_talk": 1.0}, "cross_talk is 1.0, allowed: more than -0.5 and less than 1"),
        (wrist, {"cross_talk": -0.5}, "cross_talk is -0.5, allowed: more than -0.5 and less than"),
        (wrist, {"cross_talk": ((1.0,),)}, "cross_talk is ((1.0,),), allowed: a number, or a reg"),
        (wrist, {"cross_talk": 6 * (6 * (1.0,),)}, "cross_talk is ((1.0, 1.0, 1.0, 1.0, 1.0, 1.0"),
        (wrist, {"position": (0.0, 0.0, 0.1)}, "position is (0.0, 0.0, 0.1), allowed: 0 unless c"),
        (wrist, {"radius": 0.1}, "radius is 0.1, allowed: 0.05 unless a 6 x 6 cross-talk is undo"),
        (LoadCellParams, {"axis": (0.0, 0.0, 0.0)}, "axis is [0.0, 0.0, 0.0], allowed: a finite "),
        (six_axes, {"cross_talk": ((1.0,) * 6,) * 6}, "cross_talk is ((1.0, 1.0, 1.0, 1.0, 1.0,"),
        (six_axes, {"origin": (0.0, 0.0, INF)}, "origin is (0.0, 0.0, inf), allowed: three f"),
        (six_axes, {"tare": 0.1}, "tare is 0.1, allowed: 0: the skill takes the zero"),
        (six_axes, {"bias": (NAN,) * 6}, "bias is (nan, nan, nan, nan, nan, nan), allowed: fini"),
    ],
)
def test_is_named_in_a_line(make: Any, values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}") as caught:
        make(**values)
    assert "\n" not in str(caught.value)
