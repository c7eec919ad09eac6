"""When an error that grows is told, and when one that does not."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from chamfer.systems.servo.divergence_law import DivergenceParams, Watched
from chamfer.systems.servo.divergence_watch import DivergenceWatch

PARAMS = DivergenceParams(watched=(Watched((0, 1), 2.0), Watched((2,), 0.1)), size=3, period=1.0)


def told_at(
    errors: Sequence[Sequence[float]],
    valid: Sequence[float] | None = None,
    blind_from: float = math.inf,
) -> int | None:
    """Return after which error it is told, and check what goes through until then."""
    block = DivergenceWatch(PARAMS)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    found = None
    for k, error in enumerate(errors):
        counts, blind = 1.0 if valid is None else valid[k], k >= blind_from
        padded = np.pad(np.asarray(error, np.float64), (0, 3 - len(error)))
        for name, value in (("error", padded), ("valid", [counts]), ("blind", [float(blind)])):
            block.GetInputPort(name).FixValue(context, value)
        simulator.AdvanceTo(k + 0.5)
        told, through, stop = (
            block.GetOutputPort(name).Eval(context)[0] for name in ("diverged", "valid", "stop")
        )
        assert through == (0.0 if told else counts)
        assert stop == float(told or blind)
        if told and found is None:
            found = k
        assert told or found is None  # for good
    return found


def lost(*before: float) -> tuple[list[tuple[float]], list[float]]:
    """Return errors along the first axis that are seen, and then five that are not."""
    return [(one,) for one in (*before, *[0.0] * 5)], [1.0] * len(before) + [0.0] * 5


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        # More than 15 from the sixth on, five in a row.
        (([(10.0 + k,) for k in range(20)],), 6 + 4),
        # The size of axes together counts, not where they point.
        (([(10 * math.cos(k), 10 * math.sin(k)) for k in range(40)],), None),
        (([(3.0, 4.0), *[(5.0, 6.0)] * 5],), 5),
        (([(3.0, 4.0), *[(4.2, 6.1)] * 5],), None),
        # Small starts may grow.
        (([(0.0,), *[(2.9, 0.0, 0.14)] * 30],), None),
        (([(0.0,), *[(3.1,)] * 30],), 5),
        (([(0.0,), *[(0.0, 0.0, 0.16)] * 30],), 5),
        # Some wrong frames say nothing.
        (([*[(10.0,)] * 16, *[(90.0,)] * 4] * 5,), None),
        # What is not valid is not looked at, neither as a start nor later.
        (([(0.0,), *[(10.0,), (99.0,)] * 20], [0.0, *[1.0, 0.0] * 20]), None),
        # What gets lost while its error grows is told once it is blind.
        ((*lost(10.0, 20.0), 5), 5),
        # One that was taken back says nothing, nor does a loss alone.
        ((*lost(10.0, 20.0, 10.0), 5), None),
        ((*lost(10.0, 10.0), 5), None),
        ((*lost(), 0), None),
        # What is seen again is told by a single frame that has grown.
        (([(10.0,), (0.0,), (0.0,), (14.0,), (16.0,)], [1.0, 0.0, 0.0, 1.0, 1.0], 2), 4),
        (([(10.0,), (0.0,), (0.0,), (14.0,), (14.0,)], [1.0, 0.0, 0.0, 1.0, 1.0], 2), None),
    ],
)
def test_an_error_that_grows_is_told(arguments: Any, told: int | None) -> None:
    assert told_at(*arguments) == told


def test_an_error_that_swings_is_told_at_its_peaks() -> None:
    swings = [(10 * 1.05**k * math.cos(k),) for k in range(60)]
    told = told_at(swings)
    assert told is not None
    assert max(abs(one[0]) for one in swings[:told]) < 30
    assert told_at([(10 * math.cos(k),) for k in range(60)]) is None


@settings(max_examples=50, deadline=None)
@given(
    start=st.floats(0.1, 100.0),
    shrinks=st.floats(0.8, 1.0),
    noise=st.lists(st.floats(-0.3, 0.3), min_size=60, max_size=60),
)
def test_what_shrinks_is_never_told(start: float, shrinks: float, noise: list[float]) -> None:
    assert told_at([(start * shrinks**k + one,) for k, one in enumerate(noise)]) is None


def test_it_takes_no_connected_port_for_blindness() -> None:
    block = DivergenceWatch(PARAMS)
    context = block.CreateDefaultContext()
    block.GetInputPort("error").FixValue(context, [0.0, 0.0, 0.0])
    block.GetInputPort("valid").FixValue(context, [1.0])
    assert block.GetOutputPort("stop").Eval(context)[0] == 0
    block.GetInputPort("blind").FixValue(context, [1.0])
    assert block.GetOutputPort("stop").Eval(context)[0] == 1
