"""The benchmark as text and as a document."""

import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from chamfer.analysis.benchmarks.agreement import Agreement
from chamfer.analysis.benchmarks.cold_start import ColdStart
from chamfer.analysis.benchmarks.engine import Engine, LoopName, Source, how_to_install
from chamfer.analysis.benchmarks.insertion import Insertions, Result, sure
from chamfer.analysis.benchmarks.observers import Updates
from chamfer.analysis.benchmarks.real_time import RealTime
from chamfer.analysis.benchmarks.targets import Target, targets
from chamfer.analysis.benchmarks.timing import Times, ratio

_TITLES: Final[Mapping[LoopName, str]] = {
    "pid": "PID loop, step of 1 m, 2.5 s, output every 1 ms",
    "fsm": "FSM loop, step of 1 m, 2.5 s, output at the ticks, 80 Hz",
}
_NOT_MEASURED: Final = "-"


@dataclass
class Findings:
    """Everything that has been found so far."""

    engines: dict[LoopName, list[Engine]] = field(default_factory=dict)
    agreements: dict[LoopName, list[Agreement]] = field(default_factory=dict)
    times: dict[LoopName, dict[str, Times]] = field(default_factory=dict)
    cold: ColdStart = field(default_factory=ColdStart)
    real_time: RealTime = field(default_factory=RealTime)
    updates: Updates = field(default_factory=Updates)
    insertions: Insertions = field(default_factory=Insertions)
    missing: list[Source] = field(default_factory=list)
    interrupted: bool = False


def agreement_text(loop: LoopName, agreements: Sequence[Agreement]) -> str:
    """Return the table of a loop's results against the exact solution."""
    rows = []
    for found in agreements:
        verdict = found.failure or ("ok" if found.ok else "DIFFERS")
        rows.append(
            (
                found.engine,
                _number(found.difference, "{:.1e}"),
                f"{found.accuracy:.0e}",
                _number(found.steady_state_error, "{:.6f}"),
                _number(found.rise_time, "{:.6f}"),
                verdict,
            )
        )
    header = ("engine", "largest difference m", "promised m", "final error m", "rise time s", "")
    return _titled(f"Agreement: {_TITLES[loop]}", header, rows, right=(1, 2, 3, 4))


def times_text(loop: LoopName, engines: Sequence[Engine], times: Mapping[str, Times]) -> str:
    """Return the table of a loop's times."""
    reference = times[engines[0].name].run if engines and engines[0].name in times else None
    rows = []
    for engine in engines:
        taken = times.get(engine.name, Times())
        rows.append(
            (
                engine.name,
                _milliseconds(taken.build),
                _milliseconds(taken.run),
                _milliseconds(taken.least),
                str(taken.rounds),
                _number(ratio(taken.run, reference), "{:.3g}"),
                engine.note,
            )
        )
    header = ("engine", "build ms", "run ms", "least ms", "rounds", "ratio", "settings")
    title = f"Times from a built model to arrays, medians: {_TITLES[loop]}"
    return _titled(title, header, rows, right=(1, 2, 3, 4, 5))


def cold_text(cold: ColdStart) -> str:
    """Return the table of the fresh processes."""
    names = [*cold.times, *(name for name in cold.failures if name not in cold.times)]
    rows = [
        (
            name,
            _number(cold.median(name), "{:.2f}"),
            str(len(cold.times.get(name, []))),
            cold.failures.get(name, ""),
        )
        for name in names
    ]
    return _titled("Cold start", ("fresh process", "median s", "rounds", ""), rows, right=(1, 2))


def real_time_text(real_time: RealTime) -> str:
    """Return the table of the loops in real time."""
    rows = [
        (name, _number(real_time.median(name), "{:.1f}"), str(len(factors)))
        for name, factors in real_time.factors.items()
    ]
    header = ("experiment", "simulated / elapsed", "rounds")
    return _titled("Loops against real time, medians", header, rows, right=(1, 2))


def updates_text(updates: Updates) -> str:
    """Return the table of the observers' updates, and their times over the thesis filter's."""
    thesis = updates.seconds["thesis"]
    rows = [
        (name, f"{1e6 * seconds:.0f}", f"{seconds / thesis:.2f}")
        for name, seconds in updates.seconds.items()
    ]
    header = ("observer", "us", "over thesis")
    return _titled("Updates of the surface observers, least", header, rows, right=(1, 2))


def insertions_text(insertions: Insertions) -> str:
    """Return the table of the insertions: outcome, onset and peak of each engine, and its cost."""
    rows = []
    for one, said in insertions.predicted.items():
        cells = [f"{one[0]:g}", f"{one[1]:g}", "yes" if sure(insertions, one) else "no"]
        for result in (said, *(of[one] for of in insertions.results.values())):
            cells += _insertion_cells(result)
        rows.append(tuple(cells))
    header = ["mm", "degrees", "sure"]
    for name in ("statics", *insertions.results):
        header += [name, "onset mm", "N", "ms"]
    title = "A sprung peg fed into its hole, cap 40 N: seated or stopped"
    return _titled(title, header, rows, right=[k for k in range(len(header)) if k not in (2, 3)])


def _insertion_cells(result: Result) -> tuple[str, ...]:
    onset = None if result.onset is None else 1e3 * result.onset
    return (
        "seated" if result.seated else "stopped",
        _number(onset, "{:.2f}"),
        f"{result.force:.2f}",
        f"{1e3 * result.seconds:.0f}",
    )


def _targets(findings: Findings) -> list[Target]:
    return targets(
        findings.times,
        findings.cold,
        findings.real_time,
        findings.updates,
        findings.insertions,
    )


def summary_text(findings: Findings) -> str:
    """Return what comes after the tables: targets, what is missing, versions."""
    rows = [
        (
            target.text,
            f"{'>=' if target.relation == 'at_least' else '<='} {target.bound:g}",
            _number(target.measured, "{:.2f}"),
            {True: "met", False: "MISSED", None: "not measured"}[target.ok],
        )
        for target in _targets(findings)
    ]
    text = [_titled("Targets", ("ratio", "target", "measured", ""), rows, right=(2,))]
    lines = [how_to_install(source) for source in findings.missing]
    if findings.interrupted:
        lines.append("interrupted: this is what there was")
    lines.append(", ".join(f"{name} {found}" for name, found in versions().items()))
    return "\n\n".join([*text, "\n".join(lines)])


def document(findings: Findings) -> dict[str, Any]:
    """Return everything as a JSON document, times in s."""
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
        "real_time": asdict(findings.real_time),
        "updates": asdict(findings.updates),
        "insertions": {
            name: [
                {"lateral_mm": one[0], "tilt_deg": one[1], **_finite(result)}
                for one, result in of.items()
            ]
            for name, of in (
                ("statics", findings.insertions.predicted),
                *findings.insertions.results.items(),
            )
        },
        "targets": [{**asdict(target), "ok": target.ok} for target in _targets(findings)],
    }


def _finite(result: Result) -> dict[str, Any]:
    """Return a result without infinity, which JSON doesn't have."""
    force = result.force if math.isfinite(result.force) else None
    return {**result._asdict(), "force": force}


def versions() -> dict[str, str]:
    """Return the versions of Python and of all engines, missing ones included."""
    found = {"python": platform.python_version()}
    for name in ("drake", "numpy", "scipy", "control", "bdsim", "pathsim", "fullseye", "mujoco"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def _engine_document(engine: Engine, times: Mapping[str, Times]) -> dict[str, Any]:
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


def _milliseconds(seconds: float | None) -> str:
    return _number(None if seconds is None else 1e3 * seconds, "{:.3f}")


def _number(value: float | None, form: str) -> str:
    return _NOT_MEASURED if value is None else form.format(value)


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
