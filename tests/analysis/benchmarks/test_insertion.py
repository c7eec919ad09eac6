"""The insertion beside a peer: cells, agreement with statics, and the report."""

import math

import pytest

from chamfer.analysis.benchmarks import insertion
from chamfer.analysis.benchmarks.insertion import (
    CHAMFER,
    GRID,
    TABLE,
    Insertions,
    Result,
    agreement,
    cell,
    measure_cells,
    predict,
    sure,
    worst_force,
    worst_onset,
)
from chamfer.analysis.benchmarks.report import Findings, document, insertions_text
from chamfer.analysis.benchmarks.targets import targets
from chamfer.diagrams.insertion.peg_insertion import PegInsertionScenario


def as_said(scenario: PegInsertionScenario) -> Result:
    return predict(scenario)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> Insertions:
    """Return the table's cells by an engine that does what the statics say."""
    monkeypatch.setattr(insertion, "engines", lambda: {CHAMFER: as_said})
    found = Insertions()
    measure_cells(found, TABLE)
    return found


def test_the_table_s_part_and_the_twelve_cells() -> None:
    assert len(GRID) == 12
    scenario = cell(1.0, 5.0)
    assert scenario.support.lateral_stiffness == pytest.approx(521.7, abs=0.1)
    assert (scenario.lateral, scenario.tilt) == (0.001, math.radians(5.0))
    assert scenario.parts.peg_chamfer.width == 0.0
    assert scenario.parts.hole_chamfer.width == 0.001


@pytest.mark.slow
def test_statics_are_not_sure_next_to_the_last_tilt_that_slides(found: Insertions) -> None:
    assert [sure(found, one) for one in TABLE] == [True, True, True, False, True]
    assert [found.predicted[one].seated for one in TABLE] == [True, True, True, False, False]


@pytest.mark.slow
def test_who_does_what_statics_say_agrees(found: Insertions) -> None:
    assert agreement(found, CHAMFER) == 100.0
    onset, force = worst_onset(found, CHAMFER), worst_force(found, CHAMFER)
    assert onset is not None
    assert onset < 0.06  # of the closed form from the exact one
    assert force == pytest.approx(0.0)
    assert agreement(found, "nobody") is worst_onset(found, "nobody") is None


@pytest.mark.slow
def test_who_does_not_is_found_out(found: Insertions) -> None:
    wrong = found.results[CHAMFER]
    wrong[0.0, 5.0] = Result(False, 0.0048, 9.16, 1.0)
    wrong[0.0, 7.0] = Result(True, None, 20.0, 1.0)  # where nobody is sure
    assert agreement(found, CHAMFER) == 75.0
    assert worst_onset(found, CHAMFER) == pytest.approx(0.3, abs=0.005)
    assert worst_force(found, CHAMFER) == pytest.approx(9.9, abs=0.1)


@pytest.mark.slow
def test_the_report_has_a_row_a_cell_and_the_targets(found: Insertions) -> None:
    findings = Findings(insertions=found)
    text = insertions_text(found)
    assert len(text.splitlines()) == 2 + 2 + len(TABLE)
    assert "| seated  |     4.48 |" in text
    rows = document(findings)["insertions"]["statics"]
    assert rows[-1]["force"] is None  # no push slides it
    asked = targets(
        findings.times, findings.cold, findings.real_time, findings.updates, findings.insertions
    )
    assert [one.ok for one in asked if one.text.startswith("insertions:")] == [True] * 3
