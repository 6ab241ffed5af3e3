"""Historians' tables as they are: decimal commas, other units of time, loops without a clock."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fieldlink.assess import Job, Piece
from fieldlink.assess.errors import ReadingError
from fieldlink.assess.places import place_of
from fieldlink.assess.readers.registry import reader_of
from fieldlink.assess.series import Series
from fieldlink.site import SiteError

MOMENTS = 'time = "ts"\nloop = "name"\n'
TAGS = 'time = "ts"\ntag = "name"\nvalue = "val"\ntags = { op = "{loop}.OP", pv = "{loop}.PV" }\n'
BEGIN = 1_767_225_600
ROWS = range(100)


class Table:
    """A table of SQLite and its description."""

    def __init__(
        self, folder: Path, columns: str, rows: Sequence[tuple[Any, ...]], about: str
    ) -> None:
        with sqlite3.connect(folder / "plant.db") as db:
            db.execute(f"CREATE TABLE hist ({columns})")
            db.executemany(f"INSERT INTO hist VALUES ({', '.join('?' * len(rows[0]))})", rows)
        db.close()
        text = f'[sql]\nurl = "sqlite:///plant.db"\ntable = "hist"\n{about}'
        (folder / "x.toml").write_text(text)
        self._job = Job((place_of(str(folder / "x.toml")),))
        self._reader = reader_of("sql")

    def pieces(self) -> list[Piece]:
        found = list(self._reader.pieces(self._job, 0, ""))
        return [piece for piece in found if isinstance(piece, Piece)]

    def windows(self, piece: Piece) -> list[Series]:
        return [window for _, window in self._reader.windows(self._job, piece)]


def test_text_with_a_decimal_comma_is_a_number(tmp_path: Path) -> None:
    rows = [(i, "A", "50" if i % 7 == 0 else f"50,{i % 7}", f"{i % 5}.5") for i in ROWS]
    table = Table(tmp_path, "ts INTEGER, name TEXT, op TEXT, pv TEXT", rows, MOMENTS)
    (window,) = table.windows(table.pieces()[0])
    np.testing.assert_allclose(window.op, [50.0 + (i % 7) / 10.0 for i in ROWS])
    np.testing.assert_allclose(window.pv, [i % 5 + 0.5 for i in ROWS])


@pytest.mark.parametrize(
    ("cell", "op"), [("{:,}", "86.5"), ("{:,.1f}", "86"), ("{:G}", "86,5"), ("{:G.1f}", "86")]
)
def test_text_with_grouped_digits_is_a_number(tmp_path: Path, cell: str, op: str) -> None:
    def text(value: int) -> str:
        english = cell.replace("G", ",").format(value)
        return english.translate(str.maketrans(",.", ".,")) if "G" in cell else english

    rows = [(i, "A", op, text(950 + i)) for i in ROWS]
    table = Table(tmp_path, "ts INTEGER, name TEXT, op TEXT, pv TEXT", rows, MOMENTS)
    (window,) = table.windows(table.pieces()[0])
    np.testing.assert_allclose(window.pv, [950 + i for i in ROWS])


@pytest.mark.parametrize(
    ("text", "found"),
    [(lambda i: f"{950 + i:,}", "1,000"), (lambda i: f"86{',.'[i % 2]}{i % 7}", "86.1")],
    ids=["grouped", "both notations"],
)
def test_text_that_may_be_grouped_digits_is_refused(
    tmp_path: Path, text: Callable[[int], str], found: str
) -> None:
    rows = [(i, "A", "86", text(i)) for i in ROWS]
    table = Table(tmp_path, "ts INTEGER, name TEXT, op TEXT, pv TEXT", rows, MOMENTS)
    with pytest.raises(ReadingError, match=f"{found!r}, which may be decimals or grouped digits"):
        table.windows(table.pieces()[0])


@pytest.mark.parametrize(("unit", "counts"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
def test_times_of_another_unit_are_named_and_then_read(
    tmp_path: Path, unit: str, counts: int
) -> None:
    rows = [(counts * (BEGIN + i), "A", i % 7, i % 5) for i in ROWS]
    columns = "ts INTEGER, name TEXT, op REAL, pv REAL"
    (tmp_path / "a").mkdir()
    table = Table(tmp_path / "a", columns, rows, MOMENTS)
    with pytest.raises(ReadingError, match=f'set sql.time_unit = "{unit}"'):
        table.windows(table.pieces()[0])
    table = Table(tmp_path, columns, rows, f'{MOMENTS}time_unit = "{unit}"\n')
    (window,) = table.windows(table.pieces()[0])
    assert (window.time[0], window.period, len(window)) == (BEGIN, 1.0, len(ROWS))


def test_a_loop_without_a_clock_costs_the_others_nothing(tmp_path: Path) -> None:
    rows = [(None, "A", 1.0, 1.0), *((i, "B", i % 7, i % 5) for i in ROWS)]
    table = Table(tmp_path, "ts INTEGER, name TEXT, op REAL, pv REAL", rows, MOMENTS)
    first, second = table.pieces()
    with pytest.raises(ReadingError, match="no rows of 'A'"):
        table.windows(first)
    assert len(table.windows(second)[0]) == len(ROWS)


def test_a_table_that_is_described_wrongly_is_refused_at_the_door(tmp_path: Path) -> None:
    rows = [(i, "A.MV", i % 7) for i in ROWS]
    table = Table(tmp_path, "ts INTEGER, name TEXT, val REAL", rows, TAGS)
    with pytest.raises(ReadingError, match=r"no tag is named like \{loop\}.PV \(the first is A.MV"):
        table.pieces()
    (tmp_path / "b").mkdir()
    table = Table(tmp_path / "b", "ts INTEGER, name TEXT, val REAL", rows, MOMENTS)
    with pytest.raises(ReadingError, match="has no column 'op'"):
        table.pieces()


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("plant", "is not a database address; write sqlite:///"),
        ("postgresql://reader:secret@host:54x/plant", "is not a database address; write sqlite"),
        ("sqlite:///nothing.db", r"there is no file .*nothing.db \(.*\); check the path"),
    ],
)
def test_an_address_that_is_none_is_named_by_its_key(url: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_text(f'[sql]\nurl = "{url}"\ntable = "hist"\n{MOMENTS}')
    with pytest.raises(SiteError, match=f"x.toml:2: sql.url: {said}") as refused:
        place_of(str(tmp_path / "x.toml"))
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("about", [MOMENTS, TAGS])
def test_a_quality_that_no_row_has_is_named(about: str, tmp_path: Path) -> None:
    rows = [(i, tag, 50.0, 40.0, 45.0, 192) for i in ROWS for tag in ("A.OP", "A.PV")]
    columns = "ts INTEGER, name TEXT, op REAL, pv REAL, val REAL, q INTEGER"
    more = 'quality = "q"\ngood = [0, "Good"]\n'
    table = Table(tmp_path, columns, rows, about + more)
    with pytest.raises(ReadingError, match=r"\(q is never 0, 'Good'\); check sql.good"):
        table.windows(table.pieces()[0])


def test_numbers_in_text_with_three_decimals_are_read_of_tags_too(tmp_path: Path) -> None:
    rows = [(i, f"A.{role}", f"{i % 7}.{100 + i}") for i in ROWS for role in ("OP", "PV")]
    table = Table(tmp_path, "ts INTEGER, name TEXT, val TEXT", rows, TAGS)
    (window,) = table.windows(table.pieces()[0])
    np.testing.assert_allclose(window.pv, [i % 7 + (100 + i) / 1000.0 for i in ROWS])


def test_a_mode_may_stand_in_words(tmp_path: Path) -> None:
    rows = [(i, "A", i % 7, i % 5, "Man" if i < 30 else "AUTO") for i in ROWS]
    columns = "ts INTEGER, name TEXT, op REAL, pv REAL, mode TEXT"
    table = Table(tmp_path, columns, rows, f'{MOMENTS}auto = "mode"\n')
    (window,) = table.windows(table.pieces()[0])
    assert window.auto is not None
    np.testing.assert_array_equal(window.auto, [i >= 30 for i in ROWS])


def test_what_a_table_loses_is_noted(tmp_path: Path) -> None:
    """An hour that local time repeats, and an OP that is stored when it changes."""
    rows = [(i % 80, "A", i % 7, i % 5) for i in ROWS]
    (tmp_path / "hour").mkdir()
    table = Table(tmp_path / "hour", "ts INTEGER, name TEXT, op REAL, pv REAL", rows, MOMENTS)
    (window,) = table.windows(table.pieces()[0])
    assert window.notes[0].startswith("20 rows have the moment of another")
    rows = [(i, "A.PV", i % 5) for i in ROWS] + [(i, "A.OP", i) for i in ROWS if i % 9 == 0]
    table = Table(tmp_path, "ts INTEGER, name TEXT, val REAL", rows, TAGS)
    (window,) = table.windows(table.pieces()[0])
    assert window.notes[0].startswith("A.OP has values at 12 of the 100 moments of A.PV")
