"""What the gripper holds."""

import numpy as np
from pydrake.systems.framework import Context

from chamfer.systems.charging.crucible_world import Grasp, GraspParams


def play(
    grasp: Grasp, steps: list[tuple[float, float, float, float]]
) -> list[tuple[float, float]]:
    """Return scene and held after each step of grip, gap, item and drop."""
    context = grasp.CreateDefaultContext()
    return [_step(grasp, context, one) for one in steps]


def _step(
    grasp: Grasp, context: Context, values: tuple[float, float, float, float]
) -> tuple[float, float]:
    grip, gap, item, drop = values
    for name, value in (("grip", [grip]), ("item", [item]), ("drop", [drop])):
        grasp.GetInputPort(name).FixValue(context, value)
    grasp.GetInputPort("contact").FixValue(context, np.array([gap, *5 * [0.0]]))
    update = grasp.EvalUniquePeriodicDiscreteUpdate(context)
    context.SetDiscreteState(update)
    (scene,) = grasp.GetOutputPort("scene").Eval(context)
    (held,) = grasp.GetOutputPort("held").Eval(context)
    return float(scene), float(held)


def make(*present: bool) -> Grasp:
    return Grasp(GraspParams(), present, contacts=6)


def test_item_is_held_from_closing_on_it_to_opening() -> None:
    near, away = -1e-4, 1.0
    steps = [(0, near, 1, 0), (1, near, 1, 0), (1, away, 1, 0), (0, away, 1, 0)]
    assert play(make(True, True), steps) == [(2, 0), (3, 1), (3, 1), (2, 0)]


def test_outputs_are_numbers() -> None:
    assert [make(True).get_output_port(i).size() for i in range(2)] == [1, 1]


def test_fingers_that_closed_beside_it_stay_empty() -> None:
    assert play(make(True), [(1, 0.1, 0, 0), (1, -1e-4, 0, 0)]) == [(0, 0), (0, 0)]


def test_what_is_not_there_is_not_held() -> None:
    assert play(make(False), [(1, -1e-4, 0, 0)]) == [(0, 0)]


def test_what_is_dropped_stays_lost() -> None:
    steps = [(1, -1e-4, 0, 0), (1, 1.0, 0, 1), (1, 1.0, 0, 0)]
    assert play(make(True), steps) == [(1, 1), (0, 0), (0, 0)]
