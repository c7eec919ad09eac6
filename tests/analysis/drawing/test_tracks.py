from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.drawing.tracks import CLEARANCE, Piece, assign_tracks


def test_parallel_lines_downwards_do_not_cross() -> None:
    tracks, clashes = assign_tracks([Piece("a", (0,), (50,)), Piece("b", (20,), (70,))])
    assert tracks == {"a": 1, "b": 0}
    assert not clashes


def test_lines_at_different_heights_share_a_track() -> None:
    tracks, _ = assign_tracks([Piece("a", (0,), (20,)), Piece("b", (60,), (90,))])
    assert tracks == {"a": 0, "b": 0}


def test_lines_that_swap_their_heights_clash() -> None:
    _, clashes = assign_tracks([Piece("a", (0,), (50,)), Piece("b", (50,), (0,))])
    assert clashes


heights = st.lists(st.integers(0, 20).map(lambda i: 10.0 * i), min_size=2, max_size=2)


@given(st.lists(heights, max_size=8))
def test_pieces_on_a_track_keep_their_distance(ends: list[list[float]]) -> None:
    pieces = [Piece(i, (left,), (right,)) for i, (left, right) in enumerate(ends)]
    tracks, _ = assign_tracks(pieces)
    for a in pieces:
        for b in pieces[a.id + 1 :]:
            if tracks[a.id] == tracks[b.id]:
                assert a.high + CLEARANCE <= b.low or b.high + CLEARANCE <= a.low
