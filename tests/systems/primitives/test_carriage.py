"""What a carriage grips and carries, and the guard of its plant."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from chamfer.models.arms.wrist import tip_pose
from chamfer.models.validation import ParameterError
from chamfer.systems.pose import pose_from_vector
from chamfer.systems.primitives.carriage import (
    SIZE,
    CarriedPoses,
    DivergenceGuard,
    PartGripper,
    PartGripperParams,
    PoseDisplacement,
    TrueMotion,
    add_gripper,
)


def test_things_are_carried_in_their_places() -> None:
    carried = {
        "plug": RigidTransform([0.0, 0.0, -0.04]),
        "camera": RigidTransform(RollPitchYaw(3.1, 0.0, 0.2), [0.1, 0.0, 0.2]),
    }
    block = CarriedPoses(carried)
    context: Any = block.CreateDefaultContext()
    displacement = np.array([0.1, -0.2, 0.3, 0.01, 0.02, 0.03])
    block.GetInputPort("displacement").FixValue(context, displacement)
    for name, X_EB in carried.items():
        found = pose_from_vector(block.GetOutputPort(f"{name}_pose").Eval(context))
        assert found.IsNearlyEqualTo(tip_pose(displacement) @ X_EB, 1e-9)
    with pytest.raises(ParameterError, match=r"^carried is \{\}, allowed: one thing or more$"):
        CarriedPoses({})


def within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit)


@given(
    st.tuples(*[within(1.4)] * 2, within(3.1), *[within(2.0)] * 3),
    st.sampled_from([1.0, -1.0]),
)
def test_displacement_is_carried_poses_undone(
    displacement: tuple[float, ...], sign: float
) -> None:
    carried = CarriedPoses({"tool": RigidTransform()})
    context: Any = carried.CreateDefaultContext()
    carried.GetInputPort("displacement").FixValue(context, list(displacement))
    pose = np.array(carried.GetOutputPort("tool_pose").Eval(context))
    pose[:4] *= sign  # a quaternion and its opposite are one turn
    undone = PoseDisplacement()
    context = undone.CreateDefaultContext()
    undone.GetInputPort("pose").FixValue(context, pose)
    found = undone.GetOutputPort("displacement").Eval(context)
    np.testing.assert_allclose(found, displacement, atol=1e-9)


def test_true_motion_is_that_of_the_body_in_a_plant() -> None:
    motions = np.random.default_rng(3).uniform(-1, 1, (2, 2, 6))
    block = TrueMotion(BodyIndex(1))
    context = block.CreateDefaultContext()
    poses = [tip_pose(displacement) for displacement, _ in motions]
    velocities = [SpatialVelocity(w=velocity[:3], v=velocity[3:]) for _, velocity in motions]
    for name, values in (("body_poses", poses), ("body_velocities", velocities)):
        block.GetInputPort(name).FixValue(context, AbstractValue.Make(values))
    found = block.GetOutputPort("motion").Eval(context)
    np.testing.assert_allclose(found, motions[1].ravel(), atol=1e-12)


Array = NDArray[np.float64]
PERIOD = 0.01  # s
PARAMS = PartGripperParams(reach=0.004, period=PERIOD)
RATE = np.arange(1.0, 7.0)
RESTING = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])


class Bench:
    """A gripper whose carriage and command are set by hand."""

    def __init__(self, **fields: Any) -> None:
        builder = DiagramBuilder()
        carriage, closed = (builder.AddSystem(PassThrough(size)) for size in (2 * SIZE, 1))
        added = add_gripper(
            builder,
            PartGripper(PARAMS, **{"resting": RESTING, **fields}),
            carriage=carriage.get_output_port(),
            closed=closed.get_output_port(),
        )
        builder.ExportInput(carriage.get_input_port(), "carriage")
        builder.ExportInput(closed.get_input_port(), "closed")
        builder.ExportOutput(added.part, "part")
        builder.ExportOutput(added.holding, "holding")
        self.block = builder.Build()
        self.simulator = Simulator(self.block)
        self.context: Context = self.simulator.get_mutable_context()

    def tick(self, carriage: Array, *, closed: bool) -> None:
        """Hand on what is told to the block's next tick."""
        self.set(carriage, closed=closed)
        self.simulator.AdvanceTo(self.context.get_time() + PERIOD)
        self.simulator.AdvancePendingEvents()

    def set(self, carriage: Array, *, closed: bool) -> None:
        carried = np.concatenate([carriage, RATE])
        self.block.GetInputPort("carriage").FixValue(self.context, carried)
        self.block.GetInputPort("closed").FixValue(self.context, [float(closed)])

    @property
    def part(self) -> Array:
        found: Array = self.block.GetOutputPort("part").Eval(self.context).copy()
        return found

    @property
    def holding(self) -> bool:
        return bool(self.block.GetOutputPort("holding").Eval(self.context)[0])


def beside(distance: float, direction: tuple[float, float, float] = (0.6, 0.0, 0.8)) -> Array:
    """A carriage at a distance of the part, turned."""
    return RESTING + np.array([0.05, -0.02, 0.01, *(distance * np.array(direction))])


def test_a_part_rests_until_it_is_gripped_then_moves_as_it_was_gripped() -> None:
    bench = Bench()
    bench.tick(beside(0.003), closed=False)
    assert not bench.holding
    np.testing.assert_array_equal(bench.part, [*RESTING, *np.zeros(SIZE)])
    bench.tick(beside(0.003), closed=True)
    assert bench.holding
    np.testing.assert_allclose(bench.part, [*RESTING, *RATE])
    way = np.array([0.1, 0.0, -0.1, 0.5, 0.25, -0.5])
    bench.set(beside(0.003) + way, closed=True)
    np.testing.assert_allclose(bench.part, [*(RESTING + way), *RATE])


def test_a_part_that_is_let_go_rests_where_it_is_and_may_be_gripped_again() -> None:
    bench = Bench(offset=np.full(SIZE, 0.001))
    assert bench.holding
    there = RESTING + 1.0
    bench.tick(there, closed=True)
    bench.tick(there, closed=False)
    assert not bench.holding
    bench.set(there + 5.0, closed=False)
    np.testing.assert_allclose(bench.part, [*(there + 0.001), *np.zeros(SIZE)])
    bench.tick(there + 5.0, closed=True)
    assert not bench.holding
    bench.tick(there, closed=True)  # what is closed grips nothing
    assert not bench.holding
    bench.tick(there, closed=False)
    bench.tick(there, closed=True)
    assert bench.holding
    np.testing.assert_allclose(bench.part[:SIZE], there + 0.001)


@settings(deadline=None, max_examples=30)
@given(
    distance=st.sampled_from([0.0, 0.00399, 0.00401, 1.0]),
    angle=st.floats(0, 2 * math.pi),
    height=st.floats(-1, 1),
    turn=st.floats(-3, 3),
)
def test_what_is_within_reach_is_gripped(
    distance: float, angle: float, height: float, turn: float
) -> None:
    across = math.sqrt(1 - height**2)
    direction = across * math.cos(angle), across * math.sin(angle), height
    bench = Bench()
    bench.tick(beside(distance, direction) + turn * np.eye(SIZE)[0], closed=True)
    assert bench.holding == (distance < 0.004)


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
    guard = DivergenceGuard("arm", limits={"force": (2, 100.0), "place": (1, 1.0)}, period=0.1)
    simulator = Simulator(guard)
    context = simulator.get_mutable_context()
    guard.GetInputPort("force").FixValue(context, [1.0, force])
    guard.GetInputPort("place").FixValue(context, [place])
    context.SetTime(0.25)
    with pytest.raises(ParameterError) as refused:
        simulator.AdvanceTo(0.5)
    expected = f"simulation failed: {name} of the arm at 0.3 s {said}, it diverges"
    assert str(refused.value).startswith(expected)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Bench(resting=np.zeros(5)), "resting is .*, allowed: six finite numbers$"),
        (lambda: Bench(offset=np.full(6, math.inf)), "offset is .*, allowed: six finite numbers$"),
    ],
)
def test_refuses(make: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}"):
        make()
