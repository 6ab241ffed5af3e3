"""``fieldlink init``: from a maker's list of registers to a site file that is checked and read."""

from __future__ import annotations

import re
import struct
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fieldlink.cli import read_write
from fieldlink.cli.app import app
from fieldlink.daemon import trial
from fieldlink.errors import FieldlinkError
from fieldlink.lab.plc import Listening
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.modbus_device import modbus_device
from fieldlink.registers import Table
from fieldlink.site import load_site
from tests.links.serving import served_in_a_thread
from tests.site.made_loops import made_loop

HEADER = "Tag;Address;Type;Access;Unit\n"
CLEAR = HEADER + (
    "FC101.OP;40001;REAL;RW;%\n"
    "FC101.PV;40003;REAL;R;m3/h\n"
    "FC101.SP;40005;REAL;RW;m3/h\n"
    "FC101.MODE;40007;INT;RW;\n"
    "FIC202_OUT;40011;REAL;RW;%\n"
    "FIC202_PV;40013;REAL;R;m3/h\n"
    "TI301.PV;40021;REAL;R;degC\n"
)
UNCLEAR = HEADER + "FC101.OUT;0;REAL;R;%\nFC101.MV;2;REAL;R;%\nFC101.PV;4;REAL;R;m3/h\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "clear.csv").write_text(CLEAR)
    (tmp_path / "unclear.csv").write_text(UNCLEAR)
    return tmp_path


@pytest.fixture
def port() -> Iterator[int]:
    image = RegisterImage()
    image.define(Table.HOLDING, 0, 30)
    image.put(Table.HOLDING, 0, list(struct.unpack(">4H", struct.pack(">2f", 42.5, 12.25))))
    image.put(Table.HOLDING, 6, [1])
    with served_in_a_thread([modbus_device(image, 1)], Listening()) as number:
        yield number


def run(*arguments: str, stdin: str | None = None) -> Result:
    return CliRunner().invoke(app, ["init", *arguments], input=stdin)


def refusal(result: Result) -> str:
    assert isinstance(result.exception, FieldlinkError), result.output
    return str(result.exception)


def test_a_clear_list_becomes_a_site_that_is_read_once(folder: Path, port: int) -> None:
    options = ("--host", "127.0.0.1", "--port", str(port), "--auto-values", "1,2", "--yes")
    result = run("clear.csv", *options)
    assert result.exit_code == 0, result.output
    site = load_site(folder / "site.toml")
    assert set(site.loops) == {"FC101", "FIC202"}
    first = site.loops["FC101"]
    assert first.tags == ("FC101.OP", "FC101.PV", "FC101.SP", "FC101.MODE")
    assert first.auto_values == (1.0, 2.0)
    assert site.loops["FIC202"].tags == ("FIC202_OUT", "FIC202_PV")
    assert not any(loop.writeback.enabled for loop in site.loops.values())
    # The list lets FC101.SP be written; the new map does not.
    assert not any(tag.writable for tag in site.maps["plc"].values())
    assert "TI301.PV" not in site.maps["plc"]
    assert "left out: TI301 has no OP (TI301.PV)" in result.stderr
    assert "FC101.OP = 42.5 %" in result.stderr
    assert "FC101.PV = 12.25 m3/h" in result.stderr
    assert "ok 1 device, 2 loops" in result.stdout
    assert result.stdout.rstrip().endswith("fieldlink run site.toml")


@pytest.mark.usefixtures("folder")
def test_values_of_the_other_word_order_are_named(port: int) -> None:
    options = ("--host", "127.0.0.1", "--port", str(port), "--auto-values", "1", "--yes")
    result = run("clear.csv", *options, "--word-order", "little")
    assert result.exit_code == 0, result.output
    # 42.5 is 0x422A0000, and 0x0000422A a float of 2e-41.
    assert "FC101.OP = 2.373519339e-41 %" in result.stderr
    hint = next(line for line in result.stderr.splitlines() if "--word-order" in line)
    assert "FC101.OP" in hint
    # The same for a site that is there already.
    again = CliRunner().invoke(app, ["read", "site.toml"])
    assert again.exit_code == 0, again.output
    assert "FC101.OP" in next(line for line in again.stderr.splitlines() if "word_order" in line)
    right = run("clear.csv", *options, "--out", "b.toml")
    assert "--word-order" not in right.stderr
    assert "word_order" not in CliRunner().invoke(app, ["read", "b.toml"]).stderr


@pytest.mark.usefixtures("folder")
def test_a_mode_that_counts_as_manual_is_named(port: int) -> None:
    options = ("--host", "127.0.0.1", "--port", str(port), "--yes")
    other = run("clear.csv", *options, "--auto-values", "5").stderr
    hint = next(line for line in other.splitlines() if "counts as manual" in line)
    assert hint.strip().startswith("FC101: FC101.MODE is 1,")
    assert "auto_values = [5, 1] in site.toml" in hint
    right = run("clear.csv", *options, "--auto-values", "1", "--out", "b.toml").stderr
    assert "counts as manual" not in right


def test_nothing_is_overwritten(folder: Path) -> None:
    (folder / "site-map.csv").write_text("mine")
    said = refusal(run("clear.csv", "--auto-values", "1", "--yes"))
    assert said == "site-map.csv: the file exists; choose another name with --out"
    assert (folder / "site-map.csv").read_text() == "mine"
    assert not (folder / "site.toml").exists()


@pytest.mark.parametrize("out", [".", "..", "/"])
def test_a_folder_is_no_new_site(folder: Path, out: str) -> None:
    said = refusal(run("clear.csv", "--auto-values", "1", "--yes", "--out", out))
    assert said == f"{out}: is a folder; name a new file with --out"
    assert not (folder / "site.toml").exists()


def test_what_is_not_clear_is_refused_without_a_terminal(folder: Path) -> None:
    said = refusal(run("unclear.csv", "--yes"))
    assert "FC101: OP may be FC101.OUT or FC101.MV" in said
    assert "--loop FC101=FC101.OUT,FC101.PV" in said
    assert "--auto-values" in run("clear.csv", "--yes").output
    assert "--yes" in run("clear.csv", "--auto-values", "1").output
    assert [path.name for path in folder.glob("site*")] == []


def test_a_loop_can_be_named_or_left_out(folder: Path) -> None:
    assert run("unclear.csv", "--loop", "FC101=FC101.MV,FC101.PV", "--yes").exit_code == 0
    loops = tomllib.loads((folder / "site.toml").read_text())["loops"]
    assert loops["FC101"]["op"] == "FC101.MV"
    left = run("unclear.csv", "--leave-out", "FC101", "--out", "b.toml", "--yes")
    assert left.exit_code == 2
    assert "no tags that are OP and PV" in left.output
    wrong = run("unclear.csv", "--loop", "FC101=FC101.MU,FC101.PV", "--out", "b.toml", "--yes")
    assert "FC101.MV" in wrong.output


def test_on_a_terminal_it_asks(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read_write, "is_terminal", lambda: True)
    result = run("unclear.csv", stdin="FC101.XX\nFC101.OUT\n127.0.0.1\ny\n")
    assert "FC101.XX is none of them" in result.output
    written = tomllib.loads((folder / "site.toml").read_text())
    assert written["loops"]["FC101"]["op"] == "FC101.OUT"
    assert written["devices"]["plc"]["host"] == "127.0.0.1"


def test_a_plc_that_does_not_answer_is_reported_after_the_files_are_written(folder: Path) -> None:
    options = ("--host", "127.0.0.1", "--port", "1", "--auto-values", "1", "--yes")
    result = run("clear.csv", *options)
    assert result.exit_code == 0, result.output
    assert "not read: " in result.stderr
    assert result.stdout.rstrip().endswith("fieldlink read site.toml, once the PLC can be reached")
    assert load_site(folder / "site.toml").devices["plc"].port == 1


def test_the_word_order_of_a_list_that_does_not_say_it(folder: Path) -> None:
    result = run("clear.csv", "--auto-values", "1", "--word-order", "little", "--yes")
    assert result.exit_code == 0, result.output
    assert "byte order CDAB" in result.output
    tags = load_site(folder / "site.toml").maps["plc"]
    # 25.0 as a float32, less significant register first
    assert tags["FC101.PV"].decode([0, 0x41C8]).value == 25.0


def test_a_host_has_no_port_in_it(folder: Path) -> None:
    result = run("clear.csv", "--host", "127.0.0.1:502", "--yes")
    assert result.exit_code == 2
    assert "--port 502" in " ".join(result.output.split())
    assert not (folder / "site.toml").exists()


def test_without_a_host_the_next_step_says_so(folder: Path) -> None:
    result = run("clear.csv", "--loop", 'F"C\\1=FC101.OP,FC101.PV,sp=FC101.SP', "--yes")
    assert result.exit_code == 0, result.output
    # The name needs escapes in TOML; the loop's other proposals are withdrawn with it.
    assert set(load_site(folder / "site.toml").loops) == {'F"C\\1', "FIC202"}
    assert "put the PLC's host into site.toml" in result.stdout


def test_recorded_data_answer_and_contradict_the_names(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    op, pv = made_loop(3)
    rows = [
        f"{k},{o:.2f},{p:.4f},{50 + k % 7}" for k, (o, p) in enumerate(zip(op, pv, strict=True))
    ]
    header = "time,FC101.OUT,FC101.PV,FC101.MV\n"
    (folder / "data.csv").write_text(header + "\n".join(rows) + "\n")
    said = run("unclear.csv", "--data", "data.csv", "--yes")
    assert "OP FC101.OUT, PV FC101.PV: OP is computed from PV" in said.stderr
    assert "--loop FC101=FC101.OUT,FC101.PV" in refusal(said)
    # The same data with the names of OP and PV exchanged contradict a clear list.
    swapped = header.replace("OUT", "x").replace("PV", "OP").replace("x", "PV")
    (folder / "swapped.csv").write_text(swapped + "\n".join(rows) + "\n")
    options = ("clear.csv", "--leave-out", "FIC202", "--data", "swapped.csv", "--auto-values", "1")
    assert "OP may be FC101.PV or FC101.OP" in refusal(run(*options, "--yes"))
    assert [path.name for path in folder.glob("site*")] == []
    # On a terminal the data's answer is offered, and a person says so.
    monkeypatch.setattr(read_write, "is_terminal", lambda: True)
    asked = run(*options, stdin="\n\n127.0.0.1\ny\n")
    assert "(empty: FC101.PV, as the data say; -: leave the loop out)" in asked.output
    loop = tomllib.loads((folder / "site.toml").read_text())["loops"]["FC101"]
    assert (loop["op"], loop["pv"]) == ("FC101.PV", "FC101.OP")


def test_a_trial_says_what_came_and_what_is_next(
    folder: Path, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "TRIAL", 1.0)
    options = ("--host", "127.0.0.1", "--port", str(port), "--auto-values", "1", "--yes")
    result = run("clear.csv", *options, "--period", "0.05", "--trial")
    assert result.exit_code == 0, result.output
    counted = re.search(r"FC101: (\d+) of (\d+) samples read, \d+ bad", result.stderr)
    assert counted is not None, result.stderr
    assert 1 <= int(counted[1]) <= int(counted[2])
    assert "only" in result.stderr or "stood still" in result.stderr
    assert result.stdout.rstrip().splitlines()[-1].startswith("next: ")
    # It leaves the two files behind and no store.
    assert sorted(path.name for path in folder.glob("site*")) == ["site-map.csv", "site.toml"]
    assert not list(folder.rglob("*.sqlite"))


@pytest.mark.usefixtures("folder")
def test_an_output_in_counts_is_named() -> None:
    Path("counts.csv").write_text(HEADER + "FC1.OP;0;INT;R;\nFC1.PV;1;INT;R;\n")
    image = RegisterImage()
    image.define(Table.HOLDING, 0, 10)
    image.put(Table.HOLDING, 0, [4115, 4369])
    with served_in_a_thread([modbus_device(image, 1)], Listening()) as number:
        result = run("counts.csv", "--host", "127.0.0.1", "--port", str(number), "--yes")
    assert result.exit_code == 0, result.output
    hint = next(line for line in result.stderr.splitlines() if "is from 0 to 100 %" in line)
    assert hint.strip().startswith("FC1: OP FC1.OP is 4115,")
    assert hint.endswith("site-map.csv")
    assert not any("FC1.PV is" in line for line in result.stderr.splitlines())
