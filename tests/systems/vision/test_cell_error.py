import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.vision.cell_error import CellError, CellErrorParams, ExpectedError, ImageClock

NOTHING = [math.nan] * 6
SEEN = [70.0, -3.0, -4.0, 0.0, 0.02, -0.05]


def fed(block: CellError, error: list[float]) -> Simulator:
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("alignment_error").FixValue(context, error)
    return simulator


def read(block: CellError, simulator: Simulator, name: str) -> list[float]:
    found = block.GetOutputPort(name).Eval(simulator.get_context())
    return [float(value) for value in found]


def test_the_gap_is_to_be_kept_and_round_parts_need_no_roll() -> None:
    block = CellError(CellErrorParams(gap=60.0))
    simulator = fed(block, [70.0, -3.0, -4.0, 0.1, 0.02, -0.05])
    assert read(block, simulator, "error") == pytest.approx([10, -3, -4, 0, 0.02, -0.05])
    assert read(block, simulator, "valid") == [1.0]


@pytest.mark.parametrize("roll", [0.0, math.nan])
def test_a_hidden_tip_leaves_the_way_along_alone(roll: float) -> None:
    block = CellError(CellErrorParams(gap=60.0))
    simulator = fed(block, [math.nan, -3.0, -4.0, roll, 0.02, -0.05])
    assert read(block, simulator, "error") == pytest.approx([0, -3, -4, 0, 0.02, -0.05])
    assert read(block, simulator, "valid") == [1.0]


@pytest.mark.parametrize("missing", [1, 2, 4, 5])
def test_without_one_of_the_others_nothing_is_known(missing: int) -> None:
    block = CellError(CellErrorParams(gap=60.0))
    error = list(SEEN)
    error[missing] = math.nan
    simulator = fed(block, error)
    assert read(block, simulator, "error") == [0.0] * 6
    assert read(block, simulator, "valid") == [0.0]


def test_a_lost_part_is_no_error_grows_old_and_makes_blind_for_good() -> None:
    block = CellError(CellErrorParams(most_misses=2, period=0.25))
    simulator = fed(block, NOTHING)
    assert read(block, simulator, "error") == [0.0] * 6
    assert read(block, simulator, "valid") == [0.0]
    ages, blind = [], []
    for k in range(4):
        simulator.AdvanceTo(0.25 * k + 0.1)
        ages += read(block, simulator, "age")
        blind += read(block, simulator, "blind")
    assert ages == [0.25, 0.5, 0.75, 1.0]
    assert blind == [0.0, 0.0, 1.0, 1.0]
    context = simulator.get_mutable_context()
    block.GetInputPort("alignment_error").FixValue(context, SEEN)
    simulator.AdvanceTo(1.1)
    assert read(block, simulator, "age") == [0.0]
    assert read(block, simulator, "blind") == [1.0]


@pytest.mark.parametrize(
    ("images", "ages"),
    [
        # Two cameras that keep the period, one of them late by one of its periods more.
        ([(0.25, 0.0, 0.25), (0.25, 0.0, 0.5)], [0.25, 0.25, 0.25, 0.25, 0.25]),
        # One of twice the period, or one that exposes 0.1 s after the ticks.
        # What is exposed, or arrives, at a tick is acted on at the next one.
        ([(0.25, 0.0, 0.25), (0.5, 0.0, 0.25)], [0.25, 0.0, 0.25, 0.0, 0.25]),
        ([(0.25, 0.1, 0.5)], [0.15, 0.15, 0.15, 0.15, 0.15]),
        ([(0.25, 0.1, 0.25)], [0.0, 0.0, 0.0, 0.0, 0.0]),
        ([(0.25, 0.0, 0.0)], [0.0, 0.0, 0.0, 0.0, 0.0]),
    ],
)
def test_the_age_is_that_of_the_older_image(
    images: list[tuple[float, float, float]], ages: list[float]
) -> None:
    clocks = tuple(ImageClock(*one) for one in images)
    block = CellError(CellErrorParams(period=0.25, latency=0.5, images=clocks))
    simulator = fed(block, SEEN)
    found = []
    for k in range(4, 9):
        simulator.AdvanceTo(0.25 * k + 0.01)
        found += read(block, simulator, "age")
    assert found == pytest.approx(ages)
    context = simulator.get_mutable_context()
    block.GetInputPort("alignment_error").FixValue(context, NOTHING)
    simulator.AdvanceTo(0.25 * 10 + 0.01)
    assert read(block, simulator, "age") == pytest.approx([ages[-1] + 0.5])


def test_before_it_begins_nothing_counts() -> None:
    block = CellError(CellErrorParams(begin=1.0, period=0.25, most_misses=0))
    simulator = fed(block, NOTHING)
    simulator.AdvanceTo(0.75)
    assert read(block, simulator, "valid") == [0.0]
    assert read(block, simulator, "blind") == [0.0]


def test_what_is_expected_is_no_error() -> None:
    expected = ExpectedError(pixel_size=0.0005, gap=60.0)
    context = expected.CreateDefaultContext()
    expected.GetInputPort("peg_pose").FixValue(context, [1.0, 0, 0, 0, -0.1, 0.01, -0.02])
    expected.GetInputPort("hole_pose").FixValue(context, [1.0, 0, 0, 0, 0.0, 0.0, 0.0])
    found = expected.get_output_port().Eval(context)
    assert found == pytest.approx(np.array([140.0, -20.0, 40.0, 0.0, 0.0, 0.0]))
    block = CellError(CellErrorParams(gap=60.0))
    simulator = fed(block, [200.0, -20.0, 40.0, 0.0, 0.0, 0.0])
    block.GetInputPort("expected_error").FixValue(simulator.get_mutable_context(), found)
    assert read(block, simulator, "error") == pytest.approx([0.0] * 6)


def test_refused() -> None:
    with pytest.raises(ParameterError, match="most_misses is -1"):
        CellErrorParams(most_misses=-1)
    with pytest.raises(ParameterError, match="pixel_size is 0"):
        ExpectedError(pixel_size=0, gap=0.0)
