"""Runs experiments, says how they went and keeps the report up to date."""

import sys
import warnings
from collections.abc import Sequence
from contextlib import closing, nullcontext, redirect_stdout, suppress
from pathlib import Path
from typing import Any

from chamfer.analysis.campaign.campaign import Campaign
from chamfer.analysis.campaign.progress import TerminalProgress
from chamfer.analysis.campaign.workers import Engine
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import Job, run, trials_path
from chamfer.analysis.command.side_by_side import Ended, Order, SideBySide
from chamfer.analysis.report.atomic_write import write_text
from chamfer.analysis.report.check_text import counts, counts_text
from chamfer.analysis.report.checks import load_paper
from chamfer.analysis.report.console import failed_text, result_text, say
from chamfer.analysis.report.report import REPORT, write_report
from chamfer.analysis.report.results import RESULT, json_text, read_result
from chamfer.analysis.report.results_table import TABLE, results_table
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry


class Session:
    """The runs of one command.

    Args:
        entries: All experiments that there are, for the report.
        out: The folder of the results.
        seed: Of all randomness.
        as_json: Whether standard output gets one JSON document, and nothing else.
        here: Where experiments run side by side.
        trials: Where trials run.
        fresh: Whether to forget trials that have finished before.
        catalogue: Where experiments and published values are.
    """

    def __init__(
        self,
        entries: Sequence[Entry],
        *,
        out: Path,
        seed: int,
        as_json: bool,
        here: Engine,
        trials: Engine,
        fresh: bool,
        catalogue: Catalogue = CATALOGUE,
    ) -> None:
        self._entries = entries
        self._out = out
        self._seed = seed
        self._as_json = as_json
        self._here = here
        self._trials = trials
        self._fresh = fresh
        self._catalogue = catalogue
        self._results: list[dict[str, Any]] = []
        self._errors: list[str] = []

    def run_all(self, jobs: Sequence[Job]) -> int:
        """Run prepared experiments and return the exit status; an error ends the session."""
        for i, job in enumerate(jobs):
            self._run(job, i, len(jobs))
        return self._end()

    def reproduce_all(self, entries: Sequence[Entry]) -> int:
        """Run experiments side by side with their defaults and return the exit status.

        An experiment that ends with an error is reported and the others go on.
        """
        orders = [
            Order(
                entry=entry,
                catalogue=self._catalogue,
                seed=self._seed,
                out=self._out,
                fresh=self._fresh,
            )
            for entry in entries
        ]
        with TerminalProgress("reproduce") as progress:
            side_by_side = SideBySide(here=self._here, trials=self._trials, progress=progress)
            self._write_report(side_by_side.status())
            try:
                with closing(side_by_side.run(orders)) as runs:
                    for ended in runs:
                        with progress.aside():
                            self._report(ended)
                        self._write_report(side_by_side.status())
            finally:
                self._write_report()
        order = [entry.name for entry in self._entries]
        self._results.sort(key=lambda result: order.index(result["experiment"]))
        self._errors.sort(key=lambda error: order.index(error.partition(":")[0]))
        self._write_table()
        return self._end()

    def _run(self, job: Job, index: int, count: int) -> None:
        name = job.entry.name
        label = name if count == 1 else f"[{index + 1}/{count}] {name}"
        campaign = Campaign(
            trials_path(self._out, name),
            processors=self._trials.processors(),
            engine=self._trials,
            fresh=self._fresh,
        )
        # An experiment that prints must not spoil the JSON document.
        quiet = redirect_stdout(sys.stderr) if self._as_json else nullcontext()
        with quiet, TerminalProgress(label) as progress, closing(campaign):
            result = run(job, seed=self._seed, out=self._out, progress=progress, campaign=campaign)
        self._take(result)
        self._write_report()

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
        self._errors.append(prefix + line)
        say(self._errors[-1])

    def _take(self, result: dict[str, Any]) -> None:
        self._results.append(result)
        if not self._as_json:
            print(result_text(result), end="\n\n", flush=True)

    def _write_report(self, running: str = "") -> None:
        write_report(self._out, self._entries, self._catalogue, running=running)

    def _write_table(self) -> None:
        results = self._all_results()
        papers = {result["paper"] for result in results}
        titles = {key: load_paper(key, self._catalogue).title for key in papers}
        studies = {entry.name for entry in self._entries if entry.study}
        path = self._out / TABLE
        try:
            write_text(
                path,
                results_table(results, titles, self._errors, studies=studies, seed=self._seed),
            )
        except OSError as error:
            raise UserError(f"{path} can't be written: {error.strerror or error}") from error

    def _all_results(self) -> list[dict[str, Any]]:
        """Return those of this run, and of earlier ones with the same seed and defaults."""
        found = {result["experiment"]: result for result in self._results}
        for entry in self._entries:
            with suppress(OSError, ValueError, LookupError):
                document = read_result(self._out / entry.name / RESULT)
                if document["seed"] == self._seed and not document["overrides"]:
                    found.setdefault(entry.name, document)
        order = [entry.name for entry in self._entries]
        return sorted(found.values(), key=lambda result: order.index(result["experiment"]))

    def _end(self) -> int:
        report = self._out / REPORT
        counted = counts(check for result in self._results for check in result["checks"])
        if self._as_json:
            document = {
                "results": self._results,
                "checks": counted,
                "errors": self._errors,
                "report": str(report),
            }
            print(json_text(document), end="")
        else:
            print(counts_text(counted))
            for result in self._results:
                if failed := result["failed_trials"]:
                    print(f"{result['experiment']}: {failed_text(failed)}")
            for error in self._errors:
                print(f"ended with an error: {error}")
            if self._results:
                print(f"report: {report}")
        any_failed = any(result["failed_trials"] for result in self._results)
        return 1 if any_failed or self._errors else 0
