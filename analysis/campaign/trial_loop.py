"""Computes a campaign's missing trials on an engine, and writes each finished one."""

import time
import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Final, Generic, NamedTuple, TypeVar

from chamfer.analysis.campaign.progress import TrialProgress
from chamfer.analysis.campaign.trial_rows import Row, encode
from chamfer.analysis.campaign.trial_store import TrialStore
from chamfer.analysis.campaign.workers import Engine, LostError, StartError
from chamfer.analysis.report.console import plain_warnings
from chamfer.analysis.report.fingerprint import Code, code, modules_of
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.models.validation import ParameterError

Task = TypeVar("Task")

_TRIES: Final = 2  # of a trial whose process dies or that takes too long
_CHUNK: Final = 0.25  # s, of short trials that a worker gets at once
_BATCH: Final = 1.0  # s, between writes of finished trials
_LEAST_LIMIT: Final = 600.0  # s, that any trial may take
_LIMIT: Final = 100.0  # median times that a trial may take, if that is more
_FIRST_LIMIT: Final = 3600.0  # s, while none has finished and nobody knows what is long
_RECENT: Final = 99  # trials of which the median is taken


class Failure(NamedTuple):
    """The reason why a trial has no row."""

    reason: str  # in one line
    refused: bool  # because of its parameters


class Answer(NamedTuple):
    """The outcome of a trial that ended."""

    outcome: bytes | Failure  # its encoded row, or the reason why there is none
    seconds: float


def attempt(function: Callable[[Task], Row], task: Task) -> Answer:
    """Run a trial; an error ends it and nothing else."""
    started = time.perf_counter()
    outcome: bytes | Failure
    try:
        outcome = encode(function(task))
    except (Exception, SystemExit) as error:
        reason, refused = _why(error)
        outcome = Failure(" ".join(reason.split()), refused)
    return Answer(outcome, time.perf_counter() - started)


def _why(error: Exception | SystemExit) -> tuple[str, bool]:
    """Return the reason of a failed trial, and whether its parameters are the cause."""
    if isinstance(error, UserError | ParameterError):
        return str(error), True
    if isinstance(error, OverflowError | MemoryError):
        return f"can't be computed: {error}", True
    if isinstance(error, ExperimentError):
        return str(error), False
    if isinstance(error, SystemExit) or type(error) is RuntimeError:
        return f"stopped by Drake: {error}", False
    where = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(where.filename).name}, line {where.lineno}"
    return f"{type(error).__name__}: {error} ({place})", False


def attempt_all(
    expected: Code, function: Callable[[Task], Row], tasks: Sequence[Task]
) -> list[Answer] | str:
    """Run trials, or return the differences between this process and its client."""
    differs = code(modules_of(function)).differs(expected)
    with plain_warnings():
        return differs or [attempt(function, task) for task in tasks]


@dataclass(kw_only=True)
class TrialLoop(Generic[Task]):
    """The trials of a campaign that are not in its store."""

    function: Callable[[Task], Row]  # makes a task's row
    tasks: Mapping[bytes, Task]  # by their keys in the store
    engine: Engine
    store: TrialStore  # a finished trial is in it before it is counted
    progress: TrialProgress  # of written and failed trials

    def __post_init__(self) -> None:
        self._code = code(modules_of(self.function))
        self._untried = deque(self.tasks)
        self._lost: deque[bytes] = deque()  # to be tried again, alone
        self._suspects: set[bytes] = set()  # that have been lost
        self._tries = dict.fromkeys(self.tasks, 0)
        self._running: dict[Future[list[Answer] | str], Sequence[bytes]] = {}
        self._unwritten: list[tuple[bytes, bytes]] = []
        self._written = time.monotonic()
        self._seconds: deque[float] = deque(maxlen=_RECENT)
        self._rows: dict[bytes, bytes] = {}
        self._failures: dict[bytes, Failure] = {}

    def run(self) -> tuple[dict[bytes, bytes], dict[bytes, Failure]]:
        """Return the rows, and the failures of trials without one.

        Raises:
            UserError: If a row can't be written.
            ExperimentError: If there are no processes, or their code is another one.
        """
        try:
            while self._untried or self._lost or self._running:
                self._submit()
                due = self._written + _BATCH - time.monotonic()
                done, _ = wait(
                    self._running,
                    timeout=max(0.0, due) if self._unwritten else None,
                    return_when=FIRST_COMPLETED,
                )
                for future in done:
                    self._receive(future)
                if time.monotonic() >= self._written + _BATCH:
                    self._write()
        finally:
            self._write()  # also what had finished before an interrupt
        return self._rows, self._failures

    def _submit(self) -> None:
        while len(self._running) < self.engine.capacity():
            keys = self._next()
            if not keys:
                return
            future = self.engine.submit(
                attempt_all,
                self._code,
                self.function,
                [self.tasks[key] for key in keys],
                limit=len(keys) * self._limit(),
            )
            self._running[future] = keys

    def _next(self) -> Sequence[bytes]:
        """Return the trials to send next; none: there are none now."""
        alone = not self.engine.exact  # those that have been lost, to see who is to blame
        if self._lost and not (alone and self._running):
            return [self._lost.popleft()]
        if alone and any(key in self._suspects for keys in self._running.values() for key in keys):
            return []
        return [self._untried.popleft() for _ in range(min(self._chunk(), len(self._untried)))]

    def _chunk(self) -> int:
        """Return the number of trials to send at once: several if they are short and many."""
        if not self._seconds:
            return 1
        short = int(_CHUNK / max(median(self._seconds), 1e-6))
        share = len(self._untried) // (2 * self.engine.capacity())
        return max(1, min(short, share))

    def _limit(self) -> float:
        if not self._seconds:
            return _FIRST_LIMIT
        return max(_LEAST_LIMIT, _LIMIT * median(self._seconds))

    def _receive(self, future: Future[list[Answer] | str]) -> None:
        keys = self._running.pop(future)
        try:
            answers = future.result()
        except LostError as error:
            self._lose(keys, str(error))
            return
        except StartError as error:
            raise ExperimentError(str(error)) from error
        if isinstance(answers, str):
            raise ExperimentError(f"a worker and this process differ in {answers}")
        for key, (outcome, seconds) in zip(keys, answers, strict=True):
            if isinstance(outcome, Failure):
                self._fail(key, outcome)
            else:
                self._unwritten.append((key, outcome))
                self._seconds.append(seconds)

    def _lose(self, keys: Sequence[bytes], reason: str) -> None:
        """Try lost trials again, each alone: one of several is the cause."""
        to_blame = len(keys) == 1 and (self.engine.exact or keys[0] in self._suspects)
        for key in keys:
            self._suspects.add(key)
            self._tries[key] += to_blame
            if self._tries[key] < _TRIES:
                self._lost.append(key)
            else:
                self._fail(key, Failure(reason, False))

    def _fail(self, key: bytes, failure: Failure) -> None:
        self._failures[key] = failure
        self.progress.add(failed=1)

    def _write(self) -> None:
        if self._unwritten:
            self.store.add(self._unwritten)
            self._rows |= self._unwritten
            self.progress.add(done=len(self._unwritten))
            self._unwritten = []
        self._written = time.monotonic()
