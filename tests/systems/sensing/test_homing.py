"""Encoders that find their zeros at index marks."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.encoders import Homing, HomingParams

PERIOD = 0.25  # s, a binary fraction
Q = np.array([1.0, -2.0])
PARAMS = HomingParams(zero_error=(0.1, -0.2), mark_distance=(0.3, -0.3), settle=1.0)


def shown(homing: Homing, motions: list[list[float]]) -> tuple[np.ndarray, list[float]]:
    """Return what is shown a period after each motion, shape (steps, 2n), and whether homed."""
    simulator = Simulator(homing)
    context = simulator.get_mutable_context()
    rows, homed = [], []
    for motion in motions:
        homing.GetInputPort("motion").FixValue(context, np.array(motion))
        simulator.AdvanceTo(context.get_time() + PERIOD)
        rows.append(homing.GetOutputPort("encoders").Eval(context))
        homed.append(homing.GetOutputPort("homed").Eval(context)[0])
    return np.array(rows), homed


def test_without_marks_zeros_stay_unknown() -> None:
    rows, homed = shown(Homing(PARAMS, Q, period=PERIOD), [[1.2, -2.2, 0.5, 0.6]] * 8)
    # 1.2 and -2.2 are short of the marks at 1.3 and -2.3.
    assert rows == pytest.approx(np.tile([1.3, -2.4, 0.5, 0.6], (8, 1)))
    assert not any(homed)


def test_zero_is_taken_over_gradually_behind_each_mark() -> None:
    first = [[1.0, -2.0, 0.0, 0.0], [1.4, -2.0, 0.0, 0.0]]
    rows, homed = shown(Homing(PARAMS, Q, period=PERIOD), first + [[1.4, -2.4, 0.0, 0.0]] * 8)
    errors = rows[:, :2] - np.array([m[:2] for m in first + [[1.4, -2.4]] * 8])
    assert errors[0] == pytest.approx([0.1, -0.2])
    assert np.all(np.diff(errors[:, 0]) <= 0)
    assert np.all(np.diff(errors[:, 1]) >= 0)
    # Halfway at half the time: the mark was passed in the second step, and in the third.
    assert errors[3, 0] == pytest.approx(0.1 * (1 - 0.75**3 * (10 - 15 * 0.75 + 6 * 0.75**2)))
    assert errors[-1] == pytest.approx([0.0, 0.0])
    assert homed[0] == homed[3] == 0.0
    assert homed[-1] == 1.0


def test_mark_is_passed_once_and_stays_known() -> None:
    motions = [[1.4, -2.4, 0.0, 0.0]] * 8 + [[1.0, -2.0, 0.0, 0.0]] * 2
    rows, homed = shown(Homing(PARAMS, Q, period=PERIOD), motions)
    assert rows[-1] == pytest.approx([1.0, -2.0, 0.0, 0.0])
    assert homed[-1] == 1.0


def test_by_default_zeros_are_known() -> None:
    motion = [[1.1, -2.1, 0.5, 0.5]]
    rows, homed = shown(Homing(HomingParams(), Q, period=PERIOD), motion)
    assert rows == pytest.approx(np.array(motion))
    assert homed == [1.0]


def test_refusals() -> None:
    with pytest.raises(ParameterError, match=r"zero_error is \(0.1,\), allowed: 2 numbers"):
        Homing(HomingParams(zero_error=(0.1,)), Q, period=PERIOD)
    with pytest.raises(ParameterError, match="allowed: 0 where mark_distance is 0"):
        Homing(HomingParams(zero_error=(0.1, 0.0)), Q, period=PERIOD)
    with pytest.raises(ParameterError, match="mark_distance is"):
        HomingParams(mark_distance=(float("inf"),))
    with pytest.raises(ParameterError, match="settle is 0"):
        HomingParams(settle=0)
