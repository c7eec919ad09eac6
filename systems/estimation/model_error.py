"""Possible errors in an observer's model, and calibrations that the observer makes itself."""

import math
from dataclasses import dataclass
from itertools import accumulate
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_not_negative

Array = NDArray[np.float64]

_WHOLE: Final = 1e-6  # of a period, less is rounding
_TOUCH: Final = 3.0  # times the length of the force's error, which shows contact
_LEAST_DEVIATION: Final = 0.02  # relative, of a stiffness: no contact point rests perfectly


@dataclass(frozen=True, kw_only=True)
class ModelErrorParams:
    """Possible errors of the observer's model of gripper and sensor.

    A deviation is a standard deviation. For an error with a bound, the bound itself or little less
    is consistent at the bound, and cautious within it.
    """

    stiffness: float = 0.0  # relative, deviation of a factor on all of K
    bias: float = 0.0  # N, deviation of a constant error of F, on each axis
    delay: float = 0.0  # s, delay of the force
    delay_deviation: float = 0.0  # s, deviation of the delay
    tare: float = 0.0  # s, from the start, while the gripper is free: for the bias
    press: float = 0.0  # s, then, while it meets the surface and does not slide: for the stiffness
    position: float = 0.0  # m, deviation of the nominal position, on each axis
    position_length: float = 0.0  # m, of the path, over which it changes; 0: in each sample
    friction: float = 0.0  # rad, deviation of friction's direction from the path's

    def __post_init__(self) -> None:
        require_not_negative(self, *vars(self))
        if not self.stiffness < 1:
            raise ParameterError("stiffness", self.stiffness, "a part below 1")
        if self.tare and not self.bias:
            raise ParameterError("tare", self.tare, "0, if there is no bias to be found")
        if self.press and not self.stiffness:
            raise ParameterError("press", self.press, "0, if there is no stiffness to be found")
        if self.position_length and not self.position:
            allowed = "0, if the position has no error"
            raise ParameterError("position_length", self.position_length, allowed)


class _Memory(NamedTuple):
    """Views of a calibration's memory."""

    taken: Array  # (1,), samples so far
    bias: Array  # (3,), N
    touched: Array  # (1,), samples since contact was made
    mean: Array  # (9,), of x_nom, v_nom and K^-1 F since then
    products: Array  # (5,), sums of products of what is off them: xx, xv, vv, xF, vF
    factor: Array  # (1,), K over the one that was set; 0 before it is known
    variance: Array  # (1,), of the factor
    later: Array  # (1,), s, further delay of the force than was set
    spread: Array  # (1,), s^2, its variance


_LENGTHS: Final = (1, 3, 1, 9, 5, 1, 1, 1, 1)
_PARTS: Final = [slice(b - n, b) for n, b in zip(_LENGTHS, accumulate(_LENGTHS), strict=True)]
CALIBRATION: Final = sum(_LENGTHS)  # numbers that a calibration remembers


class GripperCalibration:
    """Finds the force sensor's bias with a free gripper; stiffness and delay by pressing.

    A free gripper feels no force, so the sensor's reading is its bias. While the contact point p
    rests, ``K^-1 F = a (p - x_nom + s v_nom)`` with the true stiffness ``a K`` and a force that is
    later by s than the setting. By least squares both are slopes, of which the one along v_nom
    needs a motion that changes. All start from the expected values and their deviations.

    Args:
        params: The possible errors, and the durations of both calibrations.
        force: N, standard deviation of a force's component.
        compliance: m/N, by the settings, shape (3, 3).
        period: s.
    """

    def __init__(
        self, params: ModelErrorParams, *, force: float, compliance: Array, period: float
    ) -> None:
        self._params, self._force = params, force
        self._compliance = compliance
        self._point = force * float(np.linalg.norm(compliance, 2))
        self._taring = math.floor(params.tare / period + _WHOLE)
        self._end = self._taring + math.floor(params.press / period + _WHOLE)

    def take(self, memory: Array, force: Array, nominal: Array, velocity: Array) -> bool:
        """Process a sample; False if the calibration is over.

        Args:
            memory: Shape (23,), zeros at first; changed.
            force: N, of the surface on the gripper, shape (3,).
            nominal: m, x_nom, shape (3,), when the force is taken to be of.
            velocity: m/s, v_nom, likewise.
        """
        kept = _views(memory)
        count = kept.taken[0]
        if count >= self._end:
            return False
        kept.taken[0] = count + 1
        if count < self._taring:
            # The mean, drawn to 0 as if as many samples had shown it before.
            before = count + (self._force / self._params.bias) ** 2
            kept.bias[:] = (kept.bias * before + force) / (before + 1)
            return True
        clean = force - kept.bias
        if kept.touched[0]:
            self._press(kept, np.stack([nominal, velocity, self._compliance @ clean]))
        # What shows contact does not count: a force that is large by chance is more likely to.
        elif float(clean @ clean) > (_TOUCH * math.sqrt(3) * self._force) ** 2:
            kept.touched[0] = 1.0
        return True

    def touched(self, memory: Array) -> bool:
        """Return whether contact was made."""
        return bool(_views(memory).touched[0])

    def _press(self, kept: _Memory, sample: Array) -> None:
        """Process x_nom, v_nom and K^-1 F, shape (3, 3)."""
        mean = kept.mean.reshape(3, 3)
        before = sample - mean
        mean += before / kept.touched[0]
        kept.touched[0] += 1
        products = before @ (sample - mean).T
        kept.products[:] += products[(0, 0, 1, 0, 1), (0, 1, 1, 2, 2)]
        xx, xv, vv, xf, vf = kept.products / self._point**2
        expected = self._params.stiffness**-2
        information = np.array([[xx + expected, -xv], [-xv, vv]])
        shown = np.array([expected - xf, vf])
        if self._params.delay_deviation:
            information[1, 1] += self._params.delay_deviation**-2
        else:
            information[0, 1] = information[1, 0] = shown[1] = 0.0
            information[1, 1] = math.inf
        factor, slope = np.linalg.solve(information, shown)
        variance = np.diag(np.linalg.inv(information))
        kept.factor[0], kept.variance[0] = factor, variance[0] + _LEAST_DEVIATION**2
        scale = max(factor, _LEAST_DEVIATION)
        kept.later[0], kept.spread[0] = slope / scale, variance[1] / scale**2

    def delay(self, memory: Array) -> tuple[float, float]:
        """Return how late the force is, s, and its standard deviation."""
        kept, params = _views(memory), self._params
        if not kept.factor[0]:
            return params.delay, params.delay_deviation
        return params.delay + float(kept.later[0]), math.sqrt(kept.spread[0])

    def bias(self, memory: Array) -> Array:
        """Return the bias, N, shape (3,)."""
        return _views(memory).bias

    def factor(self, memory: Array) -> float:
        """Return the stiffness over the one that was set."""
        factor = float(_views(memory).factor[0])
        return factor if factor > 0.0 else 1.0

    def covariance(self, memory: Array) -> Array:
        """Return the covariance of the remaining errors of both, shape (4, 4).

        First the compliance's, relative, then the bias', N.
        """
        kept = _views(memory)
        stiffness, bias = self._params.stiffness**2, self._params.bias**2
        if kept.factor[0] > 0.0:
            stiffness = min(stiffness, kept.variance[0] / kept.factor[0] ** 2)
        if bias:
            bias /= 1 + min(kept.taken[0], self._taring) * bias / self._force**2
        return np.diag([stiffness, bias, bias, bias])


def _views(memory: Array) -> _Memory:
    return _Memory(*(memory[part] for part in _PARTS))
