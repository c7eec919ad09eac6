"""A gripper that takes a part, carries it and lets it rest."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.carriage import SIZE, PartGripper, PartGripperParams, add_gripper

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


def test_between_ticks_nothing_is_gripped() -> None:
    bench = Bench()
    bench.tick(beside(0.001), closed=False)
    bench.set(beside(0.001), closed=True)
    bench.simulator.AdvanceTo(bench.context.get_time() + PERIOD / 2)
    assert not bench.holding
    bench.simulator.AdvanceTo(bench.context.get_time() + PERIOD)
    assert bench.holding


def test_a_part_that_rests_needs_no_carriage_and_one_that_is_held_a_finite_one() -> None:
    bench = Bench()
    broken = np.full(SIZE, math.nan)
    bench.set(broken, closed=False)
    np.testing.assert_array_equal(bench.part[:SIZE], RESTING)
    for bad in (Bench(), Bench(offset=np.zeros(SIZE))):
        with pytest.raises(ParameterError, match=r"^carriage is \[nan.*, allowed: finite numbers"):
            bad.tick(broken, closed=not bad.holding)


@pytest.mark.parametrize("name", ["resting", "offset"])
@pytest.mark.parametrize("value", [np.zeros(5), np.array([0, 0, 0, 0, 0, math.inf]), 1.0])
def test_places_are_six_finite_numbers(name: str, value: Any) -> None:
    with pytest.raises(ParameterError, match=rf"^{name} is .*, allowed: six finite numbers$"):
        Bench(**{name: value})


@pytest.mark.parametrize("name", ["reach", "period"])
@pytest.mark.parametrize("value", [0.0, math.nan])
def test_refuses(name: str, value: float) -> None:
    with pytest.raises(ParameterError) as refused:
        PartGripperParams(**{name: value})
    assert str(refused.value) == f"{name} is {value}, allowed: a finite number > 0"
