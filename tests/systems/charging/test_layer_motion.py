"""How far a layer is pushed."""

import numpy as np
import pytest

from chamfer.systems.charging.crucible_world import LayerMotion, LayerMotionParams

PARAMS = LayerMotionParams(stiffness=1e4, mass=0.1, friction=0.5)


def pushed(force: tuple[float, float, float], seconds: float) -> np.ndarray:
    """Return the shift under a constant force of the arm on the layer."""
    layer = LayerMotion(PARAMS)
    context = layer.CreateDefaultContext()
    layer.GetInputPort("force").FixValue(context, [-one for one in force])
    layer.GetInputPort("item").FixValue(context, [0.0])
    for _ in range(round(seconds / PARAMS.period)):
        context.SetDiscreteState(layer.EvalUniquePeriodicDiscreteUpdate(context))
    return np.array(layer.GetOutputPort("shift").Eval(context))


def test_it_gives_by_the_force_while_friction_holds() -> None:
    holds = 0.5 * (2.0 + 0.1 * 9.81)
    assert pushed((0.99 * holds, 0.0, -2.0), 1.0) == pytest.approx(
        [0.99 * holds / 1e4, 0.0, -2e-4], rel=1e-9
    )


def test_it_slips_as_a_block_on_a_table() -> None:
    holds = 0.5 * (2.0 + 0.1 * 9.81)
    shift = pushed((0.0, holds + 0.1, -2.0), 0.2)
    assert shift[1] - (holds + 0.1) / 1e4 == pytest.approx(1.0 * 0.2**2 / 2, rel=0.01)
