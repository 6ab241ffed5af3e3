"""Which of many loops were recorded in the same hours: only those can be seen to swing together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

from fieldlink.diagnosis import LoopSignals
from fieldlink.site.folded_warnings import shown

__all__ = ["clock_notes"]

_NAMED = 3
"""Names or pairs that a sentence lists: more are counted."""


def clock_notes(signals: Mapping[str, LoopSignals]) -> tuple[str, ...]:
    """What the clocks of the records leave unasked, in sentences; none where all hours are shared.

    Args:
        signals: by name of the loop, as recorded: ``start_s`` is NaN where the record has no date.
    """
    if len(signals) < 2:
        return ()
    undated = [name for name, one in signals.items() if not math.isfinite(one.start_s)]
    if undated:
        have = "has" if len(undated) == 1 else "have"
        some = f"{shown(undated, _NAMED)} {have}"
        who = "the records have" if len(undated) == len(signals) else some
        return (
            f"{who} no date and time, so all loops are taken to start at the same moment. Where "
            f"they do not, who swings together is not to be trusted: export with times.",
        )
    hours = {
        name: (one.start_s, one.start_s + one.period * one.op.size) for name, one in signals.items()
    }
    apart = {
        pair
        for pair in combinations(hours, 2)
        if max(hours[name][0] for name in pair) >= min(hours[name][1] for name in pair)
    }
    alone = [name for name in hours if sum(name in pair for pair in apart) == len(hours) - 1]
    rest = [f"{one} and {other}" for one, other in sorted(apart) if not {one, other} & set(alone)]
    notes = []
    if len(alone) == len(hours):
        notes.append(
            "no two loops share any hours, so which of them swing together cannot be found. "
            "Export the same hours of every loop."
        )
    elif alone:
        shares = "shares" if len(alone) == 1 else "share"
        notes.append(
            f"{shown(alone, _NAMED)} {shares} no hours with the other loops and cannot be grouped "
            f"with them. Export the same hours of every loop."
        )
    if rest:
        notes.append(
            f"{shown(rest, _NAMED)} share no hours: whether they swing together was not asked. "
            f"Export the same hours of every loop."
        )
    return tuple(notes)
