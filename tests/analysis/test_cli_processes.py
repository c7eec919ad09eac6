import importlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.campaign.workers import cores
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cli import main
from chamfer.analysis.report.traces import read_table
from chamfer.analysis.scenario.experiment import Catalogue

ROOT = Path(__file__).parents[2]

TRIALS = [f"trials/{name}" for name in ("result.json", "scenario.yaml", "traces.parquet")]
Start = Callable[..., subprocess.Popen[str]]
CAMPAIGN = """

FAILING = ()


def work(folder, seconds, task):
    import os
    from pathlib import Path

    Path(folder, f"{task}-{os.getpid()}-{time.monotonic_ns()}").touch()
    time.sleep(seconds)
    if task in FAILING:
        raise ValueError("not this one")
    return {"square": task**2}


def run_campaign(scenario, seed, progress):
    from functools import partial

    from chamfer.analysis.campaign.campaign import run_each

    print("started", file=sys.stderr, flush=True)
    found = run_each(partial(work, FOLDER, scenario.noise), range(6), progress)
    return Outcome(metrics={}, traces={"square": found.column("square")}, simulated_seconds=0.0)
"""

ENTRIES = """
        trials("campaign", "campaign-paper", "run_campaign"),
"""


@pytest.fixture
def busy(more_toys: Callable[[str, str], Catalogue], tmp_path: Path) -> Path:
    """Where each task of the experiment ``campaign`` leaves its number and its process."""
    folder = tmp_path / "busy"
    folder.mkdir()
    more_toys(CAMPAIGN.replace("FOLDER", repr(str(folder))), ENTRIES)
    return folder


def processes(busy: Path) -> set[int]:
    return {int(path.name.split("-")[1]) for path in busy.iterdir()}


def done(busy: Path) -> list[int]:
    """The numbers of the tasks that have been begun, those begun twice twice."""
    return sorted(int(path.name.split("-")[0]) for path in busy.iterdir())


def files(out: Path) -> list[str]:
    return sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_run_in_one_line(
    start: Start, toys: Catalogue, out: Path, sent: int
) -> None:
    with start(toys, "run", "trials", "slow", "--out", str(out)) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "started\n"
        process.send_signal(sent)
        _, err = process.communicate(timeout=10)
    assert process.returncode == 130
    assert err == "chamfer: interrupted; finished experiments and trials are kept\n"
    assert files(out) == ["index.html", *TRIALS]


@pytest.mark.slow
@pytest.mark.parametrize("when", ["starting", "working"])
def test_an_interrupted_campaign_ends_at_once(
    start: Start, toys: Catalogue, busy: Path, out: Path, when: str
) -> None:
    assert main(["run", "trials", "--out", str(out)], catalogue=toys) == 0
    arguments = ("run", "campaign", "--set", "noise=60", "--workers", "2", "--out", str(out))
    with start(toys, *arguments, group=True) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == "started\n"
        time.sleep(0.15)
        end = time.monotonic() + 60
        while when == "working" and len(processes(busy)) < 2 and time.monotonic() < end:
            time.sleep(0.02)
        begin = time.monotonic()
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does it
        _, err = process.communicate(timeout=30)
        assert time.monotonic() - begin < 20
    assert process.returncode == 130
    assert err == "chamfer: interrupted; finished experiments and trials are kept\n"
    assert {*files(out), "campaign/trials.sqlite"} == {  # which may not have been begun
        *("campaign/trials.sqlite", "index.html", *TRIALS)
    }


@pytest.mark.slow
@pytest.mark.parametrize("asked", ["2", "1", None])
def test_a_campaign_uses_the_processes_it_may(
    start: Start, toys: Catalogue, busy: Path, out: Path, asked: str | None
) -> None:
    arguments = ["run", "campaign", "--out", str(out)]
    with start(toys, *arguments, *(["--workers", asked] if asked else [])) as process:
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "started\n")
    np.testing.assert_array_equal(
        read_table(out / "campaign" / "traces.parquet")["square"], np.arange(6) ** 2
    )
    workers = int(asked) if asked else cores()
    assert process.pid not in processes(busy)
    assert 1 <= len(processes(busy)) <= workers


@pytest.mark.slow
def test_a_failed_trial_is_a_finding_and_a_status(
    start: Start, toys: Catalogue, falling: Path, busy: Path, out: Path
) -> None:
    falling.write_text(falling.read_text().replace("FAILING = ()", "FAILING = (2, 4)"))
    said = "campaign: 2 trials failed, trial 2: ValueError: not this one (all.py, line "
    for command in (("run", "campaign"), ("reproduce", "--paper", "campaign-paper")):
        with start(toys, *command, "--out", str(out)) as process:
            text, _ = process.communicate(timeout=60)
        assert process.returncode == 1
        assert [line for line in text.splitlines() if line.startswith(said)] != []
        document = json.loads((out / "campaign" / "result.json").read_text())
        assert [one["trial"] for one in document["failed_trials"]] == [2, 4]
        found = read_table(out / "campaign" / "traces.parquet")["square"]
        assert found.tolist() == [0, 1, 9, 25]
    assert done(busy) == [0, 1, 2, 2, 3, 4, 4, 5]  # the failed ones are tried again


@pytest.mark.slow
def test_reproduce_takes_up_what_was_interrupted(
    start: Start, toys: Catalogue, falling: Path, busy: Path, out: Path
) -> None:
    falling.write_text(falling.read_text().replace("range(6)", "range(30)"))
    arguments = ("reproduce", "--paper", "campaign-paper", "--workers", "2", "--out", str(out))
    for sent in (signal.SIGINT, signal.SIGKILL, None):
        before = len(done(busy))
        with start(toys, *arguments) as process:
            while sent is not None and len(done(busy)) < before + 12:
                time.sleep(0.02)
                assert process.poll() is None
            if sent is not None:
                process.send_signal(sent)
            process.communicate(timeout=60)
    assert process.returncode == 0
    found = read_table(out / "campaign" / "traces.parquet")["square"]
    np.testing.assert_array_equal(found, np.arange(30) ** 2)
    assert set(done(busy)) == set(range(30))
    assert len(done(busy)) <= 30 + 2 * 12 - 2  # what had been written was not run again
    with start(toys, *arguments, "--fresh") as process:
        process.communicate(timeout=60)
    assert len(done(busy)) >= 60


@pytest.mark.slow
def test_a_campaign_of_the_real_command_is_the_same_with_more_processes(
    chamfer: Callable[..., tuple[int, str, str]], out: Path
) -> None:
    arguments = ["run", "surface-estimation", "--seed", "3"]
    for setting in ("trials=4", "duration=1", "lead.halt=0.8"):
        arguments += ["--set", setting]
    found = []
    for workers in ("1", "2"):
        command = (*arguments, "--workers", workers, "--out", out / workers)
        status, _, err = chamfer(*command, catalogue=CATALOGUE)
        assert (status, err) == (0, "")
        folder = out / workers / "surface-estimation"
        document = json.loads((folder / "result.json").read_text())
        del document["wall_seconds"]
        found.append((document, (folder / "traces.parquet").read_bytes()))
    assert found[0] == found[1]


@pytest.mark.slow
def test_reproduce_runs_experiments_side_by_side(start: Start, toys: Catalogue, out: Path) -> None:
    printed = []
    for workers in ("1", "2"):
        arguments = ("--paper", "toy-paper", "--workers", workers, "--out", str(out / workers))
        with start(toys, "reproduce", *arguments) as process:
            said, err = process.communicate(timeout=60)
        assert (process.returncode, err) == (0, "noise on standard output\n")
        seconds = re.compile(r"\(\d+\.\d\d s\)")
        printed.append(sorted(seconds.sub("", said.replace(str(out / workers), "")).splitlines()))
    assert printed[0] == printed[1]
    for name in ("fall/fall.svg", "fall/scenario.yaml", "fall/traces.parquet", TRIALS[2]):
        assert (out / "1" / name).read_bytes() == (out / "2" / name).read_bytes()


@pytest.mark.slow
def test_reproduce_outlives_a_process_that_dies(
    start: Start, toys: Catalogue, falling: Path, out: Path
) -> None:
    killing = "    import os, signal; os.kill(os.getpid(), signal.SIGKILL)\n    time_ = np"
    falling.write_text(falling.read_text().replace("    time_ = np", killing))
    arguments = ("reproduce", "--paper", "toy-paper", "--workers", "2", "--out", str(out))
    with start(toys, *arguments) as process:
        said, err = process.communicate(timeout=60)
    assert process.returncode == 1
    noise = "noise on standard output\n"  # tried once more
    assert err == f"{noise}{noise}chamfer: fall: its process was killed (SIGKILL)\n"
    assert "ended with an error: fall: its process was killed (SIGKILL)\n" in said
    assert set(TRIALS) < set(files(out))


def test_a_reader_that_leaves_early_is_no_error(start: Start, toys: Catalogue) -> None:
    with start(toys, "list") as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 141


def test_a_terminal_that_lacks_a_character_is_no_error(
    start: Start, toys: Catalogue, falling: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = falling.parents[1] / "catalogue.py"
    path.write_text(path.read_text().replace("a body falls", "a body falls ± 1 m"))
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    with start(toys, "list") as process:
        out, err = process.communicate(timeout=10)
    assert (process.returncode, err) == (0, "")
    assert "a body falls \\xb1 1 m" in out


FULL = "chamfer: standard output can't be written: No space left on device\n"


@pytest.mark.parametrize(
    ("arguments", "status", "out_lines", "err"),
    [
        ("list >&-", 0, 0, ""),
        ("list 2>&-", 0, 40, ""),
        ("list >/dev/full", 1, 0, FULL),
        ("--help >/dev/full", 1, 0, FULL),
        ("lost 2>/dev/full", 2, 0, ""),
    ],
)
def test_streams_may_be_closed_or_full(
    arguments: str, status: int, out_lines: int, err: str
) -> None:
    found = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m analysis {arguments}"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (found.returncode, found.stderr) == (status, err)
    assert found.stdout.count("\n") >= out_lines


def test_an_interrupt_before_anything_is_imported_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupted:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "chamfer.analysis.cli":
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, "chamfer.analysis.cli")
    monkeypatch.setattr(sys, "meta_path", [Interrupted(), *sys.meta_path])
    assert importlib.import_module("chamfer.analysis.__main__").main() == 130
    assert capsys.readouterr().err == "chamfer: interrupted before anything was done\n"
