"""What numbers of a time column count, and what a column that cannot be seconds is refused with."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from fieldlink.site import Recording, RecordingError, read_recording
from fieldlink.site.numbered_times import find_time_unit

N = 900
NOON = datetime(2026, 11, 5, 12, tzinfo=UTC)
START = 1793880000.0
"""NOON by ``date --utc --date '2026-11-05 12:00' +%s``."""


def read(folder: Path, head: str, cell: Callable[[int], str], **options: float) -> Recording:
    path = folder / "loop.csv"
    path.write_text("\n".join([head, *(f"{cell(k)},{k},{-k}" for k in range(N))]) + "\n")
    return read_recording(path, **options)


def at(k: int) -> datetime:
    return NOON + timedelta(seconds=2 * k)


@pytest.mark.parametrize(
    ("head", "count"),
    [
        ("Time [min],OP [%],PV [m3/h]", 1 / 60),
        ("Time [h],OP [%],PV [m3/h]", 1 / 3600),
        ("time (ms),op,pv", 1000),
        ("time_ms,op,pv", 1000),
        ("Zeit in Minuten,op,pv", 1 / 60),
        ("time,op,pv\nms,%,m3/h", 1000),
        ("time,op,pv\nstamp,valve,flow\n[min],[%],[m3/h]", 1 / 60),
        ("Time [s],op,pv", 1),
        ("seconds,op,pv", 1),
    ],
)
def test_the_unit_of_the_heading_or_of_the_row_of_units_counts(
    head: str, count: float, tmp_path: Path
) -> None:
    recording = read(tmp_path, head, lambda k: f"{2 * k * count:.6g}")
    assert recording.period == pytest.approx(2.0, rel=1e-3)
    assert (recording.op.tolist(), recording.irregular) == (list(range(N)), 0)
    assert any("taken as seconds" in note for note in recording.notes) is (count != 1)


def test_few_digits_of_a_long_unit_cost_the_period_nothing(tmp_path: Path) -> None:
    recording = read(tmp_path, "Time [min],op,pv", lambda k: f"{k / 30:.4f}")
    assert recording.period == pytest.approx(2.0, rel=1e-5)


def test_a_unit_behind_each_number_counts(tmp_path: Path) -> None:
    assert read(tmp_path, "time,op,pv", lambda k: f"{2000 * k} ms").period == 2.0
    assert read(tmp_path, "time,op,pv", lambda k: f"{2 * k} s").period == 2.0


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        (lambda k: f"{at(k):%Y%m%d%H%M%S}", ""),
        (lambda k: f"{at(k):%Y%m%d%H%M%S}000", ""),
        (lambda k: f"{at(k):%Y%m%dT%H%M%S}", ""),
        # 740291.5: datenum(2026, 11, 5, 12, 0, 0)
        (lambda k: f"{740291.5 + k / 43200:.9f}", "MATLAB"),
        # 2461350.0: the Julian day of 5 November 2026, noon
        (lambda k: f"{2461350.0 + k / 43200:.9f}", "Julian days"),
        # new DateTime(2026, 11, 5, 12, 0, 0).Ticks
        (lambda k: f"{639294768000000000 + 20000000 * k}", ".NET ticks"),
        # DateTime.ToFileTimeUtc of the same
        (lambda k: f"{134383536000000000 + 20000000 * k}", "Windows file times"),
        (lambda k: f"{(1793880000 + 2 * k) * 1000}", "milliseconds since 1970"),
    ],
)
def test_moments_that_are_numbers(cell: Callable[[int], str], words: str, tmp_path: Path) -> None:
    recording = read(tmp_path, "time,op,pv", cell)
    assert recording.period == pytest.approx(2.0, rel=1e-6)
    assert recording.irregular == 0
    assert recording.start == pytest.approx(START, abs=0.01)
    assert words in str(recording.notes)


@pytest.mark.parametrize("day", ["%Y%m%d", "%d.%m.%Y"])
@pytest.mark.parametrize("clock", ["%H%M%S", "%H:%M:%S"])
@pytest.mark.parametrize("begin", [NOON, NOON.replace(hour=0), NOON.replace(hour=9, minute=50)])
def test_a_time_in_digits_beside_a_date(
    day: str, clock: str, begin: datetime, tmp_path: Path
) -> None:
    def cell(k: int) -> str:
        moment = begin + timedelta(seconds=2 * k)
        digits = moment.strftime(clock)
        # What a spreadsheet leaves of 000002.
        return f"{moment.strftime(day)},{int(digits) if digits.isdigit() else digits}"

    recording = read(tmp_path, "date,time,op,pv", cell)
    assert (recording.period, recording.irregular) == (2.0, 0)
    assert recording.start == begin.timestamp()


@pytest.mark.parametrize(
    ("cell", "apart"),
    [
        (lambda k: f"{61349.5 + k / 43200:.9f}".replace("61349", "161349"), "2.31"),
        (lambda k: f"{12 + 20000000 * k}", "2e+07"),
    ],
)
def test_what_cannot_be_seconds_is_refused_unless_the_period_is_given(
    cell: Callable[[int], str], apart: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError) as caught:
        read(tmp_path, "time,op,pv", cell)
    assert f"the times are {apart}" in str(caught.value)
    assert "s apart if they count seconds; name their unit in the heading" in str(caught.value)
    assert read(tmp_path, "time,op,pv", cell, period=2.0).period == 2.0


@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("time", None), ("Time (UTC)", None), ("TIME/min", "min"), ("t [h]", "h"), ("h", None),
        ("Day", None), ("date", None), ("Time_us", "us"), ("Time [\u00b5s]", "us"),
        ("minutes", "min"), ("milliseconds", "ms"), ("time_stamp", None),
    ],
)  # fmt: skip
def test_units_of_headings(heading: str, unit: str | None) -> None:
    assert find_time_unit(heading, ()) == unit
