import json
from collections.abc import Callable
from pathlib import Path

import pytest

Chamfer = Callable[..., tuple[int, str, str]]


@pytest.fixture
def results(chamfer: Chamfer, tmp_path: Path) -> list[str]:
    """Folders of two results that differ in the height, 5 m and 8 m."""
    for out, settings in (("one", []), ("two", ["--set", "height=8"])):
        assert chamfer("run", "fall", *settings, "--out", tmp_path / out)[0] == 0
    return [str(tmp_path / out / "fall") for out in ("one", "two")]


def test_json_has_what_differs(chamfer: Chamfer, results: list[str]) -> None:
    status, said, _ = chamfer("compare", *results, "--json")
    assert status == 0
    document = json.loads(said)
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
    assert document["specifications"] == {
        "height <= 10 m": {"first": "kept", "second": "kept"},
    }


def test_table_is_side_by_side(chamfer: Chamfer, results: list[str]) -> None:
    rows = [line.split() for line in chamfer("compare", *results)[1].splitlines()]
    assert rows[:2] == [["field", *results], ["height", "5.0", "8.0"]]
    assert ["height", "5", "8", "3", "+60", "%", "m"] in rows


def test_what_one_result_lacks_is_absent(
    chamfer: Chamfer, results: list[str], tmp_path: Path
) -> None:
    assert chamfer("run", "trials", "--out", tmp_path / "one")[0] == 0
    _, said, _ = chamfer("compare", results[0], tmp_path / "one" / "trials")
    rows = [line.split() for line in said.splitlines()]
    assert ["experiment", "fall", "trials"] in rows
    assert ["noise", "absent", "0.1"] in rows
    assert ["rate", "absent", "1", "-", "-"] in rows
    assert ["height", "<=", "10", "m", "kept", "absent"] in rows


def test_a_limit_that_one_result_breaks_is_named(
    chamfer: Chamfer, results: list[str], tmp_path: Path
) -> None:
    assert chamfer("run", "fall", "--set", "height=12", "--out", tmp_path)[0] == 0
    said = chamfer("compare", results[0], tmp_path / "fall")[1].splitlines()
    assert said[-2].split() == ["height", "<=", "10", "m", "kept", "broken"]
    assert said[-1] == "0 of 1 specifications are kept in both"
    assert chamfer("compare", *results)[1].splitlines()[-1].startswith("1 of 1 ")


def test_folder_without_a_result_is_refused(
    chamfer: Chamfer, results: list[str], tmp_path: Path
) -> None:
    status, _, err = chamfer("compare", results[0], tmp_path)
    assert status == 2
    assert "result.json: No such file" in err
    result = json.loads(Path(results[1], "result.json").read_text())
    values = ("far", float("inf"), 10**400)
    wrong = [{**result, "metrics": {"end": {"unit": "m", "value": value}}} for value in values]
    for document in ("{}", "[" * 100_000, *map(json.dumps, wrong)):
        (tmp_path / "result.json").write_text(document)
        status, _, err = chamfer("compare", results[0], tmp_path)
        assert status == 2
        assert "not a result" in err
