"""Why a loop is given back: what the watch says, the reason that stands, what the block is told."""

from __future__ import annotations

from compensator.action import RefusalKind
from compensator.supervising.supervision import WithdrawReason
from compensator.supervising.watch import WatchVerdict

__all__ = ["PASSING", "REASONS", "REFUSALS"]

REFUSALS = {
    WithdrawReason.WORSE: RefusalKind.WORSE,
    WithdrawReason.NO_GAIN: RefusalKind.WORSE,
    WithdrawReason.GROWING: RefusalKind.WORSE,
    WithdrawReason.HUNTING: RefusalKind.TRAVEL,
    WithdrawReason.TRAVEL: RefusalKind.TRAVEL,
    WithdrawReason.WRONG_SIGN: RefusalKind.WRONG_SIGN,
    WithdrawReason.LEFT_RANGE: RefusalKind.LEFT_RANGE,
    WithdrawReason.SOLVER: RefusalKind.OTHER,
}
"""Why a model is no longer used, of those reasons that are the model's."""

REASONS = {
    WatchVerdict.WORSE: WithdrawReason.WORSE,
    WatchVerdict.NO_GAIN: WithdrawReason.NO_GAIN,
    WatchVerdict.GROWING: WithdrawReason.GROWING,
    WatchVerdict.HUNTING: WithdrawReason.HUNTING,
    WatchVerdict.TRAVEL: WithdrawReason.TRAVEL,
    WatchVerdict.WRONG_SIGN: WithdrawReason.WRONG_SIGN,
    WatchVerdict.LEFT_RANGE: WithdrawReason.LEFT_RANGE,
}
"""Why a model is given up, by what the watch says."""


PASSING = (
    WithdrawReason.PV_BAD,
    WithdrawReason.PV_FROZEN,
    WithdrawReason.OP_OUTSIDE,
    WithdrawReason.LOAD,
    WithdrawReason.SOLVER,
)
"""Reasons that are over at the next take-over."""
