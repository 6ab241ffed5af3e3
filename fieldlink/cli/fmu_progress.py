"""How far a run of an FMU, or a sweep, has got."""

from __future__ import annotations

import sys
import time
from typing import Any

import typer

__all__ = ["FmuProgress"]


class FmuProgress:
    """The second that was reached: a live line on a terminal, else a line every half minute."""

    _SECONDS = 30.0

    def __init__(self, name: str, stop: float | None = None) -> None:
        self._name = name
        self._of = "" if stop is None else f" of {stop:g} s"
        self._status: Any = None
        self._shown = time.monotonic()

    def __enter__(self) -> FmuProgress:
        if sys.stderr.isatty():
            from rich.console import Console

            self._status = Console(stderr=True).status(f"{self._name}: starting")
            self._status.start()
        return self

    def __call__(self, moment: float) -> None:
        """Show the second that was reached."""
        self._show(f"{self._name}: {moment:g} s{self._of}")

    def count(self, done: int, of: int) -> None:
        """Show how many runs are done."""
        self._show(f"{self._name}: {done} of {of} runs")

    def _show(self, text: str) -> None:
        if self._status is not None:
            self._status.update(text)
        elif time.monotonic() > self._shown + self._SECONDS:
            self._shown = time.monotonic()
            typer.echo(text, err=True)

    def __exit__(self, *_: object) -> None:
        if self._status is not None:
            self._status.stop()
