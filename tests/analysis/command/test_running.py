from pathlib import Path

import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare
from chamfer.analysis.report.results import json_text
from chamfer.analysis.scenario.experiment import Entry
from chamfer.analysis.scenario.scenario_io import sha256, unstructure


@pytest.mark.filterwarnings("ignore:the loop is unstable:UserWarning")  # of friction-remedies
@pytest.mark.parametrize("entry", CATALOGUE.entries, ids=lambda entry: entry.name)
def test_a_results_own_scenario_remakes_it_with_its_checks(entry: Entry, tmp_path: Path) -> None:
    (default,) = prepare([entry])
    document = {"experiment": entry.name, "scenario": unstructure(default.scenario)}
    (tmp_path / "result.json").write_text(json_text(document))
    (again,) = prepare([entry], file=tmp_path / "result.json")
    assert again.scenario == default.scenario
    assert sha256(unstructure(again.scenario)) == sha256(document["scenario"])  # type: ignore[arg-type]
    assert again.checked
    assert default.checked
