import json
import sys
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.benchmarks import __main__ as entry
from chamfer.analysis.benchmarks import cold_start, command
from chamfer.analysis.benchmarks.agreement import Agreement
from chamfer.analysis.benchmarks.case import Case
from chamfer.analysis.benchmarks.cold_start import COMMAND, IMPORTS, ColdStart
from chamfer.analysis.benchmarks.engine import (
    SOURCES,
    Engine,
    LoopName,
    Source,
    how_to_install,
    installed,
)
from chamfer.analysis.benchmarks.exact import exact_fsm, exact_pid
from chamfer.analysis.benchmarks.insertion import Insertions
from chamfer.analysis.benchmarks.observers import Updates
from chamfer.analysis.benchmarks.real_time import RealTime
from chamfer.analysis.benchmarks.report import (
    Findings,
    agreement_text,
    document,
    summary_text,
    times_text,
)
from chamfer.analysis.benchmarks.targets import targets
from chamfer.analysis.benchmarks.timing import Times

_ABSENT = Source(
    module="absent_peer", requires="no_such_package", distribution="absent", extra="bench"
)


def _engine(name: str) -> Engine:
    return Engine(
        name=name, build=lambda: None, run=lambda _: np.zeros(1), accuracy=1e-6, note="settings"
    )


def _exact_engines(_sources: object, case: Case, loop: LoopName) -> list[Engine]:
    output = exact_pid(case) if loop == "pid" else exact_fsm(case)
    return [
        Engine(
            name="Chamfer", build=lambda: None, run=lambda _: output, accuracy=1e-9, note="exact"
        )
    ]


def test_missing_peer_is_named_with_what_installs_it() -> None:
    present, missing = installed((*SOURCES[:1], _ABSENT))
    assert present == list(SOURCES[:1])
    assert missing == [_ABSENT]
    line = how_to_install(_ABSENT)
    assert line == "absent is not installed and left out: pip install '.[bench]'"
    findings = Findings(missing=missing)
    assert line in summary_text(findings)
    assert document(findings)["missing"] == [line]


def test_tables_are_aligned() -> None:
    agreements = [
        Agreement(engine="Chamfer", difference=1e-12, accuracy=1e-10, rise_time=0.1),
        Agreement(engine="a longer name", accuracy=1e-6, failure="RuntimeError: no"),
        Agreement(engine="other", difference=1.0, accuracy=1e-6),
    ]
    text = agreement_text("fsm", agreements)
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert len({len(line) for line in lines}) == 1
    assert lines[2].endswith("| ok               |")
    assert "RuntimeError: no" in lines[3]
    assert "DIFFERS" in lines[4]


def test_ratios_are_to_the_first_engine() -> None:
    times = {
        "Chamfer": Times(running=[0.010]),
        "peer": Times(trials=10, running=[0.25]),
    }
    text = times_text("fsm", [_engine("Chamfer"), _engine("peer"), _engine("not run")], times)
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()[4:]]
    assert [row[6] for row in rows] == ["1", "2.5", "-"]
    assert [row[5] for row in rows] == ["1", "1", "0"]


def test_targets_are_met_missed_or_not_measured() -> None:
    times: dict[LoopName, dict[str, Times]] = {
        "fsm": {
            "Chamfer": Times(running=[1.0]),
            "Chamfer, compiled": Times(trials=1000, running=[25.0]),
            "SciPy RK45 per tick": Times(running=[2.4]),
            "python-control": Times(running=[0.9]),
            "bdsim": Times(running=[80.0]),
        }
    }
    cold = ColdStart(times={IMPORTS: [1.0], COMMAND: [1.5]})
    speed = RealTime(factors={"planar-slide": [9.0, 12.0, 11.0], "adept-nugget-hold": [2.0]})
    found = {
        target.text: target.ok
        for target in targets(
            times, cold, speed, Updates(seconds={"thesis": 41e-6, "adaptive": 90e-6}), Insertions()
        )
    }
    assert found["FSM loop: python-control / Chamfer"] is False
    assert found["FSM loop: bdsim / Chamfer"] is True
    assert found["FSM loop: pathsim / Chamfer"] is None
    assert found["FSM loop: SciPy RK45 per tick / Chamfer"] is True
    assert found["FSM loop: SciPy RK45 per tick / Chamfer, compiled"] is False
    assert found[f"{COMMAND} / {IMPORTS}"] is True
    assert found["planar-slide: simulated / elapsed"] is True
    assert found["adept-nugget-hold: simulated / elapsed"] is False
    assert found["adept-roller-hold: simulated / elapsed"] is None
    assert found["an update of the observer thesis, us"] is False
    assert found["an update of the observer adaptive, us"] is True


@pytest.mark.slow
def test_report_agrees_before_it_times(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(command, "engines", _exact_engines)
    path = tmp_path / "bench.json"
    assert (
        command.main(
            ["--rounds=2", "--cold=0", "--contact=0", "--insertion=none", "--json", str(path)]
        )
        == 0
    )
    text = capsys.readouterr().out
    assert text.index("Agreement: PID") < text.index("Agreement: FSM") < text.index("Times")
    found = json.loads(path.read_text(encoding="utf-8"))
    assert set(found["versions"]) >= {"drake", "scipy", "control", "bdsim", "pathsim"}
    (engine,) = found["loops"]["fsm"]
    assert len(engine["run"]) == 2
    (agreement,) = found["agreement"]["fsm"]
    assert agreement["ok"] is True


@pytest.mark.parametrize("stage", ["engines", "interleave"])
def test_interrupt_prints_what_there_is(
    stage: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "engines", _exact_engines)
    monkeypatch.setattr(command, stage, interrupt)
    assert command.main(["--cold=0", "--contact=0", "--insertion=none"]) == 130
    text = capsys.readouterr().out
    assert "Agreement: PID" in text
    assert "interrupted" in text


@pytest.mark.parametrize("arguments", [["--rounds", "0"], ["--cold", "-1"], ["--rounds", "x"]])
def test_mistakes_are_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        command.main(arguments)
    assert caught.value.code == 2
    assert arguments[0] in capsys.readouterr().err


def test_a_command_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    interpreter = tmp_path / "python"
    interpreter.write_text("#!/bin/sh\necho first >&2\necho no such module >&2\nexit 1\n")
    interpreter.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(interpreter))
    found = ColdStart()
    cold_start.measure(found, rounds=2)
    assert found.failures[COMMAND] == "no such module"
    assert found.median(COMMAND) is None


def test_start_takes_one_thread_but_fresh_processes_do_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "7")
    seen: dict[str, str] = {}

    def main(*, environment: dict[str, str]) -> int:
        seen["here"] = entry.os.environ["OPENBLAS_NUM_THREADS"]
        seen["fresh"] = environment["OPENBLAS_NUM_THREADS"]
        return 0

    monkeypatch.setattr(command, "main", main)
    assert entry.start() == 0
    assert seen == {"here": "1", "fresh": "7"}
