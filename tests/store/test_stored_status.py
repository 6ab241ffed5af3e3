"""What ``fieldlink status`` reads of a store without a daemon: newest rows, whatever there is."""

from __future__ import annotations

import time
import tracemalloc
from pathlib import Path

from fieldlink.daemon.reporting.status_documents import stored_status
from fieldlink.site import load_site
from fieldlink.store import (
    EstimateRecord,
    EventRecord,
    Historian,
    HistorianSettings,
    Record,
    SlotRecord,
    WritebackRecord,
)

SITE = """[site]
name = "mill"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
period = 1.0
"""
YEARS_MS = 12 * 365 * 86_400_000


def test_the_newest_rows_are_told_and_no_other_is_held(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text("tag,address,type\nOP,0,float32\nPV,2,float32\n")
    (tmp_path / "site.toml").write_text(SITE)
    site = load_site(tmp_path / "site.toml")
    now = round(1000.0 * time.time())
    document = {"text": 4000 * "x"}
    records: list[Record] = [
        EstimateRecord(
            "FC101", now - 1000 * (3000 - k), now, k, k, "estimated", "", verdict="stiction",
            stick_band=float(k), document=document,
        )
        for k in range(3000)
    ]  # fmt: skip
    records += [
        EventRecord(now + YEARS_MS, "device.good", "plc", "a clock that was ahead"),
        EventRecord(now - 9000, "device.demoted", "plc", "cable"),
        SlotRecord("FC101", now - 8000, 60.0, 60, 50, 2, 7, 3, 0, 0),
        SlotRecord("FC101", now - 7000, 60.0, 60, 51, 1, 8, 1, 0, 0),
        WritebackRecord("FC101", now - 6000, "accepted", "", seq=7, status="valid"),
        WritebackRecord("FC101", now - 5000, "too_soon", "waits"),
    ]
    historian = Historian(site.historian_url, HistorianSettings(linger=0.01))
    historian.start(EventRecord(now - 10_000, "daemon.start", "daemon", "mill"))
    for record in records:
        historian.put(record)
    historian.stop()
    stored_status(site)
    tracemalloc.start()
    found = stored_status(site)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4_000_000
    (device,) = found["devices"]
    assert (device["state"], device["reason"], device["late"]) == ("demoted", "cable", 3)
    (loop,) = found["loops"]
    assert (loop["expected"], loop["read"], loop["missed"], loop["bad"]) == (120, 101, 15, 4)
    assert (loop["verdict"], loop["stick_band"]) == ("stiction", 2999.0)
    assert loop["block"] == {
        "status": "valid", "seq": 7, "acknowledged": True, "reason": "waits"
    }  # fmt: skip
    assert found["daemon"]["since"].startswith(time.strftime("%Y-", time.gmtime(now / 1000.0)))
