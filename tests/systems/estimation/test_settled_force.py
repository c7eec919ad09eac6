"""The force is hidden while an impact fades, and at no other time."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.surface_observer import SettledForce
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST

PERIOD = 0.25  # binary, so that the ticks' times are exact


def test_hidden_at_the_begin_of_each_contact() -> None:
    block = SettledForce(2 * PERIOD, dimension=2, period=PERIOD)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("measured_force").FixValue(context, [1.0, 2.0])
    block.GetInputPort("measured_force_rate").FixValue(context, [3.0, 4.0])
    modes = [APPROACH, CONTACT, CONTACT, CONTACT, LOST, CONTACT, CONTACT, CONTACT, CONTACT]
    shown = []
    for k, mode in enumerate(modes):
        block.GetInputPort("mode").FixValue(context, float(mode))
        simulator.AdvanceTo(k * PERIOD) if k else None
        force = block.GetOutputPort("settled_force").Eval(context)
        rate = block.GetOutputPort("settled_force_rate").Eval(context)
        assert list(rate) in ([3.0, 4.0], [0.0, 0.0])
        assert bool(np.any(force)) == bool(np.any(rate))
        shown.append(bool(np.any(force)))
        simulator.AdvancePendingEvents()
    assert shown == [True, False, False, True, True, False, False, True, True]


@pytest.mark.parametrize("wait", [-1.0, np.nan, np.inf])
def test_refusals(wait: float) -> None:
    with pytest.raises(ParameterError, match=r"^wait is .*, allowed: a finite number >= 0$"):
        SettledForce(wait, dimension=2, period=PERIOD)
