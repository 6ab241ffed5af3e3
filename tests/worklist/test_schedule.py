"""The report that the site file schedules."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from fieldlink.daemon.reporting.scheduled_report import ScheduledReport, due_moment
from fieldlink.site import Site, load_site
from fieldlink.worklist.writing import write_report
from tests.worklist.test_report import LOOP, SITE


@pytest.mark.parametrize(
    ("now", "weekday", "hour", "due"),
    [
        ("2026-11-23T05:00", "monday", 5, "2026-11-23T05:00"),
        ("2026-11-23T04:59", "monday", 5, "2026-11-16T05:00"),
        ("2026-11-25T12:00", "friday", 0, "2026-11-20T00:00"),
        ("2026-11-25T12:00", "daily", 13, "2026-11-24T13:00"),
        ("2026-11-25T12:00", "daily", 12, "2026-11-25T12:00"),
    ],
)
def test_a_report_is_due_at_its_weekday_and_hour(
    now: str, weekday: str, hour: int, due: str
) -> None:
    found = due_moment(datetime.fromisoformat(now).replace(tzinfo=UTC), weekday, hour)
    assert found == datetime.fromisoformat(due).replace(tzinfo=UTC)


@dataclass
class Clock:
    now: datetime

    def __call__(self) -> datetime:
        return self.now


class Said:
    """Takes events as the journal does."""

    def __init__(self) -> None:
        self.events: list[tuple[str, str]] = []

    def event(self, kind: str, _source: str, message: str, *, bad: bool = False) -> None:
        assert bad == kind.endswith("failed")
        self.events.append((kind, message))


@pytest.fixture
def site(tmp_path: Path) -> Site:
    (tmp_path / "map.csv").write_text("tag,address,type\nF.OP,0,float32\nF.PV,2,float32\n")
    schedule = 'folder = "reports"\nformats = ["csv"]\n'
    (tmp_path / "site.toml").write_text(SITE + schedule + LOOP.format("F"))
    return load_site(tmp_path / "site.toml")


def write_one(_site: Site, file: Path) -> list[str]:
    return [sys.executable, "-c", f"open({str(file)!r}, 'w').write('list')"]


def fail(_site: Site, _file: Path) -> list[str]:
    return [sys.executable, "-c", "raise SystemExit('fieldlink: no historian; run the daemon')"]


MONDAY = datetime(2026, 11, 23, 5, tzinfo=UTC)


async def test_it_is_written_once_and_caught_up_after_a_pause(site: Site) -> None:
    clock, said = Clock(MONDAY - timedelta(hours=1)), Said()
    reports = ScheduledReport(said, now=clock, command=write_one)  # type: ignore[arg-type]
    assert await reports.write_due(site) == []
    clock.now = MONDAY + timedelta(minutes=7)
    (first,) = await reports.write_due(site)
    assert first == site.data_dir / "reports" / "report-2026-11-23.csv"
    assert await reports.write_due(site) == []
    clock.now = MONDAY + timedelta(days=16)
    late = ScheduledReport(said, now=clock, command=write_one)  # type: ignore[arg-type]
    (second,) = await late.write_due(site)
    assert second.name == "report-2026-12-07.csv"
    assert [kind for kind, _ in said.events] == ["report.written", "report.written"]


async def test_a_clock_that_was_ahead_at_the_start_puts_nothing_off(site: Site) -> None:
    clock, said = Clock(MONDAY + timedelta(days=4000)), Said()
    reports = ScheduledReport(said, now=clock, command=write_one)  # type: ignore[arg-type]
    clock.now = MONDAY - timedelta(hours=1)
    assert await reports.write_due(site) == []
    clock.now = MONDAY
    (first,) = await reports.write_due(site)
    assert first.name == "report-2026-11-23.csv"


async def test_a_failure_is_reported_once_and_tried_again(site: Site) -> None:
    clock, said = Clock(MONDAY), Said()
    reports = ScheduledReport(said, now=clock, command=fail)  # type: ignore[arg-type]
    for _ in range(2):
        assert await reports.write_due(site) == []
    ((kind, message),) = said.events
    assert kind == "report.failed"
    assert message.endswith("no historian; run the daemon")


async def test_the_real_command_says_what_is_missing(site: Site) -> None:
    said = Said()
    await ScheduledReport(said, now=Clock(MONDAY)).write_due(site)  # type: ignore[arg-type]
    ((kind, message),) = said.events
    assert kind == "report.failed"
    assert "run the daemon first" in message


def test_a_report_that_cannot_be_made_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fieldlink.worklist.writing as writing

    target = tmp_path / "list.csv"
    target.write_text("before")
    monkeypatch.setattr(writing, "render", lambda _document, _kind: b"after")
    monkeypatch.setattr(Path, "replace", _refuse)
    with pytest.raises(Exception, match="cannot be written"):
        write_report(None, target, "csv")  # type: ignore[arg-type]
    assert [file.name for file in tmp_path.iterdir()] == ["list.csv"]
    assert target.read_text() == "before"


def _refuse(_self: Path, _target: Path) -> Path:
    raise OSError(28, "No space left on device")
