"""The benchmark's findings: targets, tables and a document; and its command line.

Targets are ratios that do not depend on the machine. Results are compared before any time is
taken; what is timed is the way from a built model to the arrays of results.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.benchmarks import peg_benchmark as insertion
from chamfer.analysis.benchmarks import speed
from chamfer.analysis.benchmarks.engine import (
    LoopCase,
    LoopEngine,
    LoopName,
    agree,
    exact,
    interleave,
    median,
    ratio,
)
from chamfer.analysis.benchmarks.peers import (
    CHAMFER,
    COMPILED,
    DRAKE,
    PER_TICK,
    engines,
    missing,
    versions,
)
from chamfer.analysis.benchmarks.speed import COMMAND, IMPORTS, Rounds
from chamfer.analysis.report.atomic_write import write_text
from chamfer.analysis.report.console import table
from chamfer.analysis.report.results import json_text

_TITLES: Final[dict[LoopName, str]] = {
    "pid": "PID loop, step of 1 m, 2.5 s, output every 1 ms",
    "fsm": "FSM loop, step of 1 m, 2.5 s, output at the ticks, 80 Hz",
}
_INTERRUPTED: Final = 130  # exit status


@dataclass
class Findings:
    """Everything that has been found so far."""

    loops: dict[LoopName, list[LoopEngine]] = field(default_factory=dict)
    cold: Rounds = field(default_factory=dict)  # s, of fresh processes by what they did
    cold_failures: dict[str, str] = field(default_factory=dict)  # why the others failed
    real_time: Rounds = field(default_factory=dict)  # simulated over elapsed seconds
    updates: dict[str, float] = field(default_factory=dict)  # s, least, by observer
    insertions: insertion.Insertions = field(default_factory=dict)
    interrupted: bool = False


@dataclass(frozen=True)
class Target:
    """A ratio of two times, or a distance from statics, and the bound on it."""

    text: str
    relation: str  # >= or <=
    bound: float
    measured: float | None  # None: not measured

    @property
    def ok(self) -> bool | None:
        """Whether the bound is kept; None if it was not measured."""
        if self.measured is None:
            return None
        return (
            self.measured >= self.bound if self.relation == ">=" else self.measured <= self.bound
        )


def targets(found: Findings) -> Iterator[Target]:
    """Yield the targets with what was measured: to be ahead of every peer, and by how much."""
    runs = {
        (loop, one.name): median(one.running) for loop, of in found.loops.items() for one in of
    }
    for (loop, name), run in runs.items():
        # Drake as it comes is no peer of the FSM loop: it runs the same compensator.
        if name not in (CHAMFER, COMPILED) and (loop, name) != ("fsm", DRAKE):
            times_faster = ratio(run, runs.get((loop, CHAMFER)))
            yield Target(f"{loop.upper()} loop: {name} / {CHAMFER}", ">=", 1.0, times_faster)
    trial = runs.get(("fsm", COMPILED))
    times_faster = ratio(runs.get(("fsm", PER_TICK)), trial)
    yield Target(f"FSM loop: {PER_TICK} / {COMPILED}", ">=", 100.0, times_faster)
    many = None if trial is None else 1e4 * trial
    yield Target(f"FSM loop: {COMPILED}, s for 10,000 trials on one core", "<=", 20.0, many)
    start = ratio(median(found.cold.get(COMMAND)), median(found.cold.get(IMPORTS)))
    yield Target(f"{COMMAND} / {IMPORTS}", "<=", 2.0, start)
    for name, bound in speed.REAL_TIME.items():
        factor = median(found.real_time.get(name))
        yield Target(f"{name}: simulated / elapsed", ">=", bound, factor)
    for name, bound in speed.UPDATES.items():
        update = 1e6 * found.updates[name] if name in found.updates else None
        yield Target(f"an update of the observer {name}, us", "<=", bound, update)
    for text, relation, bound, judge in (
        ("outcome as exact statics say where they are sure, %", ">=", 100.0, insertion.agreement),
        ("onset from Whitney's closed form, mm", "<=", 0.1, insertion.worst_onset),
        ("peak from exact statics at 3 to 5 degrees, %", "<=", 6.0, insertion.worst_force),
    ):
        yield Target(f"insertions: {text}", relation, bound, judge(found.insertions))


def agreement_text(loop: LoopName, compared: Sequence[LoopEngine]) -> str:
    """Return the table of a loop's results against the exact solution."""
    rows = [
        (
            one.name,
            _number(one.difference, "{:.1e}"),
            f"{one.accuracy:.0e}",
            _number(one.steady_state_error, "{:.6f}"),
            _number(one.rise_time, "{:.6f}"),
            one.failure or ("ok" if one.ok else "DIFFERS"),
        )
        for one in compared
    ]
    header = ("engine", "largest difference m", "promised m", "final error m", "rise time s", "")
    return _titled(f"Agreement: {_TITLES[loop]}", header, rows, right=(1, 2, 3, 4))


def times_text(loop: LoopName, compared: Sequence[LoopEngine]) -> str:
    """Return the table of a loop's times; ratios are to the first engine."""
    rows = []
    for one in compared:
        if not one.failure:
            run, least = median(one.running), min(one.running, default=None)
            spent = [_number(t, "{:.3f}", 1e3) for t in (median(one.building), run, least)]
            slower = _number(ratio(run, median(compared[0].running)), "{:.3g}")
            rows.append((one.name, *spent, str(len(one.running)), slower, one.note))
    header = ("engine", "build ms", "run ms", "least ms", "rounds", "ratio", "settings")
    title = f"Times from a built model to arrays, medians: {_TITLES[loop]}"
    return _titled(title, header, rows, right=(1, 2, 3, 4, 5))


def insertions_text(found: insertion.Insertions) -> str:
    """Return the table of the insertions: outcome, onset and peak of each engine, and its cost."""
    rows = []
    for one in found[insertion.STATICS]:
        cells = [f"{one[0]:g}", f"{one[1]:g}", "yes" if insertion.sure(one) else "no"]
        for results in found.values():
            result = results[one]
            cells += [
                "seated" if result.seated else "stopped",
                _number(result.onset, "{:.2f}", 1e3),
                f"{result.force:.2f}",
                f"{1e3 * result.seconds:.0f}",
            ]
        rows.append(cells)
    header = ["mm", "degrees", "sure"]
    for name in found:
        header += [name, "onset mm", "N", "ms"]
    title = "A sprung peg fed into its hole, cap 40 N: seated or stopped"
    return _titled(title, header, rows, right=[k for k in range(len(header)) if k not in (2, 3)])


def summary_text(found: Findings) -> str:
    """Return what comes after the tables: targets, what is missing, versions."""
    rows = [
        (
            target.text,
            f"{target.relation} {target.bound:g}",
            _number(target.measured, "{:.2f}"),
            {True: "met", False: "MISSED", None: "not measured"}[target.ok],
        )
        for target in targets(found)
    ]
    lines = [f"{name} is not installed and left out: pip install '.[bench]'" for name in missing()]
    if found.interrupted:
        lines.append("interrupted: this is what there was")
    lines.append(", ".join(f"{name} {number}" for name, number in versions().items()))
    targeted = _titled("Targets", ("ratio", "target", "measured", ""), rows, right=(2,))
    return "\n\n".join([targeted, "\n".join(lines)])


def report_text(found: Findings) -> str:
    """Return all tables but those of the agreement, and the summary."""
    tables = [times_text(loop, compared) for loop, compared in found.loops.items()]
    if found.cold or found.cold_failures:
        rows = [
            (
                name,
                _number(median(found.cold.get(name)), "{:.2f}"),
                str(len(found.cold.get(name, []))),
                found.cold_failures.get(name, ""),
            )
            for name in dict.fromkeys([*found.cold, *found.cold_failures])
        ]
        header = ("fresh process", "median s", "rounds", "")
        tables.append(_titled("Cold start", header, rows, right=(1, 2)))
    if found.real_time:
        factors = [
            (name, _number(median(of), "{:.1f}"), str(len(of)))
            for name, of in found.real_time.items()
        ]
        columns = ("experiment", "simulated / elapsed", "rounds")
        title = "Loops against real time, medians"
        tables.append(_titled(title, columns, factors, right=(1, 2)))
    if found.updates:
        costs = [
            (name, f"{1e6 * cost:.0f}", f"{cost / found.updates['thesis']:.2f}")
            for name, cost in found.updates.items()
        ]
        title = "Updates of the surface observers, least"
        tables.append(_titled(title, ("observer", "us", "over thesis"), costs, right=(1, 2)))
    if found.insertions:
        tables.append(insertions_text(found.insertions))
    return "\n\n".join([*tables, summary_text(found)])


def document(found: Findings) -> dict[str, Any]:
    """Return everything as a JSON document, times in s."""
    return {
        "versions": versions(),
        "interrupted": found.interrupted,
        "missing": missing(),
        "loops": {
            loop: [_engine_document(one) for one in compared]
            for loop, compared in found.loops.items()
        },
        "cold_start": {"times": found.cold, "failures": found.cold_failures},
        "real_time": {"factors": found.real_time},
        "updates": {"seconds": found.updates},
        "insertions": {
            name: [
                # JSON has no infinity.
                {"lateral_mm": one[0], "tilt_deg": one[1], **result._asdict()}
                | {"force": result.force if math.isfinite(result.force) else None}
                for one, result in of.items()
            ]
            for name, of in found.insertions.items()
        },
        "targets": [{**asdict(target), "ok": target.ok} for target in targets(found)],
    }


def _engine_document(engine: LoopEngine) -> dict[str, Any]:
    plain = {one.name: getattr(engine, one.name) for one in fields(engine)}
    del plain["build"], plain["run"]
    medians = {"build_median": median(engine.building), "run_median": median(engine.running)}
    return {**plain, "ok": engine.ok, **medians}


def _number(value: float | None, form: str, scale: float = 1.0) -> str:
    return "-" if value is None else form.format(scale * value)


def _titled(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int]
) -> str:
    return "\n".join([title, "", *table([header, *rows], right)])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the benchmark, print the report and return the exit status."""
    arguments = _arguments(argv)
    found = Findings()
    try:
        _measure_loops(found, rounds=arguments.rounds, share=arguments.share)
        if arguments.contact:
            speed.measure_real_time(found.real_time, rounds=arguments.contact)
            speed.measure_updates(found.updates)
        if arguments.insertion != "none":
            insertion.measure_cells(found.insertions, insertion.CELLS[arguments.insertion])
        if arguments.cold:
            speed.measure_cold_start(found.cold, found.cold_failures, rounds=arguments.cold)
    except KeyboardInterrupt:
        found.interrupted = True
    print(report_text(found))
    if arguments.json is not None:
        write_text(arguments.json, json_text(document(found)))
    return _INTERRUPTED if found.interrupted else 0


def _measure_loops(found: Findings, *, rounds: int, share: float) -> None:
    for loop in _TITLES:
        case = LoopCase(loop)
        solution = exact(case)
        compared = found.loops[loop] = []
        try:
            for engine in engines(case):
                agree(engine, case, solution)
                compared.append(engine)
        finally:
            print(f"{agreement_text(loop, compared)}\n", flush=True)
    for compared in found.loops.values():
        interleave([one for one in compared if not one.failure], rounds=rounds, share=share)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m chamfer.analysis.benchmarks",
        description="Runs the two loops of the first paper in Chamfer and in other simulators, "
        "in turns, and prints how well they agree and how long they take; and the contact loops "
        "against real time, the surface observers, and the insertion of a sprung peg.",
    )
    counts = {
        "rounds": (1, 15, "of each loop"),
        "cold": (0, 5, "rounds of fresh processes, 0 for none"),
        "contact": (0, 3, "rounds of the contact loops, 0 for none, nor of the observers"),
    }
    for name, (_, default, text) in counts.items():
        said = f"{text} (default: {default})"
        parser.add_argument(f"--{name}", type=int, default=default, metavar="N", help=said)
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
    arguments = parser.parse_args(argv)
    for name, (least, _, _) in counts.items():
        if (value := getattr(arguments, name)) < least:
            parser.error(f"--{name} is {value}, allowed: {least} or more")
    return arguments
