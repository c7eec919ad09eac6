"""What is left of force and motion beside a wall."""

import numpy as np
import pytest

from chamfer.systems.charging.along_wall import AlongWall


@pytest.mark.parametrize("wall", [(0.0, 0.0, 0.0), (0.6, 0.8, 0.0)])
def test_only_the_wall_s_normal_is_taken_out(wall: tuple[float, float, float]) -> None:
    block, rng = AlongWall(), np.random.default_rng(0)
    context, force, motion = block.CreateDefaultContext(), rng.normal(size=3), rng.normal(size=6)
    for name, value in (("force", force), ("motion", motion), ("wall", np.array(wall))):
        block.GetInputPort(name).FixValue(context, value)
    flat = np.eye(3) - np.outer(wall, wall)
    found = block.GetOutputPort("force_along").Eval(context)
    np.testing.assert_allclose(found, flat @ force, atol=1e-15)
    found = block.GetOutputPort("motion_along").Eval(context)
    np.testing.assert_allclose(found, [*(flat @ motion[:3]), *(flat @ motion[3:])], atol=1e-15)
