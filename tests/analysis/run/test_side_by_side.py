"""Tasks in processes: each as it ends, whatever becomes of the others."""

import os
import signal
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from analysis.run.side_by_side import Died, Told, side_by_side

WORK = """
import os, signal, time
from pathlib import Path

def work(folder, task, progress):
    (folder / f"{task}-{os.getpid()}").touch()
    progress(0.5, f"half of {task}")
    if task == "dies":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "raises":
        raise ValueError
    if task == "lasts":
        time.sleep(60)
    if task.startswith("waits for "):
        while not list(folder.glob(task.removeprefix("waits for ") + "-*")):
            time.sleep(0.01)
    return task.upper()
"""
Work = Callable[..., Any]


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Work:
    """Does what the task is called; leaves its name and its process in a folder."""
    name = f"work_{abs(hash(tmp_path))}"
    (tmp_path / f"{name}.py").write_text(WORK)
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "done").mkdir()
    return partial(import_module(name).work, tmp_path / "done")


def quiet(running: Mapping[int, Told]) -> None:
    assert all(0 <= told.fraction <= 1 for told in running.values())


def test_each_task_is_given_as_it_ends(work: Work) -> None:
    told: list[Mapping[int, Told]] = []
    tasks = ["waits for c", "b", "c", "d"]
    found = list(side_by_side(work, tasks, processes=2, told=told.append))
    assert sorted(found) == [(i, task.upper()) for i, task in enumerate(tasks)]
    assert [place for place, _ in found].index(0) > 1  # b and c ended first
    assert all(len(running) <= 2 for running in told)
    assert any(running.get(0) == Told(0.5, "half of waits for c") for running in told)
    assert list(side_by_side(work, [], processes=2, told=quiet)) == []


def test_a_process_takes_one_task_after_the_other(work: Work, tmp_path: Path) -> None:
    found = list(side_by_side(work, list("abcdef"), processes=2, told=quiet))
    assert len(found) == 6
    ids = {path.name.partition("-")[2] for path in (tmp_path / "done").iterdir()}
    assert str(os.getpid()) not in ids
    assert 1 <= len(ids) <= 2


@pytest.mark.parametrize(
    ("how", "status"), [("dies", -signal.SIGKILL), pytest.param("raises", 1, id="raises")]
)
def test_a_process_that_dies_keeps_no_other_task_from_its_end(
    work: Work, how: str, status: int, capfd: pytest.CaptureFixture[str]
) -> None:
    found = dict(side_by_side(work, [how, "b", "c"], processes=1, told=quiet))
    assert found == {0: Died(status), 1: "B", 2: "C"}
    assert ("ValueError" in capfd.readouterr().err) == (how == "raises")


def test_what_still_runs_ends_when_the_rest_is_not_wanted(work: Work, tmp_path: Path) -> None:
    begin = time.monotonic()
    with closing(side_by_side(work, ["lasts", "b", "lasts"], processes=2, told=quiet)) as runs:
        assert next(runs) == (1, "B")
    assert time.monotonic() - begin < 30
    for path in (tmp_path / "done").glob("lasts-*"):
        with pytest.raises(ProcessLookupError):
            os.kill(int(path.name.partition("-")[2]), 0)
