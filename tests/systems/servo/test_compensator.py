"""The compensator: the chart of Fig. 3 on sequences of errors, and the block."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.systems.servo.compensator import (
    AxisParams,
    CompensatorInputs,
    CompensatorParams,
    TrajectoryCompensator,
    make_compensator_chart,
)

# Binary fractions, so that sums of increments are exact.
AXIS = AxisParams(dead_zone=0.125, large_error=1.0, increment=0.5, divider=4.0)
PERIOD = 0.25


def with_axis(**changes: float) -> AxisParams:
    fields = {name: getattr(AXIS, name) for name in AxisParams.__dataclass_fields__}
    return AxisParams(**{**fields, **changes})


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


# Fig. 3: all degrees of freedom


def test_acts_from_the_first_measurement_on() -> None:
    driven = Driven(AXIS)
    driven.tick(2.0)
    assert driven.state == "modify_compensation"
    assert driven.read("compensation") == [0.5]


def test_is_aligned_while_every_error_is_inside_its_dead_zone() -> None:
    driven = Driven(AXIS, with_axis(dead_zone=0.5))
    driven.tick(2.0, 2.0)
    driven.tick(0.12, -0.49)
    assert driven.state == "aligned"
    assert driven.axis_states == ["aligned", "aligned"]
    assert driven.read("increment") == [0.0, 0.0]
    assert driven.read("compensation") == [0.5, 0.5]


def test_one_error_outside_its_dead_zone_is_enough() -> None:
    driven = Driven(AXIS, with_axis(dead_zone=0.5))
    driven.tick(-0.2, 0.2)
    assert driven.state == "modify_compensation"
    assert driven.axis_states == ["remove_small", "aligned"]
    assert driven.read("increment") == [-0.125, 0.0]
    assert driven.read("compensation") == [-0.125, 0.0]


@pytest.mark.parametrize(
    ("errors", "valid"),
    [
        ((2.0, 2.0), 0.0),
        ((2.0, 2.0), 0.49),
        ((0.0, 0.0), 0.0),
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


@pytest.mark.parametrize(
    ("error", "state", "total"),
    [(2.0, "modify_compensation", 1.0), (-2.0, "modify_compensation", 0.0), (0.0, "aligned", 0.5)],
)
def test_resumes_after_a_hold(error: float, state: str, total: float) -> None:
    driven = Driven(AXIS)
    driven.tick(2.0, valid=[1.0])
    driven.tick(math.nan, valid=[0.0])
    driven.tick(error, valid=[0.5])
    assert driven.state == state
    assert driven.read("compensation") == [total]


def test_log_tells_why() -> None:
    driven = Driven(AXIS)
    for error in (2.0, 0.5, math.nan, 0.0, 2.0):
        driven.tick(error)
    log = driven.block.transitions(driven.context)
    assert [(record.time, record.source, record.target, record.label) for record in log] == [
        (0.0, "next_desired_position", "modify_compensation", "error outside the dead zone"),
        (0.5, "modify_compensation", "hold", "no valid measurement"),
        (0.75, "hold", "aligned", "error inside the dead zone"),
        (1.0, "aligned", "modify_compensation", "error outside the dead zone"),
    ]
    assert all(record.also_true == () for record in log)


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


def test_end_of_the_trajectory_comes_before_a_lost_measurement() -> None:
    driven = Driven(AXIS, end_time=0.25)
    driven.tick(2.0)
    driven.tick(math.nan)
    assert driven.state == "trajectory_ended"


def test_trajectory_without_end_has_no_final_state() -> None:
    chart = make_compensator_chart(CompensatorParams(axes=(AXIS,)))
    assert all(chart.state(name).outcome is None for name in chart.state_names)


# The block


def test_command_is_the_desired_trajectory_plus_the_compensation() -> None:
    driven = Driven(AXIS, AXIS)
    for errors, goal in (
        ((2.0, -2.0), (1.0, 3.0)),
        ((0.5, 0.0), (2.0, 4.0)),
        ((0.0,) * 2, (3.0, 5.0)),
    ):
        driven.tick(*errors, desired_trajectory=goal)
        expected = np.add(goal, driven.read("compensation"))
        np.testing.assert_array_equal(driven.read("command"), expected)
    assert driven.read("command") == [3.625, 4.5]


def test_command_is_the_compensation_without_a_desired_trajectory() -> None:
    driven = Driven(AXIS)
    driven.tick(2.0)
    assert driven.read("command") == driven.read("compensation") == [0.5]


@pytest.mark.parametrize("error", [2.0, 0.0, math.nan], ids=["modify", "aligned", "hold"])
@pytest.mark.parametrize("goal", [math.nan, math.inf])
def test_desired_trajectory_that_is_not_finite_raises(error: float, goal: float) -> None:
    driven = Driven(AXIS)
    driven.tick(error, desired_trajectory=[1.0])
    with pytest.raises(
        ValueError, match=rf"^desired_trajectory is \({goal},\) at t = 0\.25 s, must be finite$"
    ):
        driven.tick(error, desired_trajectory=[goal])


def test_ports_have_one_element_per_axis() -> None:
    block = TrajectoryCompensator(CompensatorParams(axes=(AXIS,) * 3))
    inputs = [block.get_input_port(i) for i in range(block.num_input_ports())]
    outputs = [block.get_output_port(i) for i in range(block.num_output_ports())]
    assert {port.get_name(): port.size() for port in inputs} == {
        "error": 3,
        "valid": 1,
        "desired_trajectory": 3,
    }
    assert {port.get_name(): port.size() for port in outputs} == {
        "compensation": 3,
        "command": 3,
        "increment": 3,
        "axis_state": 3,
        "state": 1,
    }
    assert not block.HasAnyDirectFeedthrough()


def test_ticks_once_a_period() -> None:
    block = TrajectoryCompensator(CompensatorParams(axes=(AXIS,), period=1 / 80))
    simulator = Simulator(block)
    block.GetInputPort("error").FixValue(simulator.get_mutable_context(), [2.0])
    simulator.AdvanceTo(0.999)
    context = simulator.get_context()
    assert block.GetOutputPort("compensation").Eval(context)[0] == 80 * 0.5


# Parameters


def test_defaults_are_the_papers() -> None:
    axis = AxisParams(dead_zone=0.01, large_error=0.1, increment=0.05)
    assert (axis.divider, axis.limit) == (5.0, math.inf)
    assert axis.small_increment == 0.05 / 5
    params = CompensatorParams(axes=(axis,))
    assert (params.period, params.end_time) == (1 / 80, math.inf)


NOT_POSITIVE = (0.0, -1.0, math.nan, math.inf)


@pytest.mark.parametrize(
    ("field", "values", "allowed"),
    [
        ("dead_zone", NOT_POSITIVE, "a finite number > 0"),
        ("increment", NOT_POSITIVE, "a finite number > 0"),
        ("large_error", (0.1, -1.0, math.nan, math.inf), "a finite number >= dead_zone, 0.125"),
        ("divider", (0.99, 0.0, -5.0, math.nan, math.inf), "a finite number >= 1"),
        ("limit", (0.0, -1.0, math.nan), "a number > 0, infinity for no bound"),
    ],
)
def test_axis_parameters_out_of_range(field: str, values: tuple[float, ...], allowed: str) -> None:
    for value in values:
        with pytest.raises(ValueError, match=field) as raised:
            with_axis(**{field: value})
        assert str(raised.value) == f"{field} is {value}, allowed: {allowed}"


@pytest.mark.parametrize(
    ("field", "values", "allowed"),
    [
        ("axes", ((),), "at least one axis"),
        ("period", NOT_POSITIVE, "a finite number > 0"),
        ("end_time", (0.0, -1.0, math.nan), "a number > 0, infinity for no end"),
    ],
)
def test_parameters_out_of_range(field: str, values: tuple[object, ...], allowed: str) -> None:
    for value in values:
        with pytest.raises(ValueError, match=field) as raised:
            CompensatorParams(**{"axes": (AXIS,), field: value})
        assert str(raised.value) == f"{field} is {value!r}, allowed: {allowed}"


@pytest.mark.parametrize("valid", [0.0, 0.49, math.nan])
def test_a_measurement_that_is_not_said_to_be_valid_is_none(valid: float) -> None:
    driven = Driven(AXIS)
    driven.tick(2.0, valid=[valid])
    assert driven.state == "hold"
    driven.tick(2.0, valid=[1.0])
    assert driven.state == "modify_compensation"


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


def test_an_error_port_that_is_not_connected_is_named() -> None:
    simulator = Simulator(TrajectoryCompensator(CompensatorParams(axes=(AXIS,))))
    with pytest.raises(RuntimeError, match=r"required InputPort\[0\] \(error\)"):
        simulator.AdvanceTo(0.1)
