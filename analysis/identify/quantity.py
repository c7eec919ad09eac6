"""A quantity from a log, with a 95 % interval that accounts for correlated samples.

Every estimate is a function of sums over rows. The sums are kept for consecutive blocks of the
log, each much longer than what correlates in it, and the estimate's covariance comes from
leaving out one block after the other (the jackknife); intervals take Student's t.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher
from scipy.stats import t as student

Array = NDArray[np.float64]
BLOCKS: Final = 16  # of a log
_RIDGE: Final = 1e-12  # of a column's squares, so that columns may be alike


class Quantity(NamedTuple):
    """A value and its 95 % interval; None: unknown, for the reason in the note."""

    value: float | None
    low: float | None
    high: float | None
    unit: str
    note: str = ""


def unknown(unit: str, note: str) -> Quantity:
    """Return an unknown quantity with the reason."""
    return Quantity(None, None, None, unit, note)


class Estimate(NamedTuple):
    """Values, (k,), their covariance, (k, k), and the number of blocks behind it."""

    values: Array
    covariance: Array
    blocks: int

    def half(self) -> Array:
        """Half the widths of the 95 % intervals, (k,)."""
        quantile = student.ppf(0.975, self.blocks - 1)
        return np.asarray(quantile * np.sqrt(np.diag(self.covariance)))

    def part(self, begin: int, end: int) -> "Estimate":
        """Return some of the values."""
        return Estimate(self.values[begin:end], self.covariance[begin:end, begin:end], self.blocks)

    def quantity(self, i: int, unit: str, note: str = "") -> Quantity:
        """Return one of the values."""
        value, half = float(self.values[i]), float(self.half()[i])
        return Quantity(value, value - half, value + half, unit, note)

    def length(self, unit: str, note: str = "") -> Quantity:
        """Return the length of three values as a vector; from 0 if all may be 0."""
        length = float(np.linalg.norm(self.values))
        along = self.values / max(length, 1e-300)
        free = self.blocks - 3
        limit = 3 * (self.blocks - 1) / free * fisher.ppf(0.95, 3, free)  # Hotelling
        half = float(
            student.ppf(0.975, self.blocks - 1) * np.sqrt(along @ self.covariance @ along)
        )
        if self.values @ np.linalg.pinv(self.covariance) @ self.values < limit:
            half = max(half, float(np.sqrt(limit * np.linalg.eigvalsh(self.covariance)[-1])))
            return Quantity(length, 0.0, length + half, unit, note)
        return Quantity(length, max(0.0, length - half), length + half, unit, note)


def in_blocks(rows: Array, blocks: int = BLOCKS) -> Array:
    """Return the sums of the rows, (n, ...), over consecutive blocks, (blocks, ...)."""
    return np.array([block.sum(axis=0) for block in np.array_split(rows, blocks)])


def jackknife(statistic: Callable[..., Array], *sums: Array) -> Estimate:
    """Return a statistic, (k,), of total sums; the sums are those of blocks."""
    totals = [np.asarray(s.sum(axis=0)) for s in sums]
    left_out = zip(*sums, strict=True)
    values = np.array(
        [statistic(*(t - s for t, s in zip(totals, one, strict=True))) for one in left_out]
    )
    apart = values - values.mean(axis=0)
    blocks = len(values)
    return Estimate(statistic(*totals), (blocks - 1) / blocks * apart.T @ apart, blocks)


def solve(products: Array, right: Array) -> Array:
    """Return the least-squares coefficients, (k,) or (k, m), from sums of products, (k, k).

    A column of zeros gets the coefficient 0.
    """
    squares = np.diag(products)
    scale = np.where(squares > 0, 1 / np.sqrt(np.where(squares > 0, squares, 1.0)), 0.0)
    scaled = products * scale[:, None] * scale + _RIDGE * np.eye(len(scale))
    return np.asarray((np.linalg.inv(scaled) * scale[:, None] * scale) @ right)
