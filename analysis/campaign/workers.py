"""Processes in which trials and experiments run; a failure of one does not affect the others."""

import os
import pickle
import resource
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Final, Protocol, TypeVar

from pebble import ProcessExpired, ProcessPool

from chamfer.analysis.campaign.one_thread import use_one_thread
from chamfer.analysis.report.fingerprint import processor

Result = TypeVar("Result")

# MB that a worker may hold more than after its first call, before it is replaced: diagrams with
# Python blocks are never freed.
_GROWTH: Final = 400.0
_STARTS: Final = 3  # of a process that dies as it begins
_LOOK: Final = 0.5  # s, between looks whether a process is still there


class LostError(Exception):
    """A call did not end: its process died, or it took too long; the message says which."""


class StartError(Exception):
    """A process can't be started; the message gives the reason."""


class Engine(Protocol):
    """A place that runs calls, several at once."""

    exact: bool  # whether a call that is lost is to blame, not another one on the same worker
    processors: tuple[str, ...]  # the types of processors that calls run on

    def capacity(self) -> int:
        """Return the number of calls that run at once."""

    def submit(
        self, function: Callable[..., Result], *arguments: object, limit: float | None = None
    ) -> Future[Result]:
        """Call a function elsewhere.

        The future ends with the function's result, or with a :class:`LostError`, or with a
        :class:`StartError`. An error that the function raises is an error of the program.

        Args:
            function: At a module's top level, or a partial of one.
            arguments: Its arguments.
            limit: s, of the call.
        """

    def close(self) -> None:
        """End all calls at once."""


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Processes:
    """An engine of processes on this machine.

    They start when they are needed. A process that has died or grown too large is replaced.
    All end with this process, however that ends.

    Each is a Pebble pool of one. Workers that share a pool share its pipe with its locks: a worker
    that is killed while it holds them takes the others along (a killed worker in a hundred does).
    """

    exact = True

    def __init__(self, count: int) -> None:
        self.processors: tuple[str, ...] = (processor(),)
        self._count = count
        use_one_thread()
        lifeline, self._held = get_context("spawn").Pipe(duplex=False)
        self._lifeline = lifeline
        self._workers = [_Worker(lifeline) for _ in range(count)]
        self._idle: SimpleQueue[_Worker] = SimpleQueue()
        for worker in self._workers:
            self._idle.put(worker)
        # Processes inherit the threads' masks, until they are ready for interrupts. The tracker
        # must be there before, because whoever starts it lets interrupts through.
        resource_tracker.ensure_running()
        self._threads = ThreadPoolExecutor(count, initializer=_leave_interrupts)

    def capacity(self) -> int:
        """Return the number of calls that run at once."""
        return self._count

    def submit(
        self, function: Callable[..., Result], *arguments: object, limit: float | None = None
    ) -> Future[Result]:
        """Have a function called by the first worker that is free, see :class:`Engine`."""
        call = pickle.dumps((function, arguments))
        return self._threads.submit(self._call, call, limit)

    def close(self) -> None:
        """End all calls and processes at once."""
        if self._held.closed:
            return
        self._held.close()  # what is running ends now
        for worker in self._workers:
            worker.abandon()
        self._threads.shutdown(wait=True, cancel_futures=True)
        for worker in self._workers:
            worker.end()
        self._lifeline.close()

    def _call(self, call: bytes, limit: float | None) -> Any:
        worker = self._idle.get()
        try:
            return worker.call(call, limit)
        finally:
            self._idle.put(worker)


@contextmanager
def processes(count: int) -> Iterator[Processes]:
    """Provide an engine of processes that ends with the block."""
    engine = Processes(count)
    try:
        yield engine
    finally:
        engine.close()


class _Worker:
    """A process at a time, another one when it has died or grown too large."""

    def __init__(self, lifeline: Connection) -> None:
        self._lifeline = lifeline
        self._pool: ProcessPool | None = None
        self._pid = 0
        self._first: float | None = None  # MB that the process held after its first call
        self._running: Future[Any] | None = None
        self._abandoned = False

    def call(self, call: bytes, limit: float | None) -> Any:
        pool = self._pool if self._pool is not None and self._pool.active else self._start()
        try:
            result, held = self._wait(pool.schedule(_answer, (call,), timeout=limit))
        except TimeoutError as error:
            self.end()
            raise LostError(f"took longer than {limit:g} s") from error
        except (ProcessExpired, BrokenProcessPool) as error:
            self.end()
            raise LostError(f"its process {_death(error)}") from error
        if self._first is None:
            self._first = held
        if held > self._first + _GROWTH:
            self.end()
        return result

    def abandon(self) -> None:
        """Don't wait any more, and end; from another thread."""
        self._abandoned = True
        if self._running is not None:
            self._running.cancel()
        if self._pool is not None:
            self._pool.stop()

    def end(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.stop()
            self._pool.join()
            self._pool = self._first = None

    def _start(self) -> ProcessPool:
        for _ in range(_STARTS):
            self.end()
            self._pid = 0
            self._pool = pool = ProcessPool(
                1, context=get_context("spawn"), initializer=_begin, initargs=(self._lifeline,)
            )
            try:
                self._pid = self._wait(pool.schedule(os.getpid))
                return pool
            except (ProcessExpired, BrokenProcessPool) as error:
                cause = error
        raise StartError(f"a worker's process {_death(cause)} as it began") from cause

    def _wait(self, future: Future[Result]) -> Result:
        self._running = future
        while not self._abandoned:
            wait([future], timeout=_LOOK)
            if future.done():
                return future.result()
            # Pebble waits for ever for a process that ended as if all was well.
            if self._pid and not _runs(self._pid):
                wait([future], timeout=_LOOK)
                if not future.done():
                    raise ProcessExpired("", code=0)
        raise CancelledError


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def _death(error: Exception) -> str:
    if not isinstance(error, ProcessExpired):
        return "died"
    code = error.exitcode
    if code < 0:
        return f"was killed ({signal.Signals(-code).name})"
    return f"ended with status {code}"


def _leave_interrupts() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


def _begin(lifeline: Connection) -> None:
    """Leave interrupts to the parent; end when it closes the lifeline or ends itself."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, args=(lifeline,), daemon=True).start()
    os.dup2(2, 1)  # what is printed here must not get among the parent's results
    sys.stdout = sys.stderr


def _end_with_parent(lifeline: Connection) -> None:
    lifeline.poll(None)  # nothing is ever sent, so this is the end of the file
    os._exit(1)


def _answer(call: bytes) -> tuple[Any, float]:
    """Return the result of a pickled call, and the memory of this process then, MB."""
    function, arguments = pickle.loads(call)
    return function(*arguments), _held()


def _held() -> float:
    """Return the memory of this process, MB."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize() / 1e6
    except OSError:  # not Linux: the most that it has held
        per = 1e-6 if sys.platform == "darwin" else 1e-3
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * per
