"""Keeps what laws saw and answered while a run lasts."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, NamedTuple


class Record(NamedTuple):
    """One step of a law."""

    time: float  # s
    observation: Mapping[str, Any]  # vectors by name, None where there was none
    command: Mapping[str, Any]


@dataclass
class Recorder:
    """The steps of every law, by the path of its block in the diagram and the run's number."""

    records: dict[tuple[str, int], list[Record]] = field(default_factory=dict)
    laws: dict[tuple[str, int], Any] = field(default_factory=dict)
    _runs: dict[int, tuple[str, int]] = field(default_factory=dict)  # by the block's identity

    def note(self, block: Any, law: Any, record: Record) -> None:
        """Keep a step; a time that does not go on begins another run."""
        key = self._runs.get(id(block))
        if key is None or record.time <= self.records[key][-1].time:
            path = block.GetSystemPathname().strip(":")
            key = path, sum(1 for name, _ in self.records if name == path)
            self._runs[id(block)] = key
            self.records[key], self.laws[key] = [], law
        self.records[key].append(record)


_active: list[Recorder] = []


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
        _active.remove(recorder)
