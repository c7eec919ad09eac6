"""Worker processes: any of them may die, and all of them do with the one that started them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, wait
from pathlib import Path
from types import ModuleType

import pytest

from chamfer.analysis.campaign import workers
from chamfer.analysis.campaign.workers import LostError, Processes, StartError, cores, processes

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def engine() -> Iterator[Processes]:
    with processes(2) as engine:
        yield engine


def test_calls_return_and_raise_what_they_should(engine: Processes, toy: ModuleType) -> None:
    assert engine.capacity() == 2
    found = [engine.submit(toy.square, task) for task in range(5)]
    assert [future.result()["square"] for future in found] == [0, 1, 4, 9, 16]
    with pytest.raises(ZeroDivisionError):
        engine.submit(divmod, 1, 0).result()


def test_a_death_costs_one_call_only(engine: Processes, toy: ModuleType) -> None:
    deaths = {
        "exit": "its process ended with status 0",
        "exit 3": "its process ended with status 3",
        "crash": "its process was killed (SIGSEGV)",
        "killed": "its process was killed (SIGKILL)",
    }
    calls = {how: engine.submit(toy.misbehave, how) for how in ("", *deaths, "fine")}
    assert calls.pop("").result() == calls.pop("fine").result() == {"x": 1.0}
    for how, call in calls.items():
        with pytest.raises(LostError) as caught:
            call.result()
        assert str(caught.value) == deaths[how]


def test_a_process_that_dies_with_nothing_to_do_is_replaced(
    engine: Processes, toy: ModuleType
) -> None:
    calls = [engine.submit(toy.sleep, 0.2) for _ in range(2)]
    wait(calls)
    pids = {worker._pid for worker in engine._workers}
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    time.sleep(0.3)
    assert engine.submit(toy.process, 0).result()["pid"] not in pids


def test_a_process_is_replaced_when_it_has_grown(
    toy: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "_GROWTH", 60.0)
    with processes(1) as engine:
        pids = [engine.submit(toy.grow, 0).result()["pid"] for _ in range(9)]
    assert 2 <= len(set(pids)) <= 4
    assert pids == sorted(pids, key=pids.index)  # one after the other


def test_libraries_use_one_thread_in_a_process(engine: Processes, toy: ModuleType) -> None:
    names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"]
    assert engine.submit(toy.environment, names).result() == [1, "1", "1", "1"]


def test_what_a_call_prints_goes_to_standard_error(
    engine: Processes, toy: ModuleType, capfd: pytest.CaptureFixture[str]
) -> None:
    with processes(1) as engine:
        engine.submit(toy.shout, "hello").result()
    assert capfd.readouterr() == ("", "hello\nhello")


def test_processes_that_can_not_begin_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_begin", os._exit)  # called with the lifeline: a TypeError
    with processes(1) as engine, pytest.raises(StartError, match=r"as it began$"):
        engine.submit(os.getpid).result()


def test_the_end_comes_at_once(toy: ModuleType) -> None:
    with processes(2) as engine:
        calls = [engine.submit(toy.sleep, 60.0) for _ in range(5)]
        time.sleep(1.0)
        begin = time.monotonic()
    assert time.monotonic() - begin < 30  # of the 60 s that each sleeps
    for call in calls:
        with pytest.raises(CancelledError):
            call.result(1.0)
    engine.close()  # again does nothing


def test_cores_are_those_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {1, 4, 5}, raising=False)
    assert cores() == 3


PARENT = """
import sys
from toy_trials import leave
from chamfer.analysis.campaign.workers import processes

if __name__ == "__main__":
    with processes(2) as engine:
        for call in [engine.submit(leave, sys.argv[1], 60.0, task) for task in range(8)]:
            call.result()
"""


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def wait_until(condition: Callable[[], bool], seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_the_parent(
    tmp_path: Path, toy: ModuleType, sent: signal.Signals
) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    busy = tmp_path / "busy"
    busy.mkdir()
    assert toy.__file__ is not None
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py"), str(busy)],
        env={**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{Path(toy.__file__).parent}"},
        stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as parent:
        assert wait_until(lambda: len(list(busy.iterdir())) == 2, 30)
        pids = [int(path.name.split("-")[1]) for path in busy.iterdir()]
        assert all(map(alive, pids))
        parent.send_signal(sent)
        begin = time.monotonic()
        parent.wait(30)
        assert time.monotonic() - begin < 30
    assert wait_until(lambda: not any(map(alive, pids)), 30)
