"""Times of several engines, taken in turns so that a busy machine is busy for all of them."""

import gc
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import perf_counter

from chamfer.analysis.benchmarks.engine import Engine


@dataclass
class Times:
    """What was measured of one engine, s, a value per round."""

    trials: int = 1  # of a round
    building: list[float] = field(default_factory=list)
    running: list[float] = field(default_factory=list)

    @property
    def rounds(self) -> int:
        """How many rounds have been measured."""
        return len(self.running)

    @property
    def build(self) -> float | None:
        """Median time of building the model, s, or None before the first round."""
        return statistics.median(self.building) if self.building else None

    @property
    def run(self) -> float | None:
        """Median time of a trial from the model to the arrays of results, s."""
        return statistics.median(self.running) / self.trials if self.running else None

    @property
    def least(self) -> float | None:
        """Least time of a trial from the model to the arrays of results, s."""
        return min(self.running) / self.trials if self.running else None

    @property
    def spent(self) -> float:
        """Time spent so far, s."""
        return sum(self.building) + sum(self.running)


def interleave(
    engines: Sequence[Engine],
    times: dict[str, Times],
    *,
    rounds: int,
    share: float,
    clock: Callable[[], float] = perf_counter,
) -> None:
    """Run the engines in turns.

    Every round begins with another engine, so that none always follows the same one. An engine
    that would exceed its share of the time sits the rest out, after one round at least.

    Args:
        engines: Which ones; their names are the keys of ``times``.
        times: Is filled as the rounds go, so that an interrupt leaves what there is.
        rounds: How many.
        share: s, for each engine.
        clock: Gives the time, s.
    """
    for engine in engines:
        times.setdefault(engine.name, Times(trials=engine.trials))
    for number in range(rounds):
        first = number % len(engines)
        for engine in (*engines[first:], *engines[:first]):
            taken = times[engine.name]
            if taken.rounds and taken.spent * (1 + 1 / taken.rounds) > share:
                continue
            gc.collect()
            start = clock()
            model = engine.build()
            built = clock()
            engine.run(model)
            end = clock()
            taken.building.append(built - start)
            taken.running.append(end - built)


def ratio(time: float | None, reference: float | None) -> float | None:
    """Return how many times longer than the reference, or None if one is missing."""
    return None if time is None or not reference else time / reference
