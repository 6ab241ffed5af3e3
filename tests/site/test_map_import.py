"""Vendors' lists become register maps, and a register map that is written reads back."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.registers import DataType, Table
from fieldlink.site import SiteError, read_register_map
from fieldlink.site.map_addresses import FoundAddress, guess_style, parse_address
from fieldlink.site.map_export import write_map
from fieldlink.site.map_import import import_map

VENDOR = """\
Register Name;Modbus Address;Data Type;Access;Factor;Unit;Min;Max;Remarks;Vendor id
Tank level;40001;REAL;R;;m;0;12,5;main tank;7
Pump speed;40003;UINT;R/W;0,1;rpm;0;3000;;8
Running;40010.3;BOOL;R;;;;;bit of the status;9
Serial number;40020;STRING16;R;;;;;;10
Feed;30005;INT;R;1/10;degC;;;;11
Valve open;10004;BOOL;R;;;;;;12
Start;00002;BOOL;RW;;;;;;13
"""


def write(folder: Path, text: str, name: str = "vendor.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_vendors_list_is_understood(tmp_path: Path) -> None:
    found = import_map(write(tmp_path, VENDOR))
    assert found.problems == ()
    places = {name: (tag.table, tag.address, tag.data_type) for name, tag in found.tags.items()}
    assert places == {
        "Tank level": (Table.HOLDING, 0, DataType.FLOAT32),
        "Pump speed": (Table.HOLDING, 2, DataType.UINT16),
        "Running": (Table.HOLDING, 9, DataType.BOOL),
        "Serial number": (Table.HOLDING, 19, DataType.STRING),
        "Feed": (Table.INPUT, 4, DataType.INT16),
        "Valve open": (Table.DISCRETE, 3, DataType.BOOL),
        "Start": (Table.COIL, 1, DataType.BOOL),
    }
    assert found.tags["Running"].bit == 3
    assert found.tags["Serial number"].length == 8
    assert found.tags["Pump speed"].scale == 0.1
    assert found.tags["Pump speed"].writable
    assert found.tags["Feed"].scale == 0.1
    assert found.tags["Tank level"].high == 12.5
    notes = " / ".join(found.notes)
    assert "40001 is holding register 0" in notes
    assert "'Vendor id' is left out" in notes


def test_every_bad_row_is_reported_and_the_good_ones_are_kept(tmp_path: Path) -> None:
    bad = """\
name,register,format,length
good,40001,float,2
no address,,float,
other style,17,float,
no such type,40005,decimal,
too long,40007,int16,3
no bit 16,40009.16,bool,
below,40000,int16,
good,40020,int16,
"""
    lines = bad.splitlines()
    more = "\n".join(f"n{i},{40100 + i},word," for i in range(30))
    found = import_map(write(tmp_path, "\n".join([*lines, more])))
    said = {problem.line: f"{problem.key}: {problem.message}" for problem in found.problems}
    assert said == {
        3: "address: '' is not an address",
        4: "address: '17' is not written like the others (40001)",
        5: "type: 'decimal' is unknown",
        6: "length: 3 is given for int16, which takes 1 register",
        7: "address: '40009.16': a register has no bit 16",
        8: "address: '40000' is address -1",
        9: "tag: good is already on line 2",
    }
    assert found.bad_rows == 7
    assert len(found.tags) == 31


@pytest.mark.parametrize(
    ("cell", "style", "expected"),
    [
        ("0", "zero", FoundAddress(0)),
        ("0x64", "zero", FoundAddress(100)),
        ("100.0", "zero", FoundAddress(100)),
        ("100.12", "zero", FoundAddress(100, None, 12)),
        ("1", "one", FoundAddress(0)),
        ("40001", "modicon", FoundAddress(0, Table.HOLDING)),
        ("400001", "modicon", FoundAddress(0, Table.HOLDING)),
        ("4x00100", "modicon", FoundAddress(99, Table.HOLDING)),
        ("465536", "modicon", FoundAddress(65535, Table.HOLDING)),
        ("30011", "modicon", FoundAddress(10, Table.INPUT)),
        ("10001", "modicon", FoundAddress(0, Table.DISCRETE)),
        ("00001", "modicon", FoundAddress(0, Table.COIL)),
    ],
)
def test_addresses_as_manuals_write_them(cell: str, style: str, expected: FoundAddress) -> None:
    assert parse_address(cell, style) == expected  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("cell", "style"),
    [("", "zero"), ("ten", "zero"), ("65536", "zero"), ("0", "one"), ("40000", "modicon")],
)
def test_what_is_not_an_address_is_refused(cell: str, style: str) -> None:
    with pytest.raises(ValueError, match=";"):
        parse_address(cell, style)  # type: ignore[arg-type]


def test_one_slip_among_many_does_not_change_the_style() -> None:
    assert guess_style([*(str(40001 + n) for n in range(9)), "17"]) == "modicon"
    assert guess_style(["0", "1", "40001"]) == "zero"


def test_a_list_without_addresses_says_which_heading_is_missing(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match="address: no heading is known to mean it"):
        import_map(write(tmp_path, "name,type\nA,int16\n"))


def test_a_workbook_with_a_title_above_the_headings(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    rows = [
        ["Pump station, register list", None, None],
        [],
        ["Signal", "Address", "Type"],
        ["Level", 40001, "FLOAT"],
        ["Pressure", 40003, "FLOAT"],
        ["Spare", None, None],
    ]
    for row in rows:
        book.active.append(row)
    book.save(tmp_path / "list.xlsx")
    found = import_map(tmp_path / "list.xlsx")
    assert {name: tag.address for name, tag in found.tags.items()} == {"Level": 0, "Pressure": 2}
    assert [(problem.line, problem.key) for problem in found.problems] == [(6, "address")]
    with pytest.raises(SiteError, match="Sheet9"):
        import_map(tmp_path / "list.xlsx", sheet="Sheet9")


def test_the_commands(tmp_path: Path) -> None:
    bad = write(tmp_path, "name,address,type\nA,0,float\nB,x,float\n")
    out = tmp_path / "map.csv"
    refused = CliRunner().invoke(app, ["map", "import", str(bad), "--out", str(out)])
    assert refused.exit_code == 2
    assert "vendor.csv:3: address: 'x' is not an address" in refused.stderr
    assert not out.exists()
    taken = CliRunner().invoke(app, ["map", "import", str(bad), "--out", str(out), "--skip-bad"])
    assert taken.exit_code == 0
    assert list(read_register_map(out)) == ["A"]
    # By now somebody may have worked on it.
    out.write_text(out.read_text() + "MINE,holding,9,int16,\n")
    again = CliRunner().invoke(app, ["map", "import", str(bad), "--out", str(out), "--skip-bad"])
    assert again.exit_code == 2
    assert "replace it with --force" in again.stderr
    assert "MINE" in out.read_text()
    command = ["map", "import", str(bad), "--out", str(out), "--skip-bad", "--force"]
    assert CliRunner().invoke(app, command).exit_code == 0
    assert "MINE" not in out.read_text()
    site = Path(__file__).parents[2] / "site_configs" / "demo.toml"
    shown = CliRunner().invoke(app, ["map", "export", str(site)])
    assert shown.stdout.startswith("tag,table,address,type,order,unit,low,high,writable,comment\n")


@pytest.mark.parametrize("name", ["written.csv", "written.xlsx"])
def test_what_is_written_reads_back(tmp_path: Path, name: str) -> None:
    tags = import_map(write(tmp_path, VENDOR)).tags
    write_map(tags.values(), tmp_path / name)
    again = import_map(tmp_path / name)
    assert again.problems == ()
    assert dict(again.tags) == dict(tags)
    if name.endswith(".csv"):
        assert dict(read_register_map(tmp_path / name)) == dict(tags)


def test_of_two_rows_that_cannot_both_be_right_the_later_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "vendor.csv"
    file.write_text(
        "tag,address,type\nFLOW,10,float32\nTEMP,20,int32\nSTATE,10,uint16\nHALF,19,float32\n"
    )
    found = import_map(file)
    assert list(found.tags) == ["FLOW", "TEMP"]
    assert [problem.line for problem in found.problems] == [4, 5]
    assert "has the registers of FLOW (line 2)" in str(found.problems[0])
    assert "reaches into TEMP (line 3)" in str(found.problems[1])
    assert len(found.tags) + found.bad_rows == found.rows


def test_a_heading_is_named_where_the_list_has_words_of_its_own(tmp_path: Path) -> None:
    text = "Typ;Modbus Address;Data Type;Tag\nFC1.OP;40001;REAL;7\n"
    file, out = write(tmp_path, text), tmp_path / "map.csv"
    result = CliRunner().invoke(
        app, ["map", "import", str(file), "--out", str(out), "--column", "tag=Typ"]
    )
    assert result.exit_code == 0, result.output
    assert set(read_register_map(out)) == {"FC1.OP"}


@pytest.mark.parametrize(
    ("pair", "said"),
    [
        ("tag=Typp", "did you mean 'Typ'?"),
        ("tags=Typ", "did you mean 'tag'?"),
        ("tag", "is not COLUMN=HEADING"),
    ],
)
def test_a_heading_that_is_not_there_is_reported(tmp_path: Path, pair: str, said: str) -> None:
    file = write(tmp_path, "Typ;Modbus Address;Data Type\nFC1.OP;40001;REAL\n")
    result = CliRunner().invoke(app, ["map", "import", str(file), "--column", pair])
    assert said in f"{' '.join(result.output.replace('│', ' ').split())} {result.exception}"


def test_a_list_with_titles_above_the_headings(tmp_path: Path) -> None:
    text = (
        "Anlage Nord, Stand 12.03.2026;;;;\n;;;;\nName;Adresse;Datentyp;Max\nOP;40001;REAL;12,5\n"
    )
    found = import_map(write(tmp_path, text))
    assert found.problems == ()
    assert (found.tags["OP"].address, found.tags["OP"].high) == (0, 12.5)


@pytest.mark.parametrize(
    ("cell", "style", "address"),
    [
        ("0x0010", "zero", 16),
        ("0x0100.3", "zero", 256),
        ("16#0100", "zero", 256),
        ("&H100", "zero", 256),
        ("0100h", "zero", 256),
        ("0100", "hex", 256),
        ("0x0100", "hex", 256),
        ("1F", "hex", 31),
    ],
)
def test_hexadecimal_addresses(cell: str, style: str, address: int) -> None:
    assert parse_address(cell, style).address == address  # type: ignore[arg-type]


def test_0x_is_a_coil_only_beside_addresses_of_other_tables() -> None:
    assert guess_style(["0x0100", "0x0102"]) == "zero"
    assert guess_style(["0x0001", "4x0001"]) == "modicon"
    assert parse_address("0x0001", "modicon") == FoundAddress(0, Table.COIL)


def test_a_heading_says_that_addresses_are_hexadecimal(tmp_path: Path) -> None:
    rows = "OP,0100,REAL\nPV,0102,REAL\n"
    found = import_map(write(tmp_path, f"Tag,Address (hex),Type\n{rows}"))
    assert {name: tag.address for name, tag in found.tags.items()} == {"OP": 256, "PV": 258}
    assert "addresses are hexadecimal" in " / ".join(found.notes)
    plain = import_map(write(tmp_path, f"Tag,Address,Type\n{rows}SP,010A,REAL\n"))
    assert "--addresses hex" in str(plain.problems[0])


def test_a_size_in_bits_says_nothing_new_or_that_the_type_is_wrong(tmp_path: Path) -> None:
    rows = "A,100,UINT,16\nB,101,FLOAT,32\nC,103,INT,32\n"
    found = import_map(write(tmp_path, f"Name,Address,Type,Size\n{rows}"))
    assert list(found.tags) == ["A", "B"]
    (problem,) = found.problems
    assert problem.line == 4
    assert problem.message == "32 is given for int16, which takes 1 register"
    assert problem.remedy.startswith("correct the type if it takes more (int32")


def test_memory_words_of_12288_and_more_are_registers(tmp_path: Path) -> None:
    # WAGO counts %MW0 as 12288, which manuals that begin with a table's digit use for inputs.
    (tmp_path / "list.csv").write_text(
        "Name,Address,Type\nOP,12288,INT\nPV,12289,REAL\nAUTO,12291,BOOL\n"
    )
    found = import_map(tmp_path / "list.csv")
    assert not found.problems
    assert {tag.address: tag.table.value for tag in found.tags.values()} == dict.fromkeys(
        (12288, 12289, 12291), "holding"
    )
    (tmp_path / "list.csv").write_text("Name,Address,Type\nRUN,10001,BOOL\nOP,40001,INT\n")
    assert [tag.table.value for tag in import_map(tmp_path / "list.csv").tags.values()] == [
        "discrete",
        "holding",
    ]


def test_the_places_of_a_data_block_are_not_added_to_values(tmp_path: Path) -> None:
    rows = 'OP;REAL;0.0;40001\nPV;REAL;4.0;40003\n"A";BOOL;8.0;40005\n"B";BOOL;8.1;40006\n'
    path = tmp_path / "list.csv"
    path.write_text(f"Name;Datentyp;Offset;Modbus-Adresse\n{rows}")
    found = import_map(path)
    assert [tag.offset for tag in found.tags.values()] == [0.0] * 4
    assert any("counts up row by row" in note for note in found.notes)
    said = import_map(path, headings={"offset": "Offset"})
    assert said.tags["PV"].offset == 4.0
    path.write_text("Name;Type;Offset;Address\nOP;INT;0;1\nPV;INT;-40;2\nT;INT;-40;3\n")
    assert import_map(path).tags["PV"].offset == -40.0


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("1,string[{n}],", "is unknown; use one of"),
        ("1,uint16,{n}", "does not count decimals; give 0 to"),
        ("{n},uint16,", "is not an address; give a number"),
        ("%MW{n},uint16,", "is not an address; give the register"),
        ("0x{n},uint16,", "is not an address; give a number"),
    ],
)
def test_numbers_of_thousands_of_digits_cost_their_row(tmp_path: Path, row: str, said: str) -> None:
    """Python itself refuses to read them, in its own words."""
    text = row.format(n="9" * 5000)
    found = import_map(write(tmp_path, f"tag,address,type,decimals\nA,{text}\nB,3,uint16,\n"))
    (problem,) = map(str, found.problems)
    assert said in problem
    assert len(problem) < 300
    assert list(found.tags) == ["B"]
