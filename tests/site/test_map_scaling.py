"""What vendors' lists say of a register's worth is applied, or its row is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from fieldlink.registers import Table
from fieldlink.site.map_addresses import FoundAddress, guess_style, parse_address
from fieldlink.site.map_import import ImportedMap, import_map
from fieldlink.site.map_scaling import limits, scale_cell


def imported(folder: Path, text: str, **options: object) -> ImportedMap:
    path = folder / "vendor.csv"
    path.write_text(text, encoding="utf-8")
    return import_map(path, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("heading", "cell", "scale"),
    [
        ("Divisor", "10", 0.1),
        ("Divisor", "/100", 0.01),
        ("Decimals", "2", 0.01),
        ("Nachkommastellen", "0", 1.0),
        ("Scale", "/10", 0.1),
        ("Scale", "\u00f7100", 0.01),
        ("Scale", "1:10", 0.1),
        ("Scale", "10^-1", 0.1),
        ("Scale", "x0,1", 0.1),
        ("Scale", "0.1 degC", 0.1),
        ("Scale", "1e-1", 0.1),
    ],
)
def test_a_count_is_worth_what_the_list_says(
    heading: str, cell: str, scale: float, tmp_path: Path
) -> None:
    found = imported(tmp_path, f"Tag;Address;Type;{heading}\nPV;1;INT;{cell}\n")
    assert found.problems == ()
    assert found.tags["PV"].scale == pytest.approx(scale, rel=1e-15)


def test_a_factor_is_divided_by_the_divisor_and_stands_before_decimals() -> None:
    assert float(scale_cell({"scale": "5", "divisor": "10", "type": "int16"})) == 0.5
    assert scale_cell({"scale": "0.1", "decimals": "2", "type": "int16"}) == "0.1"
    # A float has its own decimals: those of the list are what a panel shows.
    assert scale_cell({"decimals": "2", "type": "float32"}) == ""


@pytest.mark.parametrize(
    ("heading", "cell", "said"),
    [
        ("Scale", "x10", "'x10' does not say whether the value or the register is larger"),
        ("Divisor", "0", "'0' cannot divide"),
        ("Divisor", "ten", "'ten' cannot divide"),
        ("Divisor", "1,000", "'1,000' cannot divide"),
        ("Decimals", "0.1", "'0.1' does not count decimals"),
        ("Scale", "0x10", "'0x10' is not a number"),
    ],
)
def test_a_count_of_unclear_worth_is_a_bad_row(
    heading: str, cell: str, said: str, tmp_path: Path
) -> None:
    found = imported(tmp_path, f"Tag;Address;Type;{heading}\nPV;1;INT;{cell}\n")
    assert found.tags == {}
    assert [p.message for p in found.problems if p.line == 2] == [said]


def test_a_scale_that_may_be_a_divisor_is_shown_and_can_be_said_to_be_one(tmp_path: Path) -> None:
    text = "Tag;Address;Type;Scale;Unit\nPV;1;INT;10;%\n"
    (said,) = [note for note in imported(tmp_path, text).notes if "multiplies" in note]
    assert said == (
        "'Scale' multiplies: a raw 100 of PV is 1000 %; "
        "if the register holds 10 times the value, give --column divisor='Scale'"
    )
    told = imported(tmp_path, text, headings={"divisor": "Scale"})
    assert told.tags["PV"].scale == 0.1


@pytest.mark.parametrize(
    ("cell", "ends"),
    [
        ("0..100", ("0.0", "100.0")),
        ("0-16,5 bar", ("0.0", "16.5")),
        ("-10 \u2026 +50 \u00b0C", ("-10.0", "50.0")),
        ("0 to 100 %", ("0.0", "100.0")),
        ("0=Off 1=On", None),
        ("100-0", None),
        ("5", None),
        ("", None),
    ],
)
def test_ranges_as_lists_write_them(cell: str, ends: tuple[str, str] | None) -> None:
    assert limits(cell) == ends


def test_a_range_limits_a_tag_and_what_is_none_is_noted(tmp_path: Path) -> None:
    rows = "PV;1;INT;0..100\nMODE;2;INT;0=man 1=auto\n"
    found = imported(tmp_path, f"Tag;Address;Type;Range\n{rows}")
    assert (found.tags["PV"].low, found.tags["PV"].high) == (0.0, 100.0)
    assert found.tags["MODE"].high is None
    assert "'Range' of 1 rows is not a range such as 0..100: left out" in found.notes


@pytest.mark.parametrize(
    ("cell", "writable"), [("yes", False), ("x", False), ("", False), ("no", True)]
)
def test_what_a_list_calls_read_only_is_not_writable(
    cell: str, writable: bool, tmp_path: Path
) -> None:
    found = imported(tmp_path, f"Tag;Address;Type;Read only\nSP;1;INT;{cell}\n")
    assert found.tags["SP"].writable is writable


@pytest.mark.parametrize(
    ("cell", "style", "expected"),
    [
        ("100-101", "zero", FoundAddress(100, registers=2)),
        ("100..103", "zero", FoundAddress(100, registers=4)),
        ("40001 - 40002", "modicon", FoundAddress(0, Table.HOLDING, registers=2)),
        ("%MW100", "zero", FoundAddress(100, Table.HOLDING)),
        ("%MW100.3", "one", FoundAddress(100, Table.HOLDING, 3)),
        ("%MW100:X3", "zero", FoundAddress(100, Table.HOLDING, 3)),
    ],
)
def test_spans_and_memory_words(cell: str, style: str, expected: FoundAddress) -> None:
    assert parse_address(cell, style) == expected  # type: ignore[arg-type]


@pytest.mark.parametrize("cell", ["101-100", "100.1-100.2", "%MD100", "%MW100.16", "MW100"])
def test_other_spans_and_memories_are_refused(cell: str) -> None:
    with pytest.raises(ValueError, match=";"):
        parse_address(cell, "zero")


def test_a_span_tells_the_style_and_has_the_size_of_the_type(tmp_path: Path) -> None:
    assert guess_style(["40001-40002", "40003-40004"]) == "modicon"
    found = imported(tmp_path, "Tag;Address;Type\nPV;100-101;FLOAT\nOP;102-103;INT\n")
    assert found.tags["PV"].address == 100
    (problem,) = found.problems
    assert problem.message == "2 is given for int16, which takes 1 register"
