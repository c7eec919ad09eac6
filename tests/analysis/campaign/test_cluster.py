"""Trials on a Dask cluster: the same bytes, whatever becomes of its workers."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest

from chamfer.analysis.campaign import cluster as clusters
from chamfer.analysis.campaign.campaign import Campaign
from chamfer.analysis.campaign.cluster import Cluster, engines
from chamfer.analysis.campaign.trial_rows import encode
from chamfer.analysis.campaign.workers import LostError, Processes, StartError
from chamfer.analysis.scenario.errors import UserError

pytest.importorskip("distributed")

ROOT = Path(__file__).parents[3]


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def cluster(toy: ModuleType) -> Iterator[Cluster]:
    with engines(2, "local") as (here, trials):
        assert isinstance(here, Processes)
        assert isinstance(trials, Cluster)
        yield trials


def test_rows_are_those_of_this_process(cluster: Cluster, toy: ModuleType, tmp_path: Path) -> None:
    tasks = range(50)
    path = tmp_path / "trials.sqlite"
    with closing(Campaign(path=path, processors=cluster.processors, engine=cluster)) as campaign:
        found = campaign(toy.square, tasks, quiet)
        assert campaign.failed == []
    assert [encode(row) for row in found.rows] == [encode(toy.square(task)) for task in tasks]
    assert cluster.capacity() == 2
    pids = campaign(toy.process, range(20), quiet).column("pid")
    assert os.getpid() not in pids


@pytest.mark.slow
def test_a_killed_worker_costs_no_other_trial(
    cluster: Cluster, toy: ModuleType, tmp_path: Path
) -> None:
    campaign = Campaign(path=None, processors=("toy",), engine=cluster)
    found = campaign(partial(toy.once, str(tmp_path)), range(10), quiet)
    assert found.column("square").tolist() == [task**2 for task in range(10)]
    found = campaign(toy.misbehave, ["", "killed", "raise", " "], quiet)
    assert found.tasks == ("", " ")
    assert campaign.failed[0][1].startswith("its worker died")
    assert campaign.failed[1][1].startswith("ValueError: not this way")


def test_a_call_has_its_time(cluster: Cluster, toy: ModuleType) -> None:
    with pytest.raises(LostError, match=r"^its worker died, or it took longer than 0\.5 s$"):
        cluster.submit(toy.misbehave, "hang", limit=0.5).result(30)
    assert cluster.submit(toy.misbehave, "", limit=30.0).result(30) == {"x": 1.0}


@pytest.mark.slow
def test_what_is_no_cluster_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clusters, "_PATIENCE", 0.5)
    with pytest.raises(UserError) as caught:
        Cluster("tcp://127.0.0.1:9", count=2)
    assert str(caught.value) == (
        "--cluster is 'tcp://127.0.0.1:9', allowed: one that answers and has workers"
    )
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UserError, match=r"allowed: with chamfer\[cluster\] installed$"):
        Cluster("local", count=2)


@pytest.fixture
def scheduler(toy: ModuleType) -> Iterator[tuple[str, list[subprocess.Popen[str]]]]:
    """The address of a scheduler, and the processes of it and its two workers."""
    assert toy.__file__ is not None
    options: dict[str, object] = {
        "env": {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}:{Path(toy.__file__).parent}"},
        "stderr": subprocess.PIPE,
        "text": True,
    }
    command = [sys.executable, "-m", "dask"]
    with ExitStack() as stack:

        def begin(*arguments: str) -> subprocess.Popen[str]:
            process = subprocess.Popen([*command, *arguments], **options)  # type: ignore[call-overload]
            stack.enter_context(process)
            stack.callback(process.terminate)
            return process

        first = begin("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        assert first.stderr is not None
        line = next(line for line in first.stderr if "Scheduler at:" in line)
        address = line.split()[-1]
        workers = [begin("worker", address, "--nthreads", "1", "--no-dashboard") for _ in range(2)]
        for process in (first, *workers):
            threading.Thread(target=process.communicate, daemon=True).start()
        yield address, [first, *workers]


@pytest.mark.slow
def test_a_cluster_of_its_own_commands(
    scheduler: tuple[str, list[subprocess.Popen[str]]], toy: ModuleType
) -> None:
    address, processes = scheduler
    with closing(Cluster(address, count=2)) as cluster:
        while cluster.capacity() < 2:
            time.sleep(0.1)
        campaign = Campaign(path=None, processors=cluster.processors, engine=cluster)
        pids = set(campaign(toy.process, range(20), quiet).column("pid").tolist())
        killing = threading.Timer(1.0, os.kill, (int(pids.pop()), signal.SIGKILL))
        killing.start()
        found = campaign(toy.sleep, [0.2 + i / 1000 for i in range(20)], quiet)
        assert len(found) == 20
        assert campaign.failed == []
        processes[0].kill()
        with pytest.raises(StartError, match="the cluster's scheduler has gone"):
            cluster.submit(toy.sleep, 5.0).result(60)
