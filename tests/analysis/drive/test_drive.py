"""``chamfer drive``: an insertion by a robot in another process, and what may go wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cli import main
from chamfer.analysis.command.running import prepare
from chamfer.analysis.insertion.cell_runs import run_cell_insertion
from chamfer.analysis.report.traces import read_table

ROOT = Path(__file__).parents[3]
(ENTRY,) = (entry for entry in CATALOGUE.entries if entry.name == "insertion")
QUICK = [word for setting in ENTRY.reduced for word in ("--set", setting)]
DRIVE = ["drive", "insertion", "--robot", "simulated", *QUICK]


@pytest.fixture(autouse=True)
def of_this_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the robot be of the tree that the tests are of."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT / "src"))


@pytest.mark.parametrize("rate", ["2", "0", "nan", "fast"])
def test_a_rate_that_no_robot_keeps_is_refused(rate: str, capsys: Any) -> None:
    assert main([*DRIVE, "--rate", rate]) == 2
    assert "allowed: a number > 0 and <= 1, or lockstep" in capsys.readouterr().err


def test_step_by_step_the_robot_does_what_the_diagram_does(tmp_path: Path, capsys: Any) -> None:
    assert main([*DRIVE, "--rate", "lockstep", "--out", str(tmp_path), "--json"]) == 0
    driven = json.loads(capsys.readouterr().out)["results"][0]
    assert driven["command"].startswith("chamfer drive insertion --set")
    assert driven["command"].endswith("--robot simulated --rate lockstep")
    assert driven["metrics"]["seated"]["value"] == 1
    assert driven["metrics"]["interventions"]["value"] == 0
    log = tmp_path / "drive/insertion/log"
    assert main(["replay", "insertion", str(log), "--strict", "--out", str(tmp_path)]) == 0
    (job,) = prepare([ENTRY], settings=ENTRY.reduced)
    here = run_cell_insertion(job.scenario, 0).traces
    there = read_table(tmp_path / "drive/insertion/traces.parquet")
    rows = min(len(there["time"]), len(here["time"]))
    assert rows > 0.98 * len(here["time"])
    here.pop("sides_apart")  # of a touch that is hardly one
    for name, values in here.items():
        np.testing.assert_allclose(there[name][:rows], values[:rows], atol=1e-6, err_msg=name)


def started(*arguments: str) -> tuple["subprocess.Popen[str]", int]:
    """Start the command; return it and its robot's process, once that is there."""
    command = [sys.executable, "-m", "chamfer.analysis", *DRIVE, *arguments]
    driving = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    children = Path(f"/proc/{driving.pid}/task/{driving.pid}/children")
    while driving.poll() is None:
        for child in children.read_text().split():
            if "simulated_insertion" in Path(f"/proc/{child}/cmdline").read_text():
                return driving, int(child)
        time.sleep(0.02)
    raise AssertionError(driving.communicate())


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


ENDS = {  # what happens, the exit status, and what is said
    "interrupt": (130, "interrupted"),
    "kill the robot": (1, "the simulated robot has ended"),
    "kill the controller": (-9, ""),
}


def test_whatever_ends_it_leaves_no_process_behind(tmp_path: Path) -> None:
    all_started = {what: started("--out", str(tmp_path / what), "--rate", "0.05") for what in ENDS}
    time.sleep(12.0)  # in the middle of it, or, on a slow machine, as the robot starts
    for what, (driving, robot) in all_started.items():
        killed = robot if what == "kill the robot" else driving.pid
        os.kill(killed, signal.SIGINT if what == "interrupt" else signal.SIGKILL)
    for what, (driving, robot) in all_started.items():
        status, said = ENDS[what]
        error = driving.communicate(timeout=30)[1].strip()
        assert (driving.returncode, len(error.splitlines()) <= 1) == (status, True), error
        assert said in error
        end = time.monotonic() + 10
        while alive(robot) and time.monotonic() < end:
            time.sleep(0.05)
        assert not alive(robot)


@pytest.mark.slow
def test_at_real_time_the_forces_are_those_of_the_diagram(tmp_path: Path) -> None:
    assert main([*DRIVE, "--out", str(tmp_path), "--rate", "0.25"]) == 0
    assert main(["run", "insertion", *QUICK, "--out", str(tmp_path)]) == 0
    driven, run = (
        json.loads((tmp_path / where / "insertion/result.json").read_text())["metrics"]
        for where in ("drive", ".")
    )
    assert driven["ticks"]["value"] > 80
    assert driven["lateness.median"]["value"] > 0
    if driven["ticks.missed"]["value"] == 0:  # a busy machine answers some too late
        for name in ("force.axial", "force.lateral", "force.contact"):
            assert driven[name]["value"] == pytest.approx(run[name]["value"], rel=0.01), name
