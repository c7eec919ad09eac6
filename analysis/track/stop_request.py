"""Ctrl-C as a request to stop, so that what is under way is completed."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_request() -> Iterator[Callable[[], bool]]:
    """Give a function that says whether the block has been asked to stop.

    The first Ctrl-C, or request to terminate, only asks; a second one interrupts the block where
    it is. A signal that the process ignores stays ignored.
    """
    asked = False
    before: dict[int, Any] = {}

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    if threading.current_thread() is threading.main_thread():
        before = {
            number: signal.signal(number, ask)
            for number in _SIGNALS
            if signal.getsignal(number) is not signal.SIG_IGN
        }
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
