"""What a loop's parameter block is doing, in a few words and why."""

from __future__ import annotations

from typing import Any

from fieldlink.daemon import LoopStatus, WritebackOutcome
from fieldlink.web.view.store_queries import Row
from fieldlink.web.view.texts import BLOCK_WORDS

__all__ = ["block_document"]


def block_document(live: LoopStatus | None, attempt: Row | None) -> dict[str, Any]:
    """Return the state of a loop's block.

    Args:
        live: the running daemon's view of the loop; None without a daemon.
        attempt: the loop's last write-back attempt in the store.

    Returns:
        ``text`` and ``why`` in words, ``style`` as its colour, ``seq`` of the block, ``in_use``
        (None for unknown), ``may_write``, ``hold``, ``off``, ``waiting``.
    """
    if live is None:
        return _stored(attempt)
    block = live.block
    seq = None if block is None else block.seq
    text, why, style = _live(live)
    return {
        "text": text,
        "why": why,
        "style": style,
        "seq": seq,
        "in_use": live.in_use,
        "may_write": live.may_write,
        "hold": live.hold,
        "off": live.off,
        "waiting": live.waiting,
    }


def _live(live: LoopStatus) -> tuple[str, str, str]:
    if not live.may_write:
        return "not written", "the site file does not enable write-back for this loop", "plain"
    if live.off:
        return "switched off", live.off, "warn"
    why = live.block_reason
    if live.hold:
        return "on hold", live.hold, "warn"
    if live.in_use:
        return "in use", live.waiting or "the PLC's controller uses the model", "good"
    if live.refusal:
        return "refused", live.refusal, "bad"
    if live.waiting is not None:
        return "waiting", live.waiting, "warn"
    if live.block is not None:
        name = live.block.status.name.lower()
        return BLOCK_WORDS.get(name, name), why, "plain"
    return "none", why or "no window has passed the rules of write-back yet", "plain"


def _stored(attempt: Row | None) -> dict[str, Any]:
    nothing = {"in_use": None, "may_write": None, "hold": "", "off": "", "waiting": None}
    if attempt is None:
        return {"text": "none", "why": "", "style": "plain", "seq": None, **nothing}
    outcome = WritebackOutcome.of(attempt["outcome"])
    accepted = outcome is WritebackOutcome.ACCEPTED
    return {
        "text": "accepted" if accepted else outcome.code.replace("_", " "),
        "why": attempt["reason"] or outcome.advice,
        "style": "good" if accepted else "plain",
        "seq": attempt["seq"],
        **nothing,
    }
