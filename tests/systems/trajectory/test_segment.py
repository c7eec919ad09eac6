"""Segments as vectors and back."""

import math

import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.trajectory.segment import HOLD, SIZE, SLEW, Segment, circle, hold, segment_of

START, GOAL = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0)


def test_vector_and_back() -> None:
    segment = Segment(5.0, SLEW, START, GOAL, (0.1, 0.2, 0.3), 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    vector = segment.vector()
    assert len(vector) == SIZE
    assert len(set(vector)) == SIZE - 2  # 3 and 5 stand twice
    assert segment_of(vector) == segment


def test_what_is_not_told_is_0() -> None:
    assert Segment(1.0, SLEW, START, GOAL).vector()[2 + 14 :] == (0.0,) * (SIZE - 16)


def test_hold_stays() -> None:
    segment = segment_of(hold(START, 2.0).vector())
    assert (segment.kind, segment.start, segment.goal) == (HOLD, START, START)


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
