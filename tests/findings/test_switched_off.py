"""A site that switches the diagnosis off: what it had found does not stay open for ever."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

from fieldlink.daemon.diagnosis.rounds import DiagnosisRounds
from fieldlink.daemon.diagnosis.scheduled_rounds import ScheduledRounds
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.links import VirtualClock
from fieldlink.store import EventRecord, FindingRecord, Historian, open_findings


async def test_it_closes_what_an_earlier_daemon_left_open(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path / 'history.sqlite'}"
    historian = Historian(url)
    historian.start(EventRecord(1, "daemon.start", "daemon", "mill"))
    historian.put(
        FindingRecord("F1", 10, 5, "confirmed", "sticky_valve", "A", ("A",), 9.0, 0.8, "", {})
    )
    historian.stop()
    assert [one.finding for one in open_findings(url)] == ["F1"]

    historian = Historian(url)
    clock = VirtualClock(1000.0)
    journal = Journal(historian.put, clock)
    rounds = DiagnosisRounds(dict, historian.put, journal, clock, url)
    site: Any = SimpleNamespace(file=SimpleNamespace(findings=SimpleNamespace(enabled=False)))
    schedule: Any = SimpleNamespace(remove=lambda _name: None)
    judging: Any = None
    historian.start(EventRecord(20, "daemon.start", "daemon", "mill"))
    scheduled = ScheduledRounds(rounds, judging, journal, lambda: site)
    await scheduled.resume()
    scheduled.follow(schedule)
    scheduled.follow(schedule)
    historian.stop()
    assert open_findings(url) == ()
