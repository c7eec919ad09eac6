"""A log, ours or a robot's, is fed to the same controller again."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq
import pytest

from chamfer.analysis.cli import main

FSM = "FSM-loop.controller-FSM"


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
    assert (tmp_path / "step-response" / "replay" / found["figures"][0]).exists()


def test_another_threshold_says_when_it_first_differs_and_in_which_states(
    ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ["--controller", "FSM loop::controller FSM", "--set", "fsm.dead_zone=0.02"]
    found = replayed(tmp_path, ran / "log", *settings)
    (one,) = found["controllers"]
    assert 0 < one["mismatches"] < 160
    assert found["metrics"]["replay.mismatches"]["value"] == one["mismatches"]
    first = one["first_difference"]
    states = one["states_differ"]
    assert (states["logged"], states["replayed"]) == ("modify_compensation", "aligned")
    assert first["time"] == found["metrics"]["replay.first_difference"]["value"]
    table = pd.read_parquet(tmp_path / "step-response" / "replay" / f"{FSM}.parquet")
    row = table[table["logged.state[0]"] != table["replayed.state[0]"]].iloc[0]
    assert row["time"] == states["time"] == first["time"]
    said = capsys.readouterr().out
    assert f"{one['mismatches']} differ, first at" in said
    assert "open loop" in said
    arguments = ["replay", "step-response", str(ran / "log"), "--out", str(tmp_path)]
    assert main([*arguments, *settings]) == 0
    assert main([*arguments, *settings, "--strict"]) == 1


def test_a_robots_log_may_lack_commands_and_optional_inputs(ran: Path, tmp_path: Path) -> None:
    table = pq.read_table(ran / "log" / f"{FSM}.parquet").to_pandas()
    titles = ["time (s)", "observation.error[0] (m)", "observation.valid[0]"]
    titles += ["observation.desired_trajectory[0] (m)", "command.compensation[0] (m)"]
    table = table.rename(columns={title.partition(" ")[0]: title for title in titles})[titles]
    log = tmp_path / "robot.csv"
    options = [
        "--controller",
        "FSM loop::controller FSM",
        "--scenario",
        str(ran / "scenario.yaml"),
    ]
    table.assign(note="by hand").to_csv(log, index=False)
    assert replayed(tmp_path, log, *options)["metrics"]["replay.mismatches"]["value"] == 0
    table[titles[:2]].to_csv(log, index=False)
    metric = replayed(tmp_path, log, *options)["metrics"]["replay.mismatches"]
    assert (metric["value"], metric["note"]) == (None, "no commands in the log")
    table = pd.read_parquet(tmp_path / "step-response" / "replay" / "robot.parquet")
    assert table["logged.compensation[0]"].isna().all()
    assert table["replayed.compensation[0]"].iloc[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("name", "log", "more", "said"),
    [
        ("sinusoid-response", "log", (), "is a log of step-response, not of sinusoid-response"),
        ("step-response", "nowhere", (), "nowhere can't be read as a log: No such file"),
        ("step-response", "", (), "has no logs, files that end with .parquet or .csv"),
        ("step-response", "traces.parquet", (), "doesn't say whose log it is, --controller has"),
        ("step-response", "log", ("--controller", "pid"), "unknown controller 'pid'"),
        ("plant-identification", "traces.parquet", (), "it has no controllers of its own"),
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


def test_logs_that_would_be_taken_for_others_are_refused(
    ran: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = ran / "log" / f"{FSM}.parquet"
    table = pq.read_table(log)
    arguments = ["replay", "step-response", str(tmp_path), "--out", str(tmp_path)]
    (tmp_path / log.name).write_bytes(log.read_bytes())
    pq.write_table(table.replace_schema_metadata({"overrides": "[]"}), tmp_path / "a.parquet")
    assert main(arguments) == 2
    assert "has logs of several scenarios" in capsys.readouterr().err
    (tmp_path / "a.parquet").unlink()
    table.to_pandas().to_csv(tmp_path / f"{FSM}.csv")
    assert main(arguments) == 2
    assert "has two logs of one name" in capsys.readouterr().err


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
    assert "log" not in run()
    assert [one.name for one in (folder / "log").iterdir()] == ["own.csv"]
    reduced = ["--set", "plant.stiffness=[700]", "--out", str(tmp_path)]
    assert main(["run", "plant-identification", "--log", *reduced]) == 0
    assert (
        "plant-identification: no log, the experiment has no controllers"
        in capsys.readouterr().err
    )
