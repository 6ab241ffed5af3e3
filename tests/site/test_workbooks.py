"""Workbooks that cannot be read: one sentence each, whatever is wrong inside."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from fieldlink.site import RecordingError, SiteError, read_recording
from fieldlink.site.map_import import import_map

openpyxl = pytest.importorskip("openpyxl")

N = 60
OP = [50.0 + 0.1 * (k % 7) for k in range(N)]
PV = [40.0 + 0.2 * (k % 5) for k in range(N)]


def make(path: Path) -> Path:
    book = openpyxl.Workbook()
    book.active.append(["time", "op", "pv"])
    for k in range(N):
        book.active.append([k, OP[k], PV[k]])
    book.save(path)
    return path


def changed(path: Path, part: str, change: Callable[[bytes], bytes]) -> Path:
    """The workbook with one of its parts changed."""
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, content in parts.items():
            new.writestr(name, change(content) if name.endswith(part) else content)
    return path


@pytest.mark.parametrize("part", ["sheet1.xml", "/workbook.xml", "styles.xml", "_Types].xml"])
def test_a_part_that_was_cut_off(part: str, tmp_path: Path) -> None:
    path = changed(make(tmp_path / "loop.xlsx"), part, lambda content: content[: len(content) // 2])
    with pytest.raises(RecordingError, match=r"loop.xlsx: is a damaged workbook \(.*\); open it"):
        read_recording(path)
    with pytest.raises(SiteError, match="is a damaged workbook"):
        import_map(path)


def test_a_cell_that_is_no_number(tmp_path: Path) -> None:
    path = make(tmp_path / "loop.xlsx")
    changed(path, "sheet1.xml", lambda content: content.replace(b"<v>", b"<v>q"))
    with pytest.raises(RecordingError, match="is a damaged workbook"):
        read_recording(path)


def test_bytes_that_were_lost(tmp_path: Path) -> None:
    path = make(tmp_path / "loop.xlsx")
    content = bytearray(path.read_bytes())
    middle = content.index(b"xl/worksheets/sheet1.xml") + 300
    content[middle : middle + 100] = bytes(100)
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is a damaged workbook"):
        read_recording(path)


def test_a_password(tmp_path: Path) -> None:
    """Excel puts an encrypted workbook into a compound file, as it stored all of them in 1997."""
    path = tmp_path / "loop.xlsx"
    begin = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600)
    path.write_bytes(begin + "EncryptedPackage".encode("utf-16-le") + bytes(600))
    for read in (read_recording, import_map):
        with pytest.raises((RecordingError, SiteError), match="behind a password or a sensitivity"):
            read(path)
    path.write_bytes(begin)
    for read in (read_recording, import_map):
        with pytest.raises((RecordingError, SiteError), match="a workbook of Excel 97-2003; save"):
            read(path)


def test_a_cover_before_the_samples(tmp_path: Path) -> None:
    path = make(tmp_path / "loop.xlsx")
    book = openpyxl.load_workbook(path)
    book.create_sheet("Cover", 0).append(["Trial of 5 November"])
    book.active = 1
    book.save(path)
    with pytest.raises(RecordingError, match=rf"'Cover', .* has 1 rows, and 'Sheet' has {N + 1}"):
        read_recording(path)


def test_nothing_is_warned_of_that_is_no_concern_of_the_samples(tmp_path: Path) -> None:
    path = make(tmp_path / "loop.xlsx")
    book = openpyxl.load_workbook(path)
    book.active["D1"] = "made"
    book.active["D2"], book.active["D2"].number_format = 1e9, "yyyy-mm-dd"
    book.save(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(read_recording(path)) == N


@pytest.mark.parametrize("name", ["loop.csv", "loop", "loop.XLSX"])
def test_a_workbook_under_another_name_is_read(name: str, tmp_path: Path) -> None:
    path = make(tmp_path / "loop.xlsx").rename(tmp_path / name)
    assert read_recording(path).pv.tolist() == pytest.approx(PV)


def test_sheets_that_are_not_read_are_named(tmp_path: Path) -> None:
    """A second loop on a sheet of its own was left out without a word."""
    path = make(tmp_path / "loop.xlsx")
    book = openpyxl.load_workbook(path)
    book.copy_worksheet(book.active).title = "FC202"
    book.create_sheet("Remarks").append(["shift B"])
    book.save(path)
    notes = read_recording(path).notes
    assert [note for note in notes if "sheet" in note] == [
        "the first sheet, 'Sheet', is read, and not 'FC202'"
    ]
