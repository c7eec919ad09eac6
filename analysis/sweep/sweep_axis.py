"""The fields of a sweep along the axes of its figure."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from numpy.typing import NDArray

from chamfer.analysis.sweep.sweep import SweepResult, as_column
from chamfer.analysis.sweep.sweep_design import Drawn, VariedField

_FEW: Final = 6  # places along an axis that get a tick each
_FAR: Final = 50.0  # ratio of values from which an axis is logarithmic


@dataclass(frozen=True, kw_only=True)
class FieldAxis:
    """A varied field along an axis."""

    path: str
    label: str
    at: NDArray[np.float64]  # where each point is
    ticks: tuple[str, ...]  # for values that are no numbers, at 0, 1, ...
    logarithmic: bool

    def places(self) -> NDArray[np.float64]:
        """Return the places that points are at, in order."""
        return np.unique(self.at)

    def dress(self, axis: XAxis | YAxis) -> None:
        """Scale an axis, with ticks at the places where they are few."""
        places = self.places()
        if self.ticks:
            axis.set_ticks(places, labels=list(self.ticks))
        elif len(places) <= _FEW:
            axis.set_ticks(places, labels=[f"{place:.4g}" for place in places])
            axis.set_ticks([], minor=True)

    def edges(self) -> NDArray[np.float64]:
        """Return the ends of the cells around the places, shape (places + 1,)."""
        places = np.log(self.places()) if self.logarithmic else self.places()
        inner = (places[1:] + places[:-1]) / 2
        first, last = 2 * places[0] - inner[0], 2 * places[-1] - inner[-1]
        edges = np.array([first, *inner, last])
        return np.exp(edges) if self.logarithmic else edges


def field_axis(result: SweepResult, field: VariedField) -> FieldAxis:
    """Return the axis for a field of a sweep."""
    values = result.table[field.path]
    label = f"{field.path} / {divisor(field.unit)}" if field.unit else field.path
    if values.dtype == object or not np.isfinite(np.ptp(values.astype(np.float64))):
        assert not isinstance(field.spec, Drawn)
        texts = list(map(str, values))
        names = [name for name in map(str, as_column(field.spec)) if name in texts]
        at = np.array([names.index(text) for text in texts], dtype=np.float64)
        return FieldAxis(
            path=field.path, label=label, at=at, ticks=tuple(names), logarithmic=False
        )
    at = values.astype(np.float64)
    low, high = float(at.min()), float(at.max())
    logarithmic = low > 0 and high > _FAR * low and not isinstance(field.spec, Drawn)
    return FieldAxis(path=field.path, label=label, at=at, ticks=(), logarithmic=logarithmic)


def divisor(unit: str) -> str:
    """Return a unit as a label has it behind a slash."""
    return f"({unit})" if "/" in unit or " " in unit else unit


def scale(axes: Axes, x: FieldAxis, y: FieldAxis | None = None) -> None:
    """Scale the axes of a panel for fields, the second one unless it shows a metric."""
    if x.logarithmic:
        axes.set_xscale("log")
    x.dress(axes.xaxis)
    if x.ticks:
        axes.set_xlim(-0.5, len(x.ticks) - 0.5)
    if y is not None:
        if y.logarithmic:
            axes.set_yscale("log")
        y.dress(axes.yaxis)
