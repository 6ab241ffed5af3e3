"""What the daemon finds in recorded loops is in its store, and all that reads it shows it."""

from __future__ import annotations

import json
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.store import (
    DiagnosisRecord,
    EventRecord,
    FleetReader,
    Historian,
    open_findings,
    read_estimates,
    read_events,
    read_samples,
)
from fieldlink.store.schema import SCHEMA_VERSION
from fieldlink.web.access import Access
from fieldlink.web.app import make_store_app
from fieldlink.web.metrics import render_metrics
from fieldlink.web.source import Source
from tests.findings.conftest import BEGIN, RecordedSite

READERS = {"samples": read_samples, "estimates": read_estimates, "events": read_events}


def run_json(*arguments: object) -> Any:
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.output)


def test_the_store_has_one_confirmed_finding_for_the_group(mill: RecordedSite) -> None:
    rows = open_findings(mill.site.historian_url)
    (found,) = [row for row in rows if row.state == "confirmed"]
    assert (found.state, found.cause, found.loop) == ("confirmed", "sticky_valve", "FC101")
    assert tuple(found.loops) == ("FC101", "TC2")
    kinds = read_events(mill.site.historian_url)
    told = kinds[kinds["kind"].str.startswith("finding.")]
    mine = told[told["message"].str.startswith(found.finding)]
    assert mine["kind"].tolist() == ["finding.watch", "finding.confirmed"]
    assert set(mine["source"]) == {"FC101"}
    with FleetReader(mill.site.historian_url) as store:
        diagnosis = store.diagnosis("FC101")
        assert store.diagnosis("PC3")["cause"] == "quiet"  # type: ignore[index]
    assert diagnosis is not None
    assert diagnosis["cause"] == diagnosis["document"]["causes"][0]["name"] == "sticky_valve"
    assert diagnosis["window_end_ms"] - diagnosis["window_begin_ms"] == 399_000


def test_the_daemon_goes_on_with_what_the_store_has(mill: RecordedSite) -> None:
    report = mill.status.findings
    assert report is not None
    assert report.rounds == 2
    assert report.diagnosed == {"estimated": 6}
    text = render_metrics(mill.status).decode()
    assert 'fieldlink_findings{cause="sticky_valve",state="confirmed"} 1.0' in text
    assert 'fieldlink_loop_cause{cause="sticky_valve",device="archive",loop="FC101"} 1.0' in text
    assert 'fieldlink_diagnoses_total{outcome="estimated"} 6.0' in text


def test_status_tells_the_stored_findings(mill: RecordedSite) -> None:
    status = run_json("status", mill.site.path)
    found = next(one for one in status["findings"] if one["state"] == "confirmed")
    assert found["text"].startswith("candidate FC101: sticky valve; TC2 swings with it")
    assert {one["name"]: one["cause"] for one in status["loops"]} == {
        "FC101": "sticky_valve",
        "TC2": "sticky_valve",
        "PC3": "quiet",
    }
    lines = CliRunner().invoke(app, ["status", str(mill.site.path)]).output.splitlines()
    assert any(line.startswith(f"finding {found['finding']} (confirmed)") for line in lines)


def test_a_site_is_diagnosed_from_its_store(mill: RecordedSite) -> None:
    hours = (time.time() - BEGIN) / 3600.0 + 1.0
    found = run_json("diagnose", mill.site.path, "--hours", hours)
    assert found["loops"]["FC101"]["causes"][0]["name"] == "sticky_valve"
    assert found["groups"][0]["loops"] == ["FC101", "TC2"]
    assert found["groups"][0]["candidates"][0]["loop"] == "FC101"
    assert found["refused"] == {}


def test_the_work_list_takes_causes_and_groups_from_the_store(mill: RecordedSite) -> None:
    rows = {row["tag"]: row for row in run_json("report", mill.site.path)["loops"]}
    assert rows["FC101"]["wrong"] == "sticky_valve"
    # a follower so near that its own window looks sticky is told where to begin
    assert any("begin with FC101" in remark for remark in rows["TC2"]["remarks"])
    assert rows["PC3"]["wrong"] == "quiet"
    assert rows["PC3"]["evidence"] == [
        "nothing oscillates, and no cause explains a twentieth of the control error"
    ]
    assert not any("finding" in remark for remark in rows["PC3"]["remarks"])


async def test_the_pages_show_why(mill: RecordedSite) -> None:
    source = Source(mill.site.historian_url, lambda: mill.site)
    pages = make_store_app(source, Access(None, None, "", local=True))
    transport = httpx.ASGITransport(pages, client=("127.0.0.1", 1))
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        findings = (await client.get("/api/findings")).json()["findings"]
        assert (findings[0]["state"], findings[0]["loop"]) == ("confirmed", "FC101")
        page = (await client.get("/")).text
        assert "candidate FC101: sticky valve; TC2 swings with it" in page
        rows = {row["name"]: row for row in (await client.get("/api/loops")).json()["loops"]}
        assert rows["PC3"]["cause"] == "quiet"
        loop = (await client.get("/api/loops/TC2")).json()
        assert loop["diagnosis"]["causes"][0]["name"] == "sticky_valve"
        states = [step["state"] for step in loop["findings"][0]["course"]]
        assert states == ["watch", "confirmed"]
        assert "<h2>Why it swings</h2>" in (await client.get("/loops/TC2")).text
    source.close()


@pytest.fixture
def older(mill: RecordedSite, tmp_path: Path) -> Path:
    """The store as the release with schema 3 left it."""
    file = tmp_path / "history.sqlite"
    whole = mill.site.historian_url.removeprefix("sqlite:///")
    with closing(sqlite3.connect(whole)) as old, closing(sqlite3.connect(file)) as copy:
        old.backup(copy)
        copy.execute("DROP TABLE diagnoses")
        copy.execute("DROP TABLE findings")
        copy.execute("UPDATE meta SET value = '3' WHERE key = 'schema'")
        copy.commit()
    return file


def test_a_store_of_schema_3_is_read_and_brought_up_without_a_loss(older: Path) -> None:
    url = f"sqlite:///{older}"
    assert open_findings(url) == ()
    rows = {row["tag"]: row["wrong"] for row in run_json("report", older)["loops"]}
    assert rows["FC101"] == "sticky_valve"
    before = {name: len(read(url)) for name, read in READERS.items()}
    historian = Historian(url)
    historian.start(EventRecord(round(1000.0 * BEGIN), "daemon.start", "daemon", "later"))
    historian.put(
        DiagnosisRecord("FC101", 2, 0, 1, "estimated", compensated=False, message="", cause="quiet")
    )
    assert historian.stop().dropped == 0
    with closing(sqlite3.connect(older)) as connection:
        assert connection.execute("SELECT value FROM meta").fetchall() == [(str(SCHEMA_VERSION),)]
    after = {name: len(read(url)) for name, read in READERS.items()}
    assert after == before | {"events": before["events"] + 1}
    with FleetReader(url) as store:
        assert store.diagnosis("FC101")["cause"] == "quiet"  # type: ignore[index]
