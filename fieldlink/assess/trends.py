"""The course of a loop's stick band over its windows: a small picture, and a slope."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["NEWEST", "Mark", "Trend", "after_repair", "thirty_days", "trend_of"]

WIDTH, HEIGHT, EDGE = 180.0, 36.0, 3.0
"""Of the picture, in its own units; the template has the same."""

NEWEST = 3
"""Judged windows in a row that make a verdict a state of the valve, as in the work list."""

FEWEST = 5
"""Windows for a slope: with fewer, Theil and Sen have no 90 % interval."""

MONTH = 30.0 * 86400.0


@dataclass(frozen=True, slots=True)
class Mark:
    """A window in the picture; ``kind`` is its class in the page's style."""

    x: float
    y: float
    kind: str


@dataclass(frozen=True, slots=True)
class Trend:
    """A picture: the points of the line and of the band around it, and the marks."""

    line: str
    band: str
    marks: tuple[Mark, ...]
    words: str


def trend_of(windows: Sequence[Mapping[str, Any]]) -> Trend | None:
    """Return the picture of a loop's windows, oldest first; None with fewer than two verdicts."""
    judged = [row for row in windows if row["verdict"] is not None]
    if len(judged) < 2:
        return None
    sticky = [row for row in judged if row["verdict"] == "stiction"]
    top = max((row["stick_band_high"] or row["stick_band"] or 0.0 for row in sticky), default=0.0)
    step = (WIDTH - 2.0 * EDGE) / (len(judged) - 1)

    def height(value: float) -> float:
        return round(HEIGHT - EDGE - (HEIGHT - 2.0 * EDGE) * value / (top or 1.0), 1)

    marks, line, upper, lower = [], [], [], []
    for number, row in enumerate(judged):
        x = round(EDGE + number * step, 1)
        if row["verdict"] != "stiction" or row["stick_band"] is None:
            kind = "none" if row["verdict"] == "no_stiction" else "open"
            marks.append(Mark(x, height(0.0), kind))
            continue
        value = row["stick_band"]
        low, high = (row[f"stick_band_{end}"] for end in ("low", "high"))
        marks.append(Mark(x, height(value), "dot"))
        line.append(f"{x},{height(value)}")
        upper.append(f"{x},{height(value if high is None else high)}")
        lower.append(f"{x},{height(value if low is None else low)}")
    words = f"{len(sticky)} of {len(judged)} windows sticky; S from 0 to {top:.3g}"
    return Trend(" ".join(line), " ".join([*upper, *lower[::-1]]), tuple(marks), words)


def after_repair(windows: Sequence[Mapping[str, Any]]) -> Sequence[Mapping[str, Any]]:
    """Return the windows behind the last repair, oldest first; all of them where there was none.

    A repair is where a valve that stuck in some judged windows in a row sticks in none of as many,
    as in the work list: what the stick band did before it says nothing of the valve as it is.
    """
    judged = [k for k, row in enumerate(windows) if row["verdict"] in ("stiction", "no_stiction")]
    sticks = [windows[k]["verdict"] == "stiction" for k in judged]
    for k in range(len(judged) - NEWEST, NEWEST - 1, -1):
        if all(sticks[k - NEWEST : k]) and not any(sticks[k : k + NEWEST]):
            return windows[judged[k] :]
    return windows


def thirty_days(course: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """Return the change of a quantity in 30 days with its 90 % interval; None with too few points.

    Args:
        course: seconds and values, shape ``(n, 2)``.

    Source: Theil (1950) and Sen (1968), as in SciPy.
    """
    if len(course) < FEWEST:
        return None
    # Here, because only this figure needs it.
    from scipy.stats import theilslopes

    found = theilslopes(course[:, 1], course[:, 0] / MONTH, alpha=0.9)
    return float(found.slope), float(found.low_slope), float(found.high_slope)
