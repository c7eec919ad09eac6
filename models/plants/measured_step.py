"""A measured step response from a CSV file, and the fitted plant with its uncertainty."""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import scipy  # whose submodules are imported where they are used
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_not_negative, require_positive

Array = NDArray[np.float64]

COLUMNS: Final = ("time", "command", "position")
_LEAST_ROWS: Final = 20
_WORST_FIT: Final = 0.1  # of the position's change, root mean square of what is left
_RATIOS: Final = (0.02, 0.2, 0.7)  # with which a fit is begun
_LEAST_RATIO: Final = 1e-4  # of a plant with one lag: the second is a ten thousandth of it
_MOST_RATIO: Final = 25.0  # damping ratio 0.1
_PARAMETERS: Final = 4
_LONGEST: Final = 100.0  # s, of a step as an arm makes it
_LEAST_GAIN: Final = 0.01  # of a plant whose position is to be what is commanded; 1 over the most


@dataclass(frozen=True, kw_only=True)
class IdentifiedPlant:
    """``gain e^(-dead_time s) / (ratio lag^2 s^2 + lag s + 1)``, and how well it is known.

    The ratio tells one lag (0) from two equal ones (0.25) and from an oscillation (more).
    """

    gain: float  # position per command at rest
    lag: float  # s, the sum of the plant's lags
    ratio: float  # coefficient of the second power, over the square of the lag
    dead_time: float  # s, before the position moves
    covariance: tuple[float, ...]  # of these four, 16 numbers row by row, in their units

    def __post_init__(self) -> None:
        require_positive(self, "gain", "lag", "ratio")
        require_not_negative(self, "dead_time")
        if len(self.covariance) != _PARAMETERS**2 or not all(map(math.isfinite, self.covariance)):
            raise ParameterError("covariance", self.covariance, "16 finite numbers")

    @property
    def deviations(self) -> tuple[float, ...]:
        """Standard deviations of gain, lag s, ratio and dead time s."""
        return tuple(math.sqrt(max(0.0, one)) for one in self.covariance[:: _PARAMETERS + 1])

    def drawn(self, generator: np.random.Generator) -> "IdentifiedPlant":
        """Return another plant that the measurement supports equally well."""
        covariance = np.reshape(self.covariance, (_PARAMETERS, _PARAMETERS))
        mean = (self.gain, self.lag, self.ratio, self.dead_time)
        gain, lag, ratio, dead_time = generator.multivariate_normal(
            mean, covariance, check_valid="ignore"
        ).tolist()
        return IdentifiedPlant(
            gain=max(gain, 0.1 * self.gain),
            lag=max(lag, 0.1 * self.lag),
            ratio=max(ratio, _LEAST_RATIO),
            dead_time=max(dead_time, 0.0),
            covariance=self.covariance,
        )


class MeasuredStep(NamedTuple):
    """A response to a command that changes once."""

    time: Array  # s, from the command's change on, negative before it
    position: Array
    change: float  # of the command


def read_step(path: Path) -> MeasuredStep:
    """Read a step response from a CSV file with the columns of :data:`COLUMNS`.

    Raises:
        ParameterError: If it can't be read, or the command does not change exactly once.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
        table = np.array([[float(row[name]) for name in COLUMNS] for row in rows])
    except OSError as error:
        raise ParameterError("measured", str(path), f"a file: {error.strerror}") from error
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise ParameterError("measured", str(path), _ALLOWED) from error
    if len(table) < _LEAST_ROWS or not np.isfinite(table).all():
        raise ParameterError("measured", str(path), _ALLOWED)
    time, command, position = table.T
    if not np.all(np.diff(time) > 0):
        raise ParameterError("measured", str(path), "a CSV file whose time increases")
    changes = np.flatnonzero(np.diff(command))
    if len(changes) != 1:
        allowed = f"a CSV file whose command changes once, it does {len(changes)} times"
        raise ParameterError("measured", str(path), allowed)
    first = int(changes[0]) + 1
    if len(time) - first < _LEAST_ROWS:
        allowed = f"a CSV file with {_LEAST_ROWS} rows and more after the command's change"
        raise ParameterError("measured", str(path), allowed)
    return MeasuredStep(time - time[first], position, float(np.diff(command)[first - 1]))


_ALLOWED: Final = (
    f"a CSV file with the columns {', '.join(COLUMNS)}, finite numbers, {_LEAST_ROWS} rows or more"
)


def unit_doubts(step: MeasuredStep, plant: IdentifiedPlant) -> Iterator[str]:
    """Yield the signs that a step is in other units, none if it is not."""
    lasts = float(step.time[-1] - step.time[0])
    if lasts > _LONGEST:
        yield f"it lasts {lasts:.4g} s; is its time in s, not in ms?"
    if not _LEAST_GAIN < plant.gain < 1 / _LEAST_GAIN:
        moved = f"its position changes by {plant.gain:.4g} times its command"
        yield f"{moved}; are both in m, none in mm?"


def identify(step: MeasuredStep) -> IdentifiedPlant:
    """Return the plant whose response fits best, by least squares, with its covariance.

    The covariance is the usual one of least squares, times how many rows in a row say the same,
    (1 + r)/(1 - r) with the residuals' correlation r from a row to the next.

    Raises:
        ParameterError: If no such plant answers like that.
    """
    time, position, change = step
    rest = float(position[time < 0].mean()) if np.any(time < 0) else float(position[0])
    end = float(position[-max(2, len(position) // 10) :].mean())
    gain = (end - rest) / change
    if not gain > 0:
        raise ParameterError("measured", gain, "a step whose position follows its command")
    left = np.clip((end - position[time >= 0]) / (end - rest), -1.0, 1.0)
    area = float(np.trapezoid(left, time[time >= 0]))
    lag = max(area, 1e-3 * float(time[-1]))

    def residuals(values: Array) -> Array:
        g, a, ratio, dead, start = values
        return np.array(start + change * g * unit_response(time - dead, a, ratio) - position)

    bounds = (
        [0.0, 1e-3 * lag, _LEAST_RATIO, 0.0, -np.inf],
        [np.inf, 1e3 * lag, _MOST_RATIO, float(time[-1]), np.inf],
    )
    scale = [gain, lag, 1.0, lag, abs(change * gain)]
    tried = [
        scipy.optimize.least_squares(
            residuals,
            [gain, (1 - dead) * lag, ratio, dead * lag, rest],
            bounds=bounds,
            x_scale=scale,
        )
        for ratio in _RATIOS
        for dead in (0.01, 0.3)
    ]
    best = min(tried, key=lambda one: float(one.cost))
    found = residuals(best.x)
    spread = math.sqrt(float(np.mean(found**2)))
    if not spread <= _WORST_FIT * abs(end - rest):
        share = 100 * spread / abs(end - rest)
        allowed = f"a step that a stable plant with two lags fits, {share:.2g} % are left over"
        raise ParameterError("measured", "its position", allowed)
    return IdentifiedPlant(
        **dict(zip(("gain", "lag", "ratio", "dead_time"), best.x[:4].tolist(), strict=True)),
        covariance=tuple(_covariance(np.asarray(best.jac), found)[:4, :4].ravel().tolist()),
    )


def _covariance(jacobian: Array, residuals: Array) -> Array:
    power = float(residuals @ residuals)
    alike = float(residuals[1:] @ residuals[:-1]) / power if power else 0.0
    alike = min(max(alike, 0.0), 0.99)
    variance = power / max(1, len(residuals) - jacobian.shape[1])
    inverse = np.linalg.pinv(jacobian.T @ jacobian, hermitian=True)
    return np.array(inverse * (variance * (1 + alike) / (1 - alike)), dtype=np.float64)


def unit_response(time: Array, lag: float, ratio: float) -> Array:
    """Return the response of ``1/(ratio lag^2 s^2 + lag s + 1)`` to a unit step at 0, shape (n,).

    It is 0 before.
    """
    after = np.maximum(time, 0.0) / lag
    root = np.sqrt(complex(1 - 4 * ratio))
    if abs(root) < 1e-6:  # two equal lags, of which the formula makes 0/0
        root = complex(1e-6)
    slow, fast = (-1 + root) / (2 * ratio), (-1 - root) / (2 * ratio)
    both = (fast * np.exp(slow * after) - slow * np.exp(fast * after)) / (slow - fast)
    return np.array((1 + both).real)
