import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from chamfer.diagrams.servo.compiled_loop import compensate
from chamfer.systems.servo.compensator import TrajectoryCompensator
from chamfer.systems.servo.compensator_law import (
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


class Driven:
    """A compensator block that is fed one measurement per tick."""

    def __init__(self, *axes: AxisParams, end_time: float = math.inf) -> None:
        self.block = TrajectoryCompensator(
            CompensatorParams(axes=axes, period=PERIOD, end_time=end_time)
        )
        self.simulator = Simulator(self.block)
        self.context = self.simulator.get_mutable_context()
        self.ticks = 0

    def tick(self, *errors: float, **others: Sequence[float]) -> None:
        """Feed the next tick and run it."""
        for name, value in {"error": errors, **others}.items():
            self.block.GetInputPort(name).FixValue(self.context, value)
        self.simulator.AdvanceTo(self.ticks * PERIOD)
        self.simulator.AdvancePendingEvents()
        self.ticks += 1

    def read(self, port: str) -> list[float]:
        values: list[float] = self.block.GetOutputPort(port).Eval(self.context).tolist()
        return values

    @property
    def state(self) -> str:
        return self.block.chart.state_names[int(self.read("state")[0])]

    @property
    def axis_states(self) -> list[str]:
        return [self.block.axis_chart.state_names[int(i)] for i in self.read("axis_state")]


def test_one_error_outside_its_dead_zone_is_enough() -> None:
    driven = Driven(AXIS, replace(AXIS, dead_zone=0.5))
    driven.tick(-0.2, 0.2)
    assert driven.state == "modify_compensation"
    assert driven.axis_states == ["remove_small", "aligned"]
    assert driven.read("increment") == [-0.125, 0.0]
    assert driven.read("compensation") == [-0.125, 0.0]


@pytest.mark.parametrize(
    ("errors", "valid"),
    [
        ((2.0, 2.0), 0.49),
        ((math.nan, 2.0), 1.0),
        ((2.0, math.nan), 1.0),
        ((math.inf, 2.0), 1.0),
        ((-math.inf, 0.0), 1.0),
    ],
)
def test_holds_every_axis_without_a_valid_measurement(
    errors: tuple[float, float], valid: float
) -> None:
    driven = Driven(AXIS, AXIS)
    driven.tick(2.0, -0.5, valid=[1.0], desired_trajectory=[5.0, 6.0])
    for goal in (7.0, 8.0):
        driven.tick(*errors, valid=[valid], desired_trajectory=[goal, -goal])
        assert driven.state == "hold"
        assert driven.read("increment") == [0.0, 0.0]
        assert driven.read("compensation") == [0.5, -0.125]
        assert driven.axis_states == ["add_large", "remove_small"]
        assert driven.read("command") == [goal + 0.5, -goal - 0.125]


def test_nothing_changes_after_the_end_of_the_trajectory() -> None:
    driven = Driven(AXIS, end_time=0.5)
    for goal in (1.0, 2.0, 3.0, 4.0):
        driven.tick(2.0, desired_trajectory=[goal])
    assert driven.state == "trajectory_ended"
    assert driven.block.chart.state("trajectory_ended").outcome == "done"
    assert driven.read("compensation") == [1.0]
    assert driven.read("increment") == [0.0]
    assert driven.read("command") == [3.0 + 1.0]
    assert [record.label for record in driven.block.transitions(driven.context)][1:] == [
        "trajectory ended"
    ]


@pytest.mark.parametrize("error", [2.0, 0.0, math.nan], ids=["modify", "aligned", "hold"])
@pytest.mark.parametrize("goal", [math.nan, math.inf])
def test_desired_trajectory_that_is_not_finite_raises(error: float, goal: float) -> None:
    driven = Driven(AXIS)
    driven.tick(error, desired_trajectory=[1.0])
    with pytest.raises(
        ValueError, match=rf"^desired_trajectory is \({goal},\) at t = 0\.25 s, must be finite$"
    ):
        driven.tick(error, desired_trajectory=[goal])


def test_nothing_passes_through_between_ticks() -> None:
    block = TrajectoryCompensator(CompensatorParams(axes=(AXIS,) * 3))
    assert not block.HasAnyDirectFeedthrough()


@pytest.mark.parametrize(("period", "end_time"), [(1 / 30, 3.7), (1 / 80, 1.0), (0.1, 0.3)])
def test_the_trajectory_ends_at_the_tick_of_its_end_time(period: float, end_time: float) -> None:
    chart = make_compensator_chart(
        CompensatorParams(axes=(AXIS,), period=period, end_time=end_time)
    )
    snapshot, last = chart.start(), round(end_time / period)
    for i in range(last + 1):
        assert snapshot.state != "trajectory_ended"
        snapshot, _ = chart.step(snapshot, CompensatorInputs((0.0,), None, None), i * period)
    assert snapshot.state == "trajectory_ended"


def run_axis(params: AxisParams, errors: Sequence[float]) -> list[tuple[str, AxisMemory]]:
    """Run the chart of Fig. 4; return (state, memory) after each tick."""
    chart = make_axis_chart(params)
    snapshot, results = chart.start(), []
    for i, error in enumerate(errors):
        snapshot, _ = chart.step(snapshot, error, i * PERIOD)
        results.append((snapshot.state, snapshot.memory))
    return results


THRESHOLDS = (0.125, 1.0)
TIES = [
    sign * near
    for sign in (-1, 1)
    for edge in THRESHOLDS
    for near in (edge, math.nextafter(edge, 0), math.nextafter(edge, math.inf))
]
ERRORS = st.lists(st.sampled_from([0.0, *TIES]) | st.floats(-3, 3), min_size=1, max_size=60)
AXES = st.builds(
    replace,
    st.just(AXIS),
    increment=st.floats(0.01, 2.0),
    divider=st.floats(1.0, 20.0),
    limit=st.floats(0.1, 5.0) | st.just(math.inf),
)


@settings(deadline=None)
@given(axis=AXES, errors=ERRORS)
def test_law_of_one_axis(axis: AxisParams, errors: list[float]) -> None:
    total = 0.0
    for error, (state, memory) in zip(errors, run_axis(axis, errors), strict=True):
        size, name = axis.increment, "large"
        if abs(error) < 1.0:
            size, name = axis.increment / axis.divider, "small"
        if abs(error) < 0.125:
            size, name = 0.0, ""
        assert state == (f"{'add' if error > 0 else 'remove'}_{name}" if name else "aligned")
        assert memory.increment == math.copysign(size, error)
        total = float(np.clip(total + memory.increment, -axis.limit, axis.limit))
        assert memory.compensation == total


TICKS = st.lists(
    st.sampled_from([0.0, *TIES, math.nan, math.inf, -math.inf]) | st.floats(-3, 3),
    min_size=1,
    max_size=40,
)


@settings(deadline=None)  # the first call compiles
@given(axis=AXES, errors=TICKS, large_error=st.sampled_from(THRESHOLDS))
def test_a_tick_is_that_of_the_charts(
    axis: AxisParams, errors: list[float], large_error: float
) -> None:
    axis = replace(axis, large_error=large_error)
    chart = make_compensator_chart(CompensatorParams(axes=(axis,)))
    snapshot, total = chart.start(), 0.0
    settings = axis.dead_zone, large_error, axis.increment, axis.divider, axis.limit
    for i, error in enumerate(errors):
        snapshot, _ = chart.step(snapshot, CompensatorInputs((error,), None, None), i / 80)
        total, asked = compensate(total, error, *settings)
        assert (total, asked) == snapshot.memory.axes[0].memory
