"""Runs tasks side by side in processes; one whose process dies does not keep the others."""

import multiprocessing
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnContext
from typing import Any, Final, Generic, NamedTuple, TypeVar

from analysis.run.experiment import Progress
from analysis.run.lifeline import hold_on, without_interrupts

Task = TypeVar("Task")
Result = TypeVar("Result")

_INTERVAL: Final = 0.2  # s, between two reports of a task


class Told(NamedTuple):
    """How far a task is."""

    fraction: float
    doing: str = ""


class Died(NamedTuple):
    """What there is instead of the result of a task whose process died."""

    status: int | None  # negative: the signal


class _Ended(NamedTuple, Generic[Result]):
    result: Result


def side_by_side(
    function: Callable[[Task, Progress], Result],
    tasks: Sequence[Task],
    *,
    processes: int,
    told: Callable[[Mapping[int, Told]], None],
) -> Generator[tuple[int, Result | Died]]:
    """Yield each task's place and result as it ends; they begin in order.

    Where the block that iterates is left early, what still runs ends at once.

    Args:
        function: At a module's top level, or a partial of one; what it raises kills its process.
        tasks: What it is called with, and with the progress to tell.
        processes: How many, each takes one task after the other.
        told: Told how far the running tasks are, by their place.
    """
    context = multiprocessing.get_context("spawn")
    lifeline, held = context.Pipe(duplex=False)
    left = iter(enumerate(tasks))
    running: dict[Connection, _Process] = {}

    def begin(process: _Process | None = None) -> None:
        given = next(left, None)
        if given is not None:
            process = process or _Process(context, function, lifeline)
            process.give(*given)
            running[process.connection] = process
        elif process is not None:
            process.end()

    try:
        for _ in range(processes):
            begin()
        while running:
            told({one.place: one.told for one in running.values()})
            for connection in wait(list(running)):
                assert isinstance(connection, Connection)
                process = running[connection]
                message = process.receive()
                if isinstance(message, Told):
                    process.told = message
                    continue
                del running[connection]
                yield process.place, message.result if isinstance(message, _Ended) else message
                begin(process if isinstance(message, _Ended) else None)
    finally:
        held.close()  # the processes end now
        for process in running.values():
            process.end()
        lifeline.close()


class _Process:
    """A process that takes one task after the other."""

    def __init__(
        self, context: SpawnContext, function: Callable[[Any, Progress], Any], lifeline: Connection
    ) -> None:
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(function, theirs, lifeline))
        with without_interrupts():  # until it is ready for them
            self._process.start()
        theirs.close()

    def give(self, place: int, task: object) -> None:
        """Let it do a task."""
        self.place, self.told = place, Told(0.0)
        self.connection.send(task)

    def receive(self) -> "Told | _Ended[Any] | Died":
        """Return what it says next; it must have something to say, or be dead."""
        try:
            message: Told | _Ended[Any] = self.connection.recv()
        except (EOFError, ConnectionResetError):
            self.end()
            return Died(self._process.exitcode)
        return message

    def end(self) -> None:
        """Let it end, now if it has no task, and wait for that."""
        self.connection.close()
        self._process.join()


def _work(
    function: Callable[[Any, Progress], object], connection: Connection, lifeline: Connection
) -> None:
    hold_on(lifeline)
    while True:
        try:
            task = connection.recv()
        except EOFError:
            return  # there is no other
        result = function(task, _Teller(connection))
        sys.stdout.flush()
        connection.send(_Ended(result))


class _Teller:
    """Tells the parent how far a task is, now and then."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._next = 0.0

    def __call__(self, fraction: float, doing: str = "") -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + _INTERVAL
            self._connection.send(Told(fraction, doing))
