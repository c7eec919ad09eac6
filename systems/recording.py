"""Keeps inputs and outputs of laws while a run lasts."""

import math
from array import array
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from typing import Any, NamedTuple

from chamfer.systems.law import Law

AnyLaw = Law[Any, Any, Any]


class Record(NamedTuple):
    """One step of a law."""

    time: float  # s
    observation: Mapping[str, Any]  # vectors by name, None where there was none
    command: Mapping[str, Any]


class Records:
    """The steps of one run of a law, in order, at 8 bytes a number."""

    def __init__(self, law: AnyLaw) -> None:
        self.law = law
        self.last = -math.inf  # s, of the last step
        self._numbers = array(
            "d"
        )  # of each step its time, of each vector if it is missing, and it

    def append(self, record: Record) -> None:
        """Keep a step; its vectors have the sizes of the law's signals."""
        self.last = record.time
        self._numbers.append(record.time)
        for side, signals in zip(record[1:], (self.law.inputs, self.law.outputs), strict=True):
            for name, signal in signals.items():
                value = side.get(name)
                self._numbers.append(value is None)
                self._numbers.extend([math.nan] * signal.size if value is None else value)

    def __iter__(self) -> Iterator[Record]:
        numbers = iter(self._numbers)
        for time in numbers:
            seen, answered = (
                {name: _vector(numbers, signal.size) for name, signal in signals.items()}
                for signals in (self.law.inputs, self.law.outputs)
            )
            yield Record(time, seen, answered)


def _vector(numbers: Iterator[float], size: int) -> list[float] | None:
    missing, *vector = islice(numbers, 1 + size)
    return None if missing else vector


class Recorder:
    """The steps of every law, by the path of its block in the diagram, in consecutive runs."""

    def __init__(self) -> None:
        self.runs: dict[str, list[Records]] = {}
        self._current: dict[Any, Records] = {}  # by the block

    def note(self, block: Any, record: Record) -> None:
        """Keep a step of a block's law.

        A time that does not ascend begins another run; a block that steps at its start too has
        two steps at that time.
        """
        records = self._current.get(block)
        if (
            records is None
            or record.time < records.last
            or (record.time == records.last and not block.at_start)
        ):
            records = self._current[block] = Records(block.law)
            self.runs.setdefault(block.path, []).append(records)
        records.append(record)


_active: list[Recorder | None] = [None]


def active() -> Recorder | None:
    """Return the active recorder, if there is one."""
    return _active[-1]


@contextmanager
def recording(recorder: Recorder | None) -> Iterator[Recorder | None]:
    """Let a recorder keep every step of every law in this process while the block lasts.

    With None no step is kept, as where a loop is probed and not run.
    """
    _active.append(recorder)
    try:
        yield recorder
    finally:
        _active.pop()
