"""The streams that a command is started with, any of which may be closed, full or abandoned."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class OutputError(Exception):
    """Standard output can't be written; ``__cause__`` says why."""


class _Output(io.TextIOWrapper):
    """Standard output whose failures differ from those of files."""

    def write(self, text: str) -> int:
        with _named():
            return super().write(text)

    def flush(self) -> None:
        with _named():
            super().flush()


def prepare_streams() -> None:
    """Give standard streams that are closed to the null device, and standard output its error.

    A script that closes one wants to hear nothing of it; but left closed its number goes to the
    next file that is opened, which then gets what libraries say. A character that a terminal
    lacks is written as its escape.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
            os.set_inheritable(number, True)
    if sys.stdout is None:
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), write_through=True)
    if sys.stderr is None:
        sys.stderr = io.TextIOWrapper(io.FileIO(2, "w", closefd=False), write_through=True)
    if type(sys.stdout) is io.TextIOWrapper:
        ways = (sys.stdout.line_buffering, sys.stdout.write_through)
        encoding = sys.stdout.encoding
        sys.stdout = _Output(sys.stdout.detach(), encoding, "backslashreplace", None, *ways)


def discard_output() -> None:
    """Let the null device have what standard output could not take.

    The interpreter flushes it once more when it exits.
    """
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _named() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(error.strerror) from error
