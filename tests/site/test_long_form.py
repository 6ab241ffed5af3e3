"""Recordings with a row for each value: the same loop as in a table with a row for each moment."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from fieldlink.site import Recording, RecordingError, read_recording
from fieldlink.site.recording import read_recordings

N = 120
OP = np.round(40.0 + 10.0 * np.sin(np.arange(N) / 9.0), 3)
PV = np.round(OP + 1.5, 3)
SP = np.where(np.arange(N) < 70, 41.0, 43.0)
SIGNALS = {"OP": OP, "PV": PV, "SP": SP}
NAMES = {"op", "pv", "sp", "auto", "time"}
COLUMNS: dict[str, str | None] = dict.fromkeys(NAMES)

Row = Callable[[str, int, float], str]


def at(k: int, milliseconds: int = 0) -> datetime:
    return datetime(2026, 3, 4, 10, tzinfo=UTC) + timedelta(
        seconds=2 * k, milliseconds=milliseconds
    )


def plain(tag: str, k: int, value: float) -> str:
    return f"{at(k):%Y-%m-%d %H:%M:%S},{tag},{value}"


def comma(value: float) -> str:
    return f"{value:.3f}".replace(".", ",")


def values(*, by_tag: bool = False, loop: str = "FC101") -> list[tuple[str, int, float]]:
    rows = [
        (f"{loop}.{name}", k, float(signal[k]))
        for k in range(N)
        for name, signal in SIGNALS.items()
    ]
    return sorted(rows, key=lambda row: row[0]) if by_tag else rows


def table(head: str, row: Row, rows: list[tuple[str, int, float]]) -> str:
    return "\n".join([head, *(row(*each) for each in rows)]) + "\n"


def read(path: Path, text: str, *, op: str | None = None, pv: str | None = None) -> Recording:
    path.write_text(text, encoding="utf-8")
    return read_recording(path, op=op, pv=pv)


def check(recording: Recording) -> None:
    assert len(recording) == N
    assert recording.period == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(recording.op, OP)
    np.testing.assert_allclose(recording.pv, PV)
    assert recording.sp is not None
    np.testing.assert_allclose(recording.sp, SP)


LATE = {"FC101.SP": 3, "FC101.OP": 7, "FC101.PV": 300}


@pytest.mark.parametrize(
    "text",
    {
        "sorted by time": table("Timestamp,Tag,Value", plain, values()),
        "sorted by tag": table("Timestamp,Tag,Value", plain, values(by_tag=True)),
        "newest first": table("Timestamp,Tag,Value", plain, values()[::-1]),
        "under titles": "Export\n\n" + table("Timestamp,TagName,Value", plain, values()),
        "with a quality and a unit": table(
            "Tag;Zeitstempel;Einheit;Wert;Qualität",
            lambda tag, k, v: f"{tag};{at(k):%d.%m.%Y %H:%M:%S};%;{comma(v)};192",
            values(),
        ),
        "an archive of WinCC": table(
            '"VarName";"TimeString";"VarValue";"Validity";"Time_ms"',
            lambda tag, k, v: f'"{tag}";"{at(k):%d.%m.%Y %H:%M:%S}";{comma(v)};1;{4.6e10 + 23 * k}',
            values(),
        )
        + '"$RT_OFF$";"04.03.2026 11:00:00";0;2;46085437500\n',
        "each value with a stamp of its own": table(
            "_time,_field,_value",
            lambda tag, k, v: f"{at(k, LATE[tag]).isoformat()},{tag},{v}",
            values(by_tag=True),
        ),
        "date and time apart": table(
            "Date,Time,Tag,Value",
            lambda tag, k, v: f"{at(k):%Y-%m-%d},{at(k):%H:%M:%S},{tag},{v}",
            values(),
        ),
        "the set-point when it changes": table(
            "Timestamp,Tag,Value",
            plain,
            [row for row in values() if row[0] != "FC101.SP" or row[1] in (0, 70)],
        ),
    }.items(),
    ids=lambda item: item[0],
)
def test_every_form_holds_the_same_loop(tmp_path: Path, text: tuple[str, str]) -> None:
    check(read(tmp_path / "long.csv", text[1]))


def test_what_is_of_bad_quality_is_a_bad_sample(tmp_path: Path) -> None:
    def row(tag: str, k: int, value: float) -> str:
        return f"{plain(tag, k, value)},{'Bad' if (tag, k) == ('FC101.PV', 5) else 'Good'}"

    found = read(tmp_path / "long.csv", table("Timestamp,Tag,Value,Quality", row, values()))
    assert np.flatnonzero(np.isnan(found.pv)).tolist() == [5]
    assert not np.isnan(found.op).any()


def test_a_value_that_is_missing_is_a_bad_sample(tmp_path: Path) -> None:
    rows = [row for row in values() if row[:2] != ("FC101.OP", 5)]
    found = read(tmp_path / "long.csv", table("Timestamp,Tag,Value", plain, rows))
    assert np.flatnonzero(np.isnan(found.op)).tolist() == [5]


def test_the_loops_of_a_file_are_told_apart_and_one_can_be_named(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    text = table("Timestamp,Tag,Value", plain, values() + values(loop="FC102"))
    with pytest.raises(RecordingError, match=r"Tag: holds 2 loops: 'FC101', 'FC102'; name OP and"):
        read(path, text)
    check(read(path, text, op="FC102.OP", pv="fc102.pv"))
    assert [name for name, _ in read_recordings(path, COLUMNS)] == ["FC101", "FC102"]


def test_one_bad_loop_costs_the_others_nothing(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    rows = [row for row in values() if row[0] != "FC101.OP" or row[1] % 9 == 0]
    path.write_text(table("Timestamp,Tag,Value", plain, rows + values(loop="FC102")))
    found: list[str] = []

    def read_all() -> None:
        for name, _ in read_recordings(path, COLUMNS):
            found.append(name)

    # The error comes behind the last loop.
    with pytest.raises(RecordingError, match=r"FC101\.OP: 14 values, of which 14 belong to"):
        read_all()
    assert found == ["FC102"]


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        (
            table("Timestamp,Tag,Value", plain, [("A", k, 1.0 * k) for k in range(N)]),
            {},
            "op: no tag of that name; use one of: A, or say which tag is op",
        ),
        (
            table("Timestamp,Tag,Value", plain, values()),
            {"op": "FC101.OX", "pv": "FC101.PV"},
            "FC101.OX: no tag of that name; did you mean 'FC101.OP'?",
        ),
        (
            table("Timestamp,Tag,Value", plain, values()).replace(
                f",FC101.PV,{PV[3]}", ",FC101.PV,x"
            ),
            {},
            "12: FC101.PV: 'x' is not a number",
        ),
        (
            table("Timestamp,Tag,Value", lambda tag, _, v: f"then,{tag},{v}", values()),
            {},
            "2: Timestamp: ",
        ),
        (
            table("Timestamp,Tag,Value", plain, values()[:90]),
            {},
            "has 30 rows, at least 50 are needed",
        ),
    ],
)
def test_what_is_wrong_is_said_with_its_place(
    tmp_path: Path, text: str, options: dict[str, str], expected: str
) -> None:
    with pytest.raises(RecordingError) as caught:
        read(tmp_path / "long.csv", text, **options)
    assert expected in str(caught.value)


def test_the_repeated_hour_of_summer_time(tmp_path: Path) -> None:
    """In local time an hour stands twice: the second one is that of winter time."""
    begin = datetime(2026, 10, 25, 1, 59, tzinfo=UTC)
    k_of_change = 30

    def row(tag: str, k: int, value: float) -> str:
        # Two minutes apart, from 01:59 on; after an hour the clock is set back from 03:00 to 02:00.
        wall = begin + timedelta(minutes=2 * k) - timedelta(hours=1 if k > k_of_change else 0)
        return f"{wall:%d.%m.%Y %H:%M:%S},{tag},{value}"

    found = read(tmp_path / "long.csv", table("Timestamp,Tag,Value", row, values()))
    assert found.period == pytest.approx(120.0)
    np.testing.assert_allclose(found.pv, PV)
    np.testing.assert_allclose(found.op, OP)


def test_a_loop_beside_tags_without_a_valve_is_read_and_named(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    lonely = [(tag.replace("FC101.PV", "TI7.PV"), *rest) for tag, *rest in values()]
    lonely = [row for row in lonely if row[0] == "TI7.PV"]
    other = [("FC9.OP", *rest) for tag, *rest in values() if tag == "FC101.OP"]
    path.write_text(table("Timestamp,Tag,Value", plain, values() + lonely + other))
    ((name, found),) = read_recordings(path, COLUMNS)
    assert name == "FC101"
    assert "left out, not one OP with one PV: FC9.OP" in found.notes
    path.write_text(table("Timestamp,Tag,Value", plain, values()))
    assert [name for name, _ in read_recordings(path, COLUMNS)] == ["FC101"]
