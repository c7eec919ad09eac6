"""The cell's error: from two images, from poses, and when it is believed."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.systems.vision.cell_error import (
    CellError,
    CellErrorParams,
    ExpectedError,
    ImageClock,
    ImagePlaneError,
)
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_detection import ContinuityParams, LastSeen, follow

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


U = math.nan


@pytest.mark.parametrize(
    ("xz", "xy", "expected"),
    [
        # Down in the images is down, and to the right of the way.
        ([70.0, 4.0, 0.02], [69.0, 3.0, 0.05], [70.0, -3.0, -4.0, 0.0, 0.02, -0.05]),
        ([U, 4.0, 0.02], [69.0, 3.0, 0.05], [U, -3.0, -4.0, 0.0, 0.02, -0.05]),
        ([70.0, 4.0, 0.02], [U, U, U], [70.0, U, -4.0, 0.0, 0.02, U]),
        ([U, U, U], [69.0, 3.0, 0.05], [U, -3.0, U, U, U, -0.05]),
    ],
)
def test_two_views_tell_of_six_axes(
    xz: list[float], xy: list[float], expected: list[float]
) -> None:
    block = ImagePlaneError()
    context = block.CreateDefaultContext()
    block.GetInputPort("xz_error").FixValue(context, xz)
    block.GetInputPort("xy_error").FixValue(context, xy)
    found = block.GetOutputPort("alignment_error").Eval(context)
    np.testing.assert_array_equal(found, expected)
    assert all(block.HasDirectFeedthrough(i, 0) for i in range(2))


CONTINUITY = ContinuityParams(speed=100.0, turning=1.0, most_jumps=2)
LOST = Detection(status=Status.NO_COLOUR)


def at(u: float, v: float = 50.0, angle: float = 0.0) -> Detection:
    return Detection(status=Status.VALID, tip=(u, v), angle=angle, point=(u - 40, v))


def hidden(u: float, v: float) -> Detection:
    return Detection(status=Status.OCCLUDED, angle=0.0, point=(u, v))


@pytest.mark.parametrize(
    ("found", "believed"),
    [
        ([at(0), at(9.9), at(19.5), at(10)], "yyyy"),  # 10 pixels in 0.1 s
        ([at(0), at(10.5)], "yn"),
        ([at(0), at(0, angle=0.09), at(0, angle=0.2)], "yyn"),
        ([at(0, angle=math.pi - 0.01), at(0, angle=0.01 - math.pi)], "yy"),
        ([at(0), LOST, at(19)], "y-y"),  # the longer it was lost the farther it may be
        ([at(0), LOST, at(23)], "y-n"),
        ([at(0), *[at(90)] * 4], "ynnyy"),  # what stays is believed again
        ([at(0), at(90), at(0), at(90), at(90), at(90)], "ynynny"),
        ([at(0), hidden(80, 55)], "yy"),  # of a hidden tip the way across counts
        ([at(0), hidden(-40, 65)], "yn"),
    ],
)
def test_what_is_believed_moves_no_faster_than_it_can(
    found: list[Detection], believed: str
) -> None:
    last, said = LastSeen(), ""
    for k, one in enumerate(found):
        last, seen = follow(last, one, k * 0.1, CONTINUITY)
        said += {Status.JUMPED: "n", Status.NO_COLOUR: "-"}.get(seen.status, "y")
    assert said == believed


class ShownLoop:
    """A cell error at 10 Hz that is shown one measurement after the other."""

    def __init__(self, **params: Any) -> None:
        self.block = CellError(
            CellErrorParams(gap=0.0, period=0.1, continuity=CONTINUITY, **params)
        )
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()

    def see(self, y: float, pitch: float = 0.0) -> bool:
        """Return whether it is believed, then go on to the next one."""
        error = [70.0, y, 0.0, 0.0, pitch, 0.0]
        self.block.GetInputPort("alignment_error").FixValue(self.context, error)
        valid = self.block.GetOutputPort("valid").Eval(self.context)[0]
        self.simulator.AdvanceTo(self.context.get_time() + 0.1)
        return bool(valid)

    @property
    def blind(self) -> bool:
        return bool(self.block.GetOutputPort("blind").Eval(self.context)[0])


def test_the_loop_misses_a_jump_and_believes_it_if_it_stays() -> None:
    loop = ShownLoop()
    assert [loop.see(y) for y in (0, 9, 18, 60, 18, 60, 60, 60, 60)] == [
        *(True, True, True, False, True),
        *(False, False, True, True),
    ]
    assert [loop.see(60, pitch) for pitch in (0.09, 0.5, 0.09)] == [True, False, True]
    assert not loop.blind


@pytest.mark.parametrize("most_misses", [1, 2])
def test_a_jump_that_stays_makes_nobody_blind(most_misses: int) -> None:
    loop = ShownLoop(most_misses=most_misses)
    assert [loop.see(y) for y in (0, *[60] * 4)] == [
        True,
        *[k >= most_misses for k in range(4)],
    ]
    assert not loop.blind
