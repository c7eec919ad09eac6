"""What holds for layers, orders, heights and tracks, whatever is drawn."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.drawing.layering import (
    CLEARANCE,
    align,
    assign_layers,
    assign_tracks,
    feedback,
    order_layers,
)

Pairs = list[tuple[int, int]]
pairs_of_numbers = st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), max_size=20)
heights = st.lists(st.integers(0, 20).map(lambda i: 10.0 * i), min_size=2, max_size=2)
Number = st.integers(0, 9)


def never(_: object) -> bool:
    return False


@given(pairs_of_numbers)
def test_layers_increase_along_what_is_no_feedback(pairs: Pairs) -> None:
    keys = list(range(8))
    found = feedback(keys, pairs, never)
    forward = [pair for i, pair in enumerate(pairs) if i not in found and pair[0] != pair[1]]
    layer = assign_layers(keys, forward)
    assert all(layer[source] < layer[target] for source, target in forward)
    assert set(layer.values()) == set(range(max(layer.values()) + 1))
    assert feedback(keys, [(min(pair), max(pair)) for pair in pairs], never) == set()


def test_a_disturbance_stands_before_its_target() -> None:
    pairs = [("a", "b"), ("b", "c"), ("c", "d"), ("noise", "filter"), ("filter", "d")]
    layer = assign_layers(["a", "b", "c", "d", "noise", "filter"], pairs)
    assert (layer["noise"], layer["filter"], layer["d"]) == (1, 2, 3)


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


@given(
    st.lists(st.tuples(st.integers(0, 8), st.integers(1, 9), st.floats(0, 50)), max_size=15),
    st.lists(st.tuples(Number, Number, st.floats(-50, 50)), max_size=15),
)
def test_every_gap_is_kept(
    gaps: list[tuple[int, int, float]], ties: list[tuple[int, int, float]]
) -> None:
    least = [(i, min(i + step, 9), distance) for i, step, distance in gaps]
    y = align(range(10), least, {tie: 1.0 for tie in ties if tie[0] != tie[1]})
    assert y is not None
    assert all(y[after] - y[before] >= distance - 1e-3 for before, after, distance in least)


def test_tracks_do_not_cross_unless_they_have_to() -> None:
    assert assign_tracks({"a": ([0], [50]), "b": ([20], [70])}) == ({"a": 1, "b": 0}, [])
    assert assign_tracks({"a": ([0], [20]), "b": ([60], [90])})[0] == {"a": 0, "b": 0}
    assert assign_tracks({"a": ([0], [50]), "b": ([50], [0])})[1]


@given(st.lists(heights, max_size=8))
def test_pieces_on_a_track_keep_their_distance(ends: list[list[float]]) -> None:
    tracks, _ = assign_tracks({i: ([left], [right]) for i, (left, right) in enumerate(ends)})
    for i, a in enumerate(ends):
        for j, b in enumerate(ends[:i]):
            apart = max(a) + CLEARANCE <= min(b) or max(b) + CLEARANCE <= min(a)
            assert apart or tracks[i] != tracks[j]
