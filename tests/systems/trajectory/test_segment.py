"""Segments as vectors and back."""

import pytest

from models.validation import ParameterError
from systems.trajectory.segment import HOLD, SIZE, SLEW, Segment, hold, segment_of

START, GOAL = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0), (7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0)


def test_vector_and_back() -> None:
    segment = Segment(5.0, SLEW, START, GOAL, (0.1, 0.2, 0.3), 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    vector = segment.vector()
    assert len(vector) == SIZE
    assert len(set(vector)) == SIZE - 2  # 3 and 5 stand twice
    assert segment_of(vector) == segment


def test_hold_stays() -> None:
    segment = segment_of(hold(START, 2.0).vector())
    assert (segment.kind, segment.start, segment.goal) == (HOLD, START, START)


def test_refuses_another_size() -> None:
    with pytest.raises(ParameterError, match=rf"segment is .*, allowed: {SIZE} numbers"):
        segment_of((0.0,) * (SIZE - 1))
