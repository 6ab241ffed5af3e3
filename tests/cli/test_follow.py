"""Ctrl-C while events are followed."""

from __future__ import annotations

import signal
import weakref

import pytest

from fieldlink.cli.ask_daemon import _interrupted


class _Connection:
    """What can be referred to weakly."""


def test_ctrl_c_counts_where_an_exception_would_be_lost() -> None:
    before = signal.getsignal(signal.SIGINT)
    with _interrupted() as stop:
        connection = _Connection()
        cleared = weakref.ref(connection, lambda _: signal.raise_signal(signal.SIGINT))
        assert not stop.is_set()
        del connection
        assert cleared() is None
        assert stop.wait(0.0)
        # What hangs in spite of the first one ends with the second.
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_what_a_shell_runs_in_the_background_goes_on() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with _interrupted() as stop:
            signal.raise_signal(signal.SIGINT)
            assert not stop.is_set()
    finally:
        signal.signal(signal.SIGINT, before)
