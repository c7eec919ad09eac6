"""Trials on a Dask cluster: the same bytes, whatever becomes of its workers."""

import os
import sys
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
from chamfer.analysis.scenario.experiment import quiet

pytest.importorskip("distributed")


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
        cluster.submit(toy.misbehave, "hang", limit=0.5).result(120)
    assert cluster.submit(toy.misbehave, "", limit=120.0).result(120) == {"x": 1.0}


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


@pytest.mark.slow
def test_a_cluster_that_runs_already_is_used_by_its_address(toy: ModuleType) -> None:
    with ExitStack() as stack:
        local = stack.enter_context(closing(clusters._start(2)))
        cluster = stack.enter_context(closing(Cluster(local.scheduler_address, count=1)))
        while cluster.capacity() < 2:
            time.sleep(0.1)
        assert cluster.submit(toy.square, 3).result(60)["square"] == 9
        local.scale(0)
        while cluster._client.nthreads():
            time.sleep(0.1)
        call = cluster.submit(toy.square, 3)  # waits for a worker
        local.close()
        with pytest.raises(StartError, match="the cluster's scheduler has gone"):
            call.result(60)
