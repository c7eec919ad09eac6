import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.design import design_accuracy
from chamfer.analysis.design.design import interval
from chamfer.analysis.design.design_accuracy import (
    REFUSED,
    accuracy,
    insert_once,
    plot_accuracy,
    run,
)
from chamfer.analysis.design.drawn_designs import DrawnDesignsScenario
from chamfer.analysis.report.fingerprint import digest
from chamfer.analysis.scenario.experiment import Table


@pytest.fixture
def traces() -> Table:
    seated = [4.0, 3.0, 2.0, 0.0, 0.0, 4.0, 0.0]
    trials = [4.0, 4.0, 4.0, 4.0, 4.0, 4.0, 0.0]
    ends = [
        interval(int(k), int(n)) if n else (np.nan, np.nan)
        for k, n in zip(seated, trials, strict=True)
    ]
    return {
        "verdict": np.array(["certain", "certain", "likely", "no", "likely", "likely", REFUSED]),
        "margin": np.array([0.3, 0.2, -0.1, -4.0, -0.2, 0.0, np.nan]),
        "share": np.array([1.0, 1.0, 0.7, 0.0, 0.1, 0.6, np.nan]),
        "seated": np.array(seated),
        "trials": np.array(trials),
        "low": np.array([low for low, _ in ends]),
        "high": np.array([high for _, high in ends]),
    }


def test_verdicts_are_counted_by_what_became_of_them(traces: Table) -> None:
    metrics = accuracy(traces)
    counted = {
        name.removeprefix("confusion."): metric.value
        for name, metric in metrics.items()
        if name.startswith("confusion.") and metric.value
    }
    assert counted == {
        "certain.all": 1,
        "certain.some": 1,
        "likely.some": 1,
        "likely.none": 1,
        "likely.all": 1,
        "no.none": 1,
    }
    assert metrics["refused"].value == 1


def test_shares_are_of_insertions_and_of_designs(traces: Table) -> None:
    metrics = accuracy(traces)
    assert metrics["certain.seated"].value == pytest.approx(100 * 7 / 8)
    assert metrics["no.seated"].value == 0
    # Of two designs of which all were seated one was called certain, of two with none one no.
    assert metrics["all_seated.called_certain"].value == 50
    assert metrics["none_seated.called_no"].value == 50
    expected = 100 * np.mean([0.7 - 0.5, 0.1 - 0.0, 0.6 - 1.0])
    assert metrics["likely.share_error"].value == pytest.approx(expected)


def test_what_nobody_was_called_is_undefined(traces: Table) -> None:
    likely = {**traces, "verdict": np.full(7, "likely")}
    metrics = accuracy(likely)
    assert metrics["certain.seated"].value is None
    assert metrics["certain.seated.low"].value is None
    assert "there are none" in metrics["no.seated"].note


def test_figure_has_the_table_and_every_simulated_design(traces: Table) -> None:
    figure = plot_accuracy(traces, accuracy(traces))
    figure.draw_without_rendering()
    table, margin, share = figure.axes
    assert sorted(text.get_text() for text in table.texts) == sorted("110111010")
    for axes in (margin, share):
        points = [
            line.get_xdata() for line in axes.get_lines() if line.get_marker() in ("o", "s", "X")
        ]
        assert sum(map(len, points)) == 6


def test_no_two_designs_share_the_errors_of_their_insertions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seeds: list[int] = []

    def insert(cell: object, seed: int, trial: int) -> None:
        seeds.append(trial_seed(seed, trial))

    monkeypatch.setattr(design_accuracy, "insert_drawn", insert)
    monkeypatch.setattr(design_accuracy, "resolve_design", lambda design: design)
    for task in ((design, trial) for design in range(3) for trial in range(3)):
        insert_once(DrawnDesignsScenario(), 7, task)
    assert len(set(seeds)) == 9


def test_more_designs_and_trials_keep_those_that_have_run(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bytes] = []

    class RunError(Exception):
        pass

    def stop(function: object, *_: object) -> None:
        asked.append(digest(function))
        raise RunError

    monkeypatch.setattr(design_accuracy, "run_each", stop)
    for designs, trials in ((3, 1), (4, 1), (3, 2)):
        with pytest.raises(RunError):
            run(DrawnDesignsScenario(designs=designs, trials=trials), 0, lambda *_: None)
    assert len(set(asked)) == 1
