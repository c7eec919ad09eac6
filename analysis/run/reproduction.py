"""Runs experiments with their defaults, side by side, whatever becomes of the others."""

import math
import sys
import traceback
import warnings
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing, nullcontext, redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from analysis.run.campaign import parallel
from analysis.run.errors import ExperimentError, UserError
from analysis.run.experiment import Progress
from analysis.run.progress import TerminalProgress
from analysis.run.registry import Entry, Sources
from analysis.run.running import prepare, run
from analysis.run.side_by_side import Died, Told, side_by_side


@dataclass(frozen=True, kw_only=True)
class Reproduced:
    """What became of an experiment: its result, or the error that ended it."""

    result: dict[str, Any] | None = None
    error: str = ""
    trace: str = ""  # where the error is a bug
    warned: Sequence[warnings.WarningMessage] = ()


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """How experiments are run again; results are the same with any number of workers."""

    out: Path  # the results' folder
    seed: int
    sources: Sources
    workers: int  # processes in all
    quiet: bool  # keep what experiments print from standard output

    def run(self, entries: Sequence[Entry]) -> Generator[Reproduced]:
        """Yield what becomes of each experiment in order, when it and all before have ended."""
        # Experiments side by side, and the trials of each one's campaign: with the root of the
        # workers for each, neither many short experiments nor one long campaign is what is left.
        beside = min(math.ceil(math.sqrt(self.workers)), len(entries))
        if beside < 2:
            return self._in_turn(entries)
        return self._side_by_side(entries, beside)

    def _in_turn(self, entries: Sequence[Entry]) -> Generator[Reproduced]:
        for i, entry in enumerate(entries):
            label = f"[{i + 1}/{len(entries)}] {entry.name}"
            with TerminalProgress(label) as progress:
                reproduced = self._reproduce(self.workers, entry, progress)
            yield reproduced

    def _side_by_side(self, entries: Sequence[Entry], beside: int) -> Generator[Reproduced]:
        each = math.ceil(self.workers / beside)
        ended: dict[int, Reproduced] = {}
        progress: Progress

        def told(running: Mapping[int, Told]) -> None:
            done = len(ended) + i + sum(one.fraction for one in running.values())
            progress(done / len(entries), ", ".join(entries[k].name for k in sorted(running)))

        runs = side_by_side(partial(self._reproduce, each), entries, processes=beside, told=told)
        with closing(runs):
            for i in range(len(entries)):
                with TerminalProgress(f"{i} of {len(entries)} experiments") as progress:
                    while i not in ended:
                        place, found = next(runs)
                        ended[place] = _died(found) if isinstance(found, Died) else found
                yield ended.pop(i)

    def _reproduce(self, workers: int, entry: Entry, progress: Progress) -> Reproduced:
        quiet = redirect_stdout(sys.stderr) if self.quiet else nullcontext()
        with quiet, parallel(workers), warnings.catch_warnings(record=True) as warned:
            try:
                (job,) = prepare([entry], sources=self.sources)
                result = run(job, seed=self.seed, out=self.out, progress=progress)
            except (UserError, ExperimentError) as error:
                return Reproduced(error=str(error), warned=warned)
            except Exception as error:
                return Reproduced(
                    error=f"{type(error).__name__}: {error}",
                    trace=traceback.format_exc(),
                    warned=warned,
                )
        return Reproduced(result=result, warned=warned)


def _died(found: Died) -> Reproduced:
    return Reproduced(error=f"its process died with the status {found.status}")
