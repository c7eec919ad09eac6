"""The compensator's chart of one axis, Fig. 4, on sequences of errors."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.servo.compensator import (
    AxisMemory,
    AxisParams,
    CompensatorInputs,
    CompensatorParams,
    make_axis_chart,
    make_compensator_chart,
)

# Binary fractions, so that sums of increments are exact.
AXIS = AxisParams(dead_zone=0.125, large_error=1.0, increment=0.5, divider=4.0)
PERIOD = 0.25


def with_axis(**changes: float) -> AxisParams:
    fields = {name: getattr(AXIS, name) for name in AxisParams.__dataclass_fields__}
    return AxisParams(**{**fields, **changes})


def run_axis(params: AxisParams, errors: Sequence[float]) -> list[tuple[str, AxisMemory]]:
    """Run the chart of Fig. 4; return (state, memory) after each tick."""
    chart = make_axis_chart(params)
    snapshot, results = chart.start(), []
    for i, error in enumerate(errors):
        snapshot, _ = chart.step(snapshot, error, i * PERIOD)
        results.append((snapshot.state, snapshot.memory))
    return results


@pytest.mark.parametrize(
    ("error", "state", "increment"),
    [
        (0.0, "aligned", 0.0),
        (math.nextafter(0.125, 0), "aligned", 0.0),
        (0.125, "add_small", 0.125),
        (math.nextafter(1.0, 0), "add_small", 0.125),
        (1.0, "add_large", 0.5),
        (1e9, "add_large", 0.5),
    ],
)
def test_error_class_decides_the_increment(error: float, state: str, increment: float) -> None:
    mirrored = {"add_small": "remove_small", "add_large": "remove_large"}.get(state, state)
    assert run_axis(AXIS, [error]) == [(state, AxisMemory(increment, increment))]
    assert run_axis(AXIS, [-error]) == [(mirrored, AxisMemory(-increment, -increment))]


@pytest.mark.parametrize("divider", [1.0, 2.0, 4.0, 5.0])
def test_small_error_gets_the_increment_through_the_divider(divider: float) -> None:
    ((_, memory),) = run_axis(with_axis(divider=divider), [0.5])
    assert memory.increment == 0.5 / divider


def test_large_error_may_start_at_the_dead_zone() -> None:
    axis = with_axis(large_error=0.125)
    states = [state for state, _ in run_axis(axis, [0.1, 0.125, -0.125])]
    assert states == ["aligned", "add_large", "remove_large"]


def test_increments_add_up_and_stay() -> None:
    errors = [2.0, 2.0, 0.5, 0.0, -0.5, -2.0, 0.0]
    totals = [memory.compensation for _, memory in run_axis(AXIS, errors)]
    assert totals == [0.5, 1.0, 1.125, 1.125, 1.0, 0.5, 0.5]


def test_total_stops_at_the_limit_and_leaves_it_at_once() -> None:
    errors = [2.0] * 4 + [-2.0] * 7
    memories = [memory for _, memory in run_axis(with_axis(limit=1.25), errors)]
    totals = [memory.compensation for memory in memories]
    assert totals == [0.5, 1.0, 1.25, 1.25, 0.75, 0.25, -0.25, -0.75, -1.25, -1.25, -1.25]
    assert [memory.increment for memory in memories] == [0.5] * 4 + [-0.5] * 7


ERRORS = st.lists(
    st.sampled_from([0.0, 0.125, -0.125, 1.0, -1.0]) | st.floats(-3, 3), min_size=1, max_size=60
)
AXES = st.builds(
    with_axis,
    increment=st.floats(0.01, 2.0),
    divider=st.floats(1.0, 20.0),
    limit=st.floats(0.1, 5.0) | st.just(math.inf),
)


@settings(deadline=None)
@given(axis=AXES, errors=ERRORS)
def test_law_of_one_axis(axis: AxisParams, errors: list[float]) -> None:
    total = 0.0
    for error, (_, memory) in zip(errors, run_axis(axis, errors), strict=True):
        size = 0.0 if abs(error) < 0.125 else axis.increment / axis.divider
        size = axis.increment if abs(error) >= 1.0 else size
        assert memory.increment == math.copysign(size, error)
        total = float(np.clip(total + memory.increment, -axis.limit, axis.limit))
        assert memory.compensation == total


@settings(deadline=None)
@given(axis=AXES, errors=ERRORS)
def test_mirrored_errors_give_mirrored_compensation(axis: AxisParams, errors: list[float]) -> None:
    plain = run_axis(axis, errors)
    mirrored = run_axis(axis, [-error for error in errors])
    assert [(-m.compensation, -m.increment) for _, m in mirrored] == [
        (m.compensation, m.increment) for _, m in plain
    ]


@settings(deadline=None)
@given(offset=st.integers(-4000, 4000), small=st.integers(1, 15), divider=st.integers(1, 6))
def test_static_plant_settles_within_the_theorys_count(
    offset: int, small: int, divider: int
) -> None:
    # Theory, section 2, static plant: n_s <= 2 eps and n_L <= E + eps. In units of 1/128 m, the
    # error half a unit off, so that it never ties with a threshold.
    unit, dead_zone, large_error, large = 1 / 128, 8, 96, small * divider
    axis = AxisParams(
        dead_zone=dead_zone * unit,
        large_error=large_error * unit,
        increment=large * unit,
        divider=divider,
    )
    start = (offset + 0.5) * unit
    allowed = max(0, math.ceil((abs(offset + 0.5) - large_error) / large)) + math.ceil(
        (large_error - dead_zone) / small
    )
    chart = make_axis_chart(axis)
    snapshot, actions = chart.start(), []
    for k in range(allowed + 5):
        error = start - snapshot.memory.compensation
        snapshot, _ = chart.step(snapshot, error, k * PERIOD)
        actions.append(snapshot.memory.increment)
    acted = [action for action in actions if action]
    assert len(acted) <= allowed
    assert all(action * start > 0 for action in acted)
    assert abs(start - snapshot.memory.compensation) < axis.dead_zone
    assert not any(actions[len(acted) :])


@settings(deadline=None)
@given(
    axes=st.lists(AXES, min_size=1, max_size=4),
    data=st.data(),
)
def test_axes_are_independent(axes: list[AxisParams], data: st.DataObject) -> None:
    rows = data.draw(
        st.lists(
            st.tuples(*[st.floats(-3, 3) for _ in axes]),
            min_size=1,
            max_size=30,
        )
    )
    chart = make_compensator_chart(CompensatorParams(axes=tuple(axes), period=PERIOD))
    snapshot, totals = chart.start(), []
    for i, row in enumerate(rows):
        snapshot, _ = chart.step(snapshot, CompensatorInputs(row, None, None), i * PERIOD)
        totals.append([(axis.state, axis.memory) for axis in snapshot.memory.axes])
    alone = [
        run_axis(axis, errors) for axis, errors in zip(axes, zip(*rows, strict=True), strict=True)
    ]
    assert totals == [list(row) for row in zip(*alone, strict=True)]
