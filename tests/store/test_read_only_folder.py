"""A historian on a file system that is read-only: read whole, or refused with the cause."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.store import (
    EventRecord,
    Historian,
    SampleRecord,
    StoreError,
    back_up,
    read_events,
    read_samples,
)
from tests.store.conftest import make_read_only

NOON_MS = 1_795_262_400_000
SITE = """[site]
name = "archive"
data_dir = "{data_dir}"
[web]
enabled = false
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
period = 2.0
"""
MAP = "tag,table,address,type\nOP,holding,0,float32\nPV,holding,2,float32\n"


def begin(folder: Path) -> Historian:
    historian = Historian(f"sqlite:///{folder}/history.sqlite")
    historian.start(EventRecord(NOON_MS, "start", "daemon", "started"))
    historian.put(SampleRecord("FC101", NOON_MS, 0, 1.0, 2.0, None, None, 0))
    while historian.report().written < 2:
        pass
    return historian


def test_what_a_daemon_left_is_read(small_disk: Path, tmp_path: Path) -> None:
    begin(small_disk).stop()
    make_read_only(small_disk)
    url = f"sqlite:///{small_disk}/history.sqlite"
    assert read_samples(url)["pv"].tolist() == [2.0]
    assert back_up(url, tmp_path / "copy.sqlite").samples == 1
    (tmp_path / "site.toml").write_text(SITE.format(data_dir=small_disk))
    (tmp_path / "map.csv").write_text(MAP)
    for command in ("status", "events"):
        result = CliRunner().invoke(app, [command, str(tmp_path / "site.toml")])
        assert result.exit_code == 0, result.output + repr(result.exception)


def test_a_daemon_at_work_elsewhere_is_read_with_its_newest_rows(
    small_disk: Path, tmp_path: Path
) -> None:
    historian = begin(small_disk)
    view = tmp_path / "view"
    view.mkdir()
    subprocess.run(["mount", "--bind", str(small_disk), str(view)], check=True)
    try:
        subprocess.run(["mount", "-o", "remount,ro,bind", str(view)], check=True)
        assert len(read_samples(f"sqlite:///{view}/history.sqlite")) == 1
    finally:
        subprocess.run(["umount", "--lazy", str(view)], check=True)
        historian.stop()


def test_rows_that_cannot_be_seen_are_not_passed_over(small_disk: Path, tmp_path: Path) -> None:
    historian = begin(tmp_path / "data")
    for name in ("history.sqlite", "history.sqlite-wal"):
        shutil.copy(tmp_path / "data" / name, small_disk)
    historian.stop()
    make_read_only(small_disk)
    url = f"sqlite:///{small_disk}/history.sqlite"
    for read in (read_samples, read_events, lambda url: back_up(url, tmp_path / "copy.sqlite")):
        with pytest.raises(StoreError, match=r"history.sqlite-wal .* copy both files to another"):
            read(url)
