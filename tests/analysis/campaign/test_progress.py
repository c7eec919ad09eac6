import io
import os
import time

import pytest

from chamfer.analysis.campaign.progress import TerminalProgress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class ClosedTerminal(Terminal):
    def write(self, text: str) -> int:
        raise OSError("gone")


def wait_for(stream: Terminal, text: str) -> None:
    until = time.monotonic() + 60
    while text not in stream.getvalue():
        assert time.monotonic() < until, f"{text!r} not in {stream.getvalue()!r}"
        time.sleep(0.005)


def screen(written: str) -> str:
    """Return what a terminal shows: a carriage return goes back, and text overwrites."""
    line: list[str] = []
    for part in written.split("\r"):
        line[: len(part)] = part
    return "".join(line).rstrip()


def test_line_says_what_runs_how_far_it_is_and_what_it_does() -> None:
    stream = Terminal()
    with TerminalProgress("step-response", stream, delay=0.0, interval=0.01) as progress:
        progress(0.456, "falling")
        wait_for(stream, "step-response  46 %  falling  0 s")
        progress(0.5, "up")
        wait_for(stream, "50 %  up")
        assert "falling" not in screen(stream.getvalue())  # what was longer is overwritten
    assert screen(stream.getvalue()) == ""
    assert "\n" not in stream.getvalue()


def test_long_lines_don_t_wrap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.get_terminal_size", lambda _: os.terminal_size((0, 0)))
    stream = Terminal()  # of no size: taken for a usual one
    monkeypatch.setattr(stream, "fileno", lambda: 2)
    with TerminalProgress("a" * 200, stream, delay=0.0, interval=0.01):
        wait_for(stream, "a" * 79)
    assert "a" * 80 not in stream.getvalue()


@pytest.mark.parametrize(("stream", "delay"), [(Terminal(), 1.0), (io.StringIO(), 0.0)])
def test_silent_at_first_and_where_nobody_watches(stream: io.StringIO, delay: float) -> None:
    with TerminalProgress("a", stream, delay=delay, interval=0.01) as progress:
        progress(0.5, "falling")
        time.sleep(0.05)
    assert stream.getvalue() == ""


def test_a_terminal_that_goes_away_does_not_stop_the_run() -> None:
    with TerminalProgress("a", ClosedTerminal(), delay=0.0, interval=0.01) as progress:
        time.sleep(0.05)
        progress(1.0)
