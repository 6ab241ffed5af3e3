"""Self-starting CUSUM over estimates of uneven spread: has the valve changed, and since when?

Each window is compared with the mean of the windows before it, in units of what the two together
may differ by. Small steady differences add up where single windows say nothing. While they add up,
new windows wait before they enter the mean, and a wild one never enters: a change must not become
the norm that it is measured by. After an alarm everything starts again with the first window of the
change.

Source: Hawkins (1987), "Self-starting CUSUM charts for location and scale", The Statistician 36,
299-316; design k = 0.5, h = 5: Montgomery, "Introduction to Statistical Quality Control".
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

__all__ = ["Change", "ChangeKind", "find_changes"]

Array = NDArray[np.float64]

_SLACK, _ALARM = 0.5, 5.0
_CALM, _WILD = 0.5 * _ALARM, 3.5
"""Sums up to which windows enter the mean; how far off a single one never does. In control there
is an alarm in some 465 windows, as the design promises, with or without this rule."""


class ChangeKind(StrEnum):
    """Which way a series went."""

    INCREASE = "increase"
    DECREASE = "decrease"

    @property
    def advice(self) -> str:
        """What to do when the stick band of a valve changes this way."""
        return {
            ChangeKind.INCREASE: "The valve gets worse: plan its maintenance.",
            ChangeKind.DECREASE: "The valve got better: compare with the maintenance log.",
        }[self]


@dataclass(frozen=True, slots=True)
class Change:
    """A change: which way, the window it began with and the window that gave the alarm."""

    kind: ChangeKind
    onset: int
    alarm: int


def find_changes(value: Array, std: Array, *, reference: int = 5) -> tuple[Change, ...]:
    """Find all changes in a series.

    Args:
        value: estimates in order, shape ``(n,)``, NaN where there is none.
        std: their standard deviations, shape ``(n,)``, positive where there is a value.
        reference: windows that only set the first mean and the scatter.

    Returns:
        Changes in order; indices count all windows, those without a value included. The onset is
        the split of the windows up to the alarm into two means that is most likely.
    """
    known = np.flatnonzero(np.isfinite(value))
    changes: list[Change] = []
    begin = 0
    while (found := _first_change(value[known[begin:]], std[known[begin:]], reference)) is not None:
        changes.append(
            Change(found.kind, int(known[begin + found.onset]), int(known[begin + found.alarm]))
        )
        begin += found.onset
    return tuple(changes)


def _first_change(value: Array, std: Array, reference: int) -> Change | None:
    """The first change in a series without gaps; its onset never lies in the reference."""
    sums = {ChangeKind.INCREASE: 0.0, ChangeKind.DECREASE: 0.0}
    weight = 1.0 / std**2
    calm, waiting = list(range(min(reference, value.size))), list[int]()
    for k in range(reference, value.size):
        before = weight[calm]
        mean = float(np.sum(before * value[calm]) / np.sum(before))
        # Windows that scatter more than their intervals allow are not a change.
        scatter = float(np.sum(before * (value[calm] - mean) ** 2)) / (len(calm) - 1)
        spread = np.sqrt(max(1.0, scatter) * (std[k] ** 2 + 1.0 / np.sum(before)))
        step = float((value[k] - mean) / spread)
        for kind, sign in ((ChangeKind.INCREASE, 1.0), (ChangeKind.DECREASE, -1.0)):
            # One wild window must not give the alarm alone.
            sums[kind] = max(0.0, sums[kind] + min(sign * step, _ALARM - _SLACK) - _SLACK)
            if sums[kind] > _ALARM:
                return Change(kind, _split(value[: k + 1], weight[: k + 1], reference), k)
        if abs(step) < _WILD:
            waiting.append(k)
        if max(sums.values()) <= _CALM:
            calm, waiting = calm + waiting, []
    return None


def _split(value: Array, weight: Array, reference: int) -> int:
    """First window of the later part when a series is split into its two most likely means."""
    mass, moment = np.cumsum(weight), np.cumsum(weight * value)
    earlier, later = mass[:-1], mass[-1] - mass[:-1]
    gap = moment[:-1] / earlier - (moment[-1] - moment[:-1]) / later
    gain = gap**2 / (1.0 / earlier + 1.0 / later)
    return max(reference, int(np.argmax(gain)) + 1)
