"""What a picture that merely has no overlaps doesn't show: few crossings, few steps, the order."""

import pytest

from chamfer.analysis.drawing.layering import (
    align,
    assign_layers,
    assign_tracks,
    feedback,
    order_layers,
)


def test_a_loop_is_cut_where_the_reference_enters() -> None:
    pairs = [("noise", "camera"), ("camera", "sum"), ("reference", "sum"), ("sum", "plant")]
    pairs.append(("plant", "camera"))
    keys = ["noise", "camera", "reference", "sum", "plant"]
    found = feedback(keys, pairs, lambda key: key == "sum")
    assert [pairs[i] for i in found] == [("camera", "sum")]


def test_a_disturbance_stands_before_its_target() -> None:
    pairs = [("a", "b"), ("b", "c"), ("c", "d"), ("noise", "filter"), ("filter", "d")]
    layer = assign_layers(["a", "b", "c", "d", "noise", "filter"], pairs)
    assert layer == {"a": 0, "b": 1, "c": 2, "d": 3, "noise": 1, "filter": 2}


def test_crossings_are_undone() -> None:
    crossed = [("a", 0, "y", 0), ("b", 0, "x", 0)]
    left, right = order_layers([["a", "b"], ["x", "y"]], crossed, lambda _: 0)
    assert left.index("a") - left.index("b") == right.index("y") - right.index("x")
    fixed = [("a", 0.9, "x", 0), ("a", 0.1, "y", 0)]  # ports of a cluster
    assert order_layers([["a"], ["x", "y"]], fixed, lambda _: 0) == [["a"], ["y", "x"]]
    # What belongs to the lower group stays below.
    assert order_layers([["a"], ["x", "y"]], fixed, lambda key: key == "y") == [["a"], ["x", "y"]]


def test_the_more_important_tie_is_kept() -> None:
    # 0 is above 1, 2 above 3: the ties would have to cross.
    y = align(range(4), [(0, 1, 10.0), (2, 3, 10.0)], {(0, 3, 0.0): 2.0, (1, 2, 0.0): 1.0})
    assert y is not None
    assert y[0] == pytest.approx(y[3])
    assert y[1] >= y[0] + 10
    assert y[2] <= y[3] - 10
    assert align(range(2), [(0, 1, 1.0), (1, 0, 1.0)], {}) is None


def test_tracks_do_not_cross_unless_they_have_to() -> None:
    assert assign_tracks({"a": ([0], [50]), "b": ([20], [70])}) == ({"a": 1, "b": 0}, [])
    assert assign_tracks({"a": ([0], [20]), "b": ([60], [90])})[0] == {"a": 0, "b": 0}
    assert assign_tracks({"a": ([0], [50]), "b": ([50], [0])})[1]
