"""A withdrawal that an operator asked for: whether the PLC has got it, by the rows since."""

from __future__ import annotations

from collections.abc import Sequence

from fieldlink.daemon.writeback.outcomes import WritebackOutcome
from fieldlink.registers import Status, is_newer
from fieldlink.store import EventRecord, WritebackRecord, last_events, newest_blocks

__all__ = ["WITHDRAWAL_ASKED", "find_open_withdrawals", "is_still_open"]

WITHDRAWAL_ASKED = "writeback.withdrawal_asked"
"""Kind of the event; its detail ``after`` is the newest sequence number at that moment."""


def is_still_open(after: int, rows: Sequence[WritebackRecord]) -> bool:
    """Whether a withdrawal still has to be written.

    A block that says something else is never begun before an operator has decided again. The wall
    clock may step, so numbers tell what came after.

    Args:
        after: the loop's newest sequence number when it was asked for.
        rows: of the loop's blocks, newest first.
    """
    later = [row for row in rows if row.seq is not None and is_newer(row.seq, after)]
    if any(row.status != Status.WITHDRAWN.name.lower() for row in later):
        return False
    outcomes = [WritebackOutcome.of(row.outcome) for row in later]
    if WritebackOutcome.ACCEPTED in outcomes:
        return False
    # What the newest row leaves open is looked for in the PLC.
    return not outcomes or not outcomes[0].leaves_withdrawal_open


def find_open_withdrawals(url: str) -> list[EventRecord]:
    """Return the events of withdrawals that still have to be written, by the historian at ``url``.

    Raises:
        StoreError: the historian cannot be read.
    """
    return [
        event
        for event in last_events(url, (WITHDRAWAL_ASKED,))
        if isinstance(after := (event.detail or {}).get("after"), int)
        and is_still_open(after, newest_blocks(url, event.source))
    ]
