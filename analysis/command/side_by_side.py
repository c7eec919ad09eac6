"""Runs experiments side by side in worker processes, which write their folders themselves.

An experiment that needs trials asks for them and is begun anew when they have run: then it finds
them in its folder, as it does after an interrupt. So all share the same workers, no process waits
for another one, and the main process holds no results.
"""

import time
import traceback
import warnings
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.campaign.campaign import Campaign, TrialsWantedError
from chamfer.analysis.campaign.workers import Engine, LostError, StartError
from chamfer.analysis.command.running import prepare, run, trials_path
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry, Progress

_TRIES: Final = 2  # of an experiment whose process dies


@dataclass(frozen=True, kw_only=True)
class Order:
    """An experiment to run with its default scenario."""

    entry: Entry
    catalogue: Catalogue
    seed: int
    out: Path


@dataclass(frozen=True, kw_only=True)
class Ended:
    """What became of an experiment: its result, or the error that ended it."""

    entry: Entry
    result: dict[str, Any] | None = None  # its document
    error: str = ""  # in one line
    trace: str = ""  # where the error is a bug
    warned: Sequence[warnings.WarningMessage] = ()


class SideBySide:
    """Experiments that run at the same time.

    Args:
        here: Where they run, with access to the results' folder.
        trials: Where their trials run, which may be the same.
        fresh: Whether to forget trials that have finished before.
        progress: Told how many experiments have ended.
    """

    def __init__(self, *, here: Engine, trials: Engine, fresh: bool, progress: Progress) -> None:
        self._here = here
        self._trials = trials
        self._fresh = fresh
        self._progress = progress
        self._count = 0
        self._ended = 0

    def run(self, orders: Sequence[Order]) -> Generator[Ended]:
        """Yield what becomes of each experiment in order, when it and all before have ended."""
        self._count = len(orders)
        with ThreadPoolExecutor(max(1, len(orders))) as threads:
            try:
                for future in [threads.submit(self._conduct, order) for order in orders]:
                    yield future.result()
            except BaseException:
                self._here.close()
                self._trials.close()
                raise

    def _conduct(self, order: Order) -> Ended:
        name = order.entry.name
        path, processors = trials_path(order.out, name), self._trials.processors()
        began, fresh, lost = time.monotonic(), self._fresh, 0
        with closing(Campaign(path, processors=processors, engine=self._trials)) as campaign:
            while True:
                self._tell(name)
                there = partial(
                    Campaign,
                    path,
                    processors=processors,
                    fresh=fresh,
                    failures=campaign.failures,
                    seconds=time.monotonic() - began,
                )
                try:
                    answer = self._here.submit(_perform, order, there).result()
                    if isinstance(answer, Ended):
                        return answer
                    fresh = False
                    campaign.supply(answer, partial(self._tell, name))
                except LostError as error:
                    lost += 1
                    if lost == _TRIES:
                        return Ended(entry=order.entry, error=str(error))
                except (UserError, ExperimentError, StartError) as error:
                    return Ended(entry=order.entry, error=str(error))

    def _tell(self, name: str, fraction: float = 0.0, doing: str = "") -> None:
        self._progress(
            self._ended / self._count, f"{self._ended} of {self._count}, {name} {doing}"
        )


def _perform(order: Order, make_campaign: Callable[[], Campaign]) -> Ended | TrialsWantedError:
    """Run an experiment up to its end or the first trials that have neither ended nor failed."""
    made = partial(Ended, entry=order.entry)
    with warnings.catch_warnings(record=True) as warned, closing(make_campaign()) as campaign:
        try:
            (job,) = prepare([order.entry], catalogue=order.catalogue)
            result = run(job, seed=order.seed, out=order.out, progress=_quiet, campaign=campaign)
            return made(result=result, warned=warned)
        except TrialsWantedError as wanted:
            return wanted
        except (UserError, ExperimentError) as error:
            return made(error=str(error), warned=warned)
        except Exception as error:
            message = f"{type(error).__name__}: {error}"
            return made(error=message, trace=traceback.format_exc(), warned=warned)


def _quiet(fraction: float, doing: str = "") -> None:
    """Tell nobody."""
