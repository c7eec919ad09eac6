import json
from pathlib import Path

import pytest

from chamfer.analysis.cli import main
from chamfer.analysis.scenario.experiment import Catalogue


@pytest.fixture
def results(toys: Catalogue, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Folders of two results that differ in the height, 5 m and 8 m."""
    folders = []
    for out, settings in (("one", []), ("two", ["--set", "height=8"])):
        assert main(["run", "fall", *settings, "--out", str(tmp_path / out)], catalogue=toys) == 0
        folders.append(str(tmp_path / out / "fall"))
    capsys.readouterr()
    return folders


def test_json_has_what_differs(
    results: list[str], toys: Catalogue, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *results, "--json"], catalogue=toys) == 0
    document = json.loads(capsys.readouterr().out)
    assert [document["first"], document["second"]] == results
    assert document["fields"] == {"height": {"first": 5.0, "second": 8.0}}
    assert list(document["metrics"]) == ["end", "height"]
    assert document["metrics"]["height"] == {
        "first": 5.0,
        "second": 8.0,
        "unit": "m",
        "difference": 3.0,
    }
    assert document["same_metrics"] == 2  # both undefined


def test_table_is_side_by_side(
    results: list[str], toys: Catalogue, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *results], catalogue=toys) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert rows[:2] == [["field", *results], ["height", "5.0", "8.0"]]
    assert ["height", "5", "8", "3", "+60", "%", "m"] in rows


def test_what_one_result_lacks_is_absent(
    results: list[str], toys: Catalogue, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "trials", "--out", str(tmp_path / "one")], catalogue=toys) == 0
    capsys.readouterr()
    other = str(tmp_path / "one" / "trials")
    assert main(["compare", results[0], other], catalogue=toys) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["experiment", "fall", "trials"] in rows
    assert ["noise", "absent", "0.1"] in rows
    assert ["rate", "absent", "1", "-", "-"] in rows


def test_folder_without_a_result_is_refused(
    results: list[str], toys: Catalogue, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", results[0], str(tmp_path)], catalogue=toys) == 2
    assert "result.json: No such file" in capsys.readouterr().err
    result = json.loads(Path(results[1], "result.json").read_text())
    metric = {"unit": "m"}
    for document in (
        "{}",
        "[" * 100_000,
        json.dumps({**result, "metrics": {"end": {**metric, "value": "far"}}}),
        json.dumps({**result, "metrics": {"end": {**metric, "value": float("inf")}}}),
        json.dumps({**result, "metrics": {"end": {**metric, "value": 10**400}}}),
    ):
        (tmp_path / "result.json").write_text(document)
        assert main(["compare", results[0], str(tmp_path)], catalogue=toys) == 2
        assert "not a result" in capsys.readouterr().err
