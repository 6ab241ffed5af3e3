"""Moments and lengths of time on the command line."""

from __future__ import annotations

import re
from datetime import UTC, datetime

import typer

__all__ = ["parse_length", "parse_moment"]

_UNITS = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "w": 604800.0}
_LENGTH = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]*)", re.IGNORECASE)


def parse_moment(text: str | None, option: str) -> datetime | None:
    """Return a moment, UTC without zone; None for None.

    Raises:
        typer.BadParameter: it is not a moment.
    """
    if text is None:
        return None
    try:
        moment = datetime.fromisoformat(text)
        if moment.tzinfo is not None:
            # not past the first or the last year there either
            moment.astimezone(UTC)
    except (ValueError, OverflowError) as error:
        raise typer.BadParameter(
            f"{text!r} is not a moment; write 2026-11-21 or 2026-11-21T06:00:00+00:00",
            param_hint=option,
        ) from error
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def parse_length(text: str | None, option: str) -> float | None:
    """Return seconds from text such as ``1d``, ``8h`` or ``900``; None for None.

    Raises:
        typer.BadParameter: it is not a length of time above 0.
    """
    if text is None:
        return None
    found = _LENGTH.fullmatch(text.strip())
    unit = None if found is None else _UNITS.get(found[2].lower())
    if found is None or unit is None or not float(found[1]) > 0.0:
        raise typer.BadParameter(
            f"{text!r} is not a length of time; write 1d, 8h, 30min or 900s", param_hint=option
        )
    return float(found[1]) * unit
