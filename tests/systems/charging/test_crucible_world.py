"""What the gripper holds, how far a layer is pushed, and when a fault acts."""

import numpy as np
import pytest
from pydrake.systems.framework import Context

from chamfer.systems.charging.crucible_world import (
    CutOff,
    FaultTrigger,
    Grasp,
    GraspParams,
    LayerMotion,
    LayerMotionParams,
)


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


def test_fingers_that_closed_beside_it_stay_empty() -> None:
    assert play(make(True), [(1, 0.1, 0, 0), (1, -1e-4, 0, 0)]) == [(0, 0), (0, 0)]


def test_what_is_not_there_is_not_held() -> None:
    assert play(make(False), [(1, -1e-4, 0, 0)]) == [(0, 0)]


def test_what_is_dropped_stays_lost() -> None:
    steps = [(1, -1e-4, 0, 0), (1, 1.0, 0, 1), (1, 1.0, 0, 0)]
    assert play(make(True), steps) == [(1, 1), (0, 0), (0, 0)]


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


def test_fault_acts_once_and_after_its_delay() -> None:
    trigger = FaultTrigger((3, 1), delay=0.01, lasting=0.015, period=0.005)
    context = trigger.CreateDefaultContext()
    active = []
    for state, item in [(3, 0), (2, 1), *3 * [(3, 1)], *5 * [(4, 1)], *4 * [(3, 1)]]:
        trigger.GetInputPort("state").FixValue(context, [float(state)])
        trigger.GetInputPort("item").FixValue(context, [float(item)])
        context.SetDiscreteState(trigger.EvalUniquePeriodicDiscreteUpdate(context))
        active.append(trigger.GetOutputPort("active").Eval(context)[0])
    assert active == [0, 0, 0, 0, 1, 1, 1, *7 * [0]]


def test_a_cut_line_reads_nothing() -> None:
    line = CutOff(2)
    context = line.CreateDefaultContext()
    line.GetInputPort("signal").FixValue(context, [1.0, -2.0])
    for cut, reading in ((0.0, [1.0, -2.0]), (1.0, [0.0, 0.0])):
        line.GetInputPort("cut").FixValue(context, [cut])
        assert line.GetOutputPort("reading").Eval(context).tolist() == reading
        assert line.GetOutputPort("alive").Eval(context)[0] == 1 - cut
