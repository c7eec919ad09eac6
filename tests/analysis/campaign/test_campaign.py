"""Campaigns: nothing that has finished is lost, and nothing that fails ends the others."""

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from chamfer.analysis.campaign import campaign as campaigns
from chamfer.analysis.campaign import trial_loop
from chamfer.analysis.campaign.campaign import (
    Campaign,
    TrialsWantedError,
    parallel,
    run_each,
    run_here,
    running,
)
from chamfer.analysis.campaign.trial_rows import encode
from chamfer.analysis.campaign.trial_store import TrialStore
from chamfer.analysis.campaign.workers import Processes, processes
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import quiet
from chamfer.models.validation import ParameterError


class Told:
    """Progress that remembers what it was told."""

    def __init__(self) -> None:
        self.fractions: list[float] = []
        self.doing: list[str] = []

    def __call__(self, fraction: float, doing: str = "") -> None:
        self.fractions.append(fraction)
        self.doing.append(doing)


@pytest.fixture(scope="module")
def engine() -> Iterator[Processes]:
    with processes(2) as engine:
        yield engine


Begin = Callable[..., Campaign]


@pytest.fixture
def begin(engine: Processes, tmp_path: Path) -> Iterator[Begin]:
    """Begins a campaign in the test's folder, as a new run of the same experiment does."""
    begun: list[Campaign] = []

    def begin(**options: object) -> Campaign:
        for one in begun:
            one.close()
        options = {"processors": ("toy",), "engine": engine, **options}
        begun.append(Campaign(path=tmp_path / "trials.sqlite", **options))  # type: ignore[arg-type]
        return begun[-1]

    yield begin
    begun[-1].close()


def done(folder: Path) -> list[int]:
    """The numbers of the trials that have left one, those run twice twice."""
    return sorted(int(path.name.partition("-")[0]) for path in folder.iterdir())


@pytest.fixture
def left(tmp_path: Path) -> Path:
    folder = tmp_path / "left"
    folder.mkdir()
    return folder


def test_rows_are_in_the_tasks_order_wherever_they_are_made(begin: Begin, toy: ModuleType) -> None:
    told = Told()
    here = run_each(toy.square, range(9), told)
    assert told.fractions == [(i + 1) / 9 for i in range(9)]
    assert told.doing[-1] == "9 of 9"
    told = Told()
    there = begin()(toy.square, range(9), told)
    assert told.fractions == sorted(told.fractions)
    assert told.fractions[-1] == 1.0
    assert told.doing[-2] == "9 of 9"
    again = begin()(toy.square, range(9), told)
    for found in (here, there, again):
        assert found.tasks == tuple(range(9))
        assert len(found) == 9
        np.testing.assert_array_equal(found.column("square"), np.arange(9) ** 2)
        assert [encode(row) for row in found.rows] == [encode(row) for row in here.rows]


def test_the_runner_is_that_of_the_block(toy: ModuleType) -> None:
    def here() -> bool:
        return os.getpid() in run_each(toy.process, range(3), quiet).column("pid")

    assert here()
    with parallel(2):
        assert not here()
        with pytest.raises(KeyError), running(lambda *_: {}[0]):  # type: ignore[arg-type]
            here()
        assert not here()
    assert here()


def test_one_task_is_run_here_and_raises(begin: Begin, toy: ModuleType) -> None:
    with running(begin()):
        assert run_each(toy.process, [0], quiet).rows == ({"pid": os.getpid()},)
        with pytest.raises(ParameterError):
            run_each(toy.misbehave, ["refuse"], quiet)
        with pytest.raises(TypeError):
            run_each(toy.misbehave, ["wrong row"], quiet)


def test_trials_can_be_selected_and_a_missing_number_is_nan() -> None:
    tasks = [{"x": 1.0}, {"x": 2.0}, {"x": None}]
    kept = run_each(partial(dict, other=1), tasks, quiet).select(lambda task: task["x"] != 2.0)
    assert kept.tasks == ({"x": 1.0}, {"x": None})
    np.testing.assert_array_equal(kept.column("x"), [1.0, math.nan])


def test_finished_trials_are_not_run_again(begin: Begin, toy: ModuleType, left: Path) -> None:
    trial = partial(toy.leave, str(left), 0.0)
    first = begin()(trial, range(4), quiet)
    assert done(left) == [0, 1, 2, 3]
    more = begin()(trial, range(6), quiet)
    assert done(left) == [0, 1, 2, 3, 4, 5]
    assert more.rows[:4] == first.rows
    told = Told()
    begin()(trial, range(6), told)
    assert told.fractions == [1.0]
    assert done(left) == list(range(6))
    begin(fresh=True)(trial, range(6), quiet)
    assert done(left) == sorted(2 * [*range(6)])


def test_other_trials_are_run(
    begin: Begin,
    toy: ModuleType,
    left: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    trial = partial(toy.leave, str(left), 0.0)

    def runs(campaign: Campaign, function: partial[object] = trial) -> int:
        before = len(list(left.iterdir()))
        campaign(function, [1, 2], quiet)  # type: ignore[arg-type]
        return len(list(left.iterdir())) - before

    assert runs(begin()) == 2
    assert runs(begin()) == 0
    assert capsys.readouterr().err == ""
    begin()(trial, [1, 2, 3], quiet)
    assert capsys.readouterr().err == "chamfer: kept 2 of 3 trials\n"
    assert runs(begin(processors=("another",))) == 2
    assert runs(begin(), partial(toy.leave, str(left), 1e-3)) == 2
    code = campaigns.code
    monkeypatch.setattr(campaigns, "code", lambda name: replace(code(name), sources="changed"))
    assert runs(begin()) == 2


def test_a_result_forgets_what_it_does_not_have(begin: Begin, toy: ModuleType, left: Path) -> None:
    trial = partial(toy.leave, str(left), 0.0)
    begin()(trial, [1, 2, 3], quiet)
    campaign = begin()
    campaign(trial, [3, 4], quiet)
    campaign(trial, [5, 6], quiet)
    campaign.finish()
    begin()(trial, [1, 2, 3, 4, 5, 6], quiet)
    assert done(left) == sorted([1, 2, 3, 4, 5, 6, 1, 2])


def test_failures_are_recorded_and_the_others_go_on(begin: Begin, toy: ModuleType) -> None:
    tasks = ["", "raise", "refuse", "exit", "assert", "wrong row", "killed", " "]
    told = Told()
    campaign = begin()
    found = campaign(toy.misbehave, tasks, told)
    assert found.tasks == ("", " ")
    assert told.doing[-2] == "2 of 8, 6 failed"
    assert [trial for trial, _ in campaign.failed] == [1, 2, 3, 4, 5, 6]
    reasons = [reason for _, reason in campaign.failed]
    assert reasons[0].startswith("ValueError: not this way (toy_trials.py, line ")
    assert reasons[1:4] == [
        "mass is -1.0, allowed: a number > 0",
        "its process ended with status 0",
        "stopped by Drake: Failure at plant.cc",
    ]
    assert reasons[4].startswith("TypeError: x is of type tuple, allowed: a number, ")
    assert reasons[5] == "its process was killed (SIGKILL)"
    campaign(toy.misbehave, ["", "refuse"], quiet)  # counted through the experiment
    assert campaign.failed[-1] == (9, reasons[1])


def test_a_lost_trial_is_tried_once_more(begin: Begin, toy: ModuleType, tmp_path: Path) -> None:
    campaign = begin()
    found = campaign(partial(toy.once, str(tmp_path)), range(10), quiet)
    assert campaign.failed == []
    np.testing.assert_array_equal(found.column("square"), np.arange(10) ** 2)


def test_a_trial_past_its_time_has_failed(
    begin: Begin, toy: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial_loop, "_FIRST_LIMIT", 2.0)
    monkeypatch.setattr(trial_loop, "_LEAST_LIMIT", 1.0)
    campaign = begin()
    assert campaign(toy.misbehave, ["", "hang", " "], quiet).tasks == ("", " ")
    assert campaign.failed[0][1] in ("took longer than 2 s", "took longer than 1 s")


@pytest.mark.parametrize("first", ["raise", "refuse"])
def test_a_campaign_of_failures_is_an_error(begin: Begin, toy: ModuleType, first: str) -> None:
    kind, said = {
        "raise": (ExperimentError, r"^all 2 trials failed: ValueError: not this way"),
        "refuse": (UserError, r"^all 2 trials failed: mass is -1\.0, allowed: a number > 0$"),
    }[first]
    tasks = [first, "assert"]
    for runner in (run_here, begin()):
        with running(runner), pytest.raises(kind, match=said):
            run_each(toy.misbehave, tasks, quiet)


def test_finished_trials_are_on_disk_when_they_are_counted(
    begin: Begin, toy: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial_loop, "_BATCH", 0.1)
    campaign = begin()
    keys = campaign._keys(toy.sleep, tasks := [0.05 + i / 1000 for i in range(8)])
    counts = []

    def look(fraction: float, doing: str = "") -> None:
        with closing(TrialStore(tmp_path / "trials.sqlite")) as store:
            assert len(store.rows(keys)) >= round(8 * fraction)
        counts.append(round(8 * fraction))

    campaign(toy.sleep, tasks, look)
    assert counts[-1] == 8
    assert len(counts) > 2


def test_short_trials_are_sent_and_written_together(
    begin: Begin, toy: ModuleType, engine: Processes, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = []
    submit = engine.submit

    def counting(*arguments: object, **options: object) -> object:
        sent.append(len(arguments[3]))  # type: ignore[arg-type]
        return submit(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(engine, "submit", counting)
    told = Told()
    begin()(toy.square, range(2000), told)
    assert sum(sent) == 2000
    assert len(sent) < 200
    assert len(told.fractions) < 20
    sent.clear()
    begin()(toy.sleep, [0.2 + i / 1000 for i in range(5)], quiet)
    assert sent == [1] * 5


def test_an_interrupt_keeps_what_has_finished(
    begin: Begin, toy: ModuleType, left: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = partial(toy.leave, str(left), 0.1)
    campaign = begin()
    wait = trial_loop.wait

    def interrupted(*arguments: object, **options: object) -> object:
        if len(list(left.iterdir())) > 5:
            raise KeyboardInterrupt
        return wait(*arguments, **options)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(trial_loop, "wait", interrupted)
        patch.setattr(trial_loop, "_BATCH", 1e9)  # nothing is written before the interrupt
        with pytest.raises(KeyboardInterrupt):
            campaign(trial, range(10), quiet)
    with closing(TrialStore(campaign.path)) as store:
        kept = len(store.rows(campaign._keys(trial, range(10))))
    assert 3 <= kept <= 6
    time.sleep(0.3)  # those that were running come to their end, and nobody waits for them
    begin()(trial, range(10), quiet)
    assert len(done(left)) == 10 + len(done(left)) - len(set(done(left)))
    assert len(done(left)) - 10 <= 3


def test_trials_are_wanted_where_there_is_no_engine(begin: Begin, toy: ModuleType) -> None:
    tasks = ["", "raise"]
    with pytest.raises(TrialsWantedError) as wanted:
        begin(engine=None)(toy.misbehave, tasks, quiet)
    conductor = begin()
    conductor.supply(wanted.value, quiet)
    there = begin(engine=None, failures=conductor.failures)
    assert there(toy.misbehave, tasks, quiet).tasks == ("",)
    assert [trial for trial, _ in there.failed] == [1]
    conductor = begin(failures=conductor.failures)
    with pytest.raises(ExperimentError, match="the sources have changed"):
        conductor.supply(wanted.value, quiet)


def test_a_worker_with_other_sources_is_an_error(
    begin: Begin, toy: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = trial_loop.code
    monkeypatch.setattr(trial_loop, "code", lambda name: replace(code(name), sources="changed"))
    with pytest.raises(ExperimentError, match="a worker and this process differ in the sources"):
        begin()(toy.square, range(3), quiet)
