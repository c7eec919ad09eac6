"""Runs the trials of a campaign, in several processes where that is wanted."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, TypeVar

from analysis.run.experiment import Progress
from analysis.run.lifeline import hold_on, without_interrupts

Task = TypeVar("Task")
Result = TypeVar("Result")

_FEW: Final = 4  # tasks, for fewer no process is worth its start
LIFETIME: Final = 200  # tasks of a process
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
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    progress: Progress,
    *,
    lifetime: int = LIFETIME,
) -> list[Result]:
    """Return the function's result for each task, in the tasks' order.

    Each result must depend on its task alone: it is the same with any number of processes. The
    first error ends the campaign, and so does an interrupt, without waiting for running tasks.

    Args:
        function: At a module's top level, or a partial of one.
        tasks: What it is called with.
        progress: Told how many are done.
        lifetime: Tasks after which a process is replaced, as diagrams with Python blocks are
            never freed; fewer where a task builds a large one.
    """
    workers = min(_workers.get(), len(tasks))
    if workers < 2 or len(tasks) < _FEW:
        results = []
        for i, task in enumerate(tasks):
            results.append(function(task))
            progress((i + 1) / len(tasks), f"{i + 1} of {len(tasks)}")
        return results
    return _run_in_processes(function, tasks, progress, workers, lifetime)


def _run_in_processes(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    progress: Progress,
    workers: int,
    lifetime: int,
) -> list[Result]:
    results: list[Result] = []
    # All processes are replaced at once: one by one, as max_tasks_per_child would do it, hangs
    # (CPython issue 115634).
    size = workers * lifetime
    for first in range(0, len(tasks), size):

        def told(done: int, before: int = first) -> None:
            count = before + done
            progress(count / len(tasks), f"{count} of {len(tasks)}")

        results += _run_batch(function, tasks[first : first + size], told, workers)
    return results


def _run_batch(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    told: Callable[[int], None],
    workers: int,
) -> list[Result]:
    context = multiprocessing.get_context("spawn")
    lifeline, held = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(
        workers, mp_context=context, initializer=hold_on, initargs=(lifeline,)
    )
    try:
        with without_interrupts():  # a new process inherits that until it is ready for them
            futures = [executor.submit(function, task) for task in tasks]
        left = set(futures)
        while left:
            done, left = wait(left, return_when=FIRST_COMPLETED)
            for future in done:
                future.result()  # raises what it raised
            told(len(tasks) - len(left))
        return [future.result() for future in futures]
    except BaseException:
        held.close()  # what is still running ends now
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
        held.close()
        lifeline.close()
