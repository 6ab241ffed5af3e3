"""A period that is given beside a time column: the times still order and fill the rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fieldlink.links import Quality, VirtualClock, open_link
from fieldlink.site import check, load_site, read_recording
from fieldlink.site.missing_rows import fill_missing_rows
from fieldlink.site.recording import read_recordings

N = 120
ROWS = [f"2026-03-04 10:{2 * k // 60:02d}:{2 * k % 60:02d},{k},{-k}" for k in range(N)]
NUMBERS = [f"{2 * k},{k},{-k}" for k in range(N)]
SHUFFLED = np.random.default_rng(1).permutation(N).tolist()

SITE = """
[site]
name = "archive"
[devices.archive]
link = "recording"
[loops.FC101]
device = "archive"
op = "FC101.OP"
pv = "FC101.PV"
mode = "FC101.MODE"
period = {period}
[loops.FC101.plant]
recording = "loop.csv"
"""


def write(folder: Path, rows: list[str], head: str = "time,op,pv") -> Path:
    path = folder / "loop.csv"
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


@pytest.mark.parametrize("rows", [ROWS, NUMBERS], ids=["dates", "seconds"])
@pytest.mark.parametrize("order", [range(N)[::-1], SHUFFLED], ids=["newest first", "shuffled"])
@pytest.mark.parametrize("period", [None, 2.0])
def test_rows_are_in_the_order_of_their_times(
    rows: list[str], order: list[int], period: float | None, tmp_path: Path
) -> None:
    recording = read_recording(write(tmp_path, [rows[k] for k in order]), period=period)
    assert recording.op.tolist() == list(range(N))
    assert recording.period == 2.0


def test_missing_rows_are_filled_and_the_start_is_kept(tmp_path: Path) -> None:
    rows = [row for k, row in enumerate(ROWS) if k not in (10, 50, 51)]
    recording = fill_missing_rows(read_recording(write(tmp_path, rows), period=2.0))
    assert np.flatnonzero(np.isnan(recording.op)).tolist() == [10, 50, 51]
    assert recording.start == 1772618400.0  # date --utc --date '2026-03-04 10:00' +%s


def test_a_period_that_the_times_contradict_counts_with_a_note(tmp_path: Path) -> None:
    recording = read_recording(write(tmp_path, ROWS[::-1]), period=2000.0)
    assert recording.period == 2000.0
    assert recording.op.tolist() == list(range(N))
    assert any("2 s between rows; the given 2000 s counts" in note for note in recording.notes)


def test_without_readable_times_the_period_alone_counts_with_a_note(tmp_path: Path) -> None:
    path = write(tmp_path, [f"batch {k},{k},{-k}" for k in range(N)])
    recording = read_recording(path, period=2.0)
    assert recording.op.tolist() == list(range(N))
    assert recording.time is None
    assert "'batch 0' is not a date and time in line 2; the rows stay as they" in recording.notes[0]


def test_a_counter_that_begins_again_is_not_sorted(tmp_path: Path) -> None:
    path = write(tmp_path, [f"{k % 60},{k},{-k}" for k in range(N)])
    recording = read_recording(path, period=1.0)
    assert recording.op.tolist() == list(range(N))
    assert "they go back from 59 to 0 s" in recording.notes[0]


def test_loops_of_one_file_are_in_the_order_of_their_times(tmp_path: Path) -> None:
    rows = [f"{loop},{row}" for row in ROWS[::-1] for loop in ("A", "B")]
    path = write(tmp_path, rows, "loop,time,op,pv")
    for _, recording in read_recordings(path, {}, 2.0):
        assert recording.op.tolist() == list(range(N))


async def test_a_recording_is_played_in_the_order_of_its_times(tmp_path: Path) -> None:
    write(tmp_path, [ROWS[k] for k in range(N)[::-1] if k != 3])
    (tmp_path / "site.toml").write_text(SITE.format(period=2.0))
    link = open_link(load_site(tmp_path / "site.toml"), "archive", VirtualClock())
    await link.open()
    scans = [await link.scan() for _ in range(6)]
    assert [scan["FC101.OP"].value for scan in scans if scan["FC101.OP"].good] == [0, 1, 2, 4, 5]
    assert scans[3]["FC101.OP"].quality is Quality.NOT_A_NUMBER


def test_check_warns_of_a_period_that_the_times_contradict(tmp_path: Path) -> None:
    write(tmp_path, ROWS)
    for period, expected in ((2.0, False), (5.0, True)):
        (tmp_path / "site.toml").write_text(SITE.format(period=period))
        warnings = check(load_site(tmp_path / "site.toml")).warnings
        assert any("are not 5 s apart" in warning for warning in warnings) is expected
