"""Answer signals that come before the event loop runs: a service stopped while it loads ends.

Loading takes half a second, and minutes where the kernels are compiled first. Without this module
SIGTERM or SIGHUP would kill Python meanwhile, and SIGINT would print a traceback. This module
imports nothing that takes time.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from types import FrameType

__all__ = ["heed_early_signals"]

_SERVICES = ("run", "plant", "compensate", "web")


def heed_early_signals(arguments: Sequence[str]) -> None:
    """Let SIGTERM and SIGINT end a service in order, and SIGHUP do nothing yet, from now on.

    Args:
        arguments: the program's; other commands than services keep Python's own answers.
    """
    command = arguments[1] if len(arguments) > 1 else ""
    if command not in _SERVICES:
        return
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _stop)
    if command == "run" and hasattr(signal, "SIGHUP"):
        # The site file is about to be read anyway.
        signal.signal(signal.SIGHUP, _wait)


def _stop(_number: int, _frame: FrameType | None) -> None:
    sys.stderr.write("fieldlink: stopped before it had started\n")
    sys.unraisablehook = _end
    raise SystemExit(0)


def _end(lost: sys.UnraisableHookArgs) -> None:
    """End at once where the order to stop came inside a callback of C code, which loses it.

    A compiler at work calls back often, and fails later without the answer.
    """
    if not isinstance(lost.exc_value, SystemExit):
        sys.__unraisablehook__(lost)
        return
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def _wait(_number: int, _frame: FrameType | None) -> None:
    """Do nothing."""
