"""Tells someone who waits at a terminal how far a run is."""

import os
import sys
import threading
import time
from types import TracebackType
from typing import Final, Self, TextIO

_COLUMNS: Final = 80  # of a terminal that doesn't say, or says 0


class TerminalProgress:
    """One line that is kept up to date while the block runs, and wiped at its end.

    Nothing is written during the first second, or if the stream is not a terminal. A thread of
    its own writes, so that the time goes on through a step that reports nothing, and a report
    costs the run two assignments.

    Args:
        label: What is running.
        stream: Where to write, standard error unless given.
        delay: How long to stay silent, s.
        interval: How long a line stands before the next one, s.
    """

    def __init__(
        self,
        label: str,
        stream: TextIO | None = None,
        *,
        delay: float = 1.0,
        interval: float = 0.2,
    ) -> None:
        self._label = label
        self._stream = sys.stderr if stream is None else stream
        self._delay = delay
        self._interval = interval
        self._fraction: float | None = None
        self._doing = ""
        self._started = 0.0
        self._width = 0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._draw, daemon=True)

    def __enter__(self) -> Self:
        """Start to write, if someone is there to read."""
        self._started = time.monotonic()
        if self._stream.isatty():
            self._thread.start()
        return self

    def __call__(self, fraction: float, doing: str = "") -> None:
        """Report the fraction done, 0 to 1, and in a few words what is being done."""
        self._fraction = fraction
        self._doing = doing

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Wipe the line."""
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()

    def _draw(self) -> None:
        wait = self._delay
        try:
            while not self._ended.wait(wait):
                self._write(self._line())
                wait = self._interval
            if self._width:
                self._write("")
                self._stream.write("\r")
                self._stream.flush()
        except OSError:
            return  # the terminal has gone, which is no reason to stop the run

    def _line(self) -> str:
        parts = [self._label]
        if self._fraction is not None:
            parts.append(f"{100 * min(max(self._fraction, 0.0), 1.0):.0f} %")
        if self._doing:
            parts.append(self._doing)
        parts.append(f"{time.monotonic() - self._started:.0f} s")
        return "  ".join(parts)

    def _write(self, line: str) -> None:
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns or _COLUMNS
        except OSError:
            columns = _COLUMNS
        line = line[: max(columns - 1, 1)]
        self._stream.write("\r" + line.ljust(self._width))
        self._stream.flush()
        self._width = len(line)
