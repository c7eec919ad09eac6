"""The trajectory compensator of Figs. 3 and 4: a state machine that corrects errors from cameras.

Source: Ruybal, Lumia and Wood, section 3. The chart of Fig. 3 decides once per measurement whether
the compensation is modified; the chart of Fig. 4, one per degree of freedom, decides by how much.
One tick is one lap of Fig. 3: reading the next desired position is what every tick begins with.

What guards and actions compute are plain functions of numbers or arrays, made of comparisons and
products alone, so that chart, compiled loop, design and benchmarks all call these.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from chamfer.models.validation import ParameterError, known, require_positive
from chamfer.systems.law import Signal
from chamfer.systems.statechart.chart import (
    ANY,
    TIME_TOLERANCE,
    Chart,
    Snapshot,
    State,
    Tick,
    Transition,
)
from chamfer.systems.statechart.chart_law import ChartLaw, MachineOutput


def error_class(error: Any, dead_zone: Any, large_error: Any) -> Any:
    """Return the class of an error: 0 in the dead zone, +-1 small, +-2 large; 0 for NaN."""
    size = abs(error)
    found = (size >= dead_zone) * 1 + (size >= large_error) * 1
    return (error > 0) * found - (error < 0) * found


def class_increment(found: Any, increment: Any, divider: Any) -> Any:
    """Return the increment of a class: n for a large error, n / divider for a small one."""
    size = abs(found)
    step = (size == 2) * increment + (size == 1) * (increment / divider)
    return (found > 0) * step - (found < 0) * step


def limited_sum(compensation: float, increment: float, limit: float) -> float:
    """Return the total compensation after an increment."""
    return max(-limit, min(limit, compensation + increment))


def is_measured(error: float) -> bool:
    """Return whether the error was measured."""
    return math.isfinite(error)


@dataclass(frozen=True, kw_only=True)
class OpenAxisParams:
    """One degree of freedom, m for a lateral one, rad for a rotation; None is to be derived.

    The paper prints only the divider. The rest can follow from the settling theorem,
    :mod:`chamfer.systems.servo.settling`.
    """

    dead_zone: float | None = None
    # m or rad or pixels, a smaller measured error gets no increment
    divider: float = 5.0  # a small error gets the increment divided by this; n/5 of Fig. 4
    large_error: float | None = None  # m or rad or pixels, least error that counts as large
    increment: float | None = None  # m or rad or N, n of Fig. 4, added per tick to a large error
    limit: float | None = None  # m or rad or N, bound on the total compensation

    def __post_init__(self) -> None:
        require_positive(self, "dead_zone", "increment")
        if not (math.isfinite(self.divider) and self.divider >= 1):
            raise ParameterError("divider", self.divider, "a finite number >= 1")
        large, dead_zone = self.large_error, self.dead_zone or 0.0
        if large is not None and not (math.isfinite(large) and large >= dead_zone):
            raise ParameterError(
                "large_error", large, f"a finite number >= dead_zone, {dead_zone:g}"
            )
        if self.limit is not None and not self.limit > 0:
            raise ParameterError("limit", self.limit, "a number > 0, infinity for no bound")

    @property
    def closed(self) -> "AxisParams":
        """The parameters with no field left open."""
        return AxisParams(**{name: known(name, value) for name, value in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
class AxisParams(OpenAxisParams):
    """Parameters of one degree of freedom, with nothing left open."""

    dead_zone: float = field()
    large_error: float = field()
    increment: float = field()
    limit: float = math.inf

    @property
    def small_increment(self) -> float:
        """The increment for a small error, n divided by the divider."""
        return float(class_increment(1, self.increment, self.divider))


@dataclass(frozen=True, kw_only=True)
class CompensatorParams:
    """Parameters of :class:`TrajectoryCompensator`."""

    axes: tuple[AxisParams, ...]  # of each axis
    period: float = 1 / 80  # s, the camera's period, section 4
    end_time: float = math.inf  # s, end of the desired trajectory

    def __post_init__(self) -> None:
        if not self.axes:
            raise ParameterError("axes", self.axes, "at least one axis")
        require_positive(self, "period")
        if not self.end_time > 0:
            raise ParameterError("end_time", self.end_time, "a number > 0, infinity for no end")


class AxisMemory(NamedTuple):
    """The memory of the chart of Fig. 4."""

    compensation: float  # the total so far
    increment: float  # what the last tick asked for


class CompensatorInputs(NamedTuple):
    """The inputs of the chart of Fig. 3; an optional port that is not connected is None."""

    error: tuple[float, ...]
    valid: tuple[float, ...] | None
    desired_trajectory: tuple[float, ...] | None


class CompensatorMemory(NamedTuple):
    """The memory of the chart of Fig. 3."""

    axes: tuple[Snapshot[AxisMemory], ...]
    desired: tuple[float, ...]


AxisChart = Chart[float, AxisMemory]
CompensatorChart = Chart[CompensatorInputs, CompensatorMemory]
CompensatorTick = Tick[CompensatorInputs, CompensatorMemory]


_CLASSES = {  # of Fig. 4, each a state
    2: ("add_large", "large error"),
    1: ("add_small", "small error"),
    -1: ("remove_small", "small negative error"),
    -2: ("remove_large", "large negative error"),
}


def make_axis_chart(params: AxisParams) -> AxisChart:
    """Return the chart of Fig. 4: how one degree of freedom answers a measured error.

    Its input is the error, desired minus actual; a positive one adds compensation.
    """

    def state(number: int) -> State[float, AxisMemory]:
        increment = class_increment(number, params.increment, params.divider)

        def during(tick: Tick[float, AxisMemory]) -> AxisMemory:
            total = limited_sum(tick.memory.compensation, increment, params.limit)
            return AxisMemory(total, increment)

        return State(name=_CLASSES[number][0], during=during)

    def becomes(number: int) -> Transition[float, AxisMemory]:
        return Transition(
            source=ANY,
            target=_CLASSES[number][0],
            label=_CLASSES[number][1],
            guard=lambda tick: (
                error_class(tick.inputs, params.dead_zone, params.large_error) == number
            ),
        )

    return Chart(
        "compensation of one axis",
        states=[
            State(name="aligned", during=lambda tick: AxisMemory(tick.memory.compensation, 0.0)),
            *map(state, _CLASSES),
        ],
        transitions=[
            *map(becomes, _CLASSES),
            Transition(
                source=ANY,
                target="aligned",
                label="no error",
                guard=lambda tick: -params.dead_zone < tick.inputs < params.dead_zone,
            ),
        ],
        memory=AxisMemory(0.0, 0.0),
    )


def make_compensator_chart(params: CompensatorParams) -> CompensatorChart:
    """Return the chart of Fig. 3, with a hold for a measurement that is not valid."""
    charts = [make_axis_chart(axis) for axis in params.axes]
    dead_zones = [axis.dead_zone for axis in params.axes]

    def desired(tick: CompensatorTick) -> tuple[float, ...]:
        goal = tick.inputs.desired_trajectory
        if goal is None:
            return tick.memory.desired
        if not all(map(math.isfinite, goal)):
            raise ValueError(
                f"desired_trajectory is {goal} at t = {tick.time:g} s, must be finite"
            )
        return goal

    def still(axis: Snapshot[AxisMemory]) -> AxisMemory:
        return AxisMemory(axis.memory.compensation, 0.0)

    def keep(tick: CompensatorTick) -> CompensatorMemory:
        axes = [axis._replace(memory=still(axis)) for axis in tick.memory.axes]
        return CompensatorMemory(tuple(axes), desired(tick))

    def align(tick: CompensatorTick) -> CompensatorMemory:
        axes = [Snapshot("aligned", tick.time, still(axis), True) for axis in tick.memory.axes]
        return CompensatorMemory(tuple(axes), desired(tick))

    def modify(tick: CompensatorTick) -> CompensatorMemory:
        fed = zip(charts, tick.memory.axes, tick.inputs.error, strict=True)
        axes = [chart.step(axis, error, tick.time)[0] for chart, axis, error in fed]
        return CompensatorMemory(tuple(axes), desired(tick))

    def invalid(tick: CompensatorTick) -> bool:
        valid = tick.inputs.valid
        return (valid is not None and not valid[0] >= 0.5) or not all(
            map(is_measured, tick.inputs.error)
        )

    def sizes(tick: CompensatorTick) -> Iterable[tuple[float, float]]:
        return zip(map(abs, tick.inputs.error), dead_zones, strict=True)

    def outside(tick: CompensatorTick) -> bool:
        return any(size >= dead_zone for size, dead_zone in sizes(tick))

    def inside(tick: CompensatorTick) -> bool:
        return all(size < dead_zone for size, dead_zone in sizes(tick))

    states: list[State[CompensatorInputs, CompensatorMemory]] = [
        State(name="next_desired_position"),
        State(name="aligned", during=align),
        State(name="modify_compensation", during=modify),
        State(name="hold", during=keep),
    ]
    ways: list[tuple[str, str, Callable[[CompensatorTick], bool]]] = [
        ("hold", "no valid measurement", invalid),
        ("modify_compensation", "error outside the dead zone", outside),
        ("aligned", "error inside the dead zone", inside),
    ]
    if math.isfinite(params.end_time):
        # An action of its own, so that what belongs to one state alone can be told.
        states.append(
            State(name="trajectory_ended", entry=lambda tick: keep(tick), outcome="done")
        )
        end = params.end_time - TIME_TOLERANCE
        ways.insert(0, ("trajectory_ended", "trajectory ended", lambda tick: tick.time >= end))
    start = tuple(chart.start() for chart in charts)
    return Chart(
        "trajectory compensator",
        states=states,
        transitions=[
            Transition(source=ANY, target=target, label=label, guard=guard)
            for target, label, guard in ways
        ],
        memory=CompensatorMemory(start, (0.0,) * len(charts)),
        on_abort="hold",
    )


COMPENSATES: Final = ("compensation", "command", "increment", "desired_trajectory")


class CompensatorLaw(ChartLaw[CompensatorInputs, CompensatorMemory]):
    """The trajectory compensator; its inputs and outputs are those of the block.

    It has no units until it is told: an axis' error may be in m, rad or pixels, its compensation,
    and what else :data:`COMPENSATES`, in m, rad or N.
    """

    def __init__(self, params: CompensatorParams) -> None:
        size = len(params.axes)
        self.params = params
        self.axis_chart = make_axis_chart(params.axes[0])
        index = {name: float(i) for i, name in enumerate(self.axis_chart.state_names)}

        def of_axes(
            read: Callable[[Snapshot[AxisMemory]], float],
        ) -> MachineOutput[CompensatorMemory]:
            return MachineOutput(size=size, read=lambda memory: tuple(map(read, memory.axes)))

        def command(memory: CompensatorMemory) -> tuple[float, ...]:
            pairs = zip(memory.desired, memory.axes, strict=True)
            return tuple(goal + axis.memory.compensation for goal, axis in pairs)

        super().__init__(
            make_compensator_chart(params),
            observation=CompensatorInputs,
            inputs={
                "error": Signal(size),
                "valid": Signal(optional=True),
                "desired_trajectory": Signal(size, optional=True),
            },
            outputs={
                "compensation": of_axes(lambda axis: axis.memory.compensation),
                "command": MachineOutput(size=size, read=command),
                "increment": of_axes(lambda axis: axis.memory.increment),
                "axis_state": of_axes(lambda axis: index[axis.state]),
            },
            period=params.period,
        )
