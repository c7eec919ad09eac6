"""Taking a force sensor's zero."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_sensor import Tare

PERIOD = 0.25  # s, a binary fraction


def runner() -> Callable[..., np.ndarray]:
    """Return what goes on by a period with inputs, and returns the output before it."""
    tare = Tare(period=PERIOD)
    simulator = Simulator(tare)
    context: Context = simulator.get_mutable_context()

    def run(force: tuple[float, float, float], *, takes: bool) -> np.ndarray:
        tare.GetInputPort("force").FixValue(context, np.array(force))
        tare.GetInputPort("tare").FixValue(context, np.array([float(takes)]))
        simulator.AdvanceTo(context.get_time() + PERIOD)
        shown: np.ndarray = tare.GetOutputPort("tared_force").Eval(context)
        return shown

    run((0.0, 0.0, 0.0), takes=False)
    return run


def test_nothing_is_taken_off_before() -> None:
    assert runner()((1.0, 2.0, 3.0), takes=False).tolist() == [1.0, 2.0, 3.0]


def test_mean_is_taken_off_until_the_next_zero() -> None:
    run = runner()
    for x in (1.0, 2.0, 6.0):
        assert run((x, 0.0, -x), takes=True).tolist() == [0.0, 0.0, 0.0]
    assert run((3.5, 1.0, -3.0), takes=False) == pytest.approx([0.5, 1.0, 0.0])
    assert run((0.0, 0.0, 0.0), takes=False) == pytest.approx([-3.0, 0.0, 3.0])
    # A second zero has nothing of the first.
    run((8.0, 8.0, 8.0), takes=True)
    run((8.0, 8.0, 8.0), takes=True)
    assert run((8.0, 8.0, 9.0), takes=False) == pytest.approx([0.0, 0.0, 1.0])


def test_spread_is_the_standard_deviation_of_the_readings_of_the_last_zero() -> None:
    tare = Tare(period=PERIOD, size=6)
    simulator = Simulator(tare)
    context = simulator.get_mutable_context()
    seen = []
    for told, x in ((1, 100.0), (1, 104.0), (1, 108.0), (0, 500.0), (1, 7.0), (1, 9.0), (0, 0.0)):
        tare.GetInputPort("force").FixValue(context, np.array([x, -x, 0, 0, 2 * x, 1.0]))
        tare.GetInputPort("tare").FixValue(context, np.array([float(told)]))
        simulator.AdvanceTo(context.get_time() + PERIOD)
        seen.append(tare.GetOutputPort("spread").Eval(context).tolist())
    assert seen[0] == [0.0] * 6
    assert seen[2] == pytest.approx([4.0, 4.0, 0.0, 0.0, 8.0, 0.0])
    assert seen[3] == seen[2]
    assert seen[-1] == pytest.approx([2**0.5, 2**0.5, 0.0, 0.0, 8**0.5, 0.0])


def test_refusals() -> None:
    with pytest.raises(ParameterError, match="period is 0"):
        Tare(period=0.0)
    with pytest.raises(ParameterError, match=r"force is \[nan"):
        runner()((float("nan"), 0.0, 0.0), takes=True)
