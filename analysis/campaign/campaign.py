"""Runs the trials of all experiments: finished ones are kept, a failed one ends no others."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.progress import TrialProgress
from chamfer.analysis.campaign.trial_loop import Failure, TrialLoop, attempt
from chamfer.analysis.campaign.trial_rows import Row, decode, encode
from chamfer.analysis.campaign.trial_store import TrialStore
from chamfer.analysis.campaign.workers import Engine, processes
from chamfer.analysis.report.console import say
from chamfer.analysis.report.fingerprint import code, digest, modules_of
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Progress

Task = TypeVar("Task")
Group = TypeVar("Group")


@dataclass(frozen=True, kw_only=True)
class Trials(Generic[Task]):
    """The finished trials, in the order of their tasks, and the failed ones."""

    tasks: tuple[Task, ...]
    rows: tuple[Row, ...]
    failed: tuple[tuple[Task, Failure], ...] = ()

    def __len__(self) -> int:
        """Return the number of finished trials."""
        return len(self.rows)

    def select(self, keep: Callable[[Task], bool]) -> "Trials[Task]":
        """Return the trials with selected tasks."""
        kept = [i for i, task in enumerate(self.tasks) if keep(task)]
        return Trials(
            tasks=tuple(self.tasks[i] for i in kept),
            rows=tuple(self.rows[i] for i in kept),
            failed=tuple(one for one in self.failed if keep(one[0])),
        )

    def split(
        self, groups: Iterable[Group], group_of: Callable[[Task], Group]
    ) -> "dict[Group, Trials[Task]]":
        """Return the trials of each group.

        Raises:
            UserError: If none of a group has finished, because of its parameters.
            ExperimentError: If none of a group has finished.
        """

        def trials_of(group: Group) -> "Trials[Task]":
            found = self.select(lambda task: group_of(task) == group)
            found.require(f"no trial of {group} has finished")
            return found

        return {group: trials_of(group) for group in groups}

    def require(self, message: str) -> None:
        """Raise an error with the first failure's reason if none has finished.

        Raises:
            UserError: If the reason is the trial's parameters.
            ExperimentError: If it is another one.
        """
        if not self.rows and self.failed:
            _, failure = self.failed[0]
            kind = UserError if failure.refused else ExperimentError
            raise kind(f"{message}: {failure.reason}")

    def column(self, name: str) -> NDArray[np.float64]:
        """Return a number of every trial, NaN for None, shape (n,)."""
        values = [row[name] for row in self.rows]
        return np.array([math.nan if one is None else one for one in values], dtype=np.float64)


Runner = Callable[[Callable[[Any], Row], Sequence[Any], Progress], Trials[Any]]  # as try_each


def run_each(
    function: Callable[[Task], Row], tasks: Sequence[Task], progress: Progress
) -> Trials[Task]:
    """Return the function's row for each task, in the tasks' order.

    As :func:`try_each`, but one of them has to finish. One task alone is no campaign: it runs
    here, and what it raises is raised.

    Raises:
        UserError: If every trial fails, the first one because of its parameters.
        ExperimentError: If every trial fails.
    """
    if len(tasks) == 1:
        row = decode(encode(function(tasks[0])))
        progress(1.0)
        return Trials(tasks=tuple(tasks), rows=(row,))
    found = try_each(function, tasks, progress)
    found.require(f"all {len(tasks)} trials failed")
    return found


def try_each(
    function: Callable[[Task], Row], tasks: Sequence[Task], progress: Progress
) -> Trials[Task]:
    """Return the function's row for each task that has one, in the tasks' order.

    A row depends on the function and its task alone: it is the same wherever it is computed, and
    however often. A trial that raises, whose process dies twice or that takes too long has
    failed; the others go on.

    Args:
        function: At a module's top level, or a partial of one. It and its tasks consist of types
            that :func:`chamfer.analysis.report.fingerprint.canonical` accepts.
        tasks: Its arguments, one per call.
        progress: Receives the number of finished tasks.
    """
    return _runner.get()(function, tasks, progress)


class TrialsWantedError(BaseException):
    """An experiment needs trials before it can go on; start it again when they have run."""

    def __init__(self, function: Callable[[Any], Row], tasks: Sequence[Any]) -> None:
        super().__init__(function, tasks)
        self.function = function
        self.tasks = tasks


@dataclass(kw_only=True)
class Campaign:
    """The trials of an experiment: finished ones are on disk and do not run twice."""

    path: Path | None  # the file for finished trials, None to delete them at the end
    processors: tuple[str, ...]  # the types of processors that trials run on
    # Where they run; None: a TrialsWantedError requests them.
    engine: Engine | None = None
    here: bool = False  # whether they run in this process, one after the other
    fresh: bool = False  # whether to ignore the content of the file
    failures: dict[bytes, Failure] = field(default_factory=dict)  # why trials failed, by key
    seconds: float = 0.0  # that the experiment took before

    def __post_init__(self) -> None:
        self.failed: list[tuple[int, str]] = []  # trials, counted through the experiment; why
        self._store: TrialStore | None = None
        self._asked: set[bytes] = set()
        self._count = 0

    def __call__(
        self, function: Callable[[Task], Row], tasks: Sequence[Task], progress: Progress
    ) -> Trials[Task]:
        """Run a function's trials, see :func:`try_each`.

        Raises:
            TrialsWantedError: If there are some to run, and no engine.
        """
        keys = self._keys(function, tasks)
        outcomes, missing = self._look_up(keys, tasks)
        if missing:
            outcomes |= self._compute(function, tasks, missing, progress)
        progress(1.0)
        listed = [outcomes[key] for key in keys]
        self.failed += [
            (self._count + i, one.reason)
            for i, one in enumerate(listed)
            if isinstance(one, Failure)
        ]
        self._count += len(tasks)
        self._asked.update(keys)
        return _trials(tasks, listed)

    def supply(self, wanted: TrialsWantedError, progress: Progress) -> None:
        """Run the trials that an experiment requests, so that it finds them.

        Raises:
            ExperimentError: If there are none to run: it would request them indefinitely.
        """
        keys = self._keys(wanted.function, wanted.tasks)
        _, missing = self._look_up(keys, wanted.tasks)
        if not missing:
            raise ExperimentError("the sources have changed since it began, run it again")
        self._compute(wanted.function, wanted.tasks, missing, progress)

    def finish(self) -> None:
        """Delete the trials of other scenarios and of other code: the file is this result's."""
        if self._store is not None:
            self._store.keep(self._asked)

    def close(self) -> None:
        """Close the file."""
        if self._store is not None:
            self._store.close()
            self._store = None

    def _keys(self, function: Callable[[Task], Row], tasks: Sequence[Task]) -> list[bytes]:
        common = digest(code(modules_of(function)), self.processors, function)
        return [digest(common, task) for task in tasks]

    def _look_up(
        self, keys: Sequence[bytes], tasks: Sequence[Task]
    ) -> tuple[dict[bytes, bytes | Failure], dict[bytes, Task]]:
        """Return the outcomes of trials, and those that are still to be run, by key."""
        outcomes: dict[bytes, bytes | Failure] = {**self._open().rows(keys), **self.failures}
        missing = {key: task for key, task in zip(keys, tasks, strict=True) if key not in outcomes}
        return outcomes, missing

    def _compute(
        self,
        function: Callable[[Task], Row],
        tasks: Sequence[Task],
        missing: Mapping[bytes, Task],
        progress: Progress,
    ) -> dict[bytes, bytes | Failure]:
        if self.here:
            each = {key: attempt(function, task).outcome for key, task in missing.items()}
            self.failures |= {key: one for key, one in each.items() if isinstance(one, Failure)}
            return each
        if self.engine is None:
            raise TrialsWantedError(function, tasks)
        kept = len(tasks) - len(missing)
        if kept:
            say(f"kept {kept} of {len(tasks)} trials")
        told = TrialProgress(progress, count=len(tasks), before=kept)
        rows, failures = TrialLoop(
            function=function, tasks=missing, engine=self.engine, store=self._open(), progress=told
        ).run()
        self.failures |= failures
        return {**rows, **failures}

    def _open(self) -> TrialStore:
        if self._store is None:
            self._store = TrialStore(self.path, fresh=self.fresh)
            self.fresh = False
        return self._store


@contextmanager
def running(runner: Runner) -> Iterator[None]:
    """Run the block's trials with another engine than one after the other here."""
    token = _runner.set(runner)
    try:
        yield
    finally:
        _runner.reset(token)


@contextmanager
def parallel(workers: int) -> Iterator[None]:
    """Run the block's trials in so many processes; none of their results stays on disk.

    For more than one process, a script's main module must allow its import by them; one is this
    one.
    """
    if workers == 1:
        yield
        return
    with processes(workers) as engine:
        campaign = Campaign(path=None, processors=engine.processors, engine=engine)
        with closing(campaign), running(campaign):
            yield


def run_here(
    function: Callable[[Task], Row], tasks: Sequence[Task], progress: Progress
) -> Trials[Task]:
    """Run a function's trials one after the other in this process, see :func:`try_each`."""
    told = TrialProgress(progress, count=len(tasks))
    outcomes = []
    for task in tasks:
        outcome = attempt(function, task).outcome
        outcomes.append(outcome)
        failed = isinstance(outcome, Failure)
        told.add(done=not failed, failed=failed)
    return _trials(tasks, outcomes)


def _trials(tasks: Sequence[Task], outcomes: Sequence[bytes | Failure]) -> Trials[Task]:
    each = list(zip(tasks, outcomes, strict=True))
    finished = [(task, row) for task, row in each if isinstance(row, bytes)]
    return Trials(
        tasks=tuple(task for task, _ in finished),
        rows=tuple(decode(row) for _, row in finished),
        failed=tuple((task, why) for task, why in each if isinstance(why, Failure)),
    )


_runner: ContextVar[Runner] = ContextVar("runner", default=run_here)
