"""Headings as people and historians write them."""

from __future__ import annotations

from pathlib import Path

import pytest

from fieldlink.site import RecordingError, read_recording
from fieldlink.site.column_names import guess_columns, loops_side_by_side


@pytest.mark.parametrize(
    ("header", "roles"),
    [
        ("timestamp;op;pv", "time op pv"),
        ("Date;FC101.OP;FC101.PV;FC101.SP", "time op pv sp"),
        ("Zeit;Stellgröße;Istwert;Sollwert", "time op pv sp"),
        ("PV_FC101;SP_FC101;OP_FC101;Time Stamp", "pv sp op time"),
        ("FIC1.OUT;FIC1.PV;FIC1.MODE", "op pv auto"),
        ("FIC1/PID.MV [%];FIC1/PID.PV [m3/h]", "op pv"),
        ("Controller output (%);Process Value;Set Point", "op pv sp"),
        ("Datum;Zeit;LMN;PV", "- time op pv"),
        ("quality;op;pv;pump", "- op pv -"),
        ("top;op;pv;output", "- op pv -"),
    ],
)
def test_columns_are_found_as_people_name_them(header: str, roles: str) -> None:
    found = guess_columns(tuple(header.split(";")), {})
    expected = {role: n for n, role in enumerate(roles.split()) if role != "-"}
    assert dict(found.columns) == expected
    assert not found.ambiguous


def test_several_loops_are_ambiguous_until_one_is_named() -> None:
    header = ("t", "A.OP", "A.PV", "A.SP", "B.OP", "B.PV")
    assert set(guess_columns(header, {}).ambiguous) == {"op", "pv"}
    one = guess_columns(header, {"op": 4})
    assert dict(one.columns) == {"pv": 5, "time": 0}
    other = guess_columns(header, {"pv": 2})
    assert dict(other.columns) == {"op": 1, "sp": 3, "time": 0}


def write(path: Path, header: str, row: str) -> Path:
    path.write_text("\n".join([header, *(row.format(k=k, s=f"{k:02d}") for k in range(60))]) + "\n")
    return path


def test_what_was_taken_is_reported(tmp_path: Path) -> None:
    file = write(tmp_path / "x.csv", "Zeit;FC1.OUT;FC1.PV", "12:00:{s};{k};5")
    recording = read_recording(file)
    assert recording.period == 1.0
    assert recording.op[3] == 3.0
    assert recording.notes[0] == (
        "columns taken by their names: op is 'FC1.OUT', pv is 'FC1.PV', time is 'Zeit'"
    )


def test_an_ambiguity_lists_the_candidates(tmp_path: Path) -> None:
    file = write(tmp_path / "x.csv", "A.OP;A.PV;B.OP;B.PV", "{k};1;2;{k}")
    with pytest.raises(RecordingError) as caught:
        read_recording(file)
    said = str(caught.value)
    assert "several columns may be meant: A.OP, B.OP; choose one with --op 'A.OP'" in said
    assert read_recording(file, op="B.OP").pv[7] == 7.0


def test_a_mode_in_numbers_and_a_date_without_time_are_left_out_with_a_note(
    tmp_path: Path,
) -> None:
    file = write(tmp_path / "x.csv", "Date;op;pv;mode", "2026-11-21;{k};5;8")
    recording = read_recording(file)
    assert (recording.auto, recording.period) == (None, 1.0)
    notes = " ".join(recording.notes)
    assert "mode is left out: name it with --auto" in notes
    assert "Date is left out" in notes
    words = write(tmp_path / "y.csv", "op;pv;mode", "{k};5;MAN")
    assert read_recording(words).auto is not None


@pytest.mark.parametrize(
    ("header", "loops"),
    [
        ("t;A.OP;A.PV;B.OP;B.PV;C.PV", "A B"),
        ("t;OP_FC101;PV_FC101;OP_FC102;PV_FC102", "FC101 FC102"),
        ("FIC1/PID.MV [%];FIC1/PID.PV;FIC2/PID.MV [%];FIC2/PID.PV", "FIC1/PID FIC2/PID"),
        ("A.OP.Value;A.PV.Value;B.OP.Value;B.PV.Value", "A B"),
        ("A.OP;A.PV;A.OUT;B.OUT;B.PV;C.MV;C.Istwert", "A B C"),
        ("Öl-1 OUT;Öl-1 PV;Öl-2 OUT;Öl-2 PV", "Öl-1 Öl-2"),
        ("op;pv;A.OP;A.PV;B.OP;B.PV", ""),
        ("A.OP;A.PV", ""),
        ("A.OP;A.PV;B.OP", "A"),
        ("A.OP;A.PV;T1.PV;T2.PV", "A"),
        ("A.OP;A.OP;A.PV;B.OP;B.PV", "B"),
    ],
)
def test_loops_beside_each_other_are_known_by_their_names(header: str, loops: str) -> None:
    assert list(loops_side_by_side(header.split(";"))) == loops.split()
