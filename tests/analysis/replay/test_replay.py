"""A log, ours or a robot's, is fed to the same controller again."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest

from chamfer.analysis.cli import main

FSM = "FSM-loop.controller-FSM"
COLUMNS = [
    *("time (s)", "observation.error[0] (m)", "observation.valid[0]"),
    *("observation.desired_trajectory[0] (m)", "command.compensation[0] (m)", "command.state[0]"),
]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of results with logs of all loops, of another scenario than the default."""
    out = tmp_path_factory.mktemp("out")
    settings = ["duration=2", "fsm.increment=0.009", "fsm.large_error=0.09"]
    arguments = [word for one in settings for word in ("--set", one)]
    assert main(["run", "step-response", "--log", "--out", str(out), *arguments]) == 0
    return out / "step-response"


def replayed(out: Path, log: Path, *more: str) -> dict[str, Any]:
    main(["replay", "step-response", str(log), "--out", str(out), *more])
    text = (out / "step-response" / "replay" / "result.json").read_text(encoding="utf-8")
    document: dict[str, Any] = json.loads(text)
    return document


def test_own_logs_have_no_mismatch_in_the_scenario_that_they_are_of(
    ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = replayed(tmp_path, ran / "log")
    assert found["metrics"]["replay.mismatches"]["value"] == 0
    assert found["metrics"]["replay.steps"]["value"] == 3 * 160 + 2 * 161
    assert found["overrides"] == ["fsm.large_error=0.09", "fsm.increment=0.009", "duration=2.0"]
    assert "160 steps, none differs" in capsys.readouterr().out
    assert len(found["figures"]) == 10
    for name in found["figures"]:
        assert (tmp_path / "step-response" / "replay" / name).exists()


def test_another_threshold_says_when_it_first_differs_and_in_which_states(
    ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ["--controller", "FSM loop::controller FSM", "--set", "fsm.dead_zone=0.02"]
    found = replayed(tmp_path, ran / "log", *settings)
    (one,) = found["controllers"]
    assert 0 < one["mismatches"] < 160
    assert found["metrics"]["replay.mismatches"]["value"] == one["mismatches"]
    first = one["first_difference"]
    states = {"logged": "modify_compensation", "replayed": "aligned"}
    assert one["states_differ"] == {"time": first["time"], **states}
    assert first["time"] == found["metrics"]["replay.first_difference"]["value"]
    table = pd.read_parquet(tmp_path / "step-response" / "replay" / f"{FSM}.parquet")
    row = table[table["logged.state[0]"] != table["replayed.state[0]"]].iloc[0]
    assert row["time"] == first["time"]
    said = capsys.readouterr().out
    assert f"{one['mismatches']} differ, first at" in said
    assert "open loop" in said
    arguments = ["replay", "step-response", str(ran / "log"), "--out", str(tmp_path)]
    assert main([*arguments, *settings]) == 0
    assert main([*arguments, *settings, "--strict"]) == 1


def robot(ran: Path, tmp_path: Path, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Path:
    """Write what a robot's log may be: CSV, with units in the titles."""
    table = pq.read_table(ran / "log" / f"{FSM}.parquet").to_pandas()
    table = table.rename(columns={name.partition(" ")[0]: name for name in COLUMNS})[COLUMNS]
    path = tmp_path / "robot.csv"
    change(table).to_csv(path, index=False)
    return path


def test_a_robots_log_may_lack_commands_and_optional_inputs(ran: Path, tmp_path: Path) -> None:
    scenario = str(ran / "scenario.yaml")
    options = ["--controller", "FSM loop::controller FSM", "--scenario", scenario]
    whole = replayed(tmp_path, robot(ran, tmp_path, lambda table: table), *options)
    assert whole["metrics"]["replay.mismatches"]["value"] == 0
    bare = robot(ran, tmp_path, lambda table: table.drop(columns=COLUMNS[2:]))
    found = replayed(tmp_path, bare, *options)
    assert found["metrics"]["replay.mismatches"] == {
        "value": None,
        "unit": "",
        "note": "no commands in the log",
    }
    table = pd.read_parquet(tmp_path / "step-response" / "replay" / "robot.parquet")
    assert table["logged.compensation[0]"].isna().all()
    assert table["replayed.compensation[0]"].iloc[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda table: table[:0], "has no rows"),
        (
            lambda table: table.rename(columns={"time (s)": "time (ms)"}),
            "time is in ms, must be in s",
        ),
        (
            lambda table: table.rename(columns={"time (s)": "time"}),
            "time is without a unit, must be in s",
        ),
        (
            lambda table: table.drop(columns="observation.error[0] (m)"),
            "has no column observation.error[0], in m",
        ),
        (lambda table: table[::-1], "s in row 2, must ascend"),
        (
            lambda table: table.assign(**{"observation.error[0] (m)": [None, *[1.0] * 159]}),
            "observation.error[0] is missing in row 1, must be a number",
        ),
        (
            lambda table: table.assign(**{"time (s)": [0.0, "nan", *table["time (s)"][2:]]}),
            "time is nan in row 2, must be a number",
        ),
        (lambda table: table.assign(**{"command.speed[0] (m)": 1.0}), "command.speed[0] is none"),
        (lambda table: table.assign(**{"time (s)": "noon"}), "invalid value 'noon'"),
    ],
)
def test_what_does_not_fit_is_refused_in_a_line(
    ran: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[pd.DataFrame], pd.DataFrame],
    said: str,
) -> None:
    path = robot(ran, tmp_path, change)
    arguments = ["replay", "step-response", str(path), "--out", str(tmp_path)]
    assert main([*arguments, "--controller", "FSM loop::controller FSM"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "log", "more", "said"),
    [
        ("sinusoid-response", "log", (), "is a log of step-response, not of sinusoid-response"),
        ("step-response", "nowhere", (), "nowhere can't be read as a log: No such file"),
        ("step-response", "", (), "has no logs, files that end with .parquet or .csv"),
        ("step-response", "traces.parquet", (), "doesn't say whose log it is, --controller has"),
        ("step-response", "log", ("--controller", "pid"), "unknown controller 'pid'"),
        ("plant-identification", "traces.parquet", (), "it has no controllers of its own"),
        ("step-response", "log", ("--set", "fsm.period=0"), "fsm.period is 0.0, allowed:"),
    ],
)
def test_a_log_of_something_else_is_refused(
    ran: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    log: str,
    more: tuple[str, ...],
    said: str,
) -> None:
    path = ran / log if log else tmp_path
    assert main(["replay", name, str(path), "--out", str(tmp_path), *more]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / name).exists()


def test_a_run_has_the_logs_of_its_own_controllers_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*options: str) -> dict[str, Any]:
        shorter = ["--set", "duration=0.5", "--out", str(tmp_path)]
        assert main(["run", "step-response", *shorter, *options]) == 0
        result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        return result

    folder = tmp_path / "step-response"
    names = run("--log")["log"]
    assert f"log/{FSM}.parquet" in names
    (folder / "log" / "own.csv").touch()
    traces = (folder / "traces.parquet").read_bytes()
    assert "log" not in run()
    assert [one.name for one in (folder / "log").iterdir()] == ["own.csv"]
    assert (folder / "traces.parquet").read_bytes() == traces
    reduced = ["--set", "plant.stiffness=[700]", "--out", str(tmp_path)]
    assert main(["run", "plant-identification", "--log", *reduced]) == 0
    assert "plant-identification: no log, it has no controllers" in capsys.readouterr().err
