"""Runs the trials of a campaign, in several processes where that is wanted."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, TypeVar

from analysis.experiment import Progress

Task = TypeVar("Task")
Result = TypeVar("Result")

_FEW: Final = 4  # tasks, for fewer no process is worth its start
_LIFETIME: Final = 200  # tasks of a process; diagrams with Python blocks are never freed
_workers: ContextVar[int] = ContextVar("workers", default=1)


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def parallel(workers: int) -> Iterator[None]:
    """Let campaigns in the block use as many processes; a script's main module must allow it."""
    token = _workers.set(workers)
    try:
        yield
    finally:
        _workers.reset(token)


def run_each(
    function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress
) -> list[Result]:
    """Return the function's result for each task, in the tasks' order.

    Each result must depend on its task alone: it is the same with any number of processes. The
    first error ends the campaign.

    Args:
        function: At a module's top level, or a partial of one.
        tasks: What it is called with.
        progress: Told how many are done.
    """
    workers = min(_workers.get(), len(tasks))
    if workers < 2 or len(tasks) < _FEW:
        results = []
        for i, task in enumerate(tasks):
            results.append(function(task))
            progress((i + 1) / len(tasks), f"{i + 1} of {len(tasks)}")
        return results
    return _run_in_processes(function, tasks, progress, workers)


def _run_in_processes(
    function: Callable[[Task], Result], tasks: Sequence[Task], progress: Progress, workers: int
) -> list[Result]:
    executor = ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
        max_tasks_per_child=_LIFETIME,
    )
    try:
        futures = [executor.submit(function, task) for task in tasks]
        left = set(futures)
        while left:
            done, left = wait(left, return_when=FIRST_COMPLETED)
            for future in done:
                future.result()  # raises what it raised
            count = len(tasks) - len(left)
            progress(count / len(tasks), f"{count} of {len(tasks)}")
        return [future.result() for future in futures]
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    """Leave interrupts to the parent, and end with it however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
