"""Asking once stops in order, asking twice at once."""

import signal

import pytest

from chamfer.analysis.track.tracking import stop_request


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_asks_and_the_second_interrupts(sent: signal.Signals) -> None:
    # A parent that ignores interrupts, as nohup does, hands that on.
    before = signal.signal(sent, signal.default_int_handler)
    try:
        with stop_request() as stopped:
            assert not stopped()
            signal.raise_signal(sent)
            assert stopped()
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(sent)
        assert signal.getsignal(sent) is signal.default_int_handler
    finally:
        signal.signal(sent, before)


def test_what_is_ignored_stays_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with stop_request() as stopped:
            signal.raise_signal(signal.SIGINT)
            assert not stopped()
    finally:
        signal.signal(signal.SIGINT, before)
