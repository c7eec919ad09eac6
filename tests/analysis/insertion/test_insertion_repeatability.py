"""Many insertions: what is made of finished trials, and what the ways do differently."""

from dataclasses import replace

import pytest

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.insertion.cell_runs import INSERTION
from chamfer.analysis.insertion.insertion_repeatability import (
    InsertionTrialsScenario,
    _saved,
    _settled_statistics,
    _statistics,
    in_a_way,
    resolve_insertion_trials,
)
from chamfer.models.validation import ParameterError

Values = dict[str, object]


def trials(way: str, *changes: Values) -> Trials[tuple[int, str]]:
    """Trials of a way, seated but for the changes."""
    usual = dict.fromkeys(INSERTION, 1.0) | {"ending": "seated", "state": "seated"}
    return Trials(
        tasks=tuple((i, way) for i in range(len(changes))),
        rows=tuple(usual | change for change in changes),
    )


def test_success_has_its_exact_interval_and_says_what_failed() -> None:
    stuck: Values = {"seated": 0.0, "seated.first": 0.0, "seated.said": 0.0, "ending": "stuck"}
    found = _statistics(trials("", *[{}] * 9, stuck))
    assert found["success_rate"].value == 90
    assert found["success_rate"].note == "seated, of 10 trials; 1: stuck"
    # Clopper and Pearson for 9 of 10.
    assert found["success_rate.low"].value == pytest.approx(55.50, abs=0.01)
    assert found["success_rate.high"].value == pytest.approx(99.75, abs=0.01)
    assert found["said_wrongly"].value == 0


def test_what_is_said_to_be_seated_and_is_not_is_counted() -> None:
    found = _statistics(trials("", {"seated": 0.0, "seated.said": 1.0}, {}))
    assert found["said_wrongly"].value == 1


def test_forces_are_quantiles() -> None:
    found = _statistics(trials("", *({"force.contact": float(k)} for k in range(21))))
    assert found["force.contact.median"].value == 10
    assert found["force.contact.p95"].value == 19
    assert found["force.contact.max"].value == 20
    assert found["force.soft"].value == pytest.approx(100 * 5 / 21)


def test_what_is_saved_is_of_pairs_that_are_both_seated() -> None:
    early = trials("", *({"time_to_seated": one} for one in (4.0, 4.5, None, 5.0)))
    late = trials("wait", *({"time_to_seated": one} for one in (6.0, 6.0, 6.0, None)))
    found = _saved(early, late)
    assert found["saved.time.mean"].value == pytest.approx(1.75)
    assert found["saved.time.mean"].note.startswith("2 pairs of one start, 1.5 to 2 s")
    none = _saved(trials("", {"time_to_seated": None}), late)
    assert none["saved.time.mean"].value is None


def test_settling_is_before_and_after() -> None:
    row: Values = {
        "frozen.lateral_error": 1e-4,
        "settled.lateral_error": 3e-4,
        "frozen.rotational_error": None,
        "settled.rotational_error": None,
    }
    found = _settled_statistics(trials("settling", row, row | {"settled.lateral_error": 5e-4}))
    assert found["settling.settled.lateral_error.mean"].value == pytest.approx(4e-4)
    assert found["settling.settled.lateral_error.max"].value == 5e-4
    assert found["settling.frozen.rotational_error.mean"].value is None


def test_ways_change_what_they_say_and_no_more() -> None:
    scenario = resolve_insertion_trials(InsertionTrialsScenario())
    assert in_a_way(scenario, "") == scenario
    waits = in_a_way(scenario, "wait")
    assert waits == replace(scenario, decide=replace(scenario.decide, kind="wait"))
    frozen = in_a_way(scenario, "frozen")
    assert (frozen.insert.compensation, frozen.decide.kind) == ("frozen", "margin")
    both = in_a_way(scenario, "frozen_wait")
    assert (both.insert.compensation, both.decide.kind) == ("frozen", "wait")
    assert in_a_way(scenario, "settling").insert.pause == 1.5


def test_a_depth_to_freeze_at_is_no_matter_to_what_is_frozen() -> None:
    scenario = InsertionTrialsScenario()
    late = replace(scenario, insert=replace(scenario.insert, freeze_depth=-0.003))
    assert in_a_way(late, "frozen").insert.freeze_depth is None


def test_refused() -> None:
    with pytest.raises(ParameterError, match=r"beside is \('wait', 'wait'\), allowed: some of"):
        InsertionTrialsScenario(beside=("wait", "wait"))
    with pytest.raises(ParameterError, match="trials is 0"):
        InsertionTrialsScenario(trials=0)
