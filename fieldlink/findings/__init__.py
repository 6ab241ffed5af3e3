"""Findings about loops: begun, confirmed and closed from one round of diagnoses to the next.

Plain data in, store records out. What diagnoses, polls, stores or reports belongs elsewhere.
"""

from fieldlink.findings.ledger import Ledger
from fieldlink.findings.observed import CauseSeen, ObservedGroup, ObservedLoop, Repair, Round
from fieldlink.findings.open_finding import OpenFinding, State
from fieldlink.findings.sentences import describe_finding

__all__ = [
    "CauseSeen",
    "Ledger",
    "ObservedGroup",
    "ObservedLoop",
    "OpenFinding",
    "Repair",
    "Round",
    "State",
    "describe_finding",
]
