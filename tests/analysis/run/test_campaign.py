"""Campaigns: the same results in order with any number of processes, and a clean end."""

import math
import operator
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from analysis.run import campaign
from analysis.run.campaign import cores, parallel, run_each
from diagrams.surface.surface_scenario import require_whole
from models.validation import ParameterError

# What runs in other processes is from modules that these can import.
ROOT = Path(__file__).parents[3]


class Told:
    """Progress that remembers what it was told."""

    def __init__(self) -> None:
        self.fractions: list[float] = []
        self.doing: list[str] = []

    def __call__(self, fraction: float, doing: str = "") -> None:
        self.fractions.append(fraction)
        self.doing.append(doing)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_results_are_in_the_tasks_order(workers: int) -> None:
    told = Told()
    # Later tasks end earlier.
    tasks = [0.3, 0.2, 0.1, 0.0, 0.0]
    with parallel(workers):
        assert run_each(time.sleep, tasks, quiet) == [None] * 5
        assert run_each(math.factorial, range(9), told) == [math.factorial(n) for n in range(9)]
    assert told.fractions == sorted(told.fractions)
    assert told.fractions[-1] == 1.0
    assert told.doing[-1] == "9 of 9"
    assert all(0 < fraction <= 1 for fraction in told.fractions)


def test_slow_tasks_do_not_change_the_order() -> None:
    # 2 ** 30,000,000 takes its time, the others do not.
    exponents = [3 * 10**7, 1, 2, 3, 4, 5]
    with parallel(2):
        found = run_each(partial(pow, 2), exponents, quiet)
    assert [one.bit_length() - 1 for one in found] == exponents


def test_each_task_in_turn_is_told() -> None:
    told = Told()
    run_each(math.sqrt, [1.0, 4.0, 9.0, 16.0], told)
    assert told.fractions == [0.25, 0.5, 0.75, 1.0]
    assert told.doing == ["1 of 4", "2 of 4", "3 of 4", "4 of 4"]


def test_no_task_gives_no_result() -> None:
    for workers in (1, 2):
        with parallel(workers):
            assert run_each(math.sqrt, [], quiet) == []


def pids(workers: int, count: int, **options: int) -> set[int]:
    """The processes that run so many tasks."""
    with parallel(workers):
        return set(run_each(operator.call, [os.getpid] * count, quiet, **options))


def test_few_tasks_stay_in_this_process() -> None:
    assert pids(2, 3) == {os.getpid()}
    assert pids(1, 9) == {os.getpid()}


def test_many_tasks_leave_this_process() -> None:
    found = pids(2, 4)
    assert os.getpid() not in found
    assert 1 <= len(found) <= 2


def test_processes_are_replaced_when_they_have_done_enough() -> None:
    told = Told()
    with parallel(2):
        found = run_each(math.factorial, range(16), told, lifetime=3)
    assert found == [math.factorial(n) for n in range(16)]
    assert told.fractions == sorted(told.fractions)
    assert told.fractions[-1] == 1.0
    assert 3 <= len(pids(2, 16, lifetime=3)) <= 6  # three lots of at most two


def test_the_number_of_processes_is_that_of_the_block() -> None:
    assert campaign._workers.get() == 1
    with parallel(3):
        assert campaign._workers.get() == 3
        with pytest.raises(KeyError), parallel(2):
            raise KeyError
        assert campaign._workers.get() == 3
    assert campaign._workers.get() == 1


def test_cores_are_those_this_process_may_use() -> None:
    count = cores()
    assert count >= 1
    if hasattr(os, "sched_setaffinity"):
        script = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        script += "from analysis.run.campaign import cores; print(cores())"
        found = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True
        )
        assert found.stdout == "1\n"


@pytest.mark.parametrize("workers", [1, 2])
def test_the_first_error_ends_the_campaign(workers: int) -> None:
    told = Told()
    with parallel(workers), pytest.raises(ZeroDivisionError):
        run_each(partial(operator.truediv, 1), [1, 2, 0, 4, 5, 6], told)
    assert 1.0 not in told.fractions


def test_an_error_does_not_wait_for_running_tasks() -> None:
    begin = time.monotonic()
    with parallel(2), pytest.raises(ValueError, match="non-negative"):
        run_each(time.sleep, [20.0, -1.0, 20.0, 20.0, 20.0], quiet)
    assert time.monotonic() - begin < 10


@pytest.mark.parametrize("workers", [1, 2])
def test_what_parameters_are_wrong_is_told_by_the_process_that_finds_out(workers: int) -> None:
    whole = partial(require_whole, 1.0, name="step")
    with parallel(workers), pytest.raises(ParameterError) as caught:
        run_each(whole, [0.5, 0.3, 0.25, 0.2], quiet)
    assert str(caught.value) == "step is 0.3, allowed: a whole part of 1 s"
    assert (caught.value.name, caught.value.value) == ("step", 0.3)


def test_an_assertion_of_drake_comes_through() -> None:
    with parallel(2), pytest.raises(SystemExit, match=r"Failure at plant\.cc"):
        run_each(sys.exit, ["Failure at plant.cc"] * 4, quiet)


PARENT = """
import os, sys, time
from pathlib import Path
from analysis.run.campaign import parallel, run_each

def work(folder, task):
    Path(folder, str(os.getpid())).touch()
    time.sleep(60)

if __name__ == "__main__":
    from functools import partial
    with parallel(2):
        run_each(partial(work, sys.argv[1]), range(8), lambda fraction, doing="": None)
"""


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


def wait_until(condition: object, seconds: float) -> bool:
    end = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks processes up in /proc")
@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_the_parent(tmp_path: Path, sent: signal.Signals) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    busy = tmp_path / "busy"
    busy.mkdir()
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py"), str(busy)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.DEVNULL,
    ) as parent:
        assert wait_until(lambda: len(list(busy.iterdir())) == 2, 30)
        workers = [int(path.name) for path in busy.iterdir()]
        assert all(map(alive, workers))
        parent.send_signal(sent)
        begin = time.monotonic()
        parent.wait(10)
        assert time.monotonic() - begin < 5
    assert wait_until(lambda: not any(map(alive, workers)), 5)
