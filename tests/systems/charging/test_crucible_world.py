"""What the gripper holds, how far a layer is pushed, and when a fault acts."""

import math

import numpy as np
import pytest

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.systems.charging.crucible_world import (
    CutOff,
    FaultTrigger,
    Grasp,
    GraspParams,
    LaidContact,
    LayerMotion,
)
from chamfer.systems.contact.arm_dynamics import GRAVITY

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


LOOSE = LaidContact(
    mass=0.05, slip_friction=0.2, friction=SurfaceFriction(coefficient=0.4), damping=0.0
)
UP = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("push", "slope", "coefficient"),
    [
        # On a flat the lower one holds 0.2 (N + 0.05 kg g); where that is more, the upper slides.
        (2.0, 0.0, 0.2 * (2.0 + 0.05 * GRAVITY) / 2.0),
        (0.4, 0.0, 0.4),
        (0.0, 0.0, 0.4),
        # Down a slope of 0.1 rad that much less, and on a steep one nothing.
        (2.0, 0.1, math.tan(math.atan(0.2 * (2.0 + 0.05 * GRAVITY) / 2.0) - 0.1)),
        (2.0, 0.5, 0.0),
    ],
)
def test_the_weaker_of_two_frictions_gives(push: float, slope: float, coefficient: float) -> None:
    normal = np.array([math.sin(slope), 0.0, math.cos(slope)])
    found = LOOSE.coefficient(np.zeros(3), push * normal, normal)
    assert found == pytest.approx(coefficient, rel=1e-12)


def test_the_layer_goes_with_the_nugget_only_where_it_gives_way() -> None:
    layer = LayerMotion(LOOSE, period=0.001)
    context = layer.CreateDefaultContext()
    holds = 0.2 * (1.0 + 0.05 * GRAVITY)
    x, shifts = 0.5, []
    for across, up, item in [
        *[(holds, 1.0, 0.0)] * 3,  # it gives way, from the second on by what the tip moves
        (0.9 * holds, 1.0, 0.0),  # what slides is the upper nugget
        (holds, 0.0, 0.0),  # nothing is touched
        (holds, 1.0, 1.0),  # another place
    ]:
        x += 1e-4
        values = {"force": across * np.eye(3)[0] + up * UP, "tip": [x, 0.0, 0.4], "item": [item]}
        for name, value in values.items():
            layer.GetInputPort(name).FixValue(context, value)
        context.SetDiscreteState(layer.EvalUniquePeriodicDiscreteUpdate(context))
        shifts.append(layer.GetOutputPort("shift").Eval(context)[0])
    assert np.diff(shifts) == pytest.approx([1e-4, 1e-4, 0.0, 0.0, -shifts[4]], abs=1e-12)


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
