"""Runs experiments side by side in worker processes, which write their folders themselves.

What had ended before with the same sources, seed and scenario is kept. The quick ones come first,
so that there is soon something to see, then the longest, so that no core waits at the end.

An experiment that needs trials asks for them and is begun anew when they have run: then it finds
them in its folder, as it does after an interrupt. So all share the same workers, no process waits
for another one, and the main process holds no results.
"""

import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from chamfer.analysis.campaign.campaign import Campaign, TrialsWantedError
from chamfer.analysis.campaign.progress import duration
from chamfer.analysis.campaign.workers import Engine, LostError, StartError
from chamfer.analysis.command.running import finished, prepare, run, trials_path
from chamfer.analysis.scenario.errors import ExperimentError, UserError
from chamfer.analysis.scenario.experiment import Catalogue, Entry, Progress

_TRIES: Final = 2  # of an experiment whose process dies
_QUICK: Final = 5.0  # s, what an experiment may take that is among the first


@dataclass(frozen=True, kw_only=True)
class Order:
    """An experiment to run with its default scenario."""

    entry: Entry
    catalogue: Catalogue
    seed: int
    out: Path
    fresh: bool  # whether to run it again if it had ended before


@dataclass(frozen=True, kw_only=True)
class Ended:
    """What became of an experiment: its result, or the error that ended it."""

    entry: Entry
    result: dict[str, Any] | None = None  # its document
    error: str = ""  # in one line
    trace: str = ""  # where the error is a bug
    kept: bool = False  # it had ended before
    warned: Sequence[warnings.WarningMessage] = ()


class SideBySide:
    """Experiments that run at the same time.

    Args:
        here: Where they run, with access to the results' folder.
        trials: Where their trials run, which may be the same.
        progress: Told how many experiments have ended.
    """

    def __init__(self, *, here: Engine, trials: Engine, progress: Progress) -> None:
        self._here = here
        self._trials = trials
        self._progress = progress
        self._began = time.monotonic()
        self._orders: Sequence[Order] = ()
        self._ended: list[Ended] = []

    def run(self, orders: Sequence[Order]) -> Generator[Ended]:
        """Yield what becomes of each experiment when it has ended."""
        self._orders = orders
        turns = sorted(orders, key=lambda order: _turn(order.entry.seconds))
        with ThreadPoolExecutor(max(1, len(orders))) as threads:
            try:
                for future in as_completed([threads.submit(self._conduct, one) for one in turns]):
                    self._ended.append(future.result())
                    yield self._ended[-1]
            except BaseException:
                self._here.close()
                self._trials.close()
                raise

    def _conduct(self, order: Order) -> Ended:
        name = order.entry.name
        path, processors = trials_path(order.out, name), self._trials.processors()
        began, fresh, lost = time.monotonic(), order.fresh, 0
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
        done = self._seconds(one.entry for one in self._ended)
        whole = self._seconds(order.entry for order in self._orders)
        self._progress(done / whole, f"{self.status()}, {name} {doing}")

    def status(self) -> str:
        """Return how many experiments have ended, and how long the others may take."""
        count, ended = len(self._orders), len(self._ended)
        text = f"{ended} of {count}"
        run = [one.entry for one in self._ended if not one.kept]
        left = self._seconds(order.entry for order in self._orders)
        left -= self._seconds(one.entry for one in self._ended)
        if ended == count or not run:
            return text
        pace = (time.monotonic() - self._began) / self._seconds(run)
        return f"{text}, about {duration(left * pace)} left"

    @staticmethod
    def _seconds(entries: Iterable[Entry]) -> float:
        return sum(entry.seconds for entry in entries)


def _turn(seconds: float) -> tuple[bool, float]:
    long = seconds > _QUICK
    return long, -seconds if long else seconds


def _perform(order: Order, make_campaign: Callable[[], Campaign]) -> Ended | TrialsWantedError:
    """Run an experiment up to its end or the first trials that have neither ended nor failed."""
    made = partial(Ended, entry=order.entry)
    with warnings.catch_warnings(record=True) as warned, closing(make_campaign()) as campaign:
        try:
            (job,) = prepare([order.entry], catalogue=order.catalogue)
            if not order.fresh and (result := finished(job, seed=order.seed, out=order.out)):
                return made(result=result, kept=True)
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
