import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.validation import ParameterError
from chamfer.systems.trajectory.paths import Path, path_of, trapezoid
from chamfer.systems.trajectory.segment import LINE as STRAIGHT
from chamfer.systems.trajectory.segment import SIZE, Segment, circle, segment_of
from chamfer.systems.trajectory.segment import SLEW as FAST

START = (0.3, -0.2, 0.5, 0.1, 0.0, 0.2, 0.3)
GOAL = (0.4, 0.2, 0.4, 1.1, 0.1, 0.0, 0.2)
LINE = Segment(1.0, STRAIGHT, START, GOAL, speed=0.15, acceleration=1.0, turn_speed=100.0)
CIRCLE = circle(
    START, 2.0, centre=(0.5, 0.1, 0.0), turn=2.0, rise=0.1, speed=0.1, acceleration=0.5
)._replace(turn_speed=100.0)
SLEW = Segment(3.0, FAST, START, GOAL, acceleration=1.0, duration=2.5, via_height=0.7)
every_kind = pytest.mark.parametrize(
    "segment", [LINE, CIRCLE, SLEW], ids=["line", "circle", "slew"]
)


def path(segment: Segment, turn_acceleration: float = 1e3) -> Path:
    return path_of(segment, turn_acceleration=turn_acceleration)


@given(speed=st.floats(0.01, 100), acceleration=st.floats(0.01, 100))
def test_trapezoid_goes_from_rest_to_rest(speed: float, acceleration: float) -> None:
    duration, profile = trapezoid(speed, acceleration)
    times = np.linspace(0.0, duration, 2001)
    far, fast = np.transpose([profile(time) for time in times])
    assert far[0] == fast[0] == fast[-1] == 0.0
    assert far[-1] == 1.0
    assert fast.max() <= speed * (1 + 1e-12)
    step = times[1]
    assert np.abs(np.diff(fast)).max() <= acceleration * step * (1 + 1e-6)
    np.testing.assert_allclose(
        np.diff(far) / step, (fast[1:] + fast[:-1]) / 2, atol=acceleration * step
    )


@every_kind
def test_goes_from_start_to_goal_and_the_velocity_is_the_rate(segment: Segment) -> None:
    way = path(segment)
    for time, place in ((0.0, segment.start), (way.duration, segment.goal)):
        position, velocity = way.at(time)
        np.testing.assert_allclose(position, place, rtol=0, atol=1e-14)
        np.testing.assert_allclose(velocity, 0.0, atol=1e-14)
    h = 1e-6
    # Not at a trapezoid's corners, where a central difference straddles two accelerations.
    for part in (0.05, 0.3, 0.5, 0.73, 0.95):
        time = part * way.duration
        rate = (way.at(time + h)[0] - way.at(time - h)[0]) / (2 * h)
        np.testing.assert_allclose(way.at(time)[1], rate, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("segment", "speed"), [(LINE, 0.15), (CIRCLE, 0.1)])
def test_middle_is_at_speed(segment: Segment, speed: float) -> None:
    way = path(segment)
    for part in (0.3, 0.5, 0.7):
        velocity = way.at(part * way.duration)[1]
        assert np.linalg.norm(velocity[:3]) == pytest.approx(speed, rel=1e-12)


def test_circle_keeps_its_radius() -> None:
    way = path(CIRCLE)
    radius = math.dist(START[:2], CIRCLE.centre[:2])
    for time in np.linspace(0.0, way.duration, 11):
        position, _ = way.at(float(time))
        assert math.dist(position[:2], CIRCLE.centre[:2]) == pytest.approx(radius, rel=1e-14)


def test_turning_is_limited_too() -> None:
    # 0.01 m of way, 1 rad of turn: it is the turn that takes the time.
    goal = (0.31, -0.2, 0.5, 1.1, 0.0, 0.2, 0.3)
    segment = Segment(1.0, STRAIGHT, START, goal, speed=1.0, acceleration=10.0, turn_speed=0.5)
    way = path(segment, 2.0)
    assert way.duration == pytest.approx(1 / 0.5 + 0.5 / 2.0)
    assert way.at(way.duration / 2)[1][3] == pytest.approx(0.5)


def test_slew_is_high_while_it_goes_across() -> None:
    way = path(SLEW)
    times = np.linspace(0.0, 2.5, 251)
    positions = np.array([way.at(t)[0] for t in times])
    velocities = np.array([way.at(t)[1] for t in times])
    assert positions[:, 2].max() == pytest.approx(0.7)
    across = np.linalg.norm(positions[:, :2] - positions[0, :2], axis=1)
    across /= across[-1]
    middle = (across > 0.1) & (across < 0.9)
    assert positions[middle, 2].min() > 0.65
    acceleration = np.diff(velocities, axis=0) / times[1]
    jerk = np.diff(acceleration, axis=0) / times[1]
    assert np.abs(acceleration[[0, -1]]).max() < 0.05 * np.abs(acceleration).max()
    assert np.abs(jerk).max() < 20


def test_standing_still_takes_no_time() -> None:
    assert path(LINE._replace(goal=START)).duration == 0.0


@pytest.mark.parametrize(
    ("segment", "message"),
    [
        (LINE._replace(speed=0.0), r"speed is 0\.0, allowed: a finite number > 0"),
        (CIRCLE._replace(acceleration=0.0), r"acceleration is 0\.0, "),
        (SLEW._replace(duration=0.0), r"duration is 0\.0, "),
        (LINE._replace(turn_speed=0.0), r"turn_speed is 0\.0, "),
        (LINE._replace(kind=7), r"kind is 7, allowed: 0 \(hold\), 1 \(line\), 2 \(circle\) or 3"),
    ],
)
def test_what_leads_nowhere(segment: Segment, message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{message}"):
        path(segment)


FROM, TO = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0)


def test_vector_and_back() -> None:
    segment = Segment(5.0, FAST, FROM, TO, (0.1, 0.2, 0.3), 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    vector = segment.vector()
    assert len(vector) == SIZE
    assert len(set(vector)) == SIZE - 2  # 3 and 5 stand twice
    assert segment_of(vector) == segment


def test_what_is_not_told_is_0() -> None:
    assert Segment(1.0, FAST, FROM, TO).vector()[16:] == (0.0,) * (SIZE - 16)


def test_refuses_another_size_and_what_is_no_number() -> None:
    allowed = rf"segment is .*, allowed: {SIZE} finite numbers"
    for vector in ((0.0,) * (SIZE - 1), (math.nan,) * SIZE):
        with pytest.raises(ParameterError, match=allowed):
            segment_of(vector)


def test_circle_turns_the_yaw_with_the_place() -> None:
    start = (0.6, 0.1, 0.4, 0.2, 0.0, 0.0, 0.3)
    centre = (0.5, 0.1, 0.0)
    found = circle(start, 1.0, centre=centre, turn=math.pi / 2, rise=0.05, speed=0.1)
    assert found.goal == pytest.approx((0.5, 0.2, 0.45, 0.2 + math.pi / 2, 0.0, 0.0, 0.3))
    assert segment_of(found.vector()) == found
