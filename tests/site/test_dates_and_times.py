"""Dates and times of day as people and programs write them: which day, which hour, which unit."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from fieldlink.site import Recording, RecordingError, read_recording

N = 900
NOON = "2026-11-05T12:00:00"
LATE = "2026-11-05T23:50:00"


def moments(begin: str) -> list[datetime]:
    first = datetime.fromisoformat(begin).replace(tzinfo=UTC)
    return [first + timedelta(seconds=2 * k) for k in range(N)]


def read(
    folder: Path,
    cell: Callable[[datetime], str],
    *,
    begin: str = NOON,
    head: str = "time",
    mark: str = ",",
) -> Recording:
    path = folder / "loop.csv"
    rows = [f"{cell(m)}{mark}{k}{mark}{-k}" for k, m in enumerate(moments(begin))]
    path.write_text("\n".join([f"{head}{mark}op{mark}pv", *rows]) + "\n")
    return read_recording(path)


def check(recording: Recording, begin: str | None = NOON) -> None:
    assert recording.op.tolist() == list(range(N))
    assert recording.period == pytest.approx(2.0, rel=1e-4)
    assert recording.irregular == 0
    if begin is None:
        assert recording.start is None
    else:
        start = datetime.fromisoformat(begin).replace(tzinfo=UTC).timestamp()
        assert recording.start == pytest.approx(start, abs=0.01)


def strftime(form: str) -> Callable[[datetime], str]:
    return lambda moment: moment.strftime(form)


@pytest.mark.parametrize(
    ("form", "mark"),
    [
        ("%d.%m.%Y %H:%M:%S", ","),
        ("%d.%m.%y %H:%M:%S", ";"),
        ("%Y.%m.%d %H:%M:%S", ","),
        ("%Y/%m/%d %H:%M:%S", ";"),
        ("%d-%b-%y %H:%M:%S", ","),
    ],
)
@pytest.mark.parametrize("begin", [NOON, LATE])
def test_a_date_with_one_reading(form: str, mark: str, begin: str, tmp_path: Path) -> None:
    recording = read(tmp_path, strftime(form), begin=begin, mark=mark)
    check(recording, begin)
    assert recording.notes == ()


@pytest.mark.parametrize(
    ("form", "mark", "read_as", "other"),
    [
        ("%d/%m/%Y %H:%M:%S", ";", "2026-11-05", "2026-05-11"),
        ("%m/%d/%Y %H:%M:%S", ",", "2026-11-05", "2026-05-11"),
        ("%m/%d/%Y %I:%M:%S %p", ";", "2026-11-05", "2026-05-11"),
    ],
)
def test_a_date_with_two_readings_gets_a_note(
    form: str, mark: str, read_as: str, other: str, tmp_path: Path
) -> None:
    recording = read(tmp_path, strftime(form), mark=mark)
    check(recording)
    assert f"which is read as {read_as}; write the year first if it is {other}" in str(
        recording.notes
    )


@pytest.mark.parametrize("form", ["%d/%m/%Y %H:%M:%S", "%m/%d/%Y %I:%M:%S %p"])
def test_a_midnight_proves_which_of_the_two_is_the_day(form: str, tmp_path: Path) -> None:
    recording = read(tmp_path, strftime(form), begin=LATE)
    check(recording, LATE)
    assert recording.notes == ()


@pytest.mark.parametrize("begin", [NOON, LATE])
@pytest.mark.parametrize(
    "form",
    [
        "%m/%d/%Y,%I:%M:%S %p",
        "%d-%b-%Y,%H:%M:%S",
        "%d-%b-%Y,%I:%M:%S %p",
        "%d %b %Y,%I:%M:%S%p",
    ],
)
def test_date_and_time_in_two_columns(form: str, begin: str, tmp_path: Path) -> None:
    check(read(tmp_path, strftime(form), begin=begin, head="Date,Time"), begin)


def test_halves_of_the_day_with_points(tmp_path: Path) -> None:
    half = {"AM": "a. m.", "PM": "p. m."}
    recording = read(
        tmp_path,
        lambda m: f"{m:%d.%m.%Y %I:%M:%S} {half[f'{m:%p}']}",
        begin="2026-11-05T11:50:00",
    )
    check(recording, "2026-11-05T11:50:00")


@pytest.mark.parametrize("form", ["%I:%M:%S %p", "%H:%M:%S"])
@pytest.mark.parametrize("begin", [NOON, LATE])
@pytest.mark.parametrize("order", [1, -1])
def test_times_of_day_go_on_after_midnight(
    form: str, begin: str, order: int, tmp_path: Path
) -> None:
    path = tmp_path / "loop.csv"
    rows = [f"{m.strftime(form)},{k},{-k}" for k, m in enumerate(moments(begin))]
    path.write_text("\n".join(["time,op,pv", *rows[::order]]) + "\n")
    check(read_recording(path), None)


def test_a_date_that_cannot_be_read_is_not_left_out_silently(tmp_path: Path) -> None:
    recording = read(tmp_path, strftime("week 45,%H:%M:%S"), head="Date,Time")
    check(recording, None)
    assert "Date is left out: 'week 45' is not a date" in str(recording.notes)


@pytest.mark.parametrize("begin", ["2026-11-05T00:00:00", "2026-11-05T00:50:00"])
@pytest.mark.parametrize("form", ["%M:%S.0", "%M:%S"])
def test_minutes_and_seconds(form: str, begin: str, tmp_path: Path) -> None:
    """What a spreadsheet writes of times whose hours it does not show."""
    recording = read(tmp_path, strftime(form), begin=begin)
    check(recording, None)
    assert "time is read as minutes and seconds" in recording.notes


def test_two_numbers_that_may_be_hours_or_minutes_get_a_note(tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    rows = [f"{k // 30:02d}:{2 * k % 60:02d},{k},{-k}" for k in range(300)]
    path.write_text("\n".join(["time,op,pv", *rows]) + "\n")
    recording = read_recording(path)
    assert recording.period == 120.0
    assert "read as hours and minutes; write 0:MM:SS if" in str(recording.notes)


@pytest.mark.parametrize("form", ["{days} day{s}, {rest}", "{hours}:{minutes:02d}:00"])
def test_durations_of_more_than_a_day(form: str, tmp_path: Path) -> None:
    path = tmp_path / "loop.csv"
    cells = []
    for k in range(300):
        days, rest = divmod(10 * k, 1440)
        hours, minutes = divmod(10 * k, 60)
        clock = f"{rest // 60}:{rest % 60:02d}:00"
        text = form.format(
            days=days, s="" if days == 1 else "s", rest=clock, hours=hours, minutes=minutes
        )
        cells.append(text if days else clock)
    path.write_text("\n".join(["time;op;pv", *(f"{c};{k};{-k}" for k, c in enumerate(cells))]))
    recording = read_recording(path)
    assert (recording.period, recording.irregular) == (600.0, 0)


@pytest.mark.parametrize("zone", ["CET", "EST", "MESZ"])
def test_a_zone_in_letters_is_named_as_the_cause(zone: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=f"names a time zone, {zone}, by letters") as caught:
        read(tmp_path, strftime(f"%Y-%m-%d %H:%M:%S {zone}"))
    assert "loop.csv:2: time: " in str(caught.value)
