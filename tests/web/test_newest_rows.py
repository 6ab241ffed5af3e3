"""The newest row of each loop, and the estimate behind the block that its PLC uses."""

from __future__ import annotations

from pathlib import Path

from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    Historian,
    HistorianSettings,
    WritebackRecord,
)
from fieldlink.store.schema import ESTIMATES
from fieldlink.web.view.store_queries import StoreQueries

QUICK = HistorianSettings(linger=0.01, retry=0.05)
NAMES = ["FC101", "FC102", "TC7"]


def fill_windows(url: str) -> None:
    historian = Historian(url, QUICK)
    historian.start(EventRecord(1, "start", "daemon", "started"))
    for day in range(1, 5):
        for name in NAMES[:2]:
            sticky = name == "FC101" and day < 4
            historian.put(
                EstimateRecord(
                    name, day, day, 0, 9, "estimated", "", "stiction" if sticky else "no_stiction",
                    stick_band=4.0 + 0.1 * day if sticky else 0.0,
                )
            )  # fmt: skip
        # The day-2 model is accepted and then renewed, as a single-precision float.
        if day >= 2:
            S = 4.2 * (1.0 + 5e-8)
            historian.put(
                WritebackRecord("FC101", day, "accepted", "", day, status="valid", stick_band=S)
            )
            historian.put(WritebackRecord("FC102", day, "too_few_windows", ""))
    historian.stop()


def check_newest(url: str) -> None:
    queries = StoreQueries(url)
    try:
        assert queries.loops() == NAMES[:2]
        for asked in (NAMES, NAMES[:1], []):
            stored = [name for name in NAMES[:2] if name in asked]
            last = queries.last_estimates(asked)
            assert {name: row["utc_ms"] for name, row in last.items()} == dict.fromkeys(stored, 4)
            accepted = queries.last_accepted(asked, 0)
            assert {name: row["seq"] for name, row in accepted.items()} == (
                {"FC101": 4} if asked else {}
            )
            behind = queries.estimates_behind(asked, 0)
            assert {name: row["utc_ms"] for name, row in behind.items()} == (
                {"FC101": 2} if asked else {}
            )
        assert queries.last_accepted(NAMES, 4) == queries.estimates_behind(NAMES, 4) == {}
        sticky = queries.last_of(ESTIMATES, NAMES, ESTIMATES.c.verdict == "stiction")
        assert {name: row["utc_ms"] for name, row in sticky.items()} == {"FC101": 3}
    finally:
        queries.close()


def test_each_loop_has_its_newest_row(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    fill_windows(url)
    check_newest(url)
