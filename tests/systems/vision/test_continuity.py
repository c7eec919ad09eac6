"""What has jumped is refused, and believed if it stays."""

import math
from typing import Any

import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.validation import ParameterError
from chamfer.systems.vision.cell_error import CellError, CellErrorParams
from chamfer.systems.vision.continuity import ContinuityParams, LastSeen, follow
from chamfer.systems.vision.part_detection import Detection, Status

PARAMS = ContinuityParams(speed=100.0, turning=1.0, most_jumps=2)
LOST = Detection(status=Status.NO_COLOUR)


def at(u: float, v: float = 50.0, angle: float = 0.0) -> Detection:
    return Detection(status=Status.VALID, tip=(u, v), angle=angle, point=(u - 40, v))


def followed(*found: Detection, period: float = 0.1) -> list[Status]:
    last, statuses = LastSeen(), []
    for k, one in enumerate(found):
        last, believed = follow(last, one, k * period, PARAMS)
        statuses.append(believed.status)
    return statuses


def test_what_moves_no_faster_than_it_can_is_followed() -> None:
    assert followed(at(0), at(9.9), at(19.5), at(10)) == [Status.VALID] * 4
    assert followed(at(0), at(10.5)) == [Status.VALID, Status.JUMPED]
    assert followed(at(0), at(0, angle=0.09), at(0, angle=0.2))[1:] == [
        Status.VALID,
        Status.JUMPED,
    ]


def test_angles_go_around() -> None:
    assert followed(at(0, angle=math.pi - 0.01), at(0, angle=0.01 - math.pi)) == [Status.VALID] * 2


def test_the_longer_it_was_lost_the_farther_it_may_be() -> None:
    assert followed(at(0), LOST, at(19)) == [Status.VALID, Status.NO_COLOUR, Status.VALID]
    assert followed(at(0), LOST, at(23))[-1] == Status.JUMPED


def test_what_stays_is_believed_again_and_what_comes_back_at_once() -> None:
    far = [at(90)] * 4
    assert followed(at(0), *far) == [
        Status.VALID,
        Status.JUMPED,
        Status.JUMPED,
        Status.VALID,
        Status.VALID,
    ]
    assert followed(at(0), at(90), at(0), at(90), at(90), at(90))[2:] == [
        Status.VALID,
        Status.JUMPED,
        Status.JUMPED,
        Status.VALID,
    ]


def test_of_hidden_tips_the_way_across_counts() -> None:
    def hidden(u: float, v: float) -> Detection:
        return Detection(status=Status.OCCLUDED, angle=0.0, point=(u, v))

    assert followed(at(0), hidden(80, 55))[1] == Status.OCCLUDED
    assert followed(at(0), hidden(-40, 65))[1] == Status.JUMPED


@pytest.mark.parametrize(
    ("name", "value"), [("speed", 0.0), ("turning", -1.0), ("most_jumps", -1)]
)
def test_mistakes_are_named(name: str, value: float) -> None:
    changes: dict[str, Any] = {name: value}
    with pytest.raises(ParameterError, match=f"^{name} is "):
        ContinuityParams(**changes)


class Loop:
    """A cell error at 10 Hz that is shown one measurement after the other."""

    def __init__(self, **params: Any) -> None:
        self.block = CellError(CellErrorParams(gap=0.0, period=0.1, continuity=PARAMS, **params))
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
    loop = Loop()
    assert [loop.see(y) for y in (0, 9, 18, 60, 18, 60, 60, 60, 60)] == [
        *(True, True, True, False, True),
        *(False, False, True, True),
    ]
    assert [loop.see(60, pitch) for pitch in (0.09, 0.5, 0.09)] == [True, False, True]
    assert not loop.blind


@pytest.mark.parametrize("most_misses", [1, 2])
def test_a_jump_that_stays_makes_nobody_blind(most_misses: int) -> None:
    loop = Loop(most_misses=most_misses)
    assert [loop.see(y) for y in (0, *[60] * 4)] == [
        True,
        *[k >= most_misses for k in range(4)],
    ]
    assert not loop.blind
