"""Which open finding a proposal is about: same loop and cause, or a group with the same period."""

from __future__ import annotations

from fieldlink.findings.observed import SAME_PERIOD
from fieldlink.findings.open_finding import OpenFinding
from fieldlink.findings.proposals import FOLLOWING, Proposal

__all__ = ["nearness"]

OVERLAP = 0.5
"""Share of the smaller of two groups that both must have to be one and the same."""


def nearness(found: OpenFinding, proposal: Proposal) -> float:
    """How well a proposal fits an open finding: 0 not at all, more is better."""
    same_source = (found.loop, found.cause) == (proposal.loop, proposal.cause) and found.loop != ""
    if len(proposal.loops) == 1:
        if same_source:
            return 3.0 if not found.is_group else 2.5
        is_victim = (
            proposal.loop in found.loops
            and proposal.cause in FOLLOWING
            and (
                proposal.cause == "sticky_valve"
                or _same_period(found.swing_period_s, proposal.swing_period_s)
            )
        )
        return 1.0 if found.is_group and is_victim else 0.0
    if same_source:
        return 4.0 if found.is_group else 1.0
    if not found.is_group:
        return 0.0
    shared = len(set(found.loops) & set(proposal.loops))
    share = shared / min(len(found.loops), len(proposal.loops))
    if share < OVERLAP or not _same_period(found.swing_period_s, proposal.swing_period_s):
        return 0.0
    return 2.0 + share


def _same_period(one: float | None, other: float | None) -> bool:
    return one is not None and other is not None and abs(one / other - 1.0) < SAME_PERIOD
