"""Where the time of an experiment goes: ``python -m chamfer.analysis.benchmarks.profile NAME``.

The experiment runs as ``chamfer run`` runs it, trials in this process, three times: short, so that
what compiles has compiled; for the time that it takes; and under Python's profiler. A function's
own time counts for the stages that it was called in, in shares of the time of its calls.
"""

import argparse
import cProfile
import pstats
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.campaign.campaign import Campaign
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare, run
from chamfer.analysis.report.console import table
from chamfer.analysis.scenario.experiment import Entry, quiet, select
from chamfer.models import compiled

Function = tuple[str, int, str]  # file, line, name
Shares = dict[str, float]  # of stages

STAGES: Final[Mapping[str, str]] = {  # and the functions that begin them, as words
    "simulation": "AdvanceTo",
    "building and resolving": r"prepare|resolve\w*|make_\w+|Build",
    "figures and drawings": "figures|figure_files|draw|_replay",
    "writing": "table_bytes|write_folder|json_text|write_report|versions",
    "metrics and the rest": "",
}
_REST: Final = list(STAGES)[-1]
_SHOWN: Final = 15  # functions
_ROUNDS: Final = 60  # in which callers pass their shares on, more than calls are deep


def main(argv: Sequence[str] | None = None) -> int:
    """Profile the experiment that is named, print the tables and return the exit status."""
    parser = argparse.ArgumentParser(prog="make profile NAME=...")
    parser.add_argument("name", help="an experiment of `chamfer list`")
    parser.add_argument("--set", action="append", default=[], dest="settings")
    arguments = parser.parse_args(argv)
    (entry,) = select(CATALOGUE.entries, [arguments.name])
    print(profile(entry, arguments.settings))
    return 0


def profile(entry: Entry, settings: Sequence[str]) -> str:
    """Return where the time of an experiment with some settings goes, as tables."""
    with tempfile.TemporaryDirectory() as folder:
        _run(entry, entry.reduced, folder)
        document = _run(entry, settings, folder)
        profiler = cProfile.Profile()
        profiler.runcall(_run, entry, settings, folder)
    found = pstats.Stats(profiler).stats  # type: ignore[attr-defined]
    total = sum(own for _, _, own, _, _ in found.values())
    spent = dict.fromkeys(STAGES, 0.0)
    for function, shares in stages(found).items():
        for stage, share in shares.items():
            spent[stage] += share * found[function][2]
    rows = [("stage", "share"), *((name, f"{of / total:.1%}") for name, of in spent.items())]
    largest = sorted(found.items(), key=lambda item: -item[1][2])[:_SHOWN]
    functions = [("function, its own time", "calls", "us a call", "share")]
    for function, (_, calls, own, _, _) in largest:
        cells = str(calls), f"{1e6 * own / calls:.1f}", f"{own / total:.1%}"
        functions.append((label(function), *cells))
    simulated, elapsed = document["simulated_seconds"], document["wall_seconds"]
    ratio = f"simulated {simulated:.3g} s in {elapsed:.3g} s: {simulated / elapsed:.3g}"
    head = f"{entry.name}: {ratio} without the profiler; {total:.3g} s under it"
    return "\n".join([head, "", *table(rows, (1,)), "", *table(functions, (1, 2, 3))])


def _run(entry: Entry, settings: Sequence[str], folder: str) -> dict[str, Any]:
    (job,) = prepare([entry], settings=settings)
    with closing(Campaign(path=None, processors=(), here=True)) as campaign:
        return run(job, seed=0, out=Path(folder), progress=quiet, campaign=campaign)


def stages(found: Mapping[Function, Any]) -> dict[Function, Shares]:
    """Return to which stages each function's own time belongs, as shares that add up to one."""
    numba = machine_code()
    begins = {
        function: stage
        for function in found
        for stage, words in STAGES.items()
        if words and re.search(rf"(^|[. ])({words})>?$", function[2])
    }
    shares: dict[Function, Shares] = {one: {begins.get(one, _REST): 1.0} for one in found}
    for _ in range(_ROUNDS):
        for function, (_, _, _, _, callers) in found.items():
            whole = sum(times[3] for times in callers.values())
            if function in begins or not whole:
                continue
            passed: Shares = {}
            for caller, (_, _, _, cumulative) in callers.items():
                for stage, share in shares[caller].items():
                    # A compiled loop that no block of Drake's calls is a simulation itself.
                    to = "simulation" if stage == _REST and function in numba else stage
                    passed[to] = passed.get(to, 0.0) + share * cumulative / whole
            shares[function] = passed
    return shares


def machine_code() -> set[Function]:
    """Return the functions that Numba compiles, of the modules that are loaded."""
    codes = {
        one.__wrapped__.__code__
        for name, module in list(sys.modules.items())
        if name.startswith("chamfer.")
        for one in vars(module).values()
        if type(one).__module__ == compiled.__name__
    }
    return {(code.co_filename, code.co_firstlineno, code.co_name) for code in codes}


def label(function: Function) -> str:
    """Return a function's name and what it is of: a module, Numba's or Drake's machine code."""
    file, _, name = function
    if file == "~":
        return f"{name.strip('<>')}{' (Drake C++)' if 'pydrake.' in name else ''}"
    return f"{Path(file).stem}.{name}{' (Numba)' if function in machine_code() else ''}"


if __name__ == "__main__":
    sys.exit(main())
