"""The compiled tick against the charts of Figs. 3 and 4."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.servo.compensator import (
    AxisParams,
    CompensatorInputs,
    CompensatorParams,
    make_compensator_chart,
)
from chamfer.systems.servo.compiled_compensator import compensate

THRESHOLDS = (0.125, 1.0)
TIES = [
    sign * near
    for sign in (-1, 1)
    for edge in THRESHOLDS
    for near in (edge, math.nextafter(edge, 0), math.nextafter(edge, math.inf))
]
ERRORS = st.lists(
    st.sampled_from([0.0, *TIES, math.nan, math.inf, -math.inf]) | st.floats(-3, 3),
    min_size=1,
    max_size=40,
)


@settings(deadline=None)  # the first call compiles
@given(
    errors=ERRORS,
    large_error=st.sampled_from(THRESHOLDS),
    increment=st.floats(0.01, 2.0),
    divider=st.floats(1.0, 20.0),
    limit=st.floats(0.1, 5.0) | st.just(math.inf),
)
def test_a_tick_is_that_of_the_charts(
    errors: list[float], large_error: float, increment: float, divider: float, limit: float
) -> None:
    axis = AxisParams(
        dead_zone=THRESHOLDS[0],
        large_error=large_error,
        increment=increment,
        divider=divider,
        limit=limit,
    )
    chart = make_compensator_chart(CompensatorParams(axes=(axis,)))
    snapshot, total = chart.start(), 0.0
    for i, error in enumerate(errors):
        snapshot, _ = chart.step(snapshot, CompensatorInputs((error,), None, None), i / 80)
        total, asked = compensate(
            total,
            error,
            axis.dead_zone,
            axis.large_error,
            axis.increment,
            axis.divider,
            axis.limit,
        )
        assert (total, asked) == snapshot.memory.axes[0].memory
