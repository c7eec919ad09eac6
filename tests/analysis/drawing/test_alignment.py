import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.drawing.alignment import Gap, align


def test_the_more_important_tie_is_kept() -> None:
    # 0 is above 1, 2 above 3: the ties would have to cross.
    gaps = [Gap(0, 1, 10.0), Gap(2, 3, 10.0)]
    positions = align(4, gaps, [Gap(0, 3, 0.0), Gap(1, 2, 0.0)])
    assert positions[0] == pytest.approx(positions[3])
    assert positions[1] >= positions[0] + 10
    assert positions[2] <= positions[3] - 10


def test_what_is_not_tied_moves_to_the_middle_of_its_wishes() -> None:
    gaps = [Gap(0, 1, 100.0)]
    positions = align(3, gaps, [Gap(0, 2, 0.0), Gap(1, 2, 0.0)])
    assert positions[0] <= positions[2] <= positions[1]


@given(
    st.lists(st.tuples(st.integers(0, 8), st.integers(1, 9), st.floats(0, 50)), max_size=15),
    st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9), st.floats(-50, 50)), max_size=15),
)
def test_every_gap_is_kept(
    gaps: list[tuple[int, int, float]], ties: list[tuple[int, int, float]]
) -> None:
    least = [Gap(i, min(i + step, 9), distance) for i, step, distance in gaps]
    wishes = [Gap(i, j, distance) for i, j, distance in ties if i != j]
    positions = align(10, least, wishes)
    for gap in least:
        assert positions[gap.after] - positions[gap.before] >= gap.distance - 1e-3
