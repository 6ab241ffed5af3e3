"""What the daemon finds in recorded loops is in its store, and everything that reads it shows it."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.store import FleetReader, open_findings, read_events
from fieldlink.web.metrics import render_metrics
from tests.findings.conftest import RecordedSite


def run_json(*arguments: object) -> Any:
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.output)


def test_the_store_has_one_confirmed_finding_for_the_group(mill: RecordedSite) -> None:
    (found,) = open_findings(mill.site.historian_url)
    assert (found.state, found.cause, found.loop) == ("confirmed", "sticky_valve", "FC101")
    assert tuple(found.loops) == ("FC101", "TC2")
    kinds = read_events(mill.site.historian_url)
    told = kinds[kinds["kind"].str.startswith("finding.")]
    assert told["kind"].tolist() == ["finding.watch", "finding.confirmed"]
    assert told["source"].tolist() == ["FC101", "FC101"]
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


def test_status_diagnose_and_report_tell_the_same(mill: RecordedSite, tmp_path: Path) -> None:
    status = run_json("status", mill.site.path)
    assert [one["loop"] for one in status["findings"]] == ["FC101"]
    assert {one["name"]: one["cause"] for one in status["loops"]} == {
        "FC101": "sticky_valve",
        "TC2": "sticky_valve",
        "PC3": "quiet",
    }
