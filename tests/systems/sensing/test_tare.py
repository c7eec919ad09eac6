"""Taking a force sensor's zero."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from models.validation import ParameterError
from systems.sensing.tare import Tare

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


def test_refusals() -> None:
    with pytest.raises(ParameterError, match="period is 0"):
        Tare(period=0.0)
    with pytest.raises(ParameterError, match=r"force is \[nan"):
        runner()((float("nan"), 0.0, 0.0), takes=True)
