"""The impulse of a surface's spring and damper against the law that it solves."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.systems.contact.stick_slip import normal_impulse, normal_slope

gaps = st.floats(-1e-2, 1e-2)
SPRING, DAMPING = 1e-4 * 1e4, 20.0  # h k, d


def law(gap: float, after: float, rigid: bool, damping: float = DAMPING) -> float:
    """Return the impulse for a gap after the step: mean force of the spring, and the damper."""
    damper = damping * (min(after, 0.0) - min(gap, 0.0))
    if not rigid:
        return max(0.0, -SPRING * after - damper)
    if max(gap, after) <= 0.0:
        return max(0.0, -SPRING * (gap + after) / 2 - damper)
    given_back = SPRING * (min(gap, 0.0) ** 2 - min(after, 0.0) ** 2) / 2
    return max(0.0, given_back / (after - gap) - damper) if given_back else max(0.0, -damper)


@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "gripper"])
@given(gap=gaps, free=gaps, reach=st.sampled_from([0.0, 1e-5, 1e-3, 1.0]))
def test_impulse_is_what_the_law_says_of_the_gap_that_it_makes(
    gap: float, free: float, reach: float, rigid: bool
) -> None:
    impulse = normal_impulse(gap, free, reach, SPRING, DAMPING, rigid)
    expected = law(gap, free + reach * impulse, rigid)
    # to rounding of the gap
    assert impulse == pytest.approx(expected, rel=1e-9, abs=(SPRING + DAMPING) * 1e-15)


@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "gripper"])
@given(gap=gaps, free=st.floats(0.0, 1e-2), reach=st.floats(0.0, 1.0))
def test_nothing_pushes_across_a_gap(gap: float, free: float, reach: float, rigid: bool) -> None:
    impulse = normal_impulse(gap, free, reach, SPRING, DAMPING, rigid)
    if gap >= 0.0:
        assert impulse == 0.0
    else:  # what the spring had stored
        assert 0.0 <= impulse * (free + reach * impulse - gap) <= SPRING * gap**2 / 2 * (1 + 1e-9)


@pytest.mark.parametrize(
    ("gap", "after", "rigid"),
    [(-1e-3, -2e-3, True), (-1e-3, 1e-5, True), (1e-3, -2e-3, True), (-1e-3, -2e-3, False)],
)
def test_slope_is_that_of_the_law(gap: float, after: float, rigid: bool) -> None:
    more, less = (law(gap, after + step, rigid, 0.1) for step in (1e-8, -1e-8))
    change = (more - less) / 2e-8
    assert change != 0.0
    slope = normal_slope(gap, after, SPRING, 0.1, rigid)
    assert slope == pytest.approx(change, rel=1e-4)
