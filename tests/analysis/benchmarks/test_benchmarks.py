"""The benchmark: engines against exact solutions, times in turns, targets and the report."""

import itertools
import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.benchmarks import __main__ as entry
from chamfer.analysis.benchmarks import benchmark_report as report
from chamfer.analysis.benchmarks import peg_benchmark as insertion
from chamfer.analysis.benchmarks import speed
from chamfer.analysis.benchmarks.benchmark_report import (
    ColdStart,
    Findings,
    agreement_text,
    document,
    insertions_text,
    real_time_text,
    summary_text,
    targets,
    times_text,
    updates_text,
)
from chamfer.analysis.benchmarks.engine import (
    Agreement,
    LoopCase,
    LoopEngine,
    LoopName,
    Times,
    agree,
    exact,
    interleave,
    make_case,
    median,
    ratio,
)
from chamfer.analysis.benchmarks.peers import (
    COMPILED,
    SOURCES,
    EngineSource,
    how_to_install,
    installed,
)
from chamfer.analysis.benchmarks.peg_benchmark import (
    CHAMFER,
    GRID,
    TABLE,
    Insertions,
    Result,
    cell,
    sure,
)
from chamfer.analysis.benchmarks.speed import COMMAND, IMPORTS, NEWTON
from chamfer.systems.estimation.normal_filter import ConstrainedFilter
from chamfer.systems.estimation.surface_observer import KINDS

# Long enough for the whole transient of the PID, and for both increments of the FSM.
CASES: dict[LoopName, LoopCase] = {"pid": make_case(0.1), "fsm": make_case()}
FSM = CASES["fsm"]


def engine(
    name: str = "an engine", run: Callable[[object], np.ndarray] | None = None
) -> LoopEngine:
    run = run or (lambda _: np.zeros(1))
    return LoopEngine(name=name, build=lambda: None, run=run, accuracy=1e-6, note="settings")


@pytest.mark.parametrize("loop", ["pid", "fsm"])
@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.distribution)
def test_engines_agree_with_the_exact_solution(source: EngineSource, loop: LoopName) -> None:
    pytest.importorskip(source.requires)
    assert source.make is not None
    for one in source.make(CASES[loop], loop):
        agreement = agree(one, CASES[loop], loop, exact(CASES[loop], loop))
        assert agreement.ok, agreement


def test_exact_solutions_end_where_theory_says() -> None:
    output = exact(FSM, "fsm")
    assert output[0] == 0.0
    assert abs(output[-1] - 1.0) < FSM.scenario.fsm.dead_zone
    assert output.max() < 1.005
    integral, stiffness = FSM.gains[1], FSM.mass_damping_stiffness[2]
    assert exact(FSM, "pid")[-1] == pytest.approx(integral / (integral + stiffness), abs=1e-9)


@pytest.mark.parametrize(
    ("error", "increments"),
    [
        (0.0, 0.0),
        (0.0074, 0.0),  # shown as 0.005, inside the dead zone
        (0.0076, 0.2),  # shown as 0.010, on its edge
        (-0.0076, -0.2),
        (0.9, 1.0),
        (-0.9, -1.0),
    ],
)
def test_a_tick_goes_by_what_the_camera_shows(error: float, increments: float) -> None:
    increment, limit = FSM.scenario.fsm.increment, FSM.scenario.fsm.limit
    assert increment is not None
    assert limit is not None
    assert FSM.compensate(0.0, error) == pytest.approx(increments * increment)
    assert FSM.compensate(math.copysign(limit, error), error) == math.copysign(limit, error)


def test_a_difference_beyond_the_promise_and_a_failure_show() -> None:
    solution = exact(FSM, "fsm")

    def agreement(run: Callable[[object], np.ndarray]) -> Agreement:
        return agree(engine(run=run), FSM, "fsm", solution)

    def fail(_: object) -> np.ndarray:
        raise RuntimeError("no\nsuch block")

    for change, ok in ((0.0, True), (1e-7, True), (1e-5, False)):
        found = agreement(lambda _, change=change: solution + change)
        assert found.ok is ok
        assert found.difference == pytest.approx(change, abs=1e-12)
    assert agreement(lambda _: solution * np.nan).failure == "gave a result that is not finite"
    assert agreement(lambda _: solution[1:]).failure == "gave 200 samples instead of 201"
    assert agreement(fail).failure == "RuntimeError: no such block"
    assert not agreement(fail).ok


class Machine:
    """Engines that take as long as they are told, on a clock of their own."""

    def __init__(self) -> None:
        self.now = 0.0
        self.order = ""

    def engine(self, name: str, seconds: float, *, interrupt_at: int | None = None) -> LoopEngine:
        count = itertools.count()

        def build() -> None:
            self.now += 0.25

        def run(_: object) -> np.ndarray:
            if next(count) == interrupt_at:
                raise KeyboardInterrupt
            self.order += name
            self.now += seconds
            return np.zeros(1)

        return replace(engine(name, run), build=build)

    def times(self, *engines: LoopEngine, rounds: int, share: float = 100.0) -> dict[str, Times]:
        times: dict[str, Times] = {}
        try:
            interleave(engines, times, rounds=rounds, share=share, clock=lambda: self.now)
        except KeyboardInterrupt:
            self.order += "!"
        return times


def test_engines_take_turns_for_as_long_as_their_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gc.collect", lambda: 0)
    machine = Machine()
    times = machine.times(*(machine.engine(name, 1.0) for name in "abc"), rounds=4)
    assert machine.order == "abcbcacababc"
    assert times["a"].building == [0.25] * 4
    assert times["a"].running == [1.0] * 4
    slow = machine.times(machine.engine("a", 0.75), machine.engine("b", 3.75), rounds=6, share=9.0)
    assert (slow["a"].rounds, slow["b"].rounds) == (6, 2)
    assert machine.times(machine.engine("a", 50.0), rounds=3, share=1.0)["a"].rounds == 1
    cut = machine.times(
        machine.engine("a", 1.0), machine.engine("b", 1.0, interrupt_at=1), rounds=9
    )
    assert machine.order.endswith("!")
    assert (cut["b"].rounds, len(cut["b"].building)) == (1, 1)


def test_medians_and_ratios() -> None:
    times = Times(building=[3.0, 1.0, 2.0], running=[4.0, 100.0, 2.0, 6.0])
    assert (times.build, times.run, times.least) == (2.0, 5.0, 2.0)
    assert Times().run is median([]) is median(None) is None
    assert ratio(10.0, 4.0) == 2.5
    assert ratio(None, 4.0) is ratio(10.0, None) is None


def test_a_factor_is_simulated_over_elapsed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 10.0, 10.5, 20.0, 20.25])  # warming up, then two rounds
    monkeypatch.setattr(speed, "perf_counter", lambda: next(clock))
    loop = speed.loops()["planar-slide"]._replace(duration=0.1)
    found: speed.Rounds = {}
    without = loop._replace(missing=lambda: "no graphics")
    speed.measure_real_time(found, rounds=2, timed={"planar-slide": loop, "no": without})
    assert found == {"planar-slide": [pytest.approx(0.2), pytest.approx(0.4)]}
    assert "| planar-slide |                 0.3 |      2 |" in real_time_text(found)


@pytest.mark.slow
def test_every_kind_of_observer_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    contenders = []
    real, seconds = speed.cost, {}

    def cost(one: speed.Contender, *arguments: object, **options: object) -> float:
        contenders.append(one.filter)
        return real(one, *arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(speed, "cost", cost)
    speed.measure_updates(seconds, updates=1)
    assert list(seconds) == [*KINDS, NEWTON]
    assert all(1e-7 < one < 1.0 for one in seconds.values())
    newton, thesis = contenders[-1], contenders[KINDS.index("thesis")]
    assert isinstance(newton, ConstrainedFilter)
    assert (newton._params.solver, thesis._params.solver) == ("newton", "closed_form")
    assert newton._params.gated == thesis._params.gated


def test_a_process_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    interpreter = tmp_path / "python"
    interpreter.write_text("#!/bin/sh\necho first >&2\necho no such module >&2\nexit 1\n")
    interpreter.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(interpreter))
    found = ColdStart()
    speed.measure_cold_start(found.times, found.failures, rounds=2)
    assert found.failures[COMMAND] == "no such module"
    assert found.times == {}


def test_cells_are_of_the_reference_s_part() -> None:
    assert len(GRID) == 12
    scenario = cell(1.0, 5.0)
    assert scenario.support.lateral_stiffness == pytest.approx(521.7, abs=0.1)
    assert (scenario.lateral, scenario.tilt) == (0.001, math.radians(5.0))
    assert scenario.parts.peg_chamfer.width == 0.0
    assert scenario.parts.hole_chamfer.width == 0.001


@pytest.mark.slow
def test_insertions_are_judged_by_statics(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(insertion, "engines", lambda: {CHAMFER: insertion.predict})
    found = Insertions()
    insertion.measure_cells(found, TABLE)
    assert [sure(found, one) for one in TABLE] == [True, True, True, False, True]
    assert [found.predicted[one].seated for one in TABLE] == [True, True, True, False, False]
    assert insertion.agreement(found, CHAMFER) == 100.0
    onset, force = insertion.worst_onset(found, CHAMFER), insertion.worst_force(found, CHAMFER)
    assert onset is not None
    assert onset < 0.06  # of the closed form from the exact one
    assert force == pytest.approx(0.0)
    assert insertion.agreement(found, "nobody") is insertion.worst_onset(found, "nobody") is None

    findings = Findings(insertions=found)
    text = insertions_text(found)
    assert len(text.splitlines()) == 2 + 2 + len(TABLE)
    assert "| seated  |     4.48 |" in text
    assert document(findings)["insertions"]["statics"][-1]["force"] is None  # nothing slides it
    asked = [one.ok for one in targets(findings) if one.text.startswith("insertions:")]
    assert asked == [True] * 3

    wrong = found.results[CHAMFER]
    wrong[0.0, 5.0] = Result(False, 0.0048, 9.16, 1.0)
    wrong[0.0, 7.0] = Result(True, None, 20.0, 1.0)  # where nobody is sure
    assert insertion.agreement(found, CHAMFER) == 75.0
    assert insertion.worst_onset(found, CHAMFER) == pytest.approx(0.3, abs=0.005)
    assert insertion.worst_force(found, CHAMFER) == pytest.approx(9.9, abs=0.1)


def test_a_missing_peer_is_named_with_what_installs_it() -> None:
    absent = EngineSource(requires="no_such_package", distribution="absent", extra="bench")
    assert installed((*SOURCES[:1], absent)) == ([SOURCES[0]], [absent])
    line = how_to_install(absent)
    assert line == "absent is not installed and left out: pip install '.[bench]'"
    assert line in summary_text(Findings(missing=[absent]))
    assert document(Findings(missing=[absent]))["missing"] == [line]


def test_tables_are_aligned_and_ratios_are_to_the_first_engine() -> None:
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
    times = {"Chamfer": Times(running=[0.010]), "peer": Times(trials=10, running=[0.25])}
    text = times_text("fsm", [engine("Chamfer"), engine("peer"), engine("not run")], times)
    rows = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()[4:]]
    assert [row[6] for row in rows] == ["1", "2.5", "-"]
    assert [row[5] for row in rows] == ["1", "1", "0"]


def test_targets_are_met_missed_or_not_measured() -> None:
    found = Findings(
        times={
            "fsm": {
                "Chamfer": Times(running=[1.0]),
                COMPILED: Times(trials=1000, running=[25.0]),
                "SciPy RK45 per tick": Times(running=[2.4]),
                "python-control": Times(running=[0.9]),
                "bdsim": Times(running=[80.0]),
            }
        },
        cold=ColdStart(times={IMPORTS: [1.0], COMMAND: [1.5]}),
        real_time={"planar-slide": [9.0, 12.0, 11.0], "adept-nugget-hold": [2.0]},
        updates={"thesis": 41e-6, "adaptive": 90e-6},
    )
    asked = {target.text: target.ok for target in targets(found)}
    expected = {
        "FSM loop: python-control / Chamfer": False,
        "FSM loop: bdsim / Chamfer": True,
        "FSM loop: pathsim / Chamfer": None,
        "FSM loop: SciPy RK45 per tick / Chamfer": True,
        f"FSM loop: SciPy RK45 per tick / {COMPILED}": False,
        f"FSM loop: {COMPILED}, s for 10,000 trials on one core": False,
        f"{COMMAND} / {IMPORTS}": True,
        "planar-slide: simulated / elapsed": True,
        "adept-nugget-hold: simulated / elapsed": False,
        "adept-roller-hold: simulated / elapsed": None,
        "an update of the observer thesis, us": False,
        "an update of the observer adaptive, us": True,
    }
    assert {text: asked[text] for text in expected} == expected
    assert "| 90 |        2.20 |" in updates_text(found.updates)
    assert set(speed.UPDATES) <= {*KINDS, NEWTON}
    assert set(speed.REAL_TIME) <= set(speed.loops())


def exact_engines(_sources: object, case: LoopCase, loop: LoopName) -> list[LoopEngine]:
    output = exact(case, loop)
    return [engine("Chamfer", lambda _: output)]


def test_the_report_agrees_before_it_times(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(report, "engines", exact_engines)
    path = tmp_path / "bench.json"
    short = ["--rounds=2", "--cold=0", "--contact=0", "--insertion=none"]
    assert report.main([*short, "--json", str(path)]) == 0
    text = capsys.readouterr().out
    assert text.index("Agreement: PID") < text.index("Agreement: FSM") < text.index("Times")
    found = json.loads(path.read_text(encoding="utf-8"))
    assert set(found["versions"]) >= {"drake", "scipy", "control", "bdsim", "pathsim"}
    (timed,) = found["loops"]["fsm"]
    assert len(timed["run"]) == 2
    (agreement,) = found["agreement"]["fsm"]
    assert agreement["ok"] is True


@pytest.mark.parametrize("stage", ["engines", "interleave"])
def test_an_interrupt_prints_what_there_is(
    stage: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(report, "engines", exact_engines)
    monkeypatch.setattr(report, stage, interrupt)
    assert report.main(["--cold=0", "--contact=0", "--insertion=none"]) == 130
    text = capsys.readouterr().out
    assert "Agreement: PID" in text
    assert "interrupted" in text


@pytest.mark.parametrize("arguments", [["--rounds", "0"], ["--cold", "-1"], ["--rounds", "x"]])
def test_mistakes_are_refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        report.main(arguments)
    assert caught.value.code == 2
    assert arguments[0] in capsys.readouterr().err


def test_one_thread_here_and_not_in_fresh_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "7")
    seen: dict[str, str] = {}

    def main(*, environment: dict[str, str]) -> int:
        seen["here"] = entry.os.environ["OPENBLAS_NUM_THREADS"]
        seen["fresh"] = environment["OPENBLAS_NUM_THREADS"]
        return 0

    monkeypatch.setattr(report, "main", main)
    assert entry.start() == 0
    assert seen == {"here": "1", "fresh": "7"}
