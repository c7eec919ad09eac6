"""Profiles an experiment by stages: ``python -m chamfer.analysis.benchmarks.profile NAME``.

It runs like ``chamfer run``, with trials in this process, three times. The first run is short and
compiles, the second takes the time, the third is under Python's profiler. A function's own time
counts for the stages in which it was called, in shares of the time of its calls.
"""

import cProfile
import pstats
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.campaign.campaign import Campaign
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import prepare, run
from chamfer.analysis.report.console import table
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Entry, quiet, select
from chamfer.models import compiled

Function = tuple[str, int, str]  # file, line, name

STAGES: Final[Mapping[str, str]] = {  # and the functions that begin them
    "simulation": "AdvanceTo",
    "building and resolving": r"prepare|resolve\w*|make_\w+|Build",
    "figures and drawings": "figures|figure_files|draw|_replay",
    "writing": "table_bytes|write_folder|json_text|versions",
    "metrics and the rest": "(?!)",
}
_REST: Final = list(STAGES)[-1]
_ROUNDS: Final = 60  # in which callers pass their shares on, more than calls are deep


def profile(entry: Entry, settings: Sequence[str]) -> str:
    """Return the time of an experiment with some settings by stages and functions, as tables."""
    with tempfile.TemporaryDirectory() as folder:
        _run(entry, entry.reduced, folder)
        document = _run(entry, settings, folder)
        profiler = cProfile.Profile()
        profiler.runcall(_run, entry, settings, folder)
    found = pstats.Stats(profiler).stats  # type: ignore[attr-defined]
    total, spent = sum(times[2] for times in found.values()), dict.fromkeys(STAGES, 0.0)
    for function, shares in stages(found).items():
        for stage, share in shares.items():
            spent[stage] += share * found[function][2]
    functions = [("function, its own time", "calls", "us a call", "share")]
    for function, (_, calls, own, *_) in sorted(found.items(), key=lambda one: -one[1][2])[:15]:
        cells = str(calls), f"{1e6 * own / calls:.1f}", f"{own / total:.1%}"
        functions.append((label(function), *cells))
    simulated, elapsed = document["simulated_seconds"], document["wall_seconds"]
    said = (
        f"{entry.name}: {simulated:.3g} s simulated in {elapsed:.3g} s: {simulated / elapsed:.3g}"
    )
    rows = [("stage", "share"), *((name, f"{of / total:.1%}") for name, of in spent.items())]
    return "\n".join([said, "", *table(rows, (1,)), "", *table(functions, (1, 2, 3))])


def _run(entry: Entry, settings: Sequence[str], folder: str) -> dict[str, Any]:
    (job,) = prepare([entry], settings=settings)
    with closing(Campaign(path=None, processors=(), here=True)) as campaign:
        return run(job, seed=0, out=Path(folder), progress=quiet, campaign=campaign)


def stages(found: Mapping[Function, Any]) -> dict[Function, dict[str, float]]:
    """Return to which stages each function's own time belongs, as shares that add up to one."""
    begins = {
        function: stage
        for function in found
        for stage, words in STAGES.items()
        if re.search(rf"(^|[. ])({words})>?$", function[2])
    }
    shares = {one: {begins.get(one, _REST): 1.0} for one in found}
    for _ in range(_ROUNDS):
        for function, (*_, callers) in found.items():
            whole = sum(times[3] for times in callers.values())
            if function in begins or not whole:
                continue
            passed = dict.fromkeys(STAGES, 0.0)
            for caller, times in callers.items():
                for stage, share in shares[caller].items():
                    # A compiled loop that no block of Drake's calls is a simulation itself.
                    own = stage == _REST and label(function).endswith("(Numba)")
                    passed["simulation" if own else stage] += share * times[3] / whole
            shares[function] = passed
    return shares


@cache
def label(function: Function) -> str:
    """Return a function's name and its origin: a module, Numba's or Drake's machine code."""
    file, _, name = function
    if file == "~":
        return f"{name.strip('<>')}{' (Drake C++)' if 'pydrake.' in name else ''}"
    of = [vars(one) for one in sys.modules.values() if getattr(one, "__file__", None) == file]
    held = of[0].get(name) if of else None
    numba = type(held).__module__ == compiled.__name__
    return f"{Path(file).stem}.{name}{' (Numba)' if numba else ''}"


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("make profile: NAME is missing, allowed: an experiment of `chamfer list`")
    try:
        (chosen,) = select(CATALOGUE.entries, sys.argv[1:2])
        print(profile(chosen, sys.argv[2:]))
    except (UserError, ExperimentError) as error:
        sys.exit(f"make profile: {error}")
