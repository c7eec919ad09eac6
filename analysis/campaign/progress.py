"""Show the progress of a run at a terminal."""

import math
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self, TextIO

if TYPE_CHECKING:
    from chamfer.analysis.scenario.experiment import Progress

_COLUMNS: Final = 80  # of a terminal that doesn't say, or says 0


@dataclass
class TerminalProgress:
    """One line that is kept up to date while the block runs, and wiped afterwards.

    Nothing is written during the first second, or if the stream is not a terminal. A separate
    thread writes, so that the time goes on through a step that reports nothing, and a report
    costs the run two assignments.
    """

    label: str  # of the run
    stream: TextIO = field(default_factory=lambda: sys.stderr)
    delay: float = 1.0  # s, how long to stay silent
    interval: float = 0.2  # s, how long a line stands before the next one

    def __post_init__(self) -> None:
        self._fraction = math.nan
        self._doing = ""
        self._started = 0.0
        self._width = 0
        self._ended = threading.Event()
        self._writing = threading.RLock()
        self._thread = threading.Thread(target=self._draw, daemon=True)

    def __enter__(self) -> Self:
        """Start to write, if the stream is a terminal."""
        self._started = time.monotonic()
        if self.stream.isatty():
            self._thread.start()
        return self

    def __call__(self, fraction: float, doing: str = "") -> None:
        """Report the fraction done, 0 to 1 or NaN, and the present step in a few words."""
        self._fraction = fraction
        self._doing = doing

    def __exit__(self, *_: object) -> None:
        """Wipe the line."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Keep the line away while the block writes to the same terminal."""
        with self._writing:
            with suppress(OSError):
                self._wipe()
            yield

    def _draw(self) -> None:
        wait = self.delay
        with suppress(OSError):  # the terminal has gone, which is no reason to stop the run
            while not self._ended.wait(wait):
                with self._writing:
                    self._write(self._line())
                wait = self.interval
            self._wipe()

    def _wipe(self) -> None:
        if self._width:
            self._write("")
            self.stream.write("\r")
            self.stream.flush()

    def _line(self) -> str:
        parts = [self.label]
        if not math.isnan(self._fraction):
            parts.append(f"{100 * min(max(self._fraction, 0.0), 1.0):.0f} %")
        if self._doing:
            parts.append(self._doing)
        parts.append(f"{time.monotonic() - self._started:.0f} s")
        return "  ".join(parts)

    def _write(self, line: str) -> None:
        try:
            columns = os.get_terminal_size(self.stream.fileno()).columns or _COLUMNS
        except OSError:
            columns = _COLUMNS
        line = line[: max(columns - 1, 1)]
        self.stream.write("\r" + line.ljust(self._width))
        self.stream.flush()
        self._width = len(line)


@dataclass
class TrialProgress:
    """Shows how many trials are done and how many failed, the speed, and the remaining time."""

    progress: "Progress"  # that is shown
    count: int  # of all trials
    before: int = 0  # that had ended already: they do not count in the speed

    def __post_init__(self) -> None:
        self._done = self.before
        self._failed = 0
        self._started = time.monotonic()

    def add(self, *, done: int = 0, failed: int = 0) -> None:
        """Count further trials and show them."""
        self._done += done
        self._failed += failed
        ended = self._done + self._failed
        parts = [f"{self._done} of {self.count}"]
        if self._failed:
            parts.append(f"{self._failed} failed")
        rate = (ended - self.before) / max(time.monotonic() - self._started, 1e-9)
        if ended < self.count and rate > 0:
            parts.append(f"{rate:.0f}/s" if rate >= 10 else f"{rate:.2g}/s")
            parts.append(f"{duration((self.count - ended) / rate)} left")
        self.progress(ended / self.count, ", ".join(parts))


def duration(seconds: float) -> str:
    """Return a time in a suitable unit."""
    for unit, length in (("h", 3600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"
