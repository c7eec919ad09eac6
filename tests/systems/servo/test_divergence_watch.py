"""When an error that grows is told, and when one that does not."""

import math
from collections.abc import Sequence

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from chamfer.systems.servo.divergence_watch import DivergenceParams, DivergenceWatch, Watched

PARAMS = DivergenceParams(watched=(Watched((0, 1), 2.0), Watched((2,), 0.1)), size=3, period=1.0)


def told_at(
    errors: Sequence[Sequence[float]],
    valid: Sequence[float] | None = None,
    params: DivergenceParams = PARAMS,
) -> int | None:
    """Return after which error it is told, and check what goes through until then."""
    block = DivergenceWatch(params)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    ports = {name: block.GetInputPort(name) for name in ("error", "valid")}
    found = None
    for k, error in enumerate(errors):
        ports["error"].FixValue(context, np.asarray(error, np.float64))
        ports["valid"].FixValue(context, [1.0 if valid is None else valid[k]])
        simulator.AdvanceTo(k + 0.5)
        told = block.GetOutputPort("diverged").Eval(context)[0]
        through = not told and (valid is None or valid[k])
        assert block.GetOutputPort("valid").Eval(context)[0] == float(through)
        assert block.GetOutputPort("stop").Eval(context)[0] == told
        if told and found is None:
            found = k
        assert not (found is not None and not told)  # for good
    return found


def test_an_error_that_grows_is_told_once_it_has_been_too_large_for_some_frames() -> None:
    errors = [(10.0 + k, 0.0, 0.0) for k in range(20)]
    assert told_at(errors) == 6 + 4  # more than 15 from the sixth on, five in a row


def test_the_size_of_axes_together_counts_not_where_they_point() -> None:
    turning = [(10 * math.cos(k), 10 * math.sin(k), 0.0) for k in range(40)]
    assert told_at(turning) is None
    assert told_at([(3.0, 4.0, 0.0), *[(5.0, 6.0, 0.0)] * 5]) == 5
    assert told_at([(3.0, 4.0, 0.0), *[(4.2, 6.1, 0.0)] * 5]) is None


def test_small_starts_may_grow() -> None:
    assert told_at([(0.0, 0.0, 0.0), *[(2.9, 0.0, 0.14)] * 30]) is None
    assert told_at([(0.0, 0.0, 0.0), *[(3.1, 0.0, 0.0)] * 30]) == 5


def test_some_wrong_frames_and_some_without_a_measurement_say_nothing() -> None:
    wrong = [*[(10.0, 0.0, 0.0)] * 16, *[(90.0, 0.0, 0.0)] * 4]
    assert told_at(wrong * 5) is None
    # What is not valid is not looked at, neither as a start nor later.
    missing = [0.0, *[1.0, 0.0] * 20]
    errors = [(0.0, 0.0, 0.0), *[(10.0, 0.0, 0.0), (99.0, 0.0, 0.0)] * 20]
    assert told_at(errors, missing) is None


def test_an_error_that_swings_is_told_at_its_peaks() -> None:
    swings = [(10 * 1.05**k * math.cos(k), 0.0, 0.0) for k in range(60)]
    told = told_at(swings)
    assert told is not None
    assert max(abs(one[0]) for one in swings[:told]) < 30
    assert told_at([(10 * math.cos(k), 0.0, 0.0) for k in range(60)]) is None


@settings(max_examples=50, deadline=None)
@given(
    start=st.floats(0.1, 100.0),
    shrinks=st.floats(0.8, 1.0),
    noise=st.lists(st.floats(-0.3, 0.3), min_size=60, max_size=60),
)
def test_what_shrinks_is_never_told(start: float, shrinks: float, noise: list[float]) -> None:
    errors = [(start * shrinks**k + one, 0.0, 0.0) for k, one in enumerate(noise)]
    assert told_at(errors) is None


def told_blind(errors: Sequence[float], valid: Sequence[float], blind_from: int) -> int | None:
    """Return in which frame it is told where the cameras are blind from one on."""
    block = DivergenceWatch(PARAMS)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    for k, (error, one) in enumerate(zip(errors, valid, strict=True)):
        block.GetInputPort("error").FixValue(context, [error, 0.0, 0.0])
        block.GetInputPort("valid").FixValue(context, [one])
        block.GetInputPort("blind").FixValue(context, [float(k >= blind_from)])
        simulator.AdvanceTo(k + 0.5)
        if block.GetOutputPort("diverged").Eval(context)[0]:
            return k
    return None


def test_what_gets_lost_while_its_error_grows_is_told_once_it_is_blind() -> None:
    lost = [0.0] * 5
    assert told_blind([10.0, 20.0, *lost], [1.0, 1.0, *lost], blind_from=5) == 5
    # One that was taken back says nothing, nor does a loss alone.
    assert told_blind([10.0, 20.0, 10.0, *lost], [1.0] * 3 + lost, blind_from=5) is None
    assert told_blind([10.0, 10.0, *lost], [1.0, 1.0, *lost], blind_from=5) is None
    assert told_blind(lost, lost, blind_from=0) is None


def test_what_is_seen_again_is_told_by_a_single_frame_that_has_grown() -> None:
    seen = [1.0, 0.0, 0.0, 1.0, 1.0]
    assert told_blind([10.0, 0.0, 0.0, 14.0, 16.0], seen, blind_from=2) == 4
    assert told_blind([10.0, 0.0, 0.0, 14.0, 14.0], seen, blind_from=2) is None


def test_blind_stops_too() -> None:
    block = DivergenceWatch(PARAMS)
    context = block.CreateDefaultContext()
    block.GetInputPort("blind").FixValue(context, [1.0])
    assert block.GetOutputPort("stop").Eval(context)[0] == 1
    assert block.GetOutputPort("diverged").Eval(context)[0] == 0
