"""Keeps what laws saw and answered while a run lasts."""

import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.law import Law, Signal

AnyLaw = Law[Any, Any, Any]


class Record(NamedTuple):
    """One step of a law."""

    time: float  # s
    observation: Mapping[str, Any]  # vectors by name, None where there was none
    command: Mapping[str, Any]


def signals(law: AnyLaw) -> dict[str, Signal]:
    """Return what a law reads and gives by their names in a log: ``observation.error``."""
    named = {f"observation.{name}": signal for name, signal in law.inputs.items()}
    return named | {f"command.{name}": signal for name, signal in law.outputs.items()}


class Records:
    """The steps of one run of a law, in order, at 8 bytes a number."""

    def __init__(self, law: AnyLaw, records: Iterable[Record] = ()) -> None:
        self.law = law
        self._sizes = {name: one.size for name, one in signals(law).items()}
        self._missing = {name: array("q") for name in signals(law)}
        self._width = 1 + sum(self._sizes.values())
        self._numbers = array("d")
        for record in records:
            self.append(record)

    def append(self, record: Record) -> None:
        """Keep a step.

        Raises:
            ValueError: If a vector has another size than its signal.
        """
        row = [record.time]
        seen = map(record.observation.get, self.law.inputs)
        answered = map(record.command.get, self.law.outputs)
        vectors = zip(self._sizes.items(), chain(seen, answered), strict=True)
        for (name, size), value in vectors:
            if value is None:
                self._missing[name].append(len(self))
                row += [math.nan] * size
            else:
                numbers = value.tolist() if isinstance(value, np.ndarray) else value
                if len(numbers) != size:
                    raise ValueError(f"{name} is {numbers}, must be {size} numbers")
                row += numbers
        self._numbers.extend(row)

    def __len__(self) -> int:
        return len(self._numbers) // self._width

    def __iter__(self) -> Iterator[Record]:
        sides: dict[str, dict[str, Any]] = {"observation": {}, "command": {}}
        for name, values, missing in self.vectors():
            side, _, own = name.partition(".")
            sides[side][own] = [
                None if lacks else vector for vector, lacks in zip(values, missing, strict=True)
            ]
        for i, time in enumerate(self.times.tolist()):
            yield Record(
                time,
                *({name: rows[i] for name, rows in side.items()} for side in sides.values()),
            )

    @property
    def last(self) -> float:
        """The time of the last step, s."""
        return self._numbers[-self._width]

    @property
    def times(self) -> NDArray[np.float64]:
        """The times of the steps, s."""
        return np.array(self._numbers[:: self._width])

    def vectors(self) -> Iterator[tuple[str, NDArray[np.float64], NDArray[np.bool_]]]:
        """Yield each signal's name in a log, its vectors, a row a step, and where it is missing.

        There its numbers are NaN.
        """
        table, first = np.array(self._numbers).reshape(-1, self._width), 1
        for name, size in self._sizes.items():
            lacks = np.zeros(len(self), dtype=np.bool_)
            lacks[self._missing[name]] = True
            yield name, table[:, first : first + size], lacks
            first += size


class Recorder:
    """The steps of every law, by the path of its block in the diagram, a run after the other."""

    def __init__(self) -> None:
        self.runs: dict[str, list[Records]] = {}
        self._current: dict[Any, Records] = {}  # by the block

    def note(self, block: Any, law: AnyLaw, record: Record, *, begins: Callable[[], bool]) -> None:
        """Keep a step of a block's law.

        A time that goes back begins another run, as does one that stays where ``begins`` tells
        that the state was the first: a block may step twice at its start.
        """
        records = self._current.get(block)
        if (
            records is None
            or record.time < records.last
            or (record.time == records.last and begins())
        ):
            records = self._current[block] = Records(law)
            self.runs.setdefault(block.path, []).append(records)
        records.append(record)


_active: list[Recorder | None] = []


def active() -> Recorder | None:
    """Return what records now, if anything does."""
    return _active[-1] if _active else None


@contextmanager
def recorded() -> Iterator[Recorder]:
    """Record every step of every law in this process while the block lasts."""
    recorder = Recorder()
    _active.append(recorder)
    try:
        yield recorder
    finally:
        _active.pop()


@contextmanager
def unrecorded() -> Iterator[None]:
    """Record no step while the block lasts: a loop is probed there, not run."""
    _active.append(None)
    try:
        yield
    finally:
        _active.pop()
