"""The compensator of one axis as machine code, for loops that are run ten thousand times.

It is the law of :mod:`chamfer.systems.servo.compensation_law`, compiled; a tick's time is left
out, as nothing here depends on it.
"""

from chamfer.systems.compiled import compiled
from chamfer.systems.servo.compensation_law import (
    class_increment,
    error_class,
    is_measured,
    limited_sum,
)

_class_increment = compiled(class_increment)
_error_class = compiled(error_class)
_is_measured = compiled(is_measured)
_limited_sum = compiled(limited_sum)


@compiled
def compensate(
    compensation: float,
    error: float,
    dead_zone: float,
    large_error: float,
    increment: float,
    divider: float,
    limit: float,
) -> tuple[float, float]:
    """Run one tick of Figs. 3 and 4 with the parameters of an axis.

    Args:
        compensation: The total so far.
        error: As measured, NaN where nothing was: then the total is held.
        dead_zone: Of the axis, as all that follow.
        large_error: From here on an error is large.
        increment: For a large error.
        divider: Of the increment for a small error.
        limit: Of the total.

    Returns:
        The new total, and the increment that the tick asked for before the limit.
    """
    if not _is_measured(error):
        return compensation, 0.0
    asked = _class_increment(_error_class(error, dead_zone, large_error), increment, divider)
    return _limited_sum(compensation, asked, limit), asked
