"""Trials on a Dask cluster: on other machines, or on one that is started here for the run."""

import faulthandler
import logging
import pickle
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager
from typing import Any, Final, TypeVar

from chamfer.analysis.campaign.one_thread import use_one_thread
from chamfer.analysis.campaign.workers import Engine, LostError, StartError, processes
from chamfer.analysis.report.console import say
from chamfer.analysis.report.fingerprint import processor
from chamfer.analysis.scenario.errors import UserError

Result = TypeVar("Result")

LOCAL: Final = "local"
_PATIENCE: Final = 30.0  # s, for a scheduler and its workers to answer
_COUNTED: Final = 1.0  # s, for which the number of workers is taken to be the same
_alone = threading.Lock()  # in a worker with several threads: diagrams are kept between calls


class Cluster:
    """An engine of the workers of a Dask scheduler.

    Args:
        address: The scheduler's, such as ``tcp://scheduler:8786``, or ``local``, which starts one
            on this machine for the run.
        count: Number of workers of a local one.

    Raises:
        UserError: If there is no scheduler, or it has no workers with this project.
    """

    exact = False

    def __init__(self, address: str, *, count: int) -> None:
        try:
            import distributed
        except ModuleNotFoundError as error:
            raise _refused(address, "with chamfer[cluster] installed") from error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is wrong is said here
        self._local = _start(count) if address == LOCAL else None
        self._counted = (-_COUNTED, 1)  # when, and how many workers there were
        self._closed = False
        try:
            self._client = distributed.Client(self._local or address, timeout=_PATIENCE)
            self._client.wait_for_workers(1, timeout=_PATIENCE)
            found = set(self._client.run(processor).values())
        except (OSError, TimeoutError) as error:
            raise _refused(address, "one that answers and has workers") from error
        except ModuleNotFoundError as error:
            raise _refused(address, f"one whose workers have this project ({error})") from error
        self.processors: tuple[str, ...] = tuple(sorted(found))
        if len(self.processors) > 1:
            listed = ", ".join(self.processors)
            say(f"the workers' processors differ, and so may the last digits: {listed}")

    def capacity(self) -> int:
        """Return the number of workers, each of which runs one call at a time."""
        then, count = self._counted
        if time.monotonic() > then + _COUNTED:
            count = max(1, len(self._client.nthreads()))
            self._counted = (time.monotonic(), count)
        return count

    def submit(
        self, function: Callable[..., Result], *arguments: object, limit: float | None = None
    ) -> Future[Result]:
        """Call a function on a worker, as ``Engine`` of the workers."""
        call = pickle.dumps((function, arguments))
        there = self._client.submit(_answer, call, limit, pure=False)
        future: Future[Result] = Future()
        there.add_done_callback(lambda done: self._end(future, done, limit))
        return future

    def close(self) -> None:
        """Disconnect from the cluster, and end a local one."""
        if not self._closed:
            self._closed = True
            self._client.close()
            if self._local is not None:
                self._local.close()

    def _end(self, future: Future[Any], done: Any, limit: float | None) -> None:
        from distributed import KilledWorker

        if done.status == "finished":
            future.set_result(done.result())
            return
        if done.status == "error":
            error = done.exception()
            if isinstance(error, KilledWorker):
                late = "" if limit is None else f", or it took longer than {limit:g} s"
                error = LostError(f"its worker died{late}")
        elif self._closed:
            error = CancelledError()
        else:
            error = StartError("the cluster's scheduler has gone")
        future.set_exception(error)


@contextmanager
def engines(workers: int, cluster: str | None) -> Iterator[tuple[Engine, Engine]]:
    """Provide the engines of experiments and of their trials until the block ends.

    Experiments run in processes on this machine, and so do trials without a cluster's address.

    Raises:
        UserError: If there is no such cluster.
    """
    with processes(workers) as here:
        if cluster is None:
            yield here, here
            return
        trials = Cluster(cluster, count=workers)
        try:
            yield here, trials
        finally:
            trials.close()


def _start(count: int) -> Any:
    import dask
    from distributed import LocalCluster

    use_one_thread()
    # A trial that kills its worker is tried again by whoever asked for it, alone.
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        return LocalCluster(
            host="127.0.0.1",
            n_workers=count,
            threads_per_worker=1,
            # Its server for health runs even without a dashboard, for everybody unless told.
            scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            silence_logs=logging.CRITICAL,
        )


def _answer(call: bytes, limit: float | None) -> Any:
    """Return what a pickled call returns; end this worker if it takes longer than the limit, s."""
    function, arguments = pickle.loads(call)
    with _alone:
        if limit is not None:
            faulthandler.dump_traceback_later(limit, exit=True)  # also if Python can't run
        try:
            return function(*arguments)
        finally:
            faulthandler.cancel_dump_traceback_later()


def _refused(address: str, allowed: str) -> UserError:
    return UserError(f"--cluster is {address!r}, allowed: {allowed}")
