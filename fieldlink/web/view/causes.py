"""Why loops swing, for the pages: each loop's newest diagnosis, and the findings."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fieldlink.findings import describe_finding
from fieldlink.web.view.store_queries import DAY_MS, Row, StoreQueries
from fieldlink.web.view.texts import iso_time

__all__ = ["Causes", "cause_document", "findings_document", "findings_of_loop"]

CLOSED_FOR_MS = 30 * DAY_MS
"""How long closed findings are listed: a month of meetings."""

LOOP_CLOSED_FOR_MS = 400 * DAY_MS
"""The same on a loop's own page: as long as its trend."""

Document = dict[str, Any]


class Causes:
    """Keeps the newest diagnosis of every loop; a row is read once.

    Args:
        queries: the store.
    """

    def __init__(self, queries: StoreQueries) -> None:
        self._queries = queries
        self._newest: dict[str, Row] = {}
        self._seen: int | None = None

    def look(self, loops: Sequence[str]) -> Mapping[str, Row]:
        """Return the newest diagnosis of each loop that has one.

        Raises:
            StoreError: the store cannot be read.
        """
        missing = [name for name in loops if name not in self._newest]
        if self._seen is None:
            self._newest = self._queries.last_diagnoses(missing)
            self._seen = max((row["id"] for row in self._newest.values()), default=0)
        for row in self._queries.diagnoses_after(self._seen):
            self._seen = row["id"]
            if row["cause"] is not None:
                self._newest[row["loop"]] = row
        return self._newest


def cause_document(row: Row | None) -> Document:
    """Return the columns of a fleet's row that a diagnosis gives."""
    cause = None if row is None else row["cause"]
    return {
        "cause": cause,
        "cause_text": "" if cause is None else cause.replace("_", " "),
        "cause_weight": None if row is None else row["weight"],
        "diagnosed": None if row is None else iso_time(row["window_end_ms"]),
    }


def findings_document(queries: StoreQueries) -> list[Document]:
    """Return the open findings, confirmed ones first, then those closed in the last month.

    Of each state those of the most loops stand first: a group has one cause and one remedy.

    Raises:
        StoreError: the store cannot be read.
    """
    now_ms = round(time.time() * 1000.0)
    found = [_finding(row) for row in queries.newest_findings(now_ms - CLOSED_FOR_MS)]
    order = {"confirmed": 0, "watch": 1, "closed": 2}
    return sorted(found, key=lambda one: (order.get(one["state"], 3), -len(one["loops"])))


def findings_of_loop(queries: StoreQueries, loop: str) -> list[Document]:
    """Return the findings that a loop belongs to, the newest first, each with its course.

    Raises:
        StoreError: the store cannot be read.
    """
    now_ms = round(time.time() * 1000.0)
    rows = queries.newest_findings(now_ms - LOOP_CLOSED_FOR_MS)
    mine = [row for row in rows if loop in row["loops"]]
    return [
        {
            **_finding(row),
            "course": [
                {"time": iso_time(one["utc_ms"]), "state": one["state"], "message": one["message"]}
                for one in queries.course_of_finding(row["finding"])
            ],
        }
        for row in mine
    ]


@dataclass(frozen=True, slots=True)
class _Described:
    cause: str
    loop: str
    loops: Sequence[str]
    swing_period_s: float | None


def _finding(row: Row) -> Document:
    document: Mapping[str, Any] = row["document"] or {}
    about = _Described(row["cause"], row["loop"], row["loops"], row["swing_period_s"])
    return {
        "finding": row["finding"],
        "state": row["state"],
        "cause": row["cause"],
        "loop": row["loop"] or None,
        "loops": row["loops"],
        "swing_period_s": row["swing_period_s"],
        "weight": row["weight"],
        "text": describe_finding(about),
        "born": iso_time(row["born_ms"]),
        "changed": iso_time(row["utc_ms"]),
        "message": row["message"],
        "evidence": document.get("evidence", []),
        "action": document.get("action", ""),
        "candidates": document.get("candidates", []),
        "followed": document.get("followed"),
    }
