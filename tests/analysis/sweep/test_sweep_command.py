import csv
import json
import shlex
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from chamfer.analysis.cli import main
from chamfer.analysis.report.traces import read_table
from chamfer.analysis.scenario.experiment import Catalogue


def run(out: Path, toys: Catalogue, *arguments: str) -> int:
    return main(["sweep", *arguments, "--out", str(out), "--workers", "1"], catalogue=toys)


def document(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "sweep-fall" / "sweep.json").read_text())
    return found


@pytest.mark.slow
def test_folder_has_points_figure_and_the_command(
    toys: Catalogue, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["fall", "--vary", "height=1:3:3", "body.mass=-1,2", "--metric", "end", "height"]
    assert run(out, toys, *arguments, "--trials", "2", "--seed", "5") == 0
    folder = out / "sweep-fall"
    assert sorted(path.name for path in folder.iterdir()) == [
        *("points.csv", "points.parquet", "sweep.json", "sweep.png", "sweep.svg"),
        *("trials.parquet", "trials.sqlite"),
    ]
    with (folder / "points.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    refused = "body.mass is -1.0, allowed: a finite number > 0"
    assert [(row["height"], row["body.mass"], row["status"]) for row in rows[:2]] == [
        ("1", "-1", refused),
        ("1", "2", "ok"),
    ]
    assert rows[0]["end"] == ""
    columns = pq.read_table(folder / "points.parquet")
    assert columns.column_names == list(rows[0])
    assert columns["end"].to_pylist()[1] == float(rows[1]["end"])
    assert set(columns["seed"].to_pylist()) == {5}
    trials = pq.read_table(folder / "trials.parquet")
    assert trials["seed"].to_pylist() == [5, 6] * 6
    assert trials["height"].to_pylist() == [1] * 4 + [2] * 4 + [3] * 4
    printed = capsys.readouterr().out
    assert "3 of 6 points ok" in printed
    assert f"3 without a result: {refused}" in printed
    assert document(out)["command"] == (
        "chamfer sweep fall --vary height=1,2,3 --vary body.mass=-1,2 "
        "--trials 2 --metric end --metric height --seed 5"
    )


@pytest.mark.slow
def test_command_of_the_document_makes_the_same_again(toys: Catalogue, out: Path) -> None:
    arguments = ["fall", "--vary", "height~1:3", "--points", "5", "--set", "body.mass=3"]
    assert run(out, toys, *arguments) == 0
    first = (out / "sweep-fall" / "points.csv").read_bytes()
    figure = (out / "sweep-fall" / "sweep.svg").read_bytes()
    words = shlex.split(document(out)["command"])
    assert words[:2] == ["chamfer", "sweep"]
    assert run(out, toys, *words[2:]) == 0
    assert (out / "sweep-fall" / "points.csv").read_bytes() == first
    assert (out / "sweep-fall" / "sweep.svg").read_bytes() == figure


def test_report_shows_the_sweep_behind_its_experiment(toys: Catalogue, out: Path) -> None:
    assert main(["run", "fall", "--out", str(out)], catalogue=toys) == 0
    assert run(out, toys, "fall", "--vary", "height=1,2,200") == 0
    page = (out / "index.html").read_text()
    assert "1 experiment, 1 sweep" in page
    assert page.index('<article id="fall">') < page.index('<article id="sweep-fall">')
    section = page[page.index('<article id="sweep-fall">') :]
    assert "3 points of its scenario (grid), 2 with a result" in section
    assert "chamfer sweep fall --vary height=1,2,200" in section
    assert "height is 200.0, allowed: a number &lt;= 100" in section
    assert 'href="sweep-fall/points.csv"' in section
    assert section.count("data:image/svg+xml") == 1


def test_json_is_one_document(
    toys: Catalogue, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(out, toys, "fall", "--vary", "height=1,2", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["points"] == printed["points_ok"] == 2
    assert printed["folder"] == str(out / "sweep-fall")


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["fall", "--vary", "height=200"], 1),  # nothing was measured
        (["broken", "--vary", "noise=1,2"], 1),
        (["fall", "--vary", "height=1,200"], 0),
    ],
)
def test_status_says_whether_points_failed(
    toys: Catalogue, out: Path, arguments: list[str], status: int
) -> None:
    assert run(out, toys, *arguments) == status


def test_mistake_is_one_line(
    toys: Catalogue, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, message in (
        (["--vary", "height=1", "height=2"], "height is varied twice"),
        (["--vary", "height=1", "--trials", "0"], "--trials is '0'"),
        (["--vary", "height~1:2", "--points", "x"], "--points is 'x'"),
        ([], "no field is varied"),
    ):
        assert run(out, toys, "fall", *arguments) == 2
        error = capsys.readouterr().err
        assert message in error
        assert error.count("\n") == 1
        assert not (out / "sweep-fall").exists()


@pytest.mark.slow
def test_a_point_whose_process_dies_is_a_row_and_the_others_are_kept(
    toys: Catalogue, falling: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = falling
    left = out.parent / "left"
    left.mkdir()
    text = f"""    import os, pathlib
    pathlib.Path({str(left)!r}, f"{{scenario.height}}-{{time.monotonic_ns()}}").touch()
    if scenario.height == 7.0:
        os._exit(3)
    time_ = np"""
    path.write_text(path.read_text().replace("    time_ = np", text))
    for _ in range(2):
        assert run(out, toys, "fall", "--vary", "height=1,7,3", "--metric", "height") == 1
        table = read_table(out / "sweep-fall" / "points.parquet")
        assert list(table["status"]) == ["ok", "its process ended with status 3", "ok"]
        assert list(table["measured.height"])[::2] == [1.0, 3.0]
    begun = sorted(path.name.partition("-")[0] for path in left.iterdir())
    assert begun == ["1.0", "3.0", *4 * ["7.0"]]  # tried twice, by both


def test_text_is_no_formula_to_a_spreadsheet(toys: Catalogue, out: Path) -> None:
    assert run(out, toys, "fall", "--vary", "body.form='=1+1',ball", "--metric", "end") == 0
    with (out / "sweep-fall" / "points.csv").open(newline="") as file:
        assert [row["body.form"] for row in csv.DictReader(file)] == ["'=1+1", "ball"]
