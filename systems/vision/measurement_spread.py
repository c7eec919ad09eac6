"""How much noise in the images moves the measured errors of two long parts.

Both long edges of a part are lines fitted to one point a column. Over L columns a line's angle
has the variance ``12 s^2 / L^3`` and its middle ``s^2 / L``, with s the standard deviation of one
point, and the axis is the mean of two lines. The lateral error is that of the peg's tip from the
hole's axis, which is prolonged over the gap.
"""

import math
from typing import Final, NamedTuple

# pixels a grey level; at a noise of 4 grey levels the parts of the paper, at rest, had standard
# deviations of 0.026 pixels and 0.25 mrad
_POINT: Final = 0.0175
_FLOOR: Final = 0.02  # pixels, of a point without noise: what a row gains or loses


class MeasurementSpread(NamedTuple):
    """Standard deviations of the error that one image tells."""

    lateral: float  # pixels
    rotational: float  # rad


def measurement_spread(noise: float, peg: float, hole: float, gap: float) -> MeasurementSpread:
    """Return the standard deviations of one frame's errors.

    Args:
        noise: Grey levels, standard deviation.
        peg: Columns of the peg's straight edges.
        hole: Likewise of the part with the hole.
        gap: Columns between tip and mouth.
    """
    point = math.hypot(_POINT * noise, _FLOOR)
    angles = [6 / length**3 for length in (peg, hole)]
    prolonged = angles[1] * (gap + hole / 2) ** 2 + 0.5 / hole
    at_tip = 2.0 / peg  # middle and angle of the peg's own axis, at its end
    return MeasurementSpread(
        lateral=point * math.sqrt(prolonged + at_tip), rotational=point * math.sqrt(sum(angles))
    )
