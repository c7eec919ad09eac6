"""The insertion's chart in a world of one dimension: a feed, a spring, and what stops the peg."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.validation import ParameterError
from chamfer.systems.statechart.chart import Snapshot
from chamfer.systems.strategies.insertion_decision import DecisionParams, InsertionRegion
from chamfer.systems.strategies.insertion_law import (
    InsertionInputs,
    InsertionMemory,
    InsertionTaskParams,
    InsertionTrouble,
    InsertParams,
    ResolvedInsertParams,
    make_insertion_chart,
)

PERIOD = 1 / 80
GAP = 0.03
SPRING = 200.0  # N/m
GOOD = (0.0, 0.5, -0.5, 0.0, 0.005, 0.004)  # pixels and rad
BAD = (0.0, 20.0, 1.0, 0.0, 0.05, 0.05)
JOINTS = (0.0,) * 7


@cache
def region() -> InsertionRegion:
    return InsertionRegion(PegHoleGeometry(), Support(centre_distance=0.006))


def params(decide: dict[str, Any] | None = None, **insert: Any) -> InsertionTaskParams:
    return InsertionTaskParams(
        decide=DecisionParams(**{"frames": 4} | (decide or {})),
        insert=ResolvedInsertParams(
            **{"speed": 0.2, "depth": 0.04, "feed": 0.11, "rest": 0.05} | insert
        ),
        region=region(),
        chamfer_height=0.004,
        begin=0.05,
        wait=0.5,
        most_saturated=0.1,
    )


@dataclass
class World:
    """What the arm and the cameras meet."""

    stop: float = math.inf  # m, depth that the peg does not pass
    holds: float = 0.0  # N, with which the stop keeps it
    error: Callable[[float], Sequence[float]] = lambda time: GOOD
    valid: Callable[[float], float] = lambda time: 1.0
    blind: Callable[[float], float] = lambda time: 0.0
    diverged: Callable[[float], float] = lambda time: 0.0
    compensation: float = 0.0
    saturated: Callable[[float], float] = lambda time: 0.0
    bias: float = 0.7  # N, that the arm takes for a force
    offset: float = 0.002  # m, by which the encoders are wrong
    depth: float = -GAP
    log: list[tuple[float, str, InsertionMemory]] = field(default_factory=list)
    hardest: float = 0.0

    def read(self, time: float, feed: float) -> InsertionInputs:
        free = feed - GAP
        if self.depth >= self.stop - 1e-12 and SPRING * (free - self.depth) > -self.holds:
            self.depth = self.stop
        else:
            self.depth = min(free, self.stop)
        push = SPRING * (free - self.depth)
        self.hardest = max(self.hardest, push)
        return InsertionInputs(
            error=tuple(self.error(time)),
            valid=(self.valid(time),),
            blind=(self.blind(time),),
            diverged=(self.diverged(time),),
            compensation=(self.compensation, *JOINTS[:5]),
            force=(push + self.bias, 0.3, -0.8),
            advance=(self.depth + self.offset,),
            peg_saturated=(self.saturated(time), *JOINTS[1:]),
            hole_saturated=None,
        )


def run(task: InsertionTaskParams, world: World, *, longest: float = 20.0) -> list[str]:
    """Return the states in the order in which they are entered, and log every tick."""
    chart = make_insertion_chart(task)
    snapshot: Snapshot[InsertionMemory] = chart.start()
    path = [snapshot.state]
    for k in range(round(longest / PERIOD)):
        time = k * PERIOD
        memory = snapshot.memory
        feed = memory.feed + memory.rate * (time - memory.time)
        snapshot, record = chart.step(snapshot, world.read(time, feed), time)
        world.log.append((time, snapshot.state, snapshot.memory))
        if record is not None:
            path.append(record.target)
        if chart.state(snapshot.state).outcome is not None and time - snapshot.entered_at > 0.5:
            break
    return path


def when(world: World, state: str) -> float:
    return next(time for time, name, _ in world.log if name == state)


IN = ["approach", "align", "decide", "insert", "check", "seated"]
OUT = ["approach", "align", "decide", "insert", "release", "back_off"]
AGAIN = ["align", "decide", "insert", "release", "back_off"]


def test_a_free_way_ends_seated_at_the_depth() -> None:
    world = World()
    assert run(params(), world) == IN
    assert world.depth == pytest.approx(0.04, abs=0.2 * PERIOD * 1.01)
    memory = world.log[-1][2]
    assert memory.attempts == 1
    assert memory.sensed_depth == pytest.approx(world.depth)  # the cameras mend the encoders
    assert memory.sensed_force == pytest.approx((0.0, 0.0, 0.0))


def test_the_cameras_say_where_the_mouth_is() -> None:
    far = (6.0, *GOOD[1:])  # pixels further away than the gap
    world = World(error=lambda time: far)
    run(params(), world)
    assert world.depth == pytest.approx(0.04 + 6 * 0.0005, abs=0.2 * PERIOD * 1.01)


def test_on_the_bottom_of_a_blind_hole_a_force_is_enough() -> None:
    # The encoders are a little short of it.
    world = World(stop=0.0195)
    task = replace(params(), bottom=0.02)
    assert run(task, world) == IN
    assert 2.0 <= world.hardest < 3.0


def test_small_errors_are_inside_after_the_frames_that_it_takes() -> None:
    world = World()
    run(params(), world)
    assert when(world, "insert") == pytest.approx(0.05 + 4 * PERIOD, abs=PERIOD)


def test_errors_that_are_unsure_are_not_inside() -> None:
    def noisy(time: float) -> Sequence[float]:
        sign = 1 if round(time / PERIOD) % 2 else -1
        return (0.0, sign * 7.0, 0.0, 0.0, 0.0, 0.0)  # 3.5 mm about the axis

    world = World(error=noisy)
    assert run(params({"timeout": 1.0}), world) == ["approach", "align", "decide", "gave_up"]
    assert world.log[-1][2].trouble is InsertionTrouble.NOT_ALIGNED


def test_to_wait_takes_its_time_whatever_the_errors_are() -> None:
    inside = (0.0, 6.0, 1.0, 0.0, 0.05, 0.02)  # of the chamfers' reach, but no margin
    world = World(error=lambda time: inside)
    assert run(params({"kind": "wait"}), world) == IN
    assert when(world, "insert") == pytest.approx(0.05 + 0.5, abs=PERIOD)


def test_at_once_is_with_the_first_frames() -> None:
    world = World(error=lambda time: BAD if time < 0.1 else GOOD)
    run(params({"kind": "at_once"}), world)
    assert when(world, "insert") == pytest.approx(0.05 + 2 * PERIOD, abs=PERIOD)


def test_a_pause_comes_before_the_advance() -> None:
    world = World()
    run(params(pause=0.3), world)
    began = when(world, "insert")
    moved = next(time for time, _, memory in world.log if memory.feed > 0)
    assert moved - began == pytest.approx(0.3, abs=2 * PERIOD)


@pytest.mark.parametrize(
    ("world", "trouble"),
    [
        (World(stop=0.02), InsertionTrouble.JAMMED),
        (World(stop=0.012, holds=4.0), InsertionTrouble.WEDGED),
        (World(stop=0.0035), InsertionTrouble.AT_MOUTH),
        (
            World(stop=0.0049),
            InsertionTrouble.AT_MOUTH,
        ),  # a millimetre below the chamfers still is
        (World(stop=0.0051), InsertionTrouble.JAMMED),
        (World(stop=-0.02), InsertionTrouble.BEFORE_MOUTH),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_what_is_stuck_is_tried_again_and_given_up_with_a_reason(
    world: World, trouble: InsertionTrouble
) -> None:
    task = params(attempts=3)
    assert run(task, world) == [*OUT, *AGAIN, *AGAIN, "gave_up"]
    memory = world.log[-1][2]
    assert (memory.attempts, memory.trouble) == (3, trouble)
    # No harder than the push, but for the way of a tick.
    assert world.hardest < task.insert.push + SPRING * task.insert.speed * 2 * PERIOD
    assert world.depth == pytest.approx(-GAP, abs=0.2 * PERIOD * 1.01)


def test_it_is_pulled_beyond_the_gap_if_it_has_to_be() -> None:
    world = World(stop=0.006, holds=7.5)
    assert run(params(attempts=1, speed=0.05), world) == [*OUT, "gave_up"]
    memory = world.log[-1][2]
    assert memory.trouble is InsertionTrouble.WEDGED
    assert memory.pull == pytest.approx(7.5, abs=SPRING * 0.05 * PERIOD)
    assert min(one.feed for *_, one in world.log) < -0.001
    assert memory.feed == 0
    assert world.depth == pytest.approx(-GAP, abs=1e-9)


def test_what_cannot_be_pulled_out_is_left() -> None:
    world = World(stop=0.012, holds=50.0)
    task = params()
    assert run(task, world) == [*OUT, "gave_up"]
    memory = world.log[-1][2]
    assert memory.trouble is InsertionTrouble.HELD
    assert memory.pull == pytest.approx(task.insert.pull, abs=SPRING * 0.2 * PERIOD * 2)
    assert abs(memory.sensed_force[0]) <= task.insert.hold_force  # and not pulled for ever


def test_a_feed_that_ends_early_is_short() -> None:
    world = World()
    task = params(feed=0.06, attempts=1)
    expected = ["approach", "align", "decide", "insert", "check", "release", "back_off", "gave_up"]
    assert run(task, world) == expected
    assert world.log[-1][2].trouble is InsertionTrouble.SHORT


def test_a_peg_beside_the_mouth_does_not_touch() -> None:
    world = World(error=lambda time: GOOD if time < 0.12 else BAD)
    path = run(params({"timeout": 1.0}, attempts=1), world, longest=3.0)
    assert path == ["approach", "align", "decide", "insert", "back_off", "gave_up"]
    assert world.log[-1][2].trouble is InsertionTrouble.BESIDE
    assert max(memory.sensed_depth for *_, memory in world.log) < 0


def test_a_peg_that_went_by_the_hole_is_not_seated() -> None:
    # So fast that no tick is between the gate and the mouth.
    world = World(error=lambda time: GOOD if time < 0.12 else BAD)
    path = run(params(speed=1.5, attempts=1), world, longest=3.0)
    assert path == [*OUT[:4], "check", *OUT[4:], "gave_up"]
    assert world.log[-1][2].trouble is InsertionTrouble.BESIDE
    assert max(memory.sensed_depth for *_, memory in world.log) > 0.04


@pytest.mark.parametrize(
    ("world", "end"),
    [
        (World(blind=lambda time: float(time > 0.3)), "blind"),
        (World(saturated=lambda time: float(time > 0.15)), "saturated"),
        (World(compensation=1.0), "limit_reached"),
        (World(diverged=lambda time: float(time > 0.3)), "diverging"),
    ],
    ids=["blind", "saturated", "limit", "diverging"],
)
def test_it_stops_for_good(world: World, end: str) -> None:
    path = run(replace(params(), limits=(1.0, *(math.inf,) * 5)), world)
    assert path[-1] == end
    memory = world.log[-1][2]
    assert memory.rate == 0
    assert not memory.compensates


def test_a_blow_stops_it_and_the_push_is_taken_away() -> None:
    # So stiff that a tick is enough to be beyond both the push and the limit.
    world = World(stop=0.01)
    task = params(speed=2.0, push=8.0, pull=8.0, force_limit=9.0)
    path = run(task, world)
    assert path[-1] == "overloaded"
    assert SPRING * (world.log[-1][2].feed - GAP - 0.01) <= task.insert.hold_force


def compensated(world: World, state: str) -> set[bool]:
    return {memory.compensates for _, name, memory in world.log if name == state}


def test_a_running_compensation_runs_on_across_the_axis_alone() -> None:
    world = World()
    run(params(), world)
    assert compensated(world, "insert") == {True}
    assert {memory.along for _, name, memory in world.log if name == "insert"} == {False}
    assert compensated(world, "check") == compensated(world, "seated") == {False}


def test_a_frozen_one_ends_with_the_decision() -> None:
    world = World()
    run(params(compensation="frozen"), world)
    assert compensated(world, "decide") == {True}
    assert compensated(world, "insert") == {False}


def test_it_freezes_at_a_depth() -> None:
    world = World()
    run(params(freeze_depth=-0.003), world)
    for _, name, memory in world.log:
        if name == "insert":
            assert memory.compensates == (memory.sensed_depth < -0.003)


def test_nothing_winds_up_under_force_or_backing_off() -> None:
    world = World(stop=0.01)
    task = params(attempts=1)
    run(task, world)
    for _, name, memory in world.log:
        if name == "insert":
            pushed = math.hypot(*memory.sensed_force) >= task.insert.hold_force
            assert memory.compensates == (not pushed)
    assert compensated(world, "release") == compensated(world, "back_off") == {False}


numbers = st.floats(-0.2, 0.2)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(numbers, st.floats(-20, 20), st.booleans()), max_size=60))
def test_it_is_never_said_to_be_seated_short_of_the_depth(
    readings: list[tuple[float, float, bool]],
) -> None:
    task = params({"kind": "at_once"})
    chart = make_insertion_chart(task)
    snapshot = chart.start()
    calm = World().read(0.0, 0.0)
    script = [(-GAP, 0.0, True)] * 12 + readings + [(0.1, 0.0, True)] * 2
    for k, (advance, force, valid) in enumerate(script):
        inputs = calm._replace(
            advance=(advance,), force=(force, 0.0, 0.0), valid=(float(valid),), error=GOOD
        )
        snapshot, record = chart.step(snapshot, inputs, k * PERIOD)
        if record is not None and record.target == "seated":
            assert snapshot.memory.depth(inputs) >= 0.9 * task.target


def test_what_is_frozen_has_a_depth() -> None:
    with pytest.raises(ParameterError, match=r"^freeze_depth is 0\.0, allowed: a fin"):
        InsertParams(compensation="frozen", freeze_depth=0.0)
