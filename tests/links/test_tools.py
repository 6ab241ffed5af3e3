"""``fieldlink scan``, ``read`` and ``write`` against a server in a thread of its own."""

from __future__ import annotations

import asyncio
import json
import re
import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from fieldlink.cli.app import app
from fieldlink.errors import FieldlinkError
from fieldlink.lab.plc import Listening
from fieldlink.lab.plc.image import RegisterImage
from fieldlink.lab.plc.modbus_device import modbus_device, other_units
from fieldlink.links.single_values import as_manual_address
from fieldlink.registers import DataType, Table, Tag
from fieldlink.site.register_map import read_register_map
from tests.links.fake_device import FakeDevice
from tests.links.serving import served_in_a_thread

SITE = """\
[site]
name = "tools"
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
port = {port}
timeout = 5.0
register_map = "map.csv"
[loops.FC1]
device = "plc"
op = "OP"
pv = "PV"
period = 1.0
"""
MAP = """\
tag,table,address,type,bit,length,scale,unit,low,high,writable
OP,holding,10,int16,,,0.1,%,0,100,yes
PV,holding,11,float32,,,,m,,,
NAME,holding,14,string,,4,,,,,yes
RUN,holding,13,bool,3,,,,,,
PUMP,coil,19,bool,,,,,,,yes
"""


@pytest.fixture
def image() -> RegisterImage:
    image = RegisterImage()
    image.define(Table.HOLDING, 10, 10, writable=True)
    image.put(Table.HOLDING, 10, [425, 0x41C8, 0, 8])
    image.put(Table.HOLDING, 14, [0x4643, 0x3130, 0x3100, 0])
    image.define(Table.HOLDING, 40, 3)
    image.define(Table.HOLDING, 330, 7)
    image.define(Table.HOLDING, 341, 2)
    image.define(Table.INPUT, 0, 2)
    image.define(Table.COIL, 16, 16, writable=True)
    return image


@pytest.fixture
def port(image: RegisterImage) -> Iterator[int]:
    with served_in_a_thread([modbus_device(image, 1), other_units()], Listening()) as number:
        yield number


@pytest.fixture
def site(tmp_path: Path, port: int) -> str:
    (tmp_path / "site.toml").write_text(SITE.format(port=port))
    (tmp_path / "map.csv").write_text(MAP)
    return str(tmp_path / "site.toml")


def run(*arguments: str, stdin: str | None = None) -> Result:
    return CliRunner().invoke(app, list(arguments), input=stdin)


def refusal(result: Result) -> str:
    assert isinstance(result.exception, FieldlinkError)
    return str(result.exception)


def test_tags_are_read_in_engineering_units(site: str) -> None:
    result = run("read", site, "OP", "PV", "NAME", "RUN", "PUMP", "holding:10")
    lines = [line.split("   (")[0] for line in result.stdout.splitlines()]
    assert lines == [
        "OP = 42.5 %",
        "PV = 25 m",
        "NAME = 'FC101'",
        "RUN = 1",
        "PUMP = 0",
        "holding:10 = 425",
    ]


def test_without_names_all_tags_of_a_device_are_read(site: str) -> None:
    result = run("read", site, "--json")
    assert set(json.loads(result.stdout)) == {"OP", "PV", "NAME", "RUN", "PUMP"}
    assert run("read", "127.0.0.1").exit_code == 2


def test_addresses_of_a_host_are_read(port: int) -> None:
    result = run("read", f"127.0.0.1:{port}", "11:float32", "--json", "--timeout", "5")
    assert json.loads(result.stdout)["11:float32"]["value"] == 25.0


def test_what_cannot_be_read_is_reported(site: str) -> None:
    assert "holding 700" in refusal(run("read", site, "700"))
    assert "did you mean 'PUMP'?" in refusal(run("read", site, "PUMB"))


def test_one_address_that_the_device_refuses_costs_the_others_nothing(port: int) -> None:
    target, given = f"127.0.0.1:{port}", ["10:int16", "11:float32", "13", "40", "41", "42"]
    result = run("read", target, *given, "700", "--timeout", "5")
    lines = [line.split("   (")[0] for line in result.stdout.splitlines()]
    assert lines[:4] == ["10:int16 = 425", "11:float32 = 25", "13 = 8", "40 = 0"]
    assert lines[6].startswith("700 = no good value: the register answered with an exception")
    assert (len(lines), result.exit_code) == (7, 2)
    assert "700 could not be read" in result.stderr
    as_json = json.loads(run("read", target, *given, "700", "--timeout", "5", "--json").stdout)
    assert {name for name, found in as_json.items() if found["quality"] == "good"} == set(given)
    assert as_json["700"]["value"] is None


def test_an_absent_device_costs_the_tags_of_another_nothing(site: str) -> None:
    text = Path(site).read_text()
    away = text.split("[loops")[0].split("[devices.plc]")[1]
    away = re.sub(r"port = \d+", "port = 1", away.replace("map.csv", "away.csv"))
    Path(site).write_text(f"{text}[devices.away]{away}")
    Path(site).with_name("away.csv").write_text("tag,address,type\nFAR,0,uint16\n")
    result = run("read", site, "OP", "FAR")
    assert result.stdout.startswith("OP = 42.5 %")
    assert "device away: no connection" in result.stderr
    assert result.exit_code == 2


@pytest.mark.parametrize(
    "what", ["-1", "holding:", "holding:1:float", "1:string", "coil:1:int16", "65535:float32"]
)
def test_what_is_not_an_address_is_reported(port: int, what: str) -> None:
    assert what in refusal(run("read", f"127.0.0.1:{port}", "--", what))


@pytest.mark.parametrize("digits", ["99999999", "9" * 5000])
def test_numbers_of_many_digits_end_in_a_sentence(digits: str) -> None:
    assert "is neither a tag nor an address" in refusal(run("read", "127.0.0.1", digits))
    assert "only a string has a length" in refusal(run("read", "127.0.0.1", f"0:string:{digits}"))
    assert run("read", f"127.0.0.1:{digits}", "0").exit_code == 2
    scanned = run("scan", "127.0.0.1", "--units", f"1-{digits}").stderr
    assert "is neither a unit id" in scanned
    assert digits not in scanned or len(digits) < 80


def test_a_tag_is_written_and_read_back(site: str, image: RegisterImage) -> None:
    result = run("write", site, "OP", "50", "--yes")
    assert "holds 42.5 %" in result.stdout
    assert "it holds 50 % now" in result.stdout
    assert image.get(Table.HOLDING, 10, 1) == [500]
    assert run("write", site, "PUMP", "on", "--yes").exit_code == 0
    assert image.get(Table.COIL, 19, 1) == [1]
    assert run("write", site, "NAME", "FC7", "--yes").exit_code == 0
    assert image.get(Table.HOLDING, 14, 4) == [0x4643, 0x3700, 0, 0]


@pytest.mark.parametrize(
    ("tag", "value", "why"),
    [
        ("PV", "1", "not writable in the register map"),
        ("RUN", "1", "not writable in the register map"),
        ("OP", "100.5", "above the high limit"),
        ("OP", "nan", "not a measured value"),
        ("OP", "much", "not a value for OP"),
        ("PUMP", "2", "not a bool"),
        ("NAME", "too long a name", "15 characters"),
    ],
)
def test_what_the_site_forbids_is_refused(
    site: str, image: RegisterImage, tag: str, value: str, why: str
) -> None:
    before = image.get(Table.HOLDING, 10, 10)
    with pytest.raises(FieldlinkError, match=why):
        raise run("write", site, tag, value, "--yes").exception or AssertionError("was written")
    assert image.get(Table.HOLDING, 10, 10) == before


def test_a_site_lets_no_bare_address_be_written(site: str) -> None:
    result = run("write", site, "holding:10", "1", "--yes")
    assert result.exit_code == 2
    assert "only its tags are written" in " ".join(result.output.replace("│", " ").split())


def test_without_a_person_nothing_is_written(site: str, image: RegisterImage) -> None:
    assert run("write", site, "OP", "50").exit_code == 2
    assert image.get(Table.HOLDING, 10, 1) == [425]


def test_an_address_of_a_host_is_written(port: int, image: RegisterImage) -> None:
    result = run("write", f"127.0.0.1:{port}", "--yes", "--timeout", "5", "--", "10:int16", "-7")
    assert result.exit_code == 0, result.output
    assert image.get(Table.HOLDING, 10, 1) == [0xFFF9]


def test_a_negative_value_needs_no_dashes(port: int, image: RegisterImage) -> None:
    target = ("write", f"127.0.0.1:{port}", "--timeout", "5", "10:int16")
    assert run(*target, "-7", "--yes").exit_code == 0
    assert image.get(Table.HOLDING, 10, 1) == [0xFFF9]
    assert run(*target, "7", "--yess").exit_code == 2
    assert image.get(Table.HOLDING, 10, 1) == [0xFFF9]


def test_a_fraction_is_not_rounded_into_a_whole_number(port: int, image: RegisterImage) -> None:
    target = ("write", f"127.0.0.1:{port}", "--yes", "--timeout", "5")
    for kind in ("uint16", "int32", "bcd16"):
        said = refusal(run(*target, f"10:{kind}", "1.5"))
        assert f"1.5 would be written as 2, for {kind} holds whole numbers" in said
    assert image.get(Table.HOLDING, 10, 1) == [425]
    assert run(*target, "10:uint16", "7.0").exit_code == 0
    assert image.get(Table.HOLDING, 10, 1) == [7]


def test_a_whole_number_is_written_to_its_last_digit_or_not_at_all(
    port: int, image: RegisterImage
) -> None:
    exact, between = 2**53 + 2, 2**53 + 1
    target = ("write", f"127.0.0.1:{port}", "--yes", "--timeout", "5", "10:int64")
    assert f"would be written as {2**53}" in refusal(run(*target, str(between)))
    assert image.get(Table.HOLDING, 10, 1) == [425]
    assert run(*target, str(exact)).exit_code == 0
    assert image.get(Table.HOLDING, 10, 4) == [0x20, 0, 0, 2]
    # a float64 holds what is nearest, as for any other fraction
    assert run(*target[:-1], "10:float64", "1e300").exit_code == 0


@contextmanager
def disturbed(change: Callable[[bytes, bytes], bytes]) -> Iterator[tuple[str, list[int]]]:
    """A device of one register; ``change`` makes each answer of request and answer.

    Gives its address and the words that were written.
    """
    written: list[int] = []

    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            while len(request := self.request.recv(300)) > 7:
                if request[7] == 6:
                    written.append(int.from_bytes(request[10:12]))
                    pdu = request[7:12]
                else:
                    pdu = bytes([3, 2]) + (written[-1] if written else 0).to_bytes(2)
                pdu = change(request[7:], pdu)
                if not pdu:
                    return
                self.request.sendall(request[:4] + (len(pdu) + 1).to_bytes(2) + request[6:7] + pdu)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_address[1]}", written
        server.shutdown()


UNSETTLED = [b"", bytes([0x86, 4]), bytes([0x86, 5]), bytes([0x86, 11]), bytes([3, 2, 0, 0])]


@pytest.mark.parametrize("answer", UNSETTLED)
def test_a_write_without_a_clear_answer_may_have_been_carried_out(answer: bytes) -> None:
    with disturbed(lambda asked, said: answer if asked[0] == 6 else said) as (target, written):
        said = refusal(run("write", target, "20", "7", "--yes", "--timeout", "5"))
    assert written == [7]
    assert "the write may have been carried out: read the value before you write again" in said
    assert "tried again" not in said


@pytest.mark.parametrize("code", [1, 2, 3, 6, 10])
def test_a_write_that_the_device_refuses_is_no_doubtful_one(code: int) -> None:
    refused = bytes([0x86, code])
    with disturbed(lambda asked, said: refused if asked[0] == 6 else said) as (target, _):
        said = refusal(run("write", target, "20", "7", "--yes", "--timeout", "5"))
    assert f"exception {code}" in said
    assert "may have been carried out" not in said


@pytest.mark.parametrize("answer", [b"", bytes([0x83, 2])])
def test_a_write_that_cannot_be_read_back_is_reported_as_written(answer: bytes) -> None:
    seen: list[int] = []

    def change(asked: bytes, said: bytes) -> bytes:
        seen.append(asked[0])
        return answer if seen[:2] == [3, 6] and asked[0] == 3 else said

    with disturbed(change) as (target, written):
        said = refusal(run("write", target, "20", "7", "--yes", "--timeout", "5"))
    assert written == [7]
    assert "the write was confirmed, but reading it back failed" in said


@pytest.mark.parametrize(("value", "held"), [("7", 10), ("-1", 0x7FFF)])
def test_a_write_that_is_confirmed_and_dropped_or_limited_is_no_success(
    value: str, held: int
) -> None:
    kept = bytes([3, 2]) + held.to_bytes(2)
    with disturbed(lambda asked, said: kept if asked[0] == 3 else said) as (target, written):
        said = refusal(run("write", target, "20:int16", value, "--yes", "--timeout", "5"))
    assert written == [int(value) & 0xFFFF]
    assert f"the write was confirmed, but it holds {held} now" in said
    assert "another client that writes it" in said


def test_a_survey_finds_units_and_ranges(port: int) -> None:
    target = f"127.0.0.1:{port}"
    result = run(
        *("scan", target, "--units", "1,7", "--last", "60", "--pause", "0", "--timeout", "5"),
        "--json",
    )
    found = json.loads(result.stdout)
    assert [unit["unit"] for unit in found["units"]] == [1]
    assert found["units"][0]["max_registers"] is None
    assert found["silent"] == [7]
    assert found["complete"]
    tables = {table["table"]: table["ranges"] for table in found["units"][0]["tables"]}
    assert tables == {
        "holding": [[10, 19], [40, 42]],
        "input": [[0, 1]],
        "coil": [[16, 31]],
        "discrete": [],
    }


@contextmanager
def answering(reply: Callable[[bytes], bytes]) -> Iterator[str]:
    """A device that answers every request frame of MBAP with what ``reply`` makes of it."""

    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            while len(request := self.request.recv(300)) > 7:
                self.request.sendall(reply(request))

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def scanned(target: str) -> list[str]:
    options = ("--units", "1", "--last", "3", "--tables", "holding", "--pause", "0")
    return run("scan", target, *options, "--timeout", "5").stdout.splitlines()[1:]


def test_a_survey_names_answers_that_do_not_fit() -> None:
    """A device that answers as another unit is not silent: its number is what is looked for."""
    with answering(lambda asked: asked[:4] + b"\x00\x05\x06\x03\x02\x00\x07") as target:
        lines = scanned(target)
    assert lines[0] == "  no unit answers"
    assert lines[1].startswith("  unit 1, no answer that fits: ")
    assert "got an answer of unit 6, not 1; set unit = 6 if all its answers are so" in lines[1]
    assert len(lines) == 2


def test_a_survey_tells_how_many_registers_a_device_gives_at_once() -> None:
    def at_most_two(asked: bytes) -> bytes:
        given = min(2, asked[11])
        return asked[:4] + bytes([0, 3 + 2 * given, asked[6], 3, 2 * given]) + bytes(2 * given)

    with answering(at_most_two) as target:
        lines = scanned(target)
    assert lines[1] == "    holding  0-3"
    assert lines[2].endswith("set max_registers = 2 in the site file")


def test_a_survey_does_not_call_a_busy_device_unreadable() -> None:
    def busy(asked: bytes) -> bytes:
        return asked[:4] + b"\x00\x03" + asked[6:7] + bytes([asked[7] | 0x80, 6])

    with answering(busy) as target:
        lines = scanned(target)
    assert lines == [
        "  unit 1 answers",
        "    holding  nothing readable up to 3 (exception 6 to 7 requests: the device is busy: "
        "poll it less often)",
    ]


def test_a_survey_without_any_answer_says_what_to_try() -> None:
    with answering(lambda _: b"") as target:
        options = ("--units", "1,2", "--last", "3", "--pause", "0")
        result = run("scan", target, *options, "--timeout", "0.05")
    # A script goes on by it.
    assert result.exit_code == 1
    assert result.stdout.splitlines()[1:] == [
        "  no unit answers",
        "  silent: 1, 2",
        "  name other ids with --units, or wait longer with --timeout",
    ]


def test_a_survey_stops_at_its_limit(port: int) -> None:
    result = run(
        *("scan", f"127.0.0.1:{port}", "--units", "1", "--max-requests", "9", "--timeout", "5"),
        *("--pause", "0"),
    )
    assert "not complete: the limit of 9 requests is reached" in result.stdout


def scan_holding(port: int, *more: str) -> tuple[int, list[list[int]], list[list[int]]]:
    """Requests, readable ranges and sampled stretches of the holding registers up to 499."""
    what = ("--units", "1", "--tables", "holding", "--pause", "0", "--timeout", "5", "--json")
    found = json.loads(run("scan", f"127.0.0.1:{port}", *what, *more).stdout)
    (table,) = found["units"][0]["tables"]
    return found["requests"], table["ranges"], table["sampled"]


def test_a_survey_samples_a_long_unreadable_stretch_and_finds_what_is_behind(port: int) -> None:
    requests, ranges, sampled = scan_holding(port)
    thorough, all_ranges, none = scan_holding(port, "--thorough")
    # What is found at the round address 330 has its whole block looked at.
    assert ranges == all_ranges == [[10, 19], [40, 42], [330, 336], [341, 342]]
    assert (sampled, none) == ([[200, 299]], [])
    # Trying each of a hundred addresses takes 199 requests, sampling them 11.
    assert thorough - requests > 150


def test_an_absent_host_is_no_empty_survey() -> None:
    assert "no connection" in refusal(run("scan", "127.0.0.1:1"))


@pytest.mark.parametrize("command", [("scan",), ("read", "0"), ("write", "0", "1")])
def test_a_message_names_a_host_once_and_says_what_to_do(command: tuple[str, ...]) -> None:
    name, *rest = command
    said = refusal(run(name, "127.0.0.1:1", *rest))
    assert said.count("127.0.0.1") == 1
    assert "Connection refused" in said
    assert "check that the device is on" in said


@pytest.mark.parametrize(
    ("written", "point"),
    [
        ("40001", "holding:0"), ("30008", "input:7"), ("10005", "discrete:4"),
        ("00017", "coil:16"), ("465536", "holding:65535"),
        ("40001:float32", "holding:0:float32"), ("30008:string:4", "input:7:string:4"),
    ],
)  # fmt: skip
def test_an_address_of_a_manual_is_reported(written: str, point: str) -> None:
    assert as_manual_address(written) == point


@pytest.mark.parametrize("text", ["4000", "20001", "40000", "holding:40001", "10001:int16", "OP"])
def test_any_other_address_means_what_it_says(text: str) -> None:
    assert as_manual_address(text) is None


def test_reading_40001_says_that_0_may_be_meant(port: int) -> None:
    result = run("read", f"127.0.0.1:{port}", "40001", "10", "--timeout", "5")
    assert "if the manual's 40001 is meant, give holding:0" in result.stderr
    assert "10 = 425" in result.stdout
    assert "holding:0" in refusal(run("read", f"127.0.0.1:{port}", "400001"))


def test_reading_40001_asks_on_a_terminal(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fieldlink.cli.read_write.is_terminal", lambda: True)
    result = run("read", f"127.0.0.1:{port}", "40011", "--timeout", "5", stdin="y\n")
    assert "is holding:10 meant" in result.stdout
    assert "holding:10 = 425" in result.stdout


def test_an_address_of_a_manual_is_never_written_by_guess(port: int, image: RegisterImage) -> None:
    for written in ("40011", "40011:uint16"):
        result = run("write", f"127.0.0.1:{port}", written, "7", "--yes")
        assert result.exit_code == 2
        assert "holding:10" in result.output
    assert image.get(Table.HOLDING, 10, 1) == [425]


def test_a_scan_makes_a_map_that_reads_back(port: int, tmp_path: Path) -> None:
    out = tmp_path / "guessed.csv"
    options = ("--units", "1", "--last", "60", "--pause", "0", "--timeout", "5", "--out", str(out))
    result = run("scan", f"127.0.0.1:{port}", *options)
    assert result.exit_code == 0, result.output
    tags = read_register_map(out)
    assert (tags["H10"].data_type, tags["H11"].data_type) == (DataType.UINT16, DataType.FLOAT32)
    assert tags["H11"].comment == "guessed: 25 when it was read"
    assert not any(tag.writable for tag in tags.values())
    taken = [n for tag in tags.values() if tag.table is Table.HOLDING for n in span(tag)]
    assert taken == [*range(10, 20), *range(40, 43)]
    assert f"fieldlink init {out} --host 127.0.0.1 --port {port} --unit 1" in unwrapped(result)
    before = out.read_text()
    assert "exists; choose another name" in unwrapped(run("scan", "127.0.0.1:1", "--out", str(out)))
    assert out.read_text() == before


def span(tag: Tag) -> range:
    return range(tag.address, tag.end)


def unwrapped(result: Result) -> str:
    return " ".join(re.sub("[│╭╮╰╯─]", " ", result.stderr).split())


async def test_a_value_that_a_failed_request_costs_is_named_with_its_cause(
    device: FakeDevice,
) -> None:
    """Not with a doubt about the address: the next try may well read it."""
    answered = count()

    def busy_for_the_second(frame: bytes) -> bytes:
        if next(answered) != 1:
            return frame
        return frame[:4] + bytes((0, 3, frame[6], frame[7] | 0x80, 6))

    device.tamper = busy_for_the_second
    target = f"127.0.0.1:{device.port}"
    result = await asyncio.to_thread(run, "read", target, "10", "300", "--timeout", "5")
    assert result.exit_code == 2
    assert "exception 6" in result.stderr
    assert "300 could not be read" in result.stderr
    assert "compare address" not in result.stderr
