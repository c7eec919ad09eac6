"""The guard that stops a simulation which diverges."""

import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.carriage import DivergenceGuard


def guarded(force: float, place: float) -> Simulator:
    guard = DivergenceGuard("arm", limits={"force": (2, 100.0), "place": (1, 1.0)}, period=0.1)
    simulator = Simulator(guard)
    guard.GetInputPort("force").FixValue(simulator.get_mutable_context(), [1.0, force])
    guard.GetInputPort("place").FixValue(simulator.get_mutable_context(), [place])
    return simulator


def test_what_is_within_its_limits_goes_on() -> None:
    simulator = guarded(-100.0, 1.0)
    simulator.AdvanceTo(0.5)
    assert simulator.get_context().get_time() == 0.5


@pytest.mark.parametrize(
    ("force", "place", "name", "said"),
    [
        (-101.0, 0.0, "force", "is -101.0, allowed: at most 100"),
        (math.nan, 0.0, "force", "is nan, allowed: at most 100"),
        (0.0, np.inf, "place", "is inf, allowed: at most 1"),
    ],
)
def test_what_diverges_is_told_with_plant_time_and_value(
    force: float, place: float, name: str, said: str
) -> None:
    simulator = guarded(force, place)
    simulator.get_mutable_context().SetTime(0.25)
    with pytest.raises(ParameterError) as refused:
        simulator.AdvanceTo(0.5)
    expected = f"simulation failed: {name} of the arm at 0.3 s {said}, it diverges"
    assert str(refused.value).startswith(expected)
