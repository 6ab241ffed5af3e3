"""Findings in words: one sentence for an event, a page or a notice."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Protocol

__all__ = ["describe_finding", "describe_follow_up", "join_names", "moment_text"]

MOST_NAMES = 6
"""Loops that a sentence names; more are counted."""


class Described(Protocol):
    """The parts of a finding that its sentence uses."""

    @property
    def cause(self) -> str:
        """Name of the cause."""
        ...

    @property
    def loop(self) -> str:
        """The loop that has it; empty for none."""
        ...

    @property
    def loops(self) -> Sequence[str]:
        """All loops that swing because of it."""
        ...

    @property
    def swing_period_s(self) -> float | None:
        """Period of the oscillation in seconds."""
        ...


def join_names(names: Sequence[str]) -> str:
    """Return names as a list in words, a long one shortened."""
    shown = list(names)
    if len(shown) > MOST_NAMES:
        rest = len(shown) - MOST_NAMES
        shown = [*shown[:MOST_NAMES], f"{rest} more"]
    if len(shown) < 2:
        return "".join(shown)
    return f"{', '.join(shown[:-1])} and {shown[-1]}"


def describe_finding(found: Described) -> str:
    """Return what a finding is about: ``candidate A: sticky valve; B swings with it every 9 s``."""
    cause = found.cause.replace("_", " ")
    period = "" if found.swing_period_s is None else f" every {_seconds_text(found.swing_period_s)}"
    others = [name for name in found.loops if name != found.loop]
    if not others:
        return f"{found.loop}: {cause}" + (f", swings{period}" if period else "")
    if not found.loop:
        return f"{join_names(others)} swing together{period}; the source is none of them"
    swing = "swings" if len(others) == 1 else "swing"
    candidate = "" if found.cause == "undetermined" else f": {cause}"
    return f"candidate {found.loop}{candidate}; {join_names(others)} {swing} with it{period}"


def _seconds_text(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds >= 10.0 else f"{seconds:.2g} s"


def describe_follow_up(
    loop: str, what: str, utc_ms: int, calm: Sequence[str], swinging: Sequence[str]
) -> str:
    """Return what the others did after the candidate was repaired or put in manual."""
    begin = f"since {loop} was {what} ({moment_text(utc_ms)})"
    if not swinging:
        return f"{begin}, {join_names(calm)} no longer {_verb(calm, 'swing')}: it was the source"
    if not calm:
        return f"{begin}, {join_names(swinging)} still {_verb(swinging, 'swing')}: look elsewhere"
    return (
        f"{begin}, {join_names(calm)} no longer {_verb(calm, 'swing')}; {join_names(swinging)} "
        f"still {_verb(swinging, 'do')}: another source may be there too"
    )


def moment_text(utc_ms: int) -> str:
    """Return a moment to the minute, UTC."""
    return f"{datetime.fromtimestamp(utc_ms / 1000.0, UTC):%Y-%m-%d %H:%M} UTC"


def _verb(names: Sequence[str], verb: str) -> str:
    if len(names) > 1:
        return verb
    return "does" if verb == "do" else f"{verb}s"
