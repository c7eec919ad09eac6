"""What an engine is, which ones there are, and which of them are missing here."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Final, Literal

from chamfer.analysis.benchmarks.case import Case, Samples

LoopName = Literal["pid", "fsm"]


@dataclass(frozen=True, kw_only=True)
class Engine:
    """A simulator with one of the loops."""

    name: str
    build: Callable[[], Any]  # returns a model that is good for one run
    run: Callable[[Any], Samples]  # from a built model to the output at the wanted times, m
    accuracy: float  # m, largest difference from the exact solution that the settings promise
    note: str  # the settings
    trials: int = 1  # that a run makes at once; its time is shared among them


@dataclass(frozen=True, kw_only=True)
class Source:
    """A module that makes engines, and what has to be installed for it."""

    module: str  # has a function ``engines(case, loop)``
    requires: str  # name to import
    distribution: str
    extra: str | None = None  # of chamfer, that installs it


SOURCES: Final = (
    Source(module="chamfer", requires="pydrake", distribution="drake"),
    Source(module="compiled", requires="numba", distribution="numba"),
    Source(module="drake_as_it_comes", requires="pydrake", distribution="drake"),
    Source(module="scipy_peer", requires="scipy", distribution="scipy"),
    Source(module="control_peer", requires="control", distribution="control"),
    Source(module="bdsim_peer", requires="bdsim", distribution="bdsim", extra="bench"),
    Source(module="pathsim_peer", requires="pathsim", distribution="pathsim", extra="bench"),
)


def installed(sources: Iterable[Source] = SOURCES) -> tuple[list[Source], list[Source]]:
    """Return the sources that can be used and those that are missing."""
    present: list[Source] = []
    missing: list[Source] = []
    for source in sources:
        (present if find_spec(source.requires) else missing).append(source)
    return present, missing


def engines(sources: Iterable[Source], case: Case, loop: LoopName) -> list[Engine]:
    """Return the engines for a loop, Chamfer first."""
    found: list[Engine] = []
    for source in sources:
        found += import_module(f"chamfer.analysis.benchmarks.{source.module}").engines(case, loop)
    return found


def how_to_install(source: Source) -> str:
    """Return one line that names a missing peer and says how to get it."""
    wanted = f".[{source.extra}]" if source.extra else source.distribution
    return f"{source.distribution} is not installed and left out: pip install '{wanted}'"
