"""The rule of Fig. 4: by how much one axis is corrected for a measured error.

Source: Ruybal, Lumia and Wood, Fig. 4. The functions take numbers or arrays and are made of
comparisons and products alone, so that the chart, the compiled loop, the design and the benchmarks
all call these: nowhere else is the rule written.
"""

import math
from typing import Any


def error_class(error: Any, dead_zone: Any, large_error: Any) -> Any:
    """Return the class of an error: 0 in the dead zone, +-1 small, +-2 large; 0 for NaN."""
    size = abs(error)
    found = (size >= dead_zone) * 1 + (size >= large_error) * 1
    return (error > 0) * found - (error < 0) * found


def class_increment(found: Any, increment: Any, divider: Any) -> Any:
    """Return what a class asks for: n for a large error, n / divider for a small one."""
    size = abs(found)
    step = (size == 2) * increment + (size == 1) * (increment / divider)
    return (found > 0) * step - (found < 0) * step


def limited_sum(compensation: float, increment: float, limit: float) -> float:
    """Return the total compensation after an increment."""
    return max(-limit, min(limit, compensation + increment))


def is_measured(error: float) -> bool:
    """Return whether there is a measurement."""
    return math.isfinite(error)
