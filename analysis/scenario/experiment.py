"""What an experiment is, and what running one returns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pydrake.geometry import Meshcat
    from pydrake.systems.framework import Diagram

    from chamfer.systems.statechart.chart import Chart

Scenario = TypeVar("Scenario")

Table = Mapping[str, NDArray[Any]]  # columns of equal length by name, in order


class Progress(Protocol):
    """Told by a run how far it is."""

    def __call__(self, fraction: float, doing: str = "") -> None:
        """Report the fraction done, 0 to 1, and in a few words what is being done.

        The fraction is NaN where nobody knows how much there is to do.
        """


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A measured number; ``value`` is None where it is undefined, and ``note`` says why."""

    value: float | None
    unit: str  # "" for a pure number
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a run measured.

    ``traces`` has one row per log time (campaigns: per trial); ``tables`` holds further tables
    that the figures need, by file name without ending.
    """

    metrics: Mapping[str, Metric]
    traces: Table
    simulated_seconds: float
    tables: Mapping[str, Table] = field(default_factory=dict)


def _as_it_is(scenario: Scenario) -> Scenario:
    return scenario


@dataclass(frozen=True, kw_only=True)
class Experiment(Generic[Scenario]):
    """An experiment that the command line can run, draw and report.

    The registry reads ``name``, ``paper``, ``figure`` and ``summary`` from the source, so that
    listing experiments imports neither Drake nor Matplotlib: write them as plain strings.
    """

    name: str
    paper: str  # the paper's key, the name of its module in analysis/published with dashes
    figure: str  # the paper's figure or section, "" for an analysis of our own
    summary: str  # one line
    scenario: type[Scenario]
    run: Callable[[Scenario, int, Progress], Outcome]  # resolved scenario, seed, progress
    plot: Callable[[Scenario, Outcome], Mapping[str, "Figure"]]  # figures by file name, no ending
    resolve: Callable[[Scenario], Scenario] = _as_it_is  # fills in what the scenario leaves open
    # the same, to 1e-12, by a way that is faster for the many points of a sweep
    run_swept: Callable[[Scenario, int, Progress], Outcome] | None = None
    diagram: Callable[[Scenario], "Diagram"] | None = None  # the wiring, for the block diagram
    charts: Callable[[Scenario], Sequence["Chart[Any, Any]"]] | None = None  # its state charts
    replay: Callable[[Scenario, Outcome, "Meshcat"], None] | None = None  # shows the run in 3-D
    # path=value: the smallest run that is still one, for tests, audits and examples
    reduced: tuple[str, ...] = ()


def column(values: Sequence[float] | NDArray[Any]) -> NDArray[np.float64]:
    """Return a table's column as an array of float64."""
    return np.asarray(values, dtype=np.float64)
