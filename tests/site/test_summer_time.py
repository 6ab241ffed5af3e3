"""Local times over a change of summer time, in whatever order the rows stand."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from fieldlink.site import read_recording
from fieldlink.site.missing_rows import fill_missing_rows

AUTUMN = datetime(2026, 10, 24, 14, tzinfo=UTC)
SPRING = datetime(2026, 3, 28, 14, tzinfo=UTC)


def rows_of(
    begin: datetime,
    count: int,
    step: int,
    zone: str = "Europe/Berlin",
    *,
    without: range = range(0),
) -> list[str]:
    """A row each ``step`` seconds; PV counts the steps."""
    moments = [
        (begin + timedelta(seconds=step * k)).astimezone(ZoneInfo(zone)) for k in range(count)
    ]
    return [
        f"{moment:%Y-%m-%d %H:%M:%S},{k % 70 + 0.5},{k}"
        for k, moment in enumerate(moments)
        if k not in without
    ]


def write(folder: Path, rows: list[str]) -> Path:
    path = folder / "loop.csv"
    path.write_text("\n".join(["time,op,pv", *rows]) + "\n")
    return path


@pytest.mark.parametrize("order", [1, -1], ids=["oldest first", "newest first"])
@pytest.mark.parametrize(
    ("begin", "zone"),
    [
        (AUTUMN, "Europe/Berlin"),
        (SPRING, "Europe/Berlin"),
        (datetime(2026, 11, 1, 0, tzinfo=UTC), "America/New_York"),
        (datetime(2026, 3, 8, 0, tzinfo=UTC), "America/New_York"),
        (datetime(2026, 4, 4, 8, tzinfo=UTC), "Australia/Sydney"),
        (datetime(2026, 10, 3, 8, tzinfo=UTC), "Australia/Sydney"),
    ],
)
@pytest.mark.parametrize("step", [10, 60])
def test_the_times_count_on(
    begin: datetime, zone: str, step: int, order: int, tmp_path: Path
) -> None:
    count = 86400 // step
    rows = rows_of(begin, count, step, zone)[::order]
    recording = fill_missing_rows(read_recording(write(tmp_path, rows)))
    assert recording.pv.tolist() == list(range(count))
    assert (recording.period, recording.irregular) == (step, 0)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("begin", [AUTUMN, SPRING])
def test_rows_that_miss_where_the_clock_is_set_are_bad_samples(
    begin: datetime, order: int, tmp_path: Path
) -> None:
    seam = 11 * 360  # the clock is set at 01:00 UTC
    rows = rows_of(begin, 8640, 10, without=range(seam - 4, seam + 4))
    filled = fill_missing_rows(read_recording(write(tmp_path, rows[::order])))
    expected = np.arange(8640.0)
    expected[seam - 4 : seam + 4] = np.nan
    np.testing.assert_array_equal(filled.pv, expected)


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        (datetime(2026, 3, 29, 0, 20, tzinfo=UTC), datetime(2026, 3, 29, 1, 40, tzinfo=UTC)),
        (datetime(2026, 3, 22, 1, 55, tzinfo=UTC), datetime(2026, 3, 22, 3, 15, tzinfo=UTC)),
    ],
    ids=["no full hour", "another Sunday"],
)
def test_a_logger_that_stood_still_has_a_gap(
    begin: datetime, end: datetime, tmp_path: Path
) -> None:
    """Local time without a change, as in Iceland."""
    first = datetime(2026, 3, begin.day - 1, 14, tzinfo=UTC)
    gap = range(
        int((begin - first).total_seconds()) // 60, int((end - first).total_seconds()) // 60
    )
    rows = rows_of(first, 1440, 60, "Atlantic/Reykjavik", without=gap)
    recording = read_recording(write(tmp_path, rows))
    assert recording.time is not None
    assert np.diff(recording.time).max() == 60.0 * (len(gap) + 1)


def test_both_changes_of_a_year_are_taken_back(tmp_path: Path) -> None:
    rows = rows_of(SPRING, 62000, 300)
    filled = fill_missing_rows(read_recording(write(tmp_path, rows[::-1])))
    assert filled.pv.tolist() == list(range(62000))


def test_an_hour_whose_rows_are_mixed_is_left_out(tmp_path: Path) -> None:
    """Sorted by local time, the samples of two hours stand in turn."""
    recording = read_recording(write(tmp_path, sorted(rows_of(AUTUMN, 4320, 60))))
    # summer time ends 11 h after AUTUMN, so the hour before and the hour after are one
    assert recording.pv.tolist() == [*range(600), *range(720, 4320)]
    assert "120 rows of the hour that the end of summer time repeats are mixed" in str(
        recording.notes
    )
    filled = fill_missing_rows(recording)
    assert filled.pv.tolist() == list(range(720, 4320))


def test_of_two_rows_of_one_moment_the_last_counts(tmp_path: Path) -> None:
    rows = rows_of(SPRING, 900, 2)
    twice = rows[300].rsplit(",", 1)[0] + ",999"
    recording = read_recording(write(tmp_path, [*rows[:300], twice, *rows[300:]]))
    assert recording.pv.tolist() == list(range(900))
    assert "1 row has the time of the row after it and is left out" in recording.notes


def test_samples_a_little_faster_than_the_clock_are_all_kept(tmp_path: Path) -> None:
    stamps = np.floor(0.98 * np.arange(900)).astype(int)
    rows = [f"{SPRING + timedelta(seconds=int(s)):%Y-%m-%d %H:%M:%S},{k % 70},{k}"
            for k, s in enumerate(stamps)]  # fmt: skip
    assert read_recording(write(tmp_path, rows)).pv.tolist() == list(range(900))
