"""The benchmark: engines against exact solutions, times in turns, targets and the report."""

import itertools
import json
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.benchmarks import benchmark_report as report
from chamfer.analysis.benchmarks import peers, scaling, speed
from chamfer.analysis.benchmarks import peg_benchmark as insertion
from chamfer.analysis.benchmarks.benchmark_report import (
    Findings,
    agreement,
    document,
    insertions,
    report_text,
    targets,
    times,
)
from chamfer.analysis.benchmarks.engine import (
    LoopCase,
    LoopEngine,
    LoopName,
    agree,
    exact,
    interleave,
)
from chamfer.analysis.benchmarks.peers import COMPILED, EXTRA, PEERS, missing
from chamfer.analysis.benchmarks.peg_benchmark import CHAMFER, STATICS, TABLE, Result, sure
from chamfer.analysis.benchmarks.profile import label, stages
from chamfer.analysis.benchmarks.speed import COMMAND, IMPORTS, NEWTON
from chamfer.analysis.scenario.experiment import quiet
from chamfer.models import compiled
from chamfer.systems.estimation.normal_filter import KINDS, ConstrainedFilter

# Long enough for the whole transient of the PID, and for both increments of the FSM.
CASES: dict[LoopName, LoopCase] = {"pid": LoopCase("pid", 0.1), "fsm": LoopCase("fsm")}
FSM = CASES["fsm"]


def engine(
    name: str = "an engine",
    run: Callable[[object], np.ndarray] = lambda _: np.zeros(1),
    **found: object,
) -> LoopEngine:
    return LoopEngine(name=name, run=run, accuracy=1e-6, note="settings", **found)


@pytest.mark.parametrize("loop", ["pid", "fsm"])
@pytest.mark.parametrize("peer", PEERS)
def test_engines_agree_with_the_exact_solution(
    peer: Callable[[LoopCase], Iterator[LoopEngine]], loop: LoopName
) -> None:
    if peer.__name__ in missing():
        pytest.skip(f"{peer.__name__} is not installed")
    for one in peer(CASES[loop]):
        agree(one, CASES[loop], exact(CASES[loop]))
        assert one.ok, one


def test_exact_solutions_end_where_theory_says() -> None:
    output = exact(FSM)
    assert output[0] == 0.0
    assert abs(output[-1] - 1.0) < FSM.scenario.fsm.dead_zone
    assert output.max() < 1.005
    integral, stiffness = FSM.gains[1], FSM.mass_damping_stiffness[2]
    expected = pytest.approx(integral / (integral + stiffness), abs=1e-9)
    assert exact(LoopCase("pid"))[-1] == expected


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
    solution = exact(FSM)

    def agreed(run: Callable[[object], np.ndarray]) -> LoopEngine:
        one = engine(run=run)
        agree(one, FSM, solution)
        return one

    def fail(_: object) -> np.ndarray:
        raise RuntimeError("no\nsuch block")

    for change, ok in ((0.0, True), (1e-7, True), (1e-5, False)):
        found = agreed(lambda _, change=change: solution + change)
        assert found.ok is ok
        assert found.difference == pytest.approx(change, abs=1e-12)
    assert agreed(lambda _: solution * np.nan).failure == "gave a result that is not finite"
    assert agreed(lambda _: solution[1:]).failure == "gave 200 samples instead of 201"
    assert agreed(fail).failure == "RuntimeError: no such block"
    assert not agreed(fail).ok


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

        return engine(name, run, build=build)

    def time(self, *engines: LoopEngine, rounds: int, share: float = 100.0) -> list[int]:
        try:
            interleave(engines, rounds=rounds, share=share, clock=lambda: self.now)
        except KeyboardInterrupt:
            self.order += "!"
        return [len(one.running) for one in engines]


def test_engines_take_turns_for_as_long_as_their_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gc.collect", lambda: 0)
    machine = Machine()
    a, b, c = (machine.engine(name, 1.0) for name in "abc")
    b.trials = 4
    machine.time(a, b, c, rounds=4)
    assert machine.order == "abcbcacababc"
    assert (a.building, a.running, b.running) == ([0.25] * 4, [1.0] * 4, [0.25] * 4)
    slow = machine.engine("b", 3.75)
    slow.trials = 10
    assert machine.time(machine.engine("a", 0.75), slow, rounds=6, share=9.0) == [6, 2]
    assert machine.time(machine.engine("a", 50.0), rounds=3, share=1.0) == [1]
    cut = machine.engine("b", 1.0, interrupt_at=1)
    machine.time(machine.engine("a", 1.0), cut, rounds=9)
    assert machine.order.endswith("!")
    assert (len(cut.running), len(cut.building)) == (1, 1)


def test_a_factor_is_simulated_over_elapsed(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 1.0, 10.0, 10.5, 20.0, 20.25])  # warming up, then two rounds
    monkeypatch.setattr(speed, "perf_counter", lambda: next(clock))
    loop = speed.loops()["planar-slide"]._replace(duration=0.1)
    found: speed.Rounds = {}
    without = loop._replace(missing=lambda: "no graphics")
    speed.measure_real_time(found, rounds=2, timed={"planar-slide": loop, "no": without})
    assert found == {"planar-slide": [pytest.approx(0.2), pytest.approx(0.4)]}


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
    assert all(1e-7 < one < 60.0 for one in seconds.values())
    newton, thesis = contenders[-1], contenders[KINDS.index("thesis")]
    assert isinstance(newton, ConstrainedFilter)
    assert (newton._solver, thesis._solver) == ("newton", "closed_form")
    assert newton._params == thesis._params


def test_a_process_that_fails_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    interpreter = tmp_path / "python"
    interpreter.write_text('#!/bin/sh\necho first >&2\necho "$OMP_NUM_THREADS." >&2\nexit 1\n')
    interpreter.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(interpreter))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # not in fresh processes
    times: speed.Rounds = {}
    failures: dict[str, str] = {}
    speed.measure_cold_start(times, failures, rounds=2)
    assert failures[COMMAND] == "."
    assert times == {}


@pytest.mark.slow
def test_insertions_are_judged_by_statics(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(insertion, "insert_in_drake", insertion.predict)
    monkeypatch.setattr(insertion, "missing", lambda: ["fullseye"])
    found: insertion.Insertions = {}
    assert math.isnan(insertion.agreement(found) + insertion.worst_onset(found))
    insertion.measure_cells(found, TABLE)
    assert [sure(one) for one in TABLE] == [True, True, True, False, True]
    assert [of.seated for of in found[STATICS].values()] == [True, True, True, False, False]
    assert insertion.agreement(found) == 100.0
    assert insertion.worst_onset(found) < 0.06  # of the closed form from the exact one
    assert insertion.worst_force(found) == pytest.approx(0.0)

    row = insertions(found).documents()[-1]
    assert (row["degrees"], row["sure"], row["statics"]) == (9.0, "yes", "stopped")
    assert row["statics: N"] is None  # nothing slides it
    findings = Findings(insertions=found)
    asked = [one.ok for one in targets(findings) if one.text.startswith("insertions:")]
    assert asked == [True] * 3 + [None]

    wrong = found[CHAMFER]
    wrong[0.0, 5.0] = Result(False, 0.0048, 9.16, 1.0)
    wrong[0.0, 7.0] = Result(True, math.nan, 20.0, 1.0)  # where nobody is sure
    assert insertion.agreement(found) == 75.0
    assert insertion.worst_onset(found) == pytest.approx(0.3, abs=0.005)
    assert insertion.worst_force(found) == pytest.approx(9.9, abs=0.1)
    found[insertion.PEER] = {(0.0, 5.0): Result(True, 0.0, 0.0, 2.0)}
    assert insertion.slowest(found) == 0.5


def test_a_missing_peer_is_left_out_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peers, "version", lambda name: "1" if name not in EXTRA else no(name))

    def no(name: str) -> str:
        raise peers.PackageNotFoundError(name)

    assert missing() == [*EXTRA]
    assert peers.engines(FSM)[-1].name == "python-control"
    assert "pathsim is not installed and left out: pip install '.[bench]'" in report_text(
        Findings()
    )
    assert document(Findings())["missing"] == [*EXTRA]


def test_tables_say_what_differs_and_ratios_are_to_the_first_engine() -> None:
    agreements = [
        engine("Chamfer", difference=1e-12, rise_time=0.1),
        engine("a longer name", failure="RuntimeError: no"),
        engine("other", difference=1.0),
    ]
    lines = agreement("fsm", agreements).text().splitlines()
    assert lines[3].split() == ["Chamfer", "1e-12", "1e-6", "-", "0.1", "ok"]
    assert [line.split()[-1] for line in lines[4:]] == ["no", "DIFFERS"]
    timed = [engine("Chamfer", running=[0.010]), engine("peer", running=[0.025]), engine("none")]
    rows = times("fsm", timed).documents()
    assert [(row["rounds"], row["ratio"]) for row in rows] == [(1, 1.0), (1, 2.5), (0, None)]
    assert rows[1]["running s"] == [0.025]


def test_targets_are_met_missed_or_not_measured() -> None:
    run = {"Chamfer": [1.0], COMPILED: [0.025], "SciPy RK45 per tick": [2.4], "pathsim": []}
    run |= {"Drake as it comes": [0.9], "python-control": [0.9], "bdsim": [80.0]}
    found = Findings(
        loops={"fsm": [engine(name, running=running) for name, running in run.items()]},
        cold={IMPORTS: [1.0], COMMAND: [1.5]},
        real_time={"planar-slide": [9.0, 90.0, 61.0], "adept-nugget-hold": [2.0]},
        updates={"thesis": 41e-6, "adaptive": 90e-6},
    )
    asked = {target.text: target.ok for target in targets(found)}
    expected = {
        "FSM loop: SciPy RK45 per tick / Chamfer": True,
        "FSM loop: pathsim / Chamfer": None,
        "FSM loop: python-control / Chamfer": False,
        "FSM loop: bdsim / Chamfer": True,
        f"FSM loop: SciPy RK45 per tick / {COMPILED}": False,
        f"FSM loop: {COMPILED}, s for 10,000 trials on one core": False,
        f"{COMMAND} / {IMPORTS}": True,
        f"{COMMAND}, s in a fresh process": True,
        "planar-slide: simulated / elapsed": True,
        "adept-nugget-hold: simulated / elapsed": False,
        "adept-roller-hold: simulated / elapsed": None,
        "an update of the observer thesis, us": False,
        "an update of the observer adaptive, us": True,
    }
    assert {text: asked[text] for text in expected} == expected
    assert [text for text in asked if text.startswith("FSM")] == list(expected)[:6]
    words = " ".join(report_text(found).split())
    assert "planar-slide 61 3" in words
    assert "adaptive 90 2.195" in words
    assert set(speed.UPDATES) <= {*KINDS, NEWTON}
    assert set(speed.REAL_TIME) <= set(speed.loops())


def exact_engines(case: LoopCase) -> list[LoopEngine]:
    output = exact(case)
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
    (agreed,), *_, (timed,), (first, *_) = (rows for rows in found["tables"].values() if rows)
    assert agreed[""] == "ok"
    assert len(timed["running s"]) == 2
    assert first["target"] == ">= 100"


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


def test_a_profile_shares_time_among_stages_and_names_machine_code() -> None:
    run, make, step = ("a.py", 1, "run"), ("a.py", 9, "make_loop"), ("a.py", 20, "calc")
    advance = ("~", 0, "<built-in method pydrake.systems.analysis.AdvanceTo>")
    numba = (compiled.__file__, 1, "inverse")
    callers = {run: {}, make: {run: 1.0}, advance: {run: 5.0}, numba: {run: 2.0}}
    callers[step] = {advance: 1.0, make: 3.0}
    found = {
        one: (1, 1, 1.0, 1.0, {by: (1, 1, cost, cost) for by, cost in of.items()})
        for one, of in callers.items()
    }
    shares = stages(found)
    assert shares[step]["simulation"] == 0.25
    assert shares[step]["building and resolving"] == 0.75
    assert shares[numba]["simulation"] == 1.0  # a compiled loop
    assert label(numba) == "compiled.inverse (Numba)"


def test_costs_grow_with_the_power_that_is_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "_cost", lambda make, size, scenario: float(size) ** 1.5)
    metrics = scaling.run(scaling.SCALING, 0, quiet).metrics
    slopes = [one for name, one in metrics.items() if name.endswith("slope")]
    assert [one.value for one in slopes] == pytest.approx([1.5] * 4)
    assert slopes[0].note == "+- 0.00, the 95 % interval"
