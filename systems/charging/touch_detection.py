"""How the charging cycle tells that something is touched: by the mean of the last force readings.

A reading alone is mostly noise, and to ask for several in a row beyond a threshold is slow where
the force is near it, and often wrong where the noise is larger than the force. With an uniform
noise of half-width e the mean of n readings has a standard deviation of ``e / sqrt(3 n)``.
"""

import math
from dataclasses import dataclass, replace
from typing import Final

from chamfer.models.validation import ParameterError, require_not_negative, require_positive

_RARE: Final = 5.0  # standard deviations of the mean that noise alone does not show
_CLEAR: Final = 2.0  # thresholds by one another, at least


@dataclass(frozen=True, kw_only=True)
class TouchDetectionParams:
    """What is contact with the wall, and its loss."""

    readings: int = 16  # of the force, a period each, whose mean is looked at
    detect: float | None = None  # N, a larger mean is contact; None: derived from the noise
    release: float = 0.15  # N, a mean not above it is its loss; assumed, an eighth of the force

    def __post_init__(self) -> None:
        require_not_negative(self, "release")
        if self.readings < 1:
            raise ParameterError("readings", self.readings, "a whole number >= 1")
        if self.detect is not None:
            require_positive(self, "detect")
            if not self.release < self.detect:
                raise ParameterError("release", self.release, f"less than detect, {self.detect:g}")

    def resolved(self, noise: float, bias: float = 0.0) -> "TouchDetectionParams":
        """Return the parameters with what noise and bias ask for filled in.

        Args:
            noise: N, half-width of the measured push without contact.
            bias: N, the most that it is off on average.

        Raises:
            ParameterError: If the bias alone would be taken for contact.
        """
        if self.detect is None:
            spread = noise / math.sqrt(3 * self.readings)
            found = bias + max(_CLEAR * self.release, _RARE * spread)
            return replace(self, detect=float(f"{found:.6g}"))
        if self.detect <= bias:
            raise ParameterError("detect", self.detect, f"more than the sensor's bias, {bias:g} N")
        return self
