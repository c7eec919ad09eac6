"""Files of results: each whole or not there, the same bytes for the same content."""

import json
import math
import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.report.atomic_write import locked, replacing, write_text
from chamfer.analysis.report.checks import Check, Published, check
from chamfer.analysis.report.results import (
    check_document,
    defined_metrics,
    json_text,
    metric_document,
    read_result,
    write_folder,
)
from chamfer.analysis.report.traces import read_table, write_table
from chamfer.analysis.scenario.experiment import Metric


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_a_writer_that_fails_midway_leaves_the_old_file(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "older")
    write_text(path, "old ±")

    def write() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert path.read_text(encoding="utf-8") == "old ±"
    assert list(tmp_path.iterdir()) == [path]


def test_two_writers_at_once_don_t_share_a_temporary_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with replacing(path) as first, replacing(path) as second:
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"  # the outer one ends last
    assert list(tmp_path.iterdir()) == [path]


def test_permissions_are_those_of_any_new_file(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "text")
    (tmp_path / "b.txt").write_text("text")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def table() -> dict[str, NDArray[Any]]:
    return {
        "time": np.array([np.nan, *np.linspace(0.0, 1.0, 49)]),  # NaN where a trial lacks it
        "trial": np.arange(50),
        "ok": np.arange(50) % 2 == 0,
        "state": np.array(["aligned", "moving"] * 25),
    }


def test_columns_come_back_in_order_with_their_types(tmp_path: Path) -> None:
    write_table(tmp_path / "a.parquet", table())
    read = read_table(tmp_path / "a.parquet")
    assert list(read) == ["time", "trial", "ok", "state"]
    for name, values in table().items():
        np.testing.assert_array_equal(read[name], values)
    assert [read[name].dtype.kind for name in ("time", "trial", "ok")] == ["f", "i", "b"]
    pandas = pytest.importorskip("pandas")
    assert pandas.read_parquet(tmp_path / "a.parquet").state.tolist() == ["aligned", "moving"] * 25


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"a": np.zeros(3), "b": np.zeros(2)}, "column 'b' has 2 rows, the first one has 3"),
        ({"a": np.array([0.0, -np.inf])}, "column 'a' is infinite in row 1"),
        ({"a": np.zeros((2, 3))}, r"column 'a' has shape \(2, 3\), allowed: \(rows,\)"),
    ],
)
def test_bad_columns_are_named_and_the_old_table_stays(
    tmp_path: Path, columns: dict[str, NDArray[Any]], message: str
) -> None:
    path = tmp_path / "a.parquet"
    write_table(path, table())
    before = path.read_bytes()
    with pytest.raises(ValueError, match=f"^{message}$"):
        write_table(path, columns)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_table_without_rows_or_columns_can_be_read(tmp_path: Path) -> None:
    write_table(tmp_path / "a.parquet", {"x": np.array([])})
    assert read_table(tmp_path / "a.parquet")["x"].shape == (0,)
    write_table(tmp_path / "a.parquet", {})
    assert read_table(tmp_path / "a.parquet") == {}


FILES = {"a.parquet": b"\x00", "scenario.yaml": "height: 5.0 # π", "result.json": "{}"}


def published(**changes: Any) -> Published:
    given: dict[str, Any] = {
        "experiment": "fall",
        "metric": "end",
        "relation": "near",
        "value": 1,
        "tolerance": 0.5,
        "unit": "m",
        "kind": "predicted",
        "source": "Fig. 1",
    }
    return Published(**{**given, **changes})


def test_all_files_are_written_and_the_document_appears_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    appeared: list[str] = []
    replace = os.replace

    def spy(source: Path, target: Path) -> None:
        appeared.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr("chamfer.analysis.report.results.os.replace", spy)
    write_folder(tmp_path / "fall", FILES)
    assert appeared == list(FILES)
    assert {path.name: path.read_bytes() for path in (tmp_path / "fall").iterdir()} == {
        name: content.encode() if isinstance(content, str) else content
        for name, content in FILES.items()
    }
    assert read_result(tmp_path / "fall" / "result.json") == {}


@pytest.mark.parametrize("failure", [OSError(28, "full"), KeyboardInterrupt()])
def test_a_failure_midway_leaves_the_old_result_with_its_own_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException
) -> None:
    write_folder(tmp_path, FILES)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    write = Path.write_bytes

    def fail(path: Path, content: bytes) -> None:
        if path.name == "scenario.yaml":
            raise failure
        write(path, content)

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(type(failure)):
        write_folder(tmp_path, dict.fromkeys(FILES, "new"))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_document_that_is_not_json_is_refused() -> None:
    with pytest.raises(ValueError, match="JSON"):
        json_text({"value": math.nan})


def test_two_runs_don_t_mix_their_files(tmp_path: Path) -> None:
    with locked(tmp_path):  # another run is renaming its files
        writer = threading.Thread(target=write_folder, args=(tmp_path, FILES))
        writer.start()
        writer.join(timeout=0.5)
        assert [path.name for path in tmp_path.iterdir() if path.is_file()] == []
    writer.join(timeout=10)
    assert (tmp_path / "result.json").exists()


def test_metrics_that_are_not_finite_are_null_with_a_note() -> None:
    defined = defined_metrics(
        {
            "a": Metric(value=np.float64(1.5), unit="m"),
            "b": Metric(value=math.inf, unit="m"),
            "c": Metric(value=math.nan, unit="", note="no rest"),
            "d": Metric(value=None, unit="s"),
        }
    )
    documents = {name: metric_document(metric) for name, metric in defined.items()}
    assert documents == {
        "a": {"value": 1.5, "unit": "m"},
        "b": {"value": None, "unit": "m", "note": "measured inf"},
        "c": {"value": None, "unit": "", "note": "no rest"},
        "d": {"value": None, "unit": "s", "note": "undefined"},
    }
    json.loads(json_text(documents))


@pytest.mark.parametrize(
    ("changes", "measured", "verdict"),
    [
        ({}, 1.5, "holds"),
        ({}, 0.5, "holds"),
        ({}, 1.6, "not_reached"),
        ({}, 0.4, "not_reached"),
        ({"otherwise": "does_not_hold"}, 1.5, "holds"),
        ({"relation": "at_most", "otherwise": "does_not_hold"}, 1.1, "does_not_hold"),
        ({"relation": "at_most"}, 1.0, "holds"),
        ({"relation": "at_least"}, 1.0, "holds"),
        ({"relation": "at_least"}, None, "not_reached"),
        ({"relation": "between", "low": 0, "high": 2}, 2.0, "holds"),
        ({"relation": "between", "low": 0, "high": 2}, -0.1, "not_reached"),
    ],
)
def test_a_check_holds_within_the_bounds_of_its_relation(
    changes: dict[str, Any], measured: float | None, verdict: str
) -> None:
    found = Check(published=published(**changes, note="why"), measured=measured)
    assert (found.verdict, found.ok) == (verdict, verdict == "holds")


@pytest.mark.parametrize(
    ("metric", "measured", "kept"),
    [
        (Metric(value=1.0, unit="m"), 1.0, True),
        (Metric(value=1.1, unit="m"), 1.1, False),
        (Metric(value=None, unit="m"), None, False),  # its mode ended without a value
        (Metric(value=0.5, unit="m", trials=(0.3, 0.7)), 0.7, True),
        (Metric(value=0.9, unit="m", trials=(0.6, 1.2)), 1.2, False),  # the mean keeps it
        (Metric(value=0.6, unit="m", trials=(0.6, None)), None, False),
    ],
)
def test_a_limit_is_judged_on_the_worst_trial_whatever_the_scenario(
    metric: Metric, measured: float | None, kept: bool
) -> None:
    fails = {"otherwise": "does_not_hold", "note": "its own task"}
    limit = published(relation="at_most", kind="specification", **fails)
    values = [limit, published(), published(metric="absent", kind="specification")]
    (found,) = check(values, {"end": metric}, default=False)
    assert (found.measured, found.ok) == (measured, kept)
    assert found.verdict == ("holds" if kept else "not_reached")  # no claim of the paper's
    assert check([limit], {"end": metric})[0].verdict == ("holds" if kept else "does_not_hold")
    assert ("kept" in check_document(found)) == bool(metric.trials)
    (other,) = check([published()], {"end": metric})  # by the mean, if each trial has a value
    assert other.measured == (None if None in metric.trials else metric.value)


@pytest.mark.parametrize(
    ("relation", "worst"),
    [("at_most", 3.0), ("at_least", -2.0), ("near", -2.0), ("between", 3.0)],
)
def test_the_worst_value_is_the_farthest_beyond_the_bounds(relation: str, worst: float) -> None:
    value = published(relation=relation, low=0.0, high=0.5)
    assert value.worst((1.0, 3.0, -2.0)) == worst


def test_a_claim_that_does_not_hold_says_why() -> None:
    with pytest.raises(ValueError, match="a claim that does not hold lacks a note"):
        published(otherwise="does_not_hold")
