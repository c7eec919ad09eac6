"""Experiments, their catalogue, and the outcome of a run."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, TypeVar

from chamfer.analysis.scenario.errors import UserError, valid_name

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray
    from pydrake.geometry import Meshcat
    from pydrake.systems.framework import Diagram

    from chamfer.systems.statechart.chart import Chart

Scenario = TypeVar("Scenario")

_KEY: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")

Table = Mapping[str, "NDArray[Any]"]  # columns of equal length by name, in order


class Progress(Protocol):
    """Receives the progress of a run."""

    def __call__(self, fraction: float, doing: str = "") -> None:
        """Report the fraction done, 0 to 1, and the current activity in a few words.

        The fraction is NaN where the total is unknown.
        """


def quiet(fraction: float, doing: str = "") -> None:
    """Report to nobody."""


def part_of(progress: Progress, begin: float, end: float, name: str = "") -> Progress:
    """Return the progress of a part of a run, from one fraction of it to another."""

    def told(fraction: float, doing: str = "") -> None:
        progress(begin + (end - begin) * fraction, f"{name} {doing}".strip())

    return told


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A measured number; if it is undefined, ``value`` is None and ``note`` gives the reason."""

    value: float | None
    unit: str  # "" for a pure number
    note: str = ""
    trials: tuple[float | None, ...] = ()  # the values that it is made of, if there are several


def measured(value: float | None, unit: str, *, note: str = "", missing: str) -> Metric:
    """Return a metric, which is undefined with a note if the number is not finite."""
    if value is None or not math.isfinite(value):
        return Metric(value=None, unit=unit, note=missing)
    return Metric(value=float(value), unit=unit, note=note)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The measurements of a run.

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
    """An experiment that the command line can run, draw and report."""

    default: Scenario  # as written
    run: Callable[[Any, int, Progress], Outcome]  # resolved scenario, seed, progress
    plot: Callable[[Any, Outcome], Mapping[str, "Figure"]]  # figures by file name, no ending
    resolve: Callable[[Scenario], Any] = _as_it_is  # fills in what the scenario leaves open
    # the same, to 1e-12, by a way that is faster for the many points of a sweep
    run_swept: Callable[[Any, int, Progress], Outcome] | None = None
    diagram: Callable[[Any], "Diagram"] | None = None  # the wiring, for the block diagram
    # the loops that a run simulates, in its order, if they aren't the diagram's alone; none if
    # its controllers are drawn
    loops: Callable[[Any], Sequence["Diagram"]] | None = None
    charts: Callable[[Any], Sequence["Chart[Any, Any]"]] | None = None  # its state charts
    replay: Callable[[Any, Outcome, "Meshcat"], None] | None = None  # shows the run in 3-D


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An experiment as a catalogue lists it, without importing it.

    ``scenario``, ``run`` and the names below it are of ``module``, or name their own:
    ``chamfer.diagrams.servo.servo_loops:make_servo_diagram``. They are the fields of
    :class:`Experiment`.
    """

    name: str
    paper: str  # the paper's key, the name of its module among the published values with dashes
    summary: str  # one line
    module: str
    scenario: str
    figure: str = ""  # the paper's figure or section, "" for an analysis of our own
    study: bool = False  # True: goes beyond the paper's own figures and tables
    seconds: float = 5.0  # s, about what it takes on one core, for its turn and the time left
    run: str = "run"
    plot: str = "figures"
    resolve: str = ""
    run_swept: str = ""
    diagram: str = ""
    loops: str = ""
    charts: str = ""
    replay: str = ""
    # path=value: the smallest run that is still one, for tests, audits and examples
    reduced: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("name", "paper"):  # they become folders and anchors
            if not _KEY.fullmatch(value := getattr(self, name)):
                raise UserError(
                    f"experiment {self.name!r}: {name} is {value!r}, "
                    "allowed: lower-case letters, digits and single dashes between them"
                )


@dataclass(frozen=True, kw_only=True)
class Catalogue:
    """Experiments, and the package with the published values, a module for each paper.

    Raises:
        UserError: If two experiments have the same name.
    """

    entries: tuple[Entry, ...]
    published: str

    def __post_init__(self) -> None:
        names = [entry.name for entry in self.entries]
        for name in names:
            if names.count(name) > 1:
                raise UserError(f"two experiments are named {name!r}")


def load(entry: Entry) -> Experiment[Any]:
    """Import the experiment."""
    named = {
        field.name: _found(entry.module, name)
        for field in fields(Experiment)
        if (name := getattr(entry, field.name, ""))
    }
    return Experiment(default=_found(entry.module, entry.scenario), **named)


def _found(module: str, name: str) -> Any:
    own, _, attribute = name.rpartition(":")
    return getattr(import_module(own or module), attribute)


def select(entries: Sequence[Entry], names: Sequence[str]) -> list[Entry]:
    """Return the named experiments in the order of ``names``, each once.

    Raises:
        UserError: If there is no experiment of a name.
    """
    by_name = {entry.name: entry for entry in entries}
    return [by_name[valid_name("experiment", name, by_name)] for name in dict.fromkeys(names)]


def column(values: "Sequence[float] | NDArray[Any]") -> "NDArray[np.float64]":
    """Return a table's column as an array of float64."""
    import numpy as np  # listing experiments needs none

    return np.asarray(values, dtype=np.float64)


def valid_integer(option: str, text: str | None, low: int, high: int) -> int | None:
    """Return the integer of an option, None if it has none.

    Raises:
        UserError: If it is no integer, or outside the range.
    """
    if text is None:
        return None
    if not re.fullmatch("[0-9]{1,10}", text) or not low <= int(text) <= high:
        raise UserError(f"{option} is {text!r}, allowed: an integer from {low} to {high}")
    return int(text)
