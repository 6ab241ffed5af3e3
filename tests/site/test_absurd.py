"""Absurd files end in a sentence; nothing in a name is obeyed by a terminal or a spreadsheet."""

from __future__ import annotations

import csv
import io
import os
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import openpyxl
import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.registers import DataType, Table, Tag
from fieldlink.site import SiteError, load_site, read_register_map
from fieldlink.site.map_export import map_as_csv, write_map
from fieldlink.site.map_import import import_map
from fieldlink.spreadsheet import from_cell, to_cell
from fieldlink.store import EventRecord, Historian, SampleRecord, export

SITE = """
[site]
name = "plant"

[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"

[loops.FC101]
device = "plc"
op = "OP"
pv = "PV"
period = 1.0
"""
MAP = "tag,address,type,scale,unit,comment\nOP,0,float32,1,%,\nPV,2,float32,1,%,\n"


@pytest.fixture
def refused(tmp_path: Path) -> Callable[..., str]:
    """Write a site and its map, and return the message about them."""

    def make(site: str | bytes = SITE, register_map: str | bytes = MAP) -> str:
        for name, content in (("site.toml", site), ("map.csv", register_map)):
            raw = content if isinstance(content, bytes) else content.encode()
            (tmp_path / name).write_bytes(raw)
        with pytest.raises(SiteError) as caught:
            load_site(tmp_path / "site.toml")
        said = str(caught.value).replace(f"{tmp_path}/", "")
        assert said.replace("\n", "").isprintable()
        assert len(said) < 400
        return said

    return make


@pytest.mark.parametrize("seconds", ["1e308", "1e-300", "-1", "1e9", "0.0001"])
def test_a_period_that_is_none(refused: Callable[..., str], seconds: str) -> None:
    said = refused(SITE.replace("period = 1.0", f"period = {seconds}"))
    assert re.match(r"site.toml:14: loops.FC101.period: .* should be (greater|less) than", said)


@pytest.mark.parametrize(
    ("table", "keys"),
    [
        ("historian", "retention_days = 1e308"),
        ("historian", "max_megabytes = 1e300"),
        ("estimation", "memory_megabytes = 1e300"),
        ("loops.FC101.writeback", "min_interval = 1e300"),
        ("loops.FC101.writeback", "deadband = 1e300"),
        ("loops.FC101.writeback.limits", "stick_band = [0, 1e300]"),
        ("loops.FC101.compensate", "heartbeat_timeout = 1e-300"),
    ],
)
def test_other_numbers_beyond_any_plant(refused: Callable[..., str], table: str, keys: str) -> None:
    said = refused(f"{SITE}\n[{table}]\n{keys}\n")
    assert said.startswith("site.toml:1")
    assert table in said


def test_a_number_of_thousands_of_digits_is_named_with_its_line(
    refused: Callable[..., str],
) -> None:
    said = refused(SITE.replace("period = 1.0", f"period = {'9' * 5000}"))
    assert said.startswith("site.toml:14: a number has more than ")


@pytest.mark.parametrize(
    "deep",
    ["x = " + "[" * 5000 + "]" * 5000, "x = " + "[" * 60 + "]" * 60, ".".join("a" * 3000) + " = 1"],
)
def test_what_lies_too_deep(refused: Callable[..., str], deep: str) -> None:
    assert refused(f"{SITE}\n{deep}\n") == (
        "site.toml: its tables or arrays lie more than 30 deep in each other; no key of a site "
        "file needs more than six"
    )


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_a_site_file_in_another_encoding(refused: Callable[..., str], encoding: str) -> None:
    assert "is not UTF-8 text" in refused(SITE.encode(encoding))


@pytest.mark.parametrize("encoding", ["utf-32", "utf-32-be"])
def test_a_map_in_another_encoding(refused: Callable[..., str], encoding: str) -> None:
    said = refused(register_map=MAP.encode(encoding))
    assert said.startswith("map.csv: is not a CSV file: it is ")


def test_a_map_as_excel_writes_unicode_text(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_bytes(MAP.encode("utf-16"))
    assert list(read_register_map(tmp_path / "map.csv")) == ["OP", "PV"]


def test_a_device_or_a_pipe_is_no_file(refused: Callable[..., str], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name in ("/dev/zero", "pipe", "."):
        said = refused(SITE.replace("map.csv", name))
        assert "cannot be read (it is a" in said
    with pytest.raises(SiteError, match="a device"):
        load_site("/dev/zero")


@pytest.mark.parametrize("key", ['name = "plant"', "loops.FC101", "devices.plc"])
def test_names_that_a_terminal_would_obey(refused: Callable[..., str], key: str) -> None:
    name = key.split(".")[-1].split('"')[-2 if '"' in key else -1]
    evil = f"{name}\\u001b[2J\\u202e"
    text = SITE.replace(key, key.replace(name, evil if '"' in key else f'"{evil}"'))
    assert f"'{name}?[2J?' has characters that cannot be printed" in refused(text)


@pytest.mark.parametrize("name", [".", ".."])
def test_a_loop_whose_page_a_browser_cannot_ask_for(refused: Callable[..., str], name: str) -> None:
    said = refused(SITE.replace("loops.FC101", f'loops."{name}"'))
    assert f"'{name}' cannot be part of an address; rename it" in said


@pytest.mark.parametrize("key", ["topic", "group", "node", "client_id"])
def test_levels_of_topics_that_a_broker_refuses(refused: Callable[..., str], key: str) -> None:
    text = SITE + f'[mqtt]\nhost = "127.0.0.1"\n{key} = "a\\tb\\uFFFE"\n'
    assert f"mqtt.{key}: 'a b?' has characters that cannot be printed" in refused(text)
    in_area = SITE.replace("[loops.FC101]", '[loops.FC101]\narea = "a\\u0000b"')
    assert "loops.FC101.area: 'a?b' has characters that cannot be printed" in refused(in_area)


def test_tags_that_a_terminal_would_obey(refused: Callable[..., str]) -> None:
    rows = "tag,address,type,unit,comment\n\x1b]0;x\x07,0,uint16,,\nPV,2,uint16,\x1b[5m,\n"
    said = refused(register_map=rows).splitlines()
    assert said[0].startswith("map.csv:2: tag: '?]0;x?' has characters")
    assert said[1].startswith("map.csv:3: unit: '?[5m' has characters")


@pytest.mark.parametrize(
    "row",
    ["1e308,1e308", "1e-300,0", "1,1e40", "1e-40,0"],
)
def test_a_scaling_that_leaves_no_number(refused: Callable[..., str], row: str) -> None:
    rows = f"tag,address,type,scale,offset\nOP,0,uint16,{row}\nPV,2,uint16,1,0\n"
    assert "leaves no number of a register" in refused(register_map=rows)


def test_two_points_that_overflow(refused: Callable[..., str]) -> None:
    rows = "tag,address,type,raw_low,raw_high,eng_low,eng_high\nOP,0,uint16,0,1,-1e308,1e308\n"
    assert "leaves no number of a register" in refused(register_map=rows)


def test_markup_in_a_name_is_a_name(tmp_path: Path) -> None:
    text = SITE.replace("[loops.FC101]", '[loops."[red]FC[/bold]"]').replace(
        'name = "plant"', 'name = "[link=http://x]plant"'
    )
    (tmp_path / "site.toml").write_text(text)
    (tmp_path / "map.csv").write_text(MAP)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "site.toml")])
    assert result.exit_code == 0, result.output
    assert "site [link=http://x]plant " in result.output
    assert "loop [red]FC[/bold]  on plc" in result.output


FORMULAS = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "'quoted", "''", "plain", "-12.5", ""]


@pytest.mark.parametrize("text", FORMULAS)
def test_a_cell_is_read_back_as_it_was(text: str) -> None:
    assert from_cell(to_cell(text)) == text
    assert to_cell(text)[:1] not in ("=", "+", "@")


def formula_tags() -> list[Tag]:
    names = [text for text in FORMULAS if text and text != "-12.5"]
    return [
        Tag(name, Table.HOLDING, 2 * at, DataType.UINT16, unit="=A1", comment="@x")
        for at, name in enumerate(names)
    ]


def test_a_map_has_no_formulas_and_comes_back_the_same(tmp_path: Path) -> None:
    tags = formula_tags()
    text = map_as_csv(tags)
    for row in csv.reader(io.StringIO(text)):
        assert not any(cell.startswith(("=", "+", "@")) for cell in row)
    (tmp_path / "map.csv").write_text(text)
    assert list(read_register_map(tmp_path / "map.csv").values()) == tags
    write_map(tags, tmp_path / "map.xlsx")
    book = openpyxl.load_workbook(tmp_path / "map.xlsx")
    kinds = {cell.data_type for row in book.active.iter_rows() for cell in row}
    assert "f" not in kinds
    assert list(import_map(tmp_path / "map.xlsx").tags.values()) == tags


def test_an_export_has_no_formulas(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/history.sqlite"
    historian = Historian(url)
    historian.start(EventRecord(0, "=start", "@daemon", "-2+3+cmd|' /C calc'!A0"))
    historian.put(SampleRecord("=HYPERLINK(1)", 1000, 0, -1.5, 2.0, None, None, 0))
    historian.stop()
    export(url, tmp_path / "events.csv", table="events", until=datetime.now(UTC))
    export(url, tmp_path / "samples.csv")
    with (tmp_path / "events.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert (rows[0]["kind"], rows[0]["source"]) == ("'=start", "'@daemon")
    assert rows[0]["message"].startswith("'-2+3")
    with (tmp_path / "samples.csv").open(newline="") as stream:
        row = next(csv.DictReader(stream))
    assert (row["loop"], row["op"]) == ("'=HYPERLINK(1)", "-1.5")
