"""A disk that is really full: what waits is kept, what is too much is counted, and it goes on."""

from __future__ import annotations

import resource
import shutil
import sqlite3
import subprocess
import sys
import textwrap
import time
from contextlib import closing, suppress
from pathlib import Path

import pytest

from fieldlink.daemon.installation import is_in_use, only_daemon
from fieldlink.errors import FieldlinkError
from fieldlink.store import (
    EventRecord,
    Historian,
    HistorianSettings,
    SampleRecord,
    StoreError,
    read_events,
    read_samples,
)
from fieldlink.web.access import make_operator_token

OPENED = EventRecord(1_795_262_400_000, "start", "daemon", "started")


def sample(slot: int) -> SampleRecord:
    return SampleRecord("FC101", 1_795_262_400_000 + 1000 * slot, slot, 1.0, 2.0, None, None, 0)


def fill_up(ballast: Path) -> None:
    """Leave no byte free on the disk of a file."""
    with ballast.open("wb", buffering=0) as stream:
        for size in (4096, 1):
            with suppress(OSError):
                while True:
                    stream.write(b"x" * size)


def test_a_daemon_that_begins_on_a_full_disk_says_so(small_disk: Path) -> None:
    with only_daemon(small_disk) as identity:
        pass
    fill_up(small_disk / "ballast")
    # It knows who it is, and one sentence says what keeps it from beginning.
    with only_daemon(small_disk) as again:
        assert again == identity
        with pytest.raises(StoreError, match="disk is full"):
            Historian(f"sqlite:///{small_disk}/history.sqlite").start(OPENED)
        assert is_in_use(small_disk)


def test_a_store_is_read_on_a_full_disk_though_its_log_cannot_be_indexed(
    small_disk: Path, tmp_path: Path
) -> None:
    url = f"sqlite:///{small_disk}/history.sqlite"
    historian = Historian(url)
    historian.start(OPENED)
    historian.put(sample(0))
    historian.stop()
    fill_up(small_disk / "ballast")
    for _ in range(2):
        assert read_samples(url)["pv"].tolist() == [2.0]
    # As the attempt of another program leaves it.
    (small_disk / "history.sqlite-shm").touch()
    assert len(read_events(url)) == 1
    shutil.copy(small_disk / "history.sqlite", tmp_path)
    with closing(sqlite3.connect(tmp_path / "history.sqlite")) as other:
        other.execute("update samples set pv = 3")
        other.commit()
        (small_disk / "ballast").unlink()
        shutil.copy(tmp_path / "history.sqlite-wal", small_disk)
    fill_up(small_disk / "ballast")
    with pytest.raises(StoreError, match=r"history.sqlite-wal .* which is full; copy both"):
        read_samples(url)


def test_a_token_that_does_not_fit_is_drawn_when_there_is_room(small_disk: Path) -> None:
    fill_up(small_disk / "ballast")
    with pytest.raises(FieldlinkError, match="No space left on device"):
        make_operator_token(small_disk)
    (small_disk / "operator-token").touch()
    (small_disk / "ballast").unlink()
    assert len(make_operator_token(small_disk).read_text().strip()) == 32


def test_sampling_goes_on_and_what_is_lost_is_said(small_disk: Path) -> None:
    ballast = small_disk / "ballast"
    url = f"sqlite:///{small_disk}/history.sqlite"
    settings = HistorianSettings(queue=100, linger=0.01, retry=0.02, busy_timeout=0.1)
    historian = Historian(url, settings)
    historian.start(OPENED)
    historian.put(sample(0))
    while historian.report().written < 2:
        time.sleep(0.005)
    fill_up(ballast)
    slot = 1
    while historian.report().dropped == 0:
        historian.put(sample(slot))
        slot += 1
        time.sleep(0.0005)
    assert historian.report().failing
    assert "full" in historian.report().last_error
    ballast.unlink()
    while historian.report().waiting:
        time.sleep(0.005)
    historian.put(sample(slot))
    report = historian.stop()
    assert not report.failing
    assert report.dropped >= 1
    assert read_samples(url)["slot"].iloc[-1] == slot
    assert len(read_samples(url)) == slot + 1 - report.dropped
    events = read_events(url).set_index("kind")["message"]
    assert "store.lost" in events.index
    # The outage has its begin and its end there, once each.
    assert "full" in events["store.cannot_write"]
    # Where, and what to do.
    assert "history.sqlite: " in events["store.cannot_write"]
    assert "look at its disk" in events["store.cannot_write"]
    assert "records waited for" in events["store.writable_again"]


def test_a_bound_on_the_size_of_files_is_waited_out(tmp_path: Path) -> None:
    """The same without a file system of its own: the kernel refuses to let the file grow."""
    program = textwrap.dedent(
        """
        import resource, sys, time
        from fieldlink.store import EventRecord, Historian, HistorianSettings, SampleRecord
        settings = HistorianSettings(linger=0.01, retry=0.02, busy_timeout=0.1)
        historian = Historian(sys.argv[1], settings)
        historian.start(EventRecord(0, "start", "daemon", ""))
        for slot in range(20_000):
            historian.put(SampleRecord("FC101", slot, slot, 1.0, 2.0, None, None, 0))
        while historian.report().retries == 0:
            time.sleep(0.005)
        print("full", flush=True)
        sys.stdin.readline()
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
        while historian.report().waiting:
            time.sleep(0.005)
        report = historian.stop()
        print(report.written, report.dropped, report.failing)
        """
    )
    url = f"sqlite:///{tmp_path}/history.sqlite"
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    with subprocess.Popen(
        [sys.executable, "-c", program, url],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, hard)),
    ) as process:
        out, _ = process.communicate("\n", timeout=300)
    lines = out.splitlines()
    assert "full" in out
    # The samples, the start, and the outage with its end.
    assert lines[-1] == "20003 0 False"
    assert len(read_samples(url)) == 20_000
