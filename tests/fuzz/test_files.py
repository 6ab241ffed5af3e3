"""Whatever a file holds, reading it ends in a result or in the project's own error."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from fieldlink.errors import FieldlinkError
from fieldlink.registers import DataType, Table, Tag
from fieldlink.registers.types import ORDERS
from fieldlink.site import SiteError, check, load_site, read_recording, read_register_map
from fieldlink.site.map_export import map_as_csv
from fieldlink.site.map_import import import_map
from fieldlink.site.map_row import COLUMNS

SITES = Path(__file__).parents[2] / "site_configs"
TOML = [path.read_text() for path in sorted(SITES.glob("*.toml"))]
MAP = (SITES / "demo.csv").read_text()

FEW = settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])

NASTY = st.sampled_from(
    [
        *(
            "",
            "-1",
            "1e400",
            "-1e-400",
            "nan",
            "inf",
            "0x",
            "0xFFFFFFFFFFFFFFFFF",
            "1_0",
            "٣",
            "\0",
        ),
        *(
            "99999999999999999999",
            "40001",
            "4x00001",
            "1/0",
            "1/3",
            "'",
            '"',
            "#",
            ";",
            ",",
            "\ufeff",
        ),
        *(
            "true",
            "null",
            "[",
            "]]",
            "{}",
            "= =",
            "\t",
            "\r",
            "\u2028",
            "abcd",
            "string999",
            "10.99",
        ),
        *(
            *DataType,
            *Table,
            *ORDERS,
            "yes",
            "clamp",
            "0",
            "15",
            "16",
            "65535",
            "65536",
            "125",
            "126",
        ),
    ]
)
CELL = NASTY | st.text(max_size=8)


@st.composite
def mutated(draw: st.DrawFn, texts: list[str]) -> str:
    """A text with some of its lines and characters changed."""
    lines = draw(st.sampled_from(texts)).splitlines()
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.integers(0, 4))
        line = lines[at]
        if kind == 0:
            del lines[at : at + draw(st.integers(1, 3))]
        elif kind == 1:
            lines.insert(at, draw(st.sampled_from(lines)))
        elif kind == 2:
            cut = draw(st.integers(0, len(line)))
            lines[at] = line[:cut] + draw(CELL) + line[cut:]
        elif kind == 3:
            head = line.split("=")[0]
            lines[at] = f"{head}= {draw(CELL)}"
        else:
            cut = draw(st.integers(0, len(line)))
            lines[at] = line[:cut]
        if not lines:
            lines = [""]
    return "\n".join(lines)


def in_file(content: str | bytes, name: str, use: Callable[[Path], object]) -> None:
    """Put the content into a file of a folder with the shipped sites' other files and use it."""
    with tempfile.TemporaryDirectory() as folder:
        for path in SITES.glob("*.csv"):
            (Path(folder) / path.name).write_bytes(path.read_bytes())
        file = Path(folder) / name
        raw = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
        file.write_bytes(raw)
        use(file)


def own_error_or_result(use: Callable[[Path], object]) -> Callable[[Path], None]:
    def attempt(path: Path) -> None:
        try:
            use(path)
        except FieldlinkError as error:
            said = str(error).strip()
        else:
            said = "a result"
        assert said

    return attempt


def load_and_check(path: Path) -> None:
    check(load_site(path))


@FEW
@given(mutated(TOML) | st.text(max_size=60))
def test_a_site_file(text: str) -> None:
    in_file(text, "site.toml", own_error_or_result(load_and_check))


@FEW
@given(st.binary(max_size=200))
def test_bytes_as_any_file(raw: bytes) -> None:
    in_file(raw, "site.toml", own_error_or_result(load_and_check))
    in_file(raw, "map.csv", own_error_or_result(read_register_map))
    in_file(raw, "vendor.csv", own_error_or_result(import_map))
    in_file(raw, "loop.csv", own_error_or_result(read_recording))


def table_of(columns: tuple[str, ...]) -> st.SearchStrategy[str]:
    cells = st.lists(CELL, min_size=len(columns), max_size=len(columns))
    return st.lists(cells, max_size=6).map(
        lambda rows: "\n".join([",".join(columns), *(",".join(row) for row in rows)])
    )


@FEW
@given(mutated([MAP]) | table_of(COLUMNS))
def test_a_register_map(text: str) -> None:
    in_file(text, "map.csv", own_error_or_result(read_register_map))


@FEW
@given(table_of(("Register Name", "Modbus Address", "Data Type", "Access", "Factor", "Bit")))
def test_a_vendors_list(text: str) -> None:
    in_file(text, "vendor.csv", own_error_or_result(import_map))


@pytest.mark.parametrize("name", ["vendor.xlsx", "vendor.xlsm"])
@settings(max_examples=10)
@given(raw=st.binary(max_size=300))
def test_a_workbook_that_is_none(name: str, raw: bytes) -> None:
    in_file(raw, name, own_error_or_result(import_map))
    in_file(b"PK\x03\x04" + raw, name, own_error_or_result(import_map))


@FEW
@given(
    st.lists(st.tuples(CELL, CELL, CELL, CELL), min_size=1, max_size=80).map(
        lambda rows: "\n".join(["op,pv,time,auto", *(",".join(row) for row in rows)])
    )
)
def test_a_recording(text: str) -> None:
    in_file(text, "loop.csv", own_error_or_result(read_recording))


@given(
    st.floats(-3.3e38, 3.3e38),
    st.lists(st.floats(-1e6, 1e6), min_size=50, max_size=60),
)
@settings(max_examples=10)
def test_a_good_recording_is_never_refused(first: float, rest: list[float]) -> None:
    values = [first, *rest]
    text = "op,pv\n" + "\n".join(f"{value!r},{value!r}" for value in values)

    def read(path: Path) -> None:
        assert list(read_recording(path).pv) == values

    in_file(text, "loop.csv", read)


finite = st.floats(-1e9, 1e9)
names = st.text(
    st.characters(codec="ascii", categories=["L", "N", "P", "Zs"], exclude_characters="#"),
    min_size=1,
    max_size=12,
)


offsets = st.floats(-1e30, 1e30)
scales = offsets.filter(lambda scale: abs(scale) >= 1e-30)


@st.composite
def tags(draw: st.DrawFn) -> Tag:
    table = draw(st.sampled_from(list(Table)))
    kind = DataType.BOOL if table.is_bits else draw(st.sampled_from(list(DataType)))
    number = kind.is_number
    bit = (
        None if table.is_bits or kind is not DataType.BOOL else draw(st.none() | st.integers(0, 15))
    )
    low, high = draw(st.none() | finite), draw(st.none() | finite)
    assume(low is None or high is None or low < high)
    order = ("big", "big") if table.is_bits else draw(st.sampled_from(list(ORDERS.values())))
    ranged = number and (low, high) != (None, None)
    return Tag(
        draw(names).strip() or "T",
        table,
        draw(st.integers(0, 60_000)),
        kind,
        scale=draw(scales) if number else 1.0,
        offset=draw(offsets) if number else 0.0,
        unit=draw(names).strip(),
        low=low if number else None,
        high=high if number else None,
        writable=table.is_writable and bit is None and draw(st.booleans()),
        comment=draw(names).strip(),
        word_order=order[0],
        byte_order=order[1],
        bit=bit,
        length=draw(st.integers(1, 125)) if kind is DataType.STRING else 0,
        clamp=ranged and draw(st.booleans()),
        invalid=tuple(draw(st.lists(finite, max_size=2))) if number else (),
        invalid_patterns=tuple(draw(st.lists(st.integers(0, 0xFFFF), max_size=2)))
        if number
        else (),
        every=draw(st.sampled_from([0.0, 5.0, 60.5])),
    )


@FEW
@given(tags())
def test_a_map_that_was_written_reads_back(tag: Tag) -> None:
    def read(path: Path) -> None:
        assert list(read_register_map(path).values()) == [tag]

    in_file(map_as_csv([tag]), "map.csv", read)


def test_the_shipped_sites_are_what_is_mutated() -> None:
    assert len(TOML) >= 3
    with pytest.raises(SiteError):
        load_site(SITES / "there_is_no_such.toml")
