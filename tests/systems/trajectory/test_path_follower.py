"""The follower: no jumps at any change of mind, and a halt that stays on the path."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from chamfer.systems.trajectory.path_follower import (
    FollowerMemory,
    PathFollower,
    PathFollowerParams,
)
from chamfer.systems.trajectory.segment import LINE, SLEW, Segment, circle, hold

PERIOD = 0.005
A = (0.3, -0.2, 0.5, 0.1, 0.0, 0.2, 0.3)
B = (0.4, 0.2, 0.4, 1.1, 0.1, 0.0, 0.2)
WAY = Segment(1.0, LINE, A, B, speed=0.15)


class Run(NamedTuple):
    position: np.ndarray  # (k, 7)
    velocity: np.ndarray  # (k, 7)
    given: np.ndarray  # (k, 7), the desired acceleration
    progress: np.ndarray  # (k,)

    @property
    def acceleration(self) -> np.ndarray:
        return np.diff(self.velocity, axis=0) / PERIOD


def run(commands: list[tuple[Segment, bool, int]], start: tuple[float, ...] = A) -> Run:
    """Follow (segment, halt, ticks), one after the other."""
    block = PathFollower(PathFollowerParams(), np.array(start))
    context = block.CreateDefaultContext()
    values = context.get_discrete_state()
    memory = FollowerMemory(*(values.value(i) for i in range(len(FollowerMemory._fields))))
    seen = [memory]
    for segment, halt, ticks in commands:
        vector = np.array(segment.vector())
        for _ in range(ticks):
            memory = block.step(memory, vector, halt=halt)
            seen.append(memory)
    return Run(
        np.array([one.desired_position for one in seen]),
        np.array([one.desired_velocity for one in seen]),
        np.array([one.desired_acceleration for one in seen]),
        np.array([one.progress[0] for one in seen]),
    )


def off_the_line(position: np.ndarray) -> float:
    """How far from the straight line between A and B, m."""
    way = np.array(B) - A
    away = position - A
    along = np.outer(away @ way / (way @ way), way)
    return float(np.abs(away - along).max())


def test_a_line_is_followed_to_its_end() -> None:
    found = run([(WAY, False, 700)])
    assert off_the_line(found.position) < 1e-12
    np.testing.assert_allclose(found.position[-1], B, atol=1e-14)
    assert found.progress[1] < 0.01
    assert found.progress[-1] == 1.0
    assert np.all(np.diff(found.progress[1:]) >= 0)
    first = int(np.argmax(found.progress[1:] == 1.0))
    np.testing.assert_allclose(found.velocity[first + 1], 0.0, atol=1e-3)


def test_halt_stays_on_the_path_and_goes_on() -> None:
    free = run([(WAY, False, 700)])
    found = run([(WAY, False, 100), (WAY, True, 200), (WAY, False, 700)])
    assert off_the_line(found.position) < 1e-12
    np.testing.assert_array_equal(found.velocity[200:300], 0.0)
    np.testing.assert_array_equal(np.diff(found.position[200:300], axis=0), 0.0)
    np.testing.assert_allclose(found.position[-1], B, atol=1e-14)
    # The halt brakes by the speed over the halt's time, and no harder.
    free_peak = np.abs(free.acceleration).max()
    brake = np.abs(free.velocity).max() / 0.25
    assert np.abs(found.acceleration).max() < free_peak + brake


every = st.sampled_from(
    [
        lambda k: hold(B, k),
        lambda k: Segment(k, LINE, B, A, speed=0.1),
        lambda k: Segment(k, LINE, A, B, speed=0.3, acceleration=2.0),
        lambda k: circle(A, k, centre=(0.5, 0.1, 0.0), turn=1.0, speed=0.2),
        lambda k: Segment(k, SLEW, A, B, duration=2.5, via_height=0.7),
    ]
)


@settings(max_examples=25)
@given(st.lists(st.tuples(every, st.booleans(), st.integers(1, 150)), min_size=1, max_size=6))
def test_nothing_jumps_at_any_change_of_mind(plan: list[Any]) -> None:
    found = run([(make(k + 1), halt, ticks) for k, (make, halt, ticks) in enumerate(plan)])
    assert np.abs(found.acceleration).max() < 12.0
    np.testing.assert_allclose(found.given[1:], found.acceleration, atol=1e-12)
    # The velocity is the position's rate; the mean over a period is off by its change in it.
    means = (found.velocity[1:] + found.velocity[:-1]) / 2
    rates = np.diff(found.position, axis=0) / PERIOD
    assert np.abs(rates - means).max() < 12.0 * PERIOD


def test_interrupted_at_speed_it_comes_to_the_new_segment() -> None:
    stop = run([(WAY, False, 200)]).position[-1]
    found = run([(WAY, False, 200), (hold(tuple(stop), 2.0), False, 300)])
    np.testing.assert_allclose(found.position[-1], stop, atol=1e-14)
    assert np.linalg.norm(found.position[200:, :3] - stop[:3], axis=1).max() < 0.6 * 0.15**2
    assert np.linalg.norm(found.acceleration[199:, :3], axis=1).max() <= 1.0 * (1 + 1e-6)
    assert found.progress[201] < 1.0 == found.progress[-1]


def test_halted_it_leaves_for_another_segment_from_rest() -> None:
    # The speed before the halt is none of the new segment's.
    slew = Segment(1.0, SLEW, A, B, duration=1.5, via_height=0.6)
    halted = run([(slew, False, 150), (slew, True, 100)])
    there = tuple(halted.position[-1].tolist())
    after = run([(slew, False, 150), (slew, True, 100), (hold(there, 2.0), False, 100)])
    assert np.abs(after.position[250:] - there).max() < 1e-9
    assert after.progress[-1] == 1


def test_a_start_elsewhere_is_made_good_smoothly() -> None:
    away = (A[0] + 0.004, *A[1:])
    found = run([(WAY, False, 700)], start=away)
    np.testing.assert_allclose(found.position[-1], B, atol=1e-14)
    # The line's own acceleration and that of the way to it.
    assert np.linalg.norm(found.acceleration[:, :3], axis=1).max() <= 2.0


class Change(LeafSystem):
    """A segment that is another one from a time on, as a state machine gives it."""

    def __init__(self) -> None:
        super().__init__()
        state = self.DeclareDiscreteState(np.array(hold(A, 9.0).vector()))
        self.DeclareStateOutputPort("segment", state)
        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, self._tick)

    def _tick(self, context: Context, state: object) -> None:
        if math.isclose(context.get_time(), 0.1):
            vector = np.array(WAY.vector())
            state.get_mutable_discrete_state().set_value(vector)  # type: ignore[attr-defined]


def test_block_begins_a_segment_in_the_tick_that_gives_it() -> None:
    builder = DiagramBuilder()
    source = builder.AddSystem(Change())
    block = builder.AddSystem(PathFollower(PathFollowerParams(), np.array(A)))
    builder.Connect(source.GetOutputPort("segment"), block.GetInputPort("segment"))
    simulator = Simulator(builder.Build())
    context = block.GetMyContextFromRoot(simulator.get_context())
    output = block.GetOutputPort("desired_velocity")
    simulator.AdvanceTo(0.0999)
    np.testing.assert_array_equal(output.Eval(context), 0.0)
    simulator.AdvanceTo(0.1001)
    velocity = output.Eval(context)
    assert np.linalg.norm(velocity[:3]) == pytest.approx(1.0 * PERIOD)
    assert not block.HasAnyDirectFeedthrough()
    assert block.GetOutputPort("progress").Eval(context) < 0.01
    assert block.num_output_ports() == 4
