"""The benchmark's command line: a report, never a test.

Results are compared before any time is taken. What is timed is the way from a built model to the
arrays of results; building the model is reported apart.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from chamfer.analysis.benchmarks import cold_start, insertion, observers, real_time
from chamfer.analysis.benchmarks.agreement import agree, exact
from chamfer.analysis.benchmarks.case import make_case
from chamfer.analysis.benchmarks.engine import LoopName, engines, installed
from chamfer.analysis.benchmarks.report import (
    Findings,
    agreement_text,
    cold_text,
    document,
    insertions_text,
    real_time_text,
    summary_text,
    times_text,
    updates_text,
)
from chamfer.analysis.benchmarks.timing import interleave
from chamfer.analysis.report.atomic_write import write_text
from chamfer.analysis.report.results import json_text

_LOOPS: Final[tuple[LoopName, ...]] = ("pid", "fsm")
_INTERRUPTED: Final = 130  # exit status


def main(
    argv: Sequence[str] | None = None, *, environment: Mapping[str, str] | None = None
) -> int:
    """Run the benchmark, print the report and return the exit status.

    Args:
        argv: The arguments, those of the process unless given.
        environment: Of the fresh processes, that of this one unless given.
    """
    arguments = _parser().parse_args(argv)
    findings = Findings()
    try:
        _measure(findings, rounds=arguments.rounds, share=arguments.share)
        if arguments.contact:
            real_time.measure(findings.real_time, rounds=arguments.contact)
            observers.measure(findings.updates)
        if arguments.insertion != "none":
            insertion.measure_cells(findings.insertions, insertion.CELLS[arguments.insertion])
            findings.missing += installed([insertion.SOURCE])[1]
        if arguments.cold:
            cold_start.measure(findings.cold, rounds=arguments.cold, environment=environment)
    except KeyboardInterrupt:
        findings.interrupted = True
    for loop, found in findings.engines.items():
        print(f"{times_text(loop, found, findings.times[loop])}\n")
    if findings.cold.times or findings.cold.failures:
        print(f"{cold_text(findings.cold)}\n")
    if findings.real_time.factors:
        print(f"{real_time_text(findings.real_time)}\n")
    if findings.updates.seconds:
        print(f"{updates_text(findings.updates)}\n")
    if findings.insertions.predicted:
        print(f"{insertions_text(findings.insertions)}\n")
    print(summary_text(findings))
    if arguments.json is not None:
        write_text(arguments.json, json_text(document(findings)))
    return _INTERRUPTED if findings.interrupted else 0


def _measure(findings: Findings, *, rounds: int, share: float) -> None:
    case = make_case()
    present, findings.missing = installed()
    for loop in _LOOPS:
        solution = exact(case, loop)
        findings.agreements[loop] = []
        findings.engines[loop] = []
        findings.times[loop] = {}
        try:
            for engine in engines(present, case, loop):
                agreement = agree(engine, case, loop, solution)
                findings.agreements[loop].append(agreement)
                if not agreement.failure:
                    findings.engines[loop].append(engine)
        finally:
            print(f"{agreement_text(loop, findings.agreements[loop])}\n", flush=True)
    for loop in _LOOPS:
        interleave(findings.engines[loop], findings.times[loop], rounds=rounds, share=share)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m chamfer.analysis.benchmarks",
        description="Runs the two loops of the first paper in Chamfer and in other simulators, "
        "in turns, and prints how well they agree and how long they take; and the contact loops "
        "against real time, the surface observers, and the insertion of a sprung peg.",
    )
    parser.add_argument(
        "--rounds", type=_AtLeast(1), default=15, metavar="N", help="of each loop (default: 15)"
    )
    parser.add_argument(
        "--share",
        type=float,
        default=10.0,
        metavar="SECONDS",
        help="of an engine per loop, after which it sits the rest out (default: 10)",
    )
    parser.add_argument(
        "--cold",
        type=_AtLeast(0),
        default=5,
        metavar="N",
        help="rounds of fresh processes, 0 for none (default: 5)",
    )
    parser.add_argument(
        "--contact",
        type=_AtLeast(0),
        default=3,
        metavar="N",
        help="rounds of the contact loops, 0 for none, nor of the observers (default: 3)",
    )
    parser.add_argument(
        "--insertion",
        choices=("none", *insertion.CELLS),
        default="all",
        help="cells of the insertion: the reference's five, or a grid too (default: all)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the report as JSON too")
    return parser


class _AtLeast:
    """A whole number from ``least`` on, as an argument of the command line."""

    def __init__(self, least: int) -> None:
        self._least = least

    def __call__(self, text: str) -> int:
        value = int(text)
        if value < self._least:
            raise argparse.ArgumentTypeError(f"is {text}, allowed: {self._least} or more")
        return value

    def __repr__(self) -> str:
        return "whole number"
