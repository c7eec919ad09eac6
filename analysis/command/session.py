"""Runs experiments, says how they went and keeps the report up to date.

Reproducing runs them side by side in worker processes, which write their folders themselves. What
had ended before with the same sources, seed and scenario is kept. The quick ones come first, so
that there is soon something to see, then the longest, so that no core waits at the end.

An experiment that needs trials asks for them and is begun anew when they have run: then it finds
them in its folder, as it does after an interrupt. So all share the same workers, no process waits
for another one, and the main process holds no results.
"""

import argparse
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, contextmanager, nullcontext, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.campaign.campaign import Campaign, TrialsWantedError, running
from chamfer.analysis.campaign.cluster import engines
from chamfer.analysis.campaign.progress import TerminalProgress, duration
from chamfer.analysis.campaign.trial_store import TRIALS
from chamfer.analysis.campaign.workers import Engine, LostError, StartError, cores
from chamfer.analysis.command.running import Job, finished, prepare, run
from chamfer.analysis.report.atomic_write import write_text, written
from chamfer.analysis.report.check_text import TABLE, counts, counts_text, kept, results_table
from chamfer.analysis.report.checks import load_paper
from chamfer.analysis.report.console import failed_text, result_text, say
from chamfer.analysis.report.report import REPORT, write_report
from chamfer.analysis.report.results import RESULT, json_text, read_result
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry, Progress, quiet

_TRIES: Final = 2  # of an experiment whose process dies
_QUICK: Final = 5.0  # s, what an experiment may take that is among the first


@dataclass(frozen=True, kw_only=True)
class Order:
    """Options that all runs of a command share."""

    catalogue: Catalogue
    out: Path  # the folder of the results
    seed: int
    fresh: bool  # whether to run again what had ended before
    log: bool = False  # whether to write what the controllers saw and answered


@dataclass(frozen=True, kw_only=True)
class Ended:
    """A finished experiment: its result, or the error that ended it."""

    entry: Entry
    result: dict[str, Any] | None = None  # its document
    error: str = ""  # in one line
    trace: str = ""  # where the error is a bug
    kept: bool = False  # it had ended before
    warned: Sequence[warnings.WarningMessage] = ()


@dataclass(kw_only=True)
class Session:
    """The runs of one command."""

    order: Order
    as_json: bool  # whether standard output gets one JSON document, and nothing else
    strict: bool  # whether a broken specification makes the exit status 1
    here: Engine  # where experiments run side by side, with access to the results' folder
    trials: Engine  # where trials run, which may be the same
    results: list[dict[str, Any]] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def run_all(self, jobs: Sequence[Job]) -> int:
        """Run prepared experiments and return the exit status; an error ends the session."""
        seed, out = self.order.seed, self.order.out
        for i, job in enumerate(jobs):
            name = job.entry.name
            label = name if len(jobs) == 1 else f"[{i + 1}/{len(jobs)}] {name}"
            log = self.order.log and bool(job.entry.diagram or job.entry.loops)
            if log != self.order.log:
                say(f"{name}: no log, the experiment has no controllers")
            campaign = self._campaign(name, fresh=self.order.fresh or log)
            campaign.here = log
            # An experiment that prints must not spoil the JSON document.
            quiet = redirect_stdout(sys.stderr) if self.as_json else nullcontext()
            with quiet, TerminalProgress(label) as progress, closing(campaign):
                result = run(
                    job,
                    seed=seed,
                    out=out,
                    progress=progress,
                    campaign=campaign,
                    log=log,
                    fresh=self.order.fresh,
                )
            self._take(result)
            self._write_report()
        return self._end()

    def reproduce_all(self, entries: Sequence[Entry]) -> int:
        """Run experiments side by side with their defaults and return the exit status.

        An experiment that ends with an error is reported and the others go on.
        """
        with TerminalProgress("reproduce") as progress:
            headway = _Headway(entries, progress)
            self._write_report(headway.status())
            try:
                with closing(self._side_by_side(headway)) as runs:
                    for ended in runs:
                        with progress.aside():
                            self._report(ended)
                        self._write_report(headway.status())
            finally:
                self._write_report()
        order = [entry.name for entry in self.order.catalogue.entries]
        self.results.sort(key=lambda result: order.index(result["experiment"]))
        self.errors.sort(key=lambda error: order.index(error.partition(":")[0]))
        self._write_table()
        return self._end()

    def _campaign(self, name: str, *, fresh: bool) -> Campaign:
        path, processors = self.order.out / name / TRIALS, self.trials.processors
        return Campaign(path=path, processors=processors, engine=self.trials, fresh=fresh)

    def _side_by_side(self, headway: "_Headway") -> Generator[Ended]:
        """Yield what becomes of each experiment when it has ended."""
        turns = sorted(headway.entries, key=_turn)
        with ThreadPoolExecutor(max(1, len(turns))) as threads:
            try:
                runs = [threads.submit(self._conduct, entry, headway) for entry in turns]
                for future in as_completed(runs):
                    headway.ended.append(future.result())
                    yield headway.ended[-1]
            except BaseException:
                self.here.close()
                self.trials.close()
                raise

    def _conduct(self, entry: Entry, headway: "_Headway") -> Ended:
        began, fresh, lost = time.monotonic(), self.order.fresh, 0
        with closing(self._campaign(entry.name, fresh=False)) as campaign:
            while True:
                headway.tell(entry.name)
                there = partial(
                    Campaign,
                    path=self.order.out / entry.name / TRIALS,
                    processors=self.trials.processors,
                    fresh=fresh,
                    failures=campaign.failures,
                    seconds=time.monotonic() - began,
                )
                try:
                    answer = self.here.submit(_perform, self.order, entry, there).result()
                    if isinstance(answer, Ended):
                        return answer
                    fresh = False
                    campaign.supply(answer, partial(headway.tell, entry.name))
                except LostError as error:
                    lost += 1
                    if lost == _TRIES:
                        return Ended(entry=entry, error=str(error))
                except (UserError, ExperimentError, StartError) as error:
                    return Ended(entry=entry, error=str(error))

    def _report(self, ended: Ended) -> None:
        for one in ended.warned:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
        if ended.result is not None:
            self._take(ended.result)
            return
        with suppress(OSError):  # nobody can be told
            print(ended.trace, end="", file=sys.stderr)
        prefix = f"{ended.entry.name}: "
        line = " ".join(ended.error.removeprefix(prefix).split())
        self.errors.append(prefix + line)
        say(self.errors[-1])

    def _take(self, result: dict[str, Any]) -> None:
        self.results.append(result)
        if not self.as_json:
            print(result_text(result), end="\n\n", flush=True)

    def _write_report(self, running: str = "") -> None:
        write_report(self.order.out, self.order.catalogue, running=running)

    def _write_table(self) -> None:
        """Write a table of this run's results, and of earlier ones of the seed and defaults."""
        catalogue, seed = self.order.catalogue, self.order.seed
        found = {result["experiment"]: result for result in self.results}
        for entry in catalogue.entries:
            with suppress(OSError, ValueError, LookupError):
                document = read_result(self.order.out / entry.name / RESULT)
                if document["seed"] == seed and not document["overrides"]:
                    found.setdefault(entry.name, document)
        results = [found[one.name] for one in catalogue.entries if one.name in found]
        titles = {
            key: load_paper(key, catalogue).title for key in {one["paper"] for one in results}
        }
        studies = {entry.name for entry in catalogue.entries if entry.study}
        path = self.order.out / TABLE
        with written(path):
            write_text(
                path, results_table(results, titles, self.errors, studies=studies, seed=seed)
            )

    def _end(self) -> int:
        report = self.order.out / REPORT
        checks = [check for result in self.results for check in result["checks"]]
        limits = kept(checks)
        failed = {one["experiment"]: one["failed_trials"] for one in self.results}
        if self.as_json:
            document = {
                "results": self.results,
                "checks": counts(checks),
                "specifications": limits,
                "errors": self.errors,
                "report": str(report),
            }
            print(json_text(document), end="")
        else:
            print(counts_text(checks))
            for name, trials in failed.items():
                if trials:
                    print(f"{name}: {failed_text(trials)}")
            for error in self.errors:
                print(f"ended with an error: {error}")
            if self.results:
                print(f"report: {report}")
        if strict := self.strict and limits["broken"] > 0:
            say(f"--strict: {limits['broken']} of {sum(limits.values())} specifications broken")
        return 1 if any(failed.values()) or self.errors or strict else 0


@contextmanager
def command_campaign(
    folder: Path, label: str, arguments: argparse.Namespace
) -> Iterator[Progress]:
    """Let the block's trials be kept in a folder until the block has written its results.

    The command's arguments have ``workers``, ``cluster`` and ``fresh``.
    """
    with engines(arguments.workers or cores(), arguments.cluster) as (_, trials):
        path, fresh = folder / TRIALS, arguments.fresh
        campaign = Campaign(path=path, processors=trials.processors, engine=trials, fresh=fresh)
        # What prints must not spoil what the command prints.
        quiet, told = redirect_stdout(sys.stderr), TerminalProgress(label)
        with closing(campaign), quiet, told as progress, running(campaign):
            yield progress
            campaign.finish()


class _Headway:
    """How far experiments are that run at the same time."""

    def __init__(self, entries: Sequence[Entry], progress: Progress) -> None:
        self.entries = entries
        self.ended: list[Ended] = []
        self._progress = progress
        self._began = time.monotonic()

    def tell(self, name: str, fraction: float = 0.0, doing: str = "") -> None:
        """Tell how far they are, and what an experiment is doing."""
        done = _seconds(one.entry for one in self.ended)
        self._progress(done / _seconds(self.entries), f"{self.status()}, {name} {doing}")

    def status(self) -> str:
        """Return how many have ended, and how long the others may take."""
        text = f"{len(self.ended)} of {len(self.entries)}"
        run = [one.entry for one in self.ended if not one.kept]
        left = _seconds(self.entries) - _seconds(one.entry for one in self.ended)
        if len(self.ended) == len(self.entries) or not run:
            return text
        pace = (time.monotonic() - self._began) / _seconds(run)
        return f"{text}, about {duration(left * pace)} left"


def _seconds(entries: Iterable[Entry]) -> float:
    return sum(entry.seconds for entry in entries)


def _turn(entry: Entry) -> tuple[bool, float]:
    long = entry.seconds > _QUICK
    return long, -entry.seconds if long else entry.seconds


def _perform(
    order: Order, entry: Entry, make_campaign: Callable[[], Campaign]
) -> Ended | TrialsWantedError:
    """Run an experiment up to its end or the first trials that have neither ended nor failed."""
    made = partial(Ended, entry=entry)
    with warnings.catch_warnings(record=True) as warned, closing(make_campaign()) as campaign:
        try:
            (job,) = prepare([entry], catalogue=order.catalogue)
            if not order.fresh and (result := finished(job, seed=order.seed, out=order.out)):
                return made(result=result, kept=True)
            result = run(job, seed=order.seed, out=order.out, progress=quiet, campaign=campaign)
            return made(result=result, warned=warned)
        except TrialsWantedError as wanted:
            return wanted
        except (UserError, ExperimentError) as error:
            return made(error=str(error), warned=warned)
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            return made(error=message, trace=traceback.format_exc(), warned=warned)
