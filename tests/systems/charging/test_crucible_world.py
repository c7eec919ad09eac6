"""What the gripper holds, how far a layer is pushed, and when a fault acts."""

import numpy as np
import pytest

from chamfer.systems.charging.crucible_world import (
    CutOff,
    FaultTrigger,
    Grasp,
    GraspParams,
    LayerMotion,
)

NEAR, AWAY = -1e-4, 1.0  # m, gaps to the item


@pytest.mark.parametrize(
    ("present", "steps"),
    [
        # Held from closing on it to opening.
        ([1, 1], [(0, NEAR, 1, 0, 2), (1, NEAR, 1, 0, 3), (1, AWAY, 1, 0, 3), (0, AWAY, 1, 0, 2)]),
        # Fingers that closed beside it stay empty.
        ([1], [(1, 0.1, 0, 0, 0), (1, NEAR, 0, 0, 0)]),
        # What is not there is not held.
        ([1, 0], [(1, NEAR, 1, 0, 2)]),
        # Behind the plan's end the last item stays.
        ([0, 1], [(1, NEAR, 2, 0, 3)]),
        # What is dropped stays lost.
        ([1], [(1, NEAR, 0, 0, 1), (1, AWAY, 0, 1, 0), (1, AWAY, 0, 0, 0)]),
    ],
)
def test_the_gripper_holds_what_it_closed_on(
    present: list[int], steps: list[tuple[float, ...]]
) -> None:
    grasp = Grasp(GraspParams(), tuple(map(bool, present)), contacts=6)
    context = grasp.CreateDefaultContext()
    for grip, gap, item, drop, scene in steps:
        for name, value in (("grip", [grip]), ("item", [item]), ("drop", [drop])):
            grasp.GetInputPort(name).FixValue(context, value)
        grasp.GetInputPort("contact").FixValue(context, np.array([gap, *5 * [0.0]]))
        context.SetDiscreteState(grasp.EvalUniquePeriodicDiscreteUpdate(context))
        assert grasp.GetOutputPort("scene").Eval(context).tolist() == [scene]
        assert grasp.GetOutputPort("held").Eval(context)[0] == scene % 2


STEP = 0.001  # s


def pushed(force: tuple[float, float, float], seconds: float) -> np.ndarray:
    """Return the shift under a constant force of the arm on the layer."""
    layer = LayerMotion(stiffness=1e4, mass=0.1, friction=0.5, period=STEP)
    context = layer.CreateDefaultContext()
    layer.GetInputPort("force").FixValue(context, [-one for one in force])
    layer.GetInputPort("item").FixValue(context, [0.0])
    for _ in range(round(seconds / STEP)):
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
