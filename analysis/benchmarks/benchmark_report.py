"""The benchmark's findings: targets, tables and a document; and its command line.

Targets are ratios that do not depend on the machine. Results are compared before any time is
taken; what is timed is the way from a built model to the arrays of results.
"""

import argparse
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final, Literal

from chamfer.analysis.benchmarks import peg_benchmark as insertion
from chamfer.analysis.benchmarks import speed
from chamfer.analysis.benchmarks.engine import (
    Agreement,
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
    EngineSource,
    engines,
    how_to_install,
    installed,
)
from chamfer.analysis.benchmarks.peg_benchmark import Insertions, Result, sure
from chamfer.analysis.benchmarks.speed import COMMAND, IMPORTS, Rounds
from chamfer.analysis.report.atomic_write import write_text
from chamfer.analysis.report.results import json_text

_TITLES: Final[Mapping[LoopName, str]] = {
    "pid": "PID loop, step of 1 m, 2.5 s, output every 1 ms",
    "fsm": "FSM loop, step of 1 m, 2.5 s, output at the ticks, 80 Hz",
}
_REFERENCE: Final = "Chamfer"
_PER_TICK: Final = "SciPy RK45 per tick"
# Drake as it comes is no peer of the FSM loop: it runs the same compensator.
_PEERS: Final[Mapping[LoopName, tuple[str, ...]]] = {
    "fsm": ("python-control", _PER_TICK, "bdsim", "pathsim"),
    "pid": (
        "Drake as it comes",
        "SciPy LSODA, solve_ivp",
        "SciPy LSODA, odeint",
        "python-control",
        "bdsim",
        "pathsim",
    ),
}
_INTERRUPTED: Final = 130  # exit status


@dataclass
class ColdStart:
    """Times, s, of fresh processes by what they did, and why the ones that failed did."""

    times: Rounds = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)


@dataclass
class Findings:
    """Everything that has been found so far."""

    engines: dict[LoopName, list[LoopEngine]] = field(default_factory=dict)
    agreements: dict[LoopName, list[Agreement]] = field(default_factory=dict)
    times: dict[LoopName, dict[str, Times]] = field(default_factory=dict)
    cold: ColdStart = field(default_factory=ColdStart)
    real_time: Rounds = field(default_factory=dict)  # simulated over elapsed seconds
    updates: dict[str, float] = field(default_factory=dict)  # s, least, by observer
    insertions: Insertions = field(default_factory=Insertions)
    missing: list[EngineSource] = field(default_factory=list)
    interrupted: bool = False


@dataclass(frozen=True)
class Target:
    """A ratio of two times, or a distance from statics, and the bound on it."""

    text: str
    relation: Literal["at_least", "at_most"]
    bound: float
    measured: float | None  # None: not measured

    @property
    def ok(self) -> bool | None:
        """Whether the bound is kept; None if it was not measured."""
        if self.measured is None:
            return None
        at_least = self.relation == "at_least"
        return self.measured >= self.bound if at_least else self.measured <= self.bound


def targets(found: Findings) -> list[Target]:
    """Return the targets with what was measured: to be ahead of every peer, and by how much."""

    def run(loop: LoopName, name: str) -> float | None:
        taken = found.times.get(loop, {})
        return taken[name].run if name in taken else None

    def scaled(value: float | None, by: float) -> float | None:
        return None if value is None else by * value

    cold, one = found.cold.times, insertion.CHAMFER
    trial = run("fsm", COMPILED)
    in_time = {name: median(found.real_time.get(name)) for name in speed.REAL_TIME}
    start = ratio(median(cold.get(COMMAND)), median(cold.get(IMPORTS)))
    rows = [
        (
            f"{loop.upper()} loop: {name} / {_REFERENCE}",
            ">=",
            1.0,
            ratio(run(loop, name), run(loop, _REFERENCE)),
        )
        for loop, names in _PEERS.items()
        for name in names
    ]
    times_faster = ratio(run("fsm", _PER_TICK), trial)
    rows += [
        (f"FSM loop: {_PER_TICK} / {COMPILED}", ">=", 100.0, times_faster),
        (f"FSM loop: {COMPILED}, s for 10,000 trials on one core", "<=", 20.0, scaled(trial, 1e4)),
        (f"{COMMAND} / {IMPORTS}", "<=", 2.0, start),
    ]
    rows += [
        (f"{name}: simulated / elapsed", ">=", bound, in_time[name])
        for name, bound in speed.REAL_TIME.items()
    ]
    rows += [
        (
            f"an update of the observer {name}, us",
            "<=",
            1e6 * bound,
            scaled(found.updates.get(name), 1e6),
        )
        for name, bound in speed.UPDATES.items()
    ]
    agrees = insertion.agreement(found.insertions, one)
    onset = insertion.worst_onset(found.insertions, one)
    force = insertion.worst_force(found.insertions, one)
    rows += [
        ("insertions: outcome as exact statics say where they are sure, %", ">=", 100.0, agrees),
        ("insertions: onset from Whitney's closed form, mm", "<=", 0.1, onset),
        ("insertions: peak from exact statics at 3 to 5 degrees, %", "<=", 6.0, force),
    ]
    return [
        Target(text, "at_least" if sign == ">=" else "at_most", bound, measured)
        for text, sign, bound, measured in rows
    ]


def agreement_text(loop: LoopName, agreements: Sequence[Agreement]) -> str:
    """Return the table of a loop's results against the exact solution."""
    rows = [
        (
            found.engine,
            _number(found.difference, "{:.1e}"),
            f"{found.accuracy:.0e}",
            _number(found.steady_state_error, "{:.6f}"),
            _number(found.rise_time, "{:.6f}"),
            found.failure or ("ok" if found.ok else "DIFFERS"),
        )
        for found in agreements
    ]
    header = ("engine", "largest difference m", "promised m", "final error m", "rise time s", "")
    return _titled(f"Agreement: {_TITLES[loop]}", header, rows, right=(1, 2, 3, 4))


def times_text(loop: LoopName, engines: Sequence[LoopEngine], times: Mapping[str, Times]) -> str:
    """Return the table of a loop's times."""
    reference = times[engines[0].name].run if engines and engines[0].name in times else None
    rows = []
    for engine in engines:
        taken = times.get(engine.name, Times())
        spent = [_number(one, "{:.3f}", 1e3) for one in (taken.build, taken.run, taken.least)]
        slower = _number(ratio(taken.run, reference), "{:.3g}")
        rows.append((engine.name, *spent, str(taken.rounds), slower, engine.note))
    header = ("engine", "build ms", "run ms", "least ms", "rounds", "ratio", "settings")
    title = f"Times from a built model to arrays, medians: {_TITLES[loop]}"
    return _titled(title, header, rows, right=(1, 2, 3, 4, 5))


def cold_text(cold: ColdStart) -> str:
    """Return the table of the fresh processes."""
    rows = [
        (
            name,
            _number(median(cold.times.get(name)), "{:.2f}"),
            str(len(cold.times.get(name, []))),
            cold.failures.get(name, ""),
        )
        for name in dict.fromkeys([*cold.times, *cold.failures])
    ]
    return _titled("Cold start", ("fresh process", "median s", "rounds", ""), rows, right=(1, 2))


def real_time_text(real_time: Rounds) -> str:
    """Return the table of the loops in real time."""
    rows = [
        (name, _number(median(factors), "{:.1f}"), str(len(factors)))
        for name, factors in real_time.items()
    ]
    header = ("experiment", "simulated / elapsed", "rounds")
    return _titled("Loops against real time, medians", header, rows, right=(1, 2))


def updates_text(updates: Mapping[str, float]) -> str:
    """Return the table of the observers' updates, and their times over the thesis filter's."""
    thesis = updates["thesis"]
    rows = [(name, f"{1e6 * one:.0f}", f"{one / thesis:.2f}") for name, one in updates.items()]
    header = ("observer", "us", "over thesis")
    return _titled("Updates of the surface observers, least", header, rows, right=(1, 2))


def insertions_text(insertions: Insertions) -> str:
    """Return the table of the insertions: outcome, onset and peak of each engine, and its cost."""
    rows = []
    for one, said in insertions.predicted.items():
        cells = [f"{one[0]:g}", f"{one[1]:g}", "yes" if sure(insertions, one) else "no"]
        for result in (said, *(of[one] for of in insertions.results.values())):
            cells += [
                "seated" if result.seated else "stopped",
                _number(result.onset, "{:.2f}", 1e3),
                f"{result.force:.2f}",
                f"{1e3 * result.seconds:.0f}",
            ]
        rows.append(cells)
    header = ["mm", "degrees", "sure"]
    for name in ("statics", *insertions.results):
        header += [name, "onset mm", "N", "ms"]
    title = "A sprung peg fed into its hole, cap 40 N: seated or stopped"
    return _titled(title, header, rows, right=[k for k in range(len(header)) if k not in (2, 3)])


def summary_text(findings: Findings) -> str:
    """Return what comes after the tables: targets, what is missing, versions."""
    rows = [
        (
            target.text,
            f"{'>=' if target.relation == 'at_least' else '<='} {target.bound:g}",
            _number(target.measured, "{:.2f}"),
            {True: "met", False: "MISSED", None: "not measured"}[target.ok],
        )
        for target in targets(findings)
    ]
    lines = [how_to_install(source) for source in findings.missing]
    if findings.interrupted:
        lines.append("interrupted: this is what there was")
    lines.append(", ".join(f"{name} {found}" for name, found in versions().items()))
    table = _titled("Targets", ("ratio", "target", "measured", ""), rows, right=(2,))
    return "\n\n".join([table, "\n".join(lines)])


def report_text(found: Findings) -> str:
    """Return all tables but those of the agreement, and the summary."""
    tables = [times_text(loop, those, found.times[loop]) for loop, those in found.engines.items()]
    if found.cold.times or found.cold.failures:
        tables.append(cold_text(found.cold))
    if found.real_time:
        tables.append(real_time_text(found.real_time))
    if found.updates:
        tables.append(updates_text(found.updates))
    if found.insertions.predicted:
        tables.append(insertions_text(found.insertions))
    return "\n\n".join([*tables, summary_text(found)])


def document(findings: Findings) -> dict[str, Any]:
    """Return everything as a JSON document, times in s."""
    insertions = findings.insertions
    return {
        "versions": versions(),
        "interrupted": findings.interrupted,
        "missing": [how_to_install(source) for source in findings.missing],
        "loops": {
            loop: [_engine_document(engine, findings.times[loop]) for engine in engines]
            for loop, engines in findings.engines.items()
        },
        "agreement": {
            loop: [{**asdict(found), "ok": found.ok} for found in agreements]
            for loop, agreements in findings.agreements.items()
        },
        "cold_start": asdict(findings.cold),
        "real_time": {"factors": findings.real_time},
        "updates": {"seconds": findings.updates},
        "insertions": {
            name: [
                {"lateral_mm": one[0], "tilt_deg": one[1], **_finite(result)}
                for one, result in of.items()
            ]
            for name, of in {"statics": insertions.predicted, **insertions.results}.items()
        },
        "targets": [{**asdict(target), "ok": target.ok} for target in targets(findings)],
    }


def _finite(result: Result) -> dict[str, Any]:
    """Return a result without infinity, which JSON doesn't have."""
    return {**result._asdict(), "force": result.force if math.isfinite(result.force) else None}


def _engine_document(engine: LoopEngine, times: Mapping[str, Times]) -> dict[str, Any]:
    taken = times.get(engine.name, Times())
    return {
        "engine": engine.name,
        "note": engine.note,
        "build": taken.building,
        "run": taken.running,
        "trials": taken.trials,
        "build_median": taken.build,
        "run_median": taken.run,
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of all engines, missing ones included."""
    found = {"python": platform.python_version()}
    for name in ("drake", "numpy", "scipy", "control", "bdsim", "pathsim", "fullseye", "mujoco"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def _number(value: float | None, form: str, scale: float = 1.0) -> str:
    return "-" if value is None else form.format(scale * value)


def _titled(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int]
) -> str:
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]

    def line(cells: Sequence[str]) -> str:
        aligned = (
            cell.rjust(width) if i in right else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return f"| {' | '.join(aligned)} |"

    rule = [
        "-" * (width - 1) + ":" if i in right else "-" * width for i, width in enumerate(widths)
    ]
    return "\n".join([title, "", line(header), line(rule), *map(line, rows)])


def main(
    argv: Sequence[str] | None = None, *, environment: Mapping[str, str] | None = None
) -> int:
    """Run the benchmark, print the report and return the exit status.

    Args:
        argv: The arguments, those of the process unless given.
        environment: Of the fresh processes, that of this one unless given.
    """
    arguments = _parser().parse_args(argv)
    found = Findings()
    try:
        _measure_loops(found, rounds=arguments.rounds, share=arguments.share)
        if arguments.contact:
            speed.measure_real_time(found.real_time, rounds=arguments.contact)
            speed.measure_updates(found.updates)
        if arguments.insertion != "none":
            insertion.measure_cells(found.insertions, insertion.CELLS[arguments.insertion])
            found.missing += installed([insertion.SOURCE])[1]
        if arguments.cold:
            cold = found.cold
            speed.measure_cold_start(
                cold.times, cold.failures, rounds=arguments.cold, environment=environment
            )
    except KeyboardInterrupt:
        found.interrupted = True
    print(report_text(found))
    if arguments.json is not None:
        write_text(arguments.json, json_text(document(found)))
    return _INTERRUPTED if found.interrupted else 0


def _measure_loops(findings: Findings, *, rounds: int, share: float) -> None:
    case = make_case()
    present, findings.missing = installed()
    for loop in _TITLES:
        solution = exact(case, loop)
        agreements = findings.agreements[loop] = []
        compared = findings.engines[loop] = []
        findings.times[loop] = {}
        try:
            for engine in engines(present, case, loop):
                agreements.append(agree(engine, case, loop, solution))
                if not agreements[-1].failure:
                    compared.append(engine)
        finally:
            print(f"{agreement_text(loop, agreements)}\n", flush=True)
    for loop in _TITLES:
        interleave(findings.engines[loop], findings.times[loop], rounds=rounds, share=share)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m chamfer.analysis.benchmarks",
        description="Runs the two loops of the first paper in Chamfer and in other simulators, "
        "in turns, and prints how well they agree and how long they take; and the contact loops "
        "against real time, the surface observers, and the insertion of a sprung peg.",
    )
    counts = {
        "--rounds": (1, 15, "of each loop"),
        "--cold": (0, 5, "rounds of fresh processes, 0 for none"),
        "--contact": (0, 3, "rounds of the contact loops, 0 for none, nor of the observers"),
    }
    for name, (least, default, text) in counts.items():
        said = f"{text} (default: {default})"
        parser.add_argument(name, type=_AtLeast(least), default=default, metavar="N", help=said)
    parser.add_argument(
        "--share",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="of an engine per loop, after which it sits the rest out (default: 10)",
    )
    parser.add_argument(
        "--insertion",
        choices=("none", *insertion.CELLS),
        default="all",
        help="cells of the insertion: the reference's five, or a grid too (default: all)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the report as JSON too")
    return parser


@dataclass(frozen=True)
class _AtLeast:
    """A whole number from ``least`` on, as an argument of the command line."""

    least: int

    def __call__(self, text: str) -> int:
        value = int(text)
        if value < self.least:
            raise argparse.ArgumentTypeError(f"is {text}, allowed: {self.least} or more")
        return value

    def __repr__(self) -> str:
        return "whole number"
