"""The benchmark's findings: targets, tables, a document and the command line.

Targets are ratios that do not depend on the machine. Results are compared before any time is
taken. The timed part is from a built model to the arrays of results.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

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
from chamfer.analysis.report.check_text import number
from chamfer.analysis.report.console import table
from chamfer.analysis.report.results import json_text

_TITLES: Final[dict[LoopName, str]] = {
    "pid": "PID loop, step of 1 m, 2.5 s, output every 1 ms",
    "fsm": "FSM loop, step of 1 m, 2.5 s, output at the ticks, 80 Hz",
}
_INTERRUPTED: Final = 130  # exit status


@dataclass
class Findings:
    """All findings of the benchmark so far."""

    loops: dict[LoopName, list[LoopEngine]] = field(default_factory=dict)
    cold: Rounds = field(default_factory=dict)  # s, of fresh processes by what they did
    cold_failures: dict[str, str] = field(default_factory=dict)  # why the others failed
    real_time: Rounds = field(default_factory=dict)  # simulated over elapsed seconds
    updates: dict[str, float] = field(default_factory=dict)  # s, least, by observer
    insertions: insertion.Insertions = field(default_factory=dict)
    interrupted: bool = False


class Table(NamedTuple):
    """A table of findings: numbers, texts, and lists that are in the document alone."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]

    def text(self) -> str:
        """Return it for a terminal."""
        rows = [list(row.values()) for row in self.documents()]
        lists, texts = (
            {i for row in rows for i, cell in enumerate(row) if isinstance(cell, kind)}
            for kind in (list, str)
        )
        shown = [i for i in range(len(self.columns)) if i not in lists]
        cells = [
            [row[i] if isinstance(row[i], str) else number(row[i]) for i in shown]
            for row in (self.columns, *rows)
        ]
        right = [place for place, i in enumerate(shown) if i not in texts]
        return "\n".join([self.title, "", *table(cells, right)])

    def documents(self) -> list[dict[str, Any]]:
        """Return the rows as JSON has them, null for what is not finite."""

        def known(cell: Any) -> Any:
            return None if isinstance(cell, float) and not math.isfinite(cell) else cell

        return [dict(zip(self.columns, map(known, row), strict=True)) for row in self.rows]


class Target(NamedTuple):
    """A ratio of two times, or a distance from statics, and the bound on it."""

    text: str
    relation: str  # >= or <=
    bound: float
    measured: float  # NaN: not measured

    @property
    def ok(self) -> bool | None:
        """Whether the bound is kept; None if it was not measured."""
        if math.isnan(self.measured):
            return None
        return (
            self.measured >= self.bound if self.relation == ">=" else self.measured <= self.bound
        )


def targets(found: Findings) -> Iterator[Target]:
    """Yield the targets with their measurements: ahead of every peer, and by how much."""
    runs: defaultdict[tuple[str, str], float] = defaultdict(lambda: math.nan)
    runs |= {
        (loop, one.name): median(one.running) for loop, of in found.loops.items() for one in of
    }
    for (loop, name), run in list(runs.items()):
        # Drake as it comes is no peer of the FSM loop: it runs the same compensator.
        if name not in (CHAMFER, COMPILED) and (loop, name) != ("fsm", DRAKE):
            slower = run / runs[loop, CHAMFER]
            yield Target(f"{loop.upper()} loop: {name} / {CHAMFER}", ">=", 1.0, slower)
    trial = runs["fsm", COMPILED]
    slower = runs["fsm", PER_TICK] / trial
    yield Target(f"FSM loop: {PER_TICK} / {COMPILED}", ">=", 100.0, slower)
    text = f"FSM loop: {COMPILED}, s for 10,000 trials on one core"
    yield Target(text, "<=", 20.0, 1e4 * trial)
    command, imports = (median(found.cold.get(name, ())) for name in (COMMAND, IMPORTS))
    yield Target(f"{COMMAND} / {IMPORTS}", "<=", 2.0, command / imports)
    yield Target(f"{COMMAND}, s in a fresh process", "<=", 2.0, command)
    for name, bound in speed.REAL_TIME.items():
        factor = median(found.real_time.get(name, ()))
        yield Target(f"{name}: simulated / elapsed", ">=", bound, factor)
    for name, bound in speed.UPDATES.items():
        update = 1e6 * found.updates.get(name, math.nan)
        yield Target(f"an update of the observer {name}, us", "<=", bound, update)
    for text, relation, bound, judge in (
        ("outcome as exact statics say where they are sure, %", ">=", 100.0, insertion.agreement),
        ("onset from Whitney's closed form, mm", "<=", 0.1, insertion.worst_onset),
        ("peak from exact statics at 3 to 5 degrees, %", "<=", 6.0, insertion.worst_force),
        ("of MuJoCo's time, in the slowest cell", "<=", 1.0, insertion.slowest),
    ):
        yield Target(f"insertions: {text}", relation, bound, judge(found.insertions))


def agreement(loop: LoopName, compared: Sequence[LoopEngine]) -> Table:
    """Return a loop's results against the exact solution."""
    columns = ("engine", "largest difference m", "promised m", "final error m", "rise time s", "")
    rows = []
    for one in compared:
        said = one.failure or ("ok" if one.ok else "DIFFERS")
        numbers = one.difference, one.accuracy, one.steady_state_error, one.rise_time
        rows.append((one.name, *numbers, said))
    return Table(f"Agreement: {_TITLES[loop]}", columns, rows)


def times(loop: LoopName, compared: Sequence[LoopEngine]) -> Table:
    """Return a loop's times; ratios are to the first engine."""
    columns = ("engine", "build ms", "run ms", "least ms", "rounds", "ratio", "settings")
    rows = []
    for one in compared:
        if not one.failure:
            run, least = median(one.running), min(one.running, default=math.nan)
            spent = [1e3 * time for time in (median(one.building), run, least)]
            slower = run / median(compared[0].running)
            raw = one.building, one.running
            rows.append((one.name, *spent, len(one.running), slower, one.note, *raw))
    title = f"Times from a built model to arrays, medians: {_TITLES[loop]}"
    return Table(title, (*columns, "building s", "running s"), rows)


def insertions(found: insertion.Insertions) -> Table:
    """Return outcome, onset and peak of each engine's insertions, and their cost."""
    columns = ["mm", "degrees", "sure"]
    for name in found:
        columns += [name, f"{name}: onset mm", f"{name}: N", f"{name}: ms"]
    rows = []
    for one in found.get(insertion.STATICS, {}):
        row: list[Any] = [*one, "yes" if insertion.sure(one) else "no"]
        for results in found.values():
            result = results[one]
            row += ["seated" if result.seated else "stopped", 1e3 * result.onset]
            row += [result.force, 1e3 * result.seconds]
        rows.append(row)
    return Table("A sprung peg fed into its hole, cap 40 N: seated or stopped", columns, rows)


def tables(found: Findings) -> list[Table]:
    """Return all tables but those of the agreement; without rows if nothing was measured."""
    cold = []
    for name in dict.fromkeys([*found.cold, *found.cold_failures]):
        seconds = found.cold.get(name, [])
        failure = found.cold_failures.get(name, "")
        cold.append((name, median(seconds), len(seconds), failure, seconds))
    factors = [(name, median(of), len(of), of) for name, of in found.real_time.items()]
    updates = [
        (name, 1e6 * cost, cost / found.updates["thesis"]) for name, cost in found.updates.items()
    ]
    said = {True: "met", False: "MISSED", None: "not measured"}
    judged = [
        (one.text, f"{one.relation} {one.bound:g}", one.measured, said[one.ok])
        for one in targets(found)
    ]
    loops = ("experiment", "simulated / elapsed", "rounds", "factors")
    observers = ("observer", "us", "over thesis")
    return [
        *(times(loop, compared) for loop, compared in found.loops.items()),
        Table("Cold start", ("fresh process", "median s", "rounds", "", "seconds"), cold),
        Table("Loops against real time, medians", loops, factors),
        Table("Updates of the surface observers, least", observers, updates),
        insertions(found.insertions),
        Table("Targets", ("ratio", "target", "measured", ""), judged),
    ]


def report_text(found: Findings) -> str:
    """Return all tables but those of the agreement, missing engines and versions."""
    shown = [one.text() for one in tables(found) if one.rows]
    shown += [
        f"{name} is not installed and left out: pip install '.[bench]'" for name in missing()
    ]
    if found.interrupted:
        shown.append("interrupted: this is what there was")
    return "\n\n".join([*shown, ", ".join(map(" ".join, versions().items()))])


def document(found: Findings) -> dict[str, Any]:
    """Return everything as a JSON document."""
    agreed = [agreement(loop, compared) for loop, compared in found.loops.items()]
    return {
        "versions": versions(),
        "interrupted": found.interrupted,
        "missing": missing(),
        "tables": {one.title: one.documents() for one in [*agreed, *tables(found)]},
    }


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
            print(f"{agreement(loop, compared).text()}\n", flush=True)
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
