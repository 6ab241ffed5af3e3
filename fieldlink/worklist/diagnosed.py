"""What the daemon's diagnoses and findings say for the work list.

Whether the valve sticks is the verdict of the estimator's newest window. Where it does not stick,
the newest diagnosis says why the loop swings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fieldlink.findings import describe_finding
from fieldlink.store import CLOSED, FindingRecord
from fieldlink.worklist.finding import Cause, Finding, Wrong, finding_of_diagnosis

__all__ = ["finding_of_stored", "findings_by_loop", "remarks_of"]

OLDEST_MS = 24 * 3_600_000
"""How much older than the newest estimate a diagnosis may be: rounds come every hour unless the
site file says otherwise, and a day without one means that they are switched off."""

DISAGREE = (
    "the estimator's window and the diagnosis differ about the valve: let the daemon judge another "
    "window, with a set-point step of a few per cent"
)


def finding_of_stored(
    diagnosis: Mapping[str, Any] | None, newest: Mapping[str, Any] | None
) -> Finding | None:
    """Return the finding of a loop's newest diagnosis; None where the estimate says it better.

    Args:
        diagnosis: the newest row of the diagnoses; None without one.
        newest: the newest estimate with a verdict; None without one.
    """
    if diagnosis is None:
        return None
    causes = diagnosis["document"]["causes"]
    if newest is None:
        return finding_of_diagnosis(causes)
    if newest["window_end_ms"] - diagnosis["window_end_ms"] > OLDEST_MS:
        return None
    if newest["verdict"] == "stiction":
        return None
    if causes[0]["name"] == Wrong.STICKY_VALVE.code:
        evidence = tuple(map(str, causes[0]["evidence"]))
        return Finding((Cause(Wrong.UNDETERMINED, evidence),), (DISAGREE,), is_sure=False)
    return finding_of_diagnosis(causes)


def findings_by_loop(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[FindingRecord]]:
    """Return the open findings of each loop.

    Args:
        rows: as `fieldlink.store.FleetReader.findings` gives them.
    """
    found: dict[str, list[FindingRecord]] = {}
    for row in rows:
        if row["state"] == CLOSED:
            continue
        record = FindingRecord(**{key: value for key, value in row.items() if key != "id"})
        for loop in record.loops:
            found.setdefault(loop, []).append(record)
    return found


def remarks_of(loop: str, findings: Sequence[FindingRecord]) -> tuple[str, ...]:
    """Return what a reader of a loop's row should know of the loops that swing with it."""
    return tuple(
        f"finding {one.finding} ({one.state}): {describe_finding(one)}"
        + ("" if one.loop in ("", loop) else f"; begin with {one.loop}")
        for one in findings
        if len(one.loops) > 1
    )
