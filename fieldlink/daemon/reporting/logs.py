"""Logging of the command line: one line an event, on stderr, so that stdout stays for results.

Whatever an event carries, it stays in its line, and what looks like a password in an address does
not appear.
"""

from __future__ import annotations

import logging
import re
import sys
from collections.abc import MutableMapping
from typing import Any

import structlog

from fieldlink.printable import as_printable

__all__ = ["configure_logging", "hide_secrets"]

_PASSWORD = re.compile(r"(\w+://[^\s:/@\"']*):[^\s\"']+@")
"""Up to the last @ of a word, because a password may hold / and @."""
_TOKEN = re.compile(r"(?i)(\bbearer\s+|(?:password|passwd|token)[\"']?\s*([=:])\s*)([^\s;,]{6,})")
_IN_A_FOLDER = re.compile(r"/[^\s/?&]*\Z")
"""The end of a path: ``/data/operator-token: ...`` says what happened to a file of that name."""


def configure_logging(level: int = logging.INFO) -> None:
    """Send the project's events to stderr as ``key=value`` lines, coloured on a terminal.

    What pymodbus, APScheduler and psycopg log, the daemon counts and says itself.
    """
    renderer: structlog.typing.Processor = (
        structlog.dev.ConsoleRenderer()
        if sys.stderr.isatty()
        else structlog.processors.LogfmtRenderer(
            key_order=["timestamp", "level", "event"], drop_missing=True
        )
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            _one_line,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        # looked up at every event: who replaces stderr gets what follows
        logger_factory=lambda *_: _LINES,
        cache_logger_on_first_use=False,
    )
    logging.basicConfig(
        level=logging.WARNING, stream=sys.stderr, format="level=%(levelname)s event=%(message)r"
    )
    logging.getLogger().handlers[0].addFilter(_without_secrets)
    for library in ("pymodbus.logging", "apscheduler", "psycopg"):
        logging.getLogger(library).setLevel(logging.CRITICAL)


class _Lines:
    """Writes lines to stderr; a log that cannot be written ends nothing.

    Lines that were lost, on a full disk or with a reader of the pipe that is gone, are counted and
    said as soon as a line can be written again.
    """

    def __init__(self) -> None:
        self._lost = 0
        self._why = ""

    def msg(self, line: str) -> None:
        """Write one line."""
        if self._lost:
            line = f'level=warning event=log.lost lines={self._lost} error="{self._why}"\n{line}'
        try:
            print(line, file=sys.stderr, flush=True)
        except OSError as error:
            self._lost += 1
            self._why = error.strerror or type(error).__name__
        else:
            self._lost = 0

    log = debug = info = warn = warning = msg
    fatal = failure = err = error = critical = exception = msg


_LINES = _Lines()


def _one_line(_: object, __: str, event: MutableMapping[str, Any]) -> MutableMapping[str, Any]:
    for key, value in event.items():
        if isinstance(value, str):
            event[key] = hide_secrets(as_printable(value))
    return event


def _without_secrets(record: logging.LogRecord) -> bool:
    record.msg, record.args = hide_secrets(record.getMessage()), ()
    return True


def hide_secrets(text: str) -> str:
    """Put stars in place of what looks like a password or a token."""
    return _TOKEN.sub(_starred, _PASSWORD.sub(r"\1:***@", text))


def _starred(match: re.Match[str]) -> str:
    if match[2] == ":" and _IN_A_FOLDER.search(match.string[: match.start()]):
        return match[1] + hide_secrets(match[3])
    return f"{match[1]}***"
