"""``fieldlink report`` and ``fieldlink work`` as a user meets them."""

from __future__ import annotations

import csv
import gzip
import io
import json
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from openpyxl import load_workbook
from pypdf import PdfReader
from typer.testing import CliRunner, Result

from benchmarks.made_fleet import Fleet
from fieldlink.cli.app import app
from fieldlink.errors import FieldlinkError
from fieldlink.store import EstimateRecord, EventRecord, Historian, record_work
from fieldlink.store.database import open_for_writing
from fieldlink.worklist import COLUMNS, PartialReport, judge_recordings, list_loops
from fieldlink.worklist.evidence_figure import EvidencePictures
from tests.cli.conftest import limit_cycle
from tests.closed_loop import run as run_loop

SITE = """\
[site]
name = "Mill <3>"
data_dir = "."
[devices.plc]
link = "modbus-tcp"
host = "127.0.0.1"
register_map = "map.csv"
[report]
stick_band_limit = 2.5
"""
LOOP = """\
[loops.{0}]
device = "plc"
op = "{0}.OP"
pv = "{0}.PV"
period = 1.0
"""


ROOT = Path(__file__).resolve().parents[2]


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def site(own_fleet: Fleet) -> Path:
    names = [own_fleet.name(number) for number in range(own_fleet.loops)]
    folder = own_fleet.file.parent
    rows = [
        f"{name}.{role},{2 * (2 * n + k)},float32,%,{low},{high}"
        for n, name in enumerate(names)
        for k, (role, low, high) in enumerate((("OP", 0, 50), ("PV", 0, 100)))
    ]
    (folder / "map.csv").write_text("\n".join(["tag,address,type,unit,low,high", *rows]) + "\n")
    (folder / "site.toml").write_text(SITE + "".join(LOOP.format(name) for name in names))
    return folder / "site.toml"


class Links(HTMLParser):
    """Everything in a page that would be fetched."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag not in ("script", "link", "iframe", "img")
        for name, value in attrs:
            assert not name.startswith("on")
            if name in ("src", "href", "xlink:href") and value:
                self.found.append(value)


@pytest.mark.slow
def test_the_page_stands_alone_and_has_a_page_for_each_sick_loop(
    site: Path, tmp_path: Path
) -> None:
    out = tmp_path / "list.html"
    result = run("report", site, "--out", out)
    assert result.exit_code == 0, result.output
    assert "10 loops" in result.stdout
    page = out.read_text("utf-8")
    links = Links()
    links.feed(page)
    assert all(link.startswith("#") for link in links.found)
    assert "Mill &lt;3&gt;" in page
    assert "<3>" not in page
    # Pictures: growing, steady, repaired, uncertain, manual, disturbed.
    assert page.count('<svg role="img" aria-label="OP, estimated stem') == 6
    assert "before</th>" in page
    assert "What would determine it" in page


def test_the_span_of_op_is_that_of_the_register_map(site: Path) -> None:
    of_site = json.loads(run("report", site, "--json").stdout)["loops"]
    of_store = json.loads(run("report", site.with_name("history.sqlite"), "--json").stdout)["loops"]
    bands = {row["tag"]: row["stick_band"] for row in of_store}
    for row in of_site:
        if row["stick_band"] is not None:
            assert row["stick_band"] == pytest.approx(2.0 * bands[row["tag"]])
        assert row["limit"] == 2.5
    assert not any("span" in remark for row in of_site for remark in row["remarks"])


def test_room_beyond_0_to_100_percent_is_no_part_of_the_span(site: Path) -> None:
    of_store = json.loads(run("report", site.with_name("history.sqlite"), "--json").stdout)["loops"]
    bands = {row["tag"]: row["stick_band"] for row in of_store}
    map_file = site.with_name("map.csv")
    head, *rows = map_file.read_text("utf-8").splitlines()
    wider = [re.sub(r"(OP,\d+,\w+),.*", r"\1,%,-5,105", row) for row in rows]
    assert wider != rows
    map_file.write_text("\n".join([head, *wider]) + "\n", "utf-8")
    for row in json.loads(run("report", site, "--json").stdout)["loops"]:
        assert row["stick_band"] == pytest.approx(bands[row["tag"]])


def test_json_csv_and_excel_say_the_same(fleet: Fleet, tmp_path: Path) -> None:
    document = json.loads(run("report", fleet.file, "--json").stdout)
    assert set(document) == {"title", "made", "loops"}
    assert all(tuple(row) == COLUMNS for row in document["loops"])
    text = run("report", fleet.file, "--format", "csv").stdout
    table = list(csv.DictReader(io.StringIO(text)))
    assert [row["tag"] for row in table] == [row["tag"] for row in document["loops"]]
    for row, plain in zip(table, document["loops"], strict=True):
        value = plain["stick_band"]
        assert row["stick_band"] == ("" if value is None else str(value))
        assert row["needs_outage"] == ("yes" if plain["needs_outage"] else "no")
    out = tmp_path / "list.xlsx"
    assert run("report", fleet.file, "--out", out).exit_code == 0
    sheet = load_workbook(out).active
    assert sheet is not None
    rows = list(sheet.iter_rows(values_only=True))
    assert rows[0] == COLUMNS
    assert [row[1] for row in rows[1:]] == [row["tag"] for row in table]


def test_no_text_from_outside_becomes_a_formula(own_fleet: Fleet, tmp_path: Path) -> None:
    record_work(own_fleet.url, "FC101", "open", note="=HYPERLINK(1)", owner="+Meyer")
    text = run("report", own_fleet.file, "--format", "csv").stdout
    row = next(row for row in csv.DictReader(io.StringIO(text)) if row["tag"] == "FC101")
    assert (row["note"], row["owner"]) == ("'=HYPERLINK(1)", "'+Meyer")
    out = tmp_path / "list.xlsx"
    run("report", own_fleet.file, "--out", out)
    sheet = load_workbook(out).active
    assert sheet is not None
    assert all(cell.data_type != "f" for row in sheet.iter_rows() for cell in row)


def test_paper_has_the_list_first_and_a_page_for_each_sick_loop(
    fleet: Fleet, tmp_path: Path
) -> None:
    out = tmp_path / "list.pdf"
    assert run("report", fleet.file, "--for", "technician", "--out", out).exit_code == 0
    pages = PdfReader(out).pages
    first = pages[0].extract_text()
    assert "Which valve is repaired" in first
    for tag in ("FC101", "FC104", "FC106"):
        assert tag in first
    assert "FC107" not in first
    assert len(pages) == 1 + 6
    assert all(len(page.images) == 1 for page in pages[1:])
    assert "check the packing, the positioner and the air supply" in pages[1].extract_text()


def test_letters_that_the_fonts_of_paper_lack_are_told_by_number(tmp_path: Path) -> None:
    """Of a tag in Chinese nothing was left."""
    recording = tmp_path / "泵 1.csv"
    recording.write_bytes((ROOT / "site_configs" / "FC202.csv").read_bytes())
    out = tmp_path / "list.pdf"
    assert run("report", recording, "--out", out).exit_code == 0
    first = PdfReader(out).pages[0].extract_text()
    assert "[U+6CF5] 1 valve sticks" in first
    assert "the HTML report shows it" in first


@pytest.mark.parametrize(
    ("audience", "listed", "evidence"),
    [("technician", 6, 6), ("engineer", 10, 10), ("manager", 6, 0)],
)
def test_each_reader_gets_a_list_of_its_own(
    fleet: Fleet, tmp_path: Path, audience: str, listed: int, evidence: int
) -> None:
    out = tmp_path / "list.html"
    assert run("report", fleet.file, "--for", audience, "--out", out).exit_code == 0
    page = out.read_text("utf-8")
    assert len(re.findall(r'<td class="tag">', page)) == listed
    assert ("Avoidable: share of" in page) == (audience != "technician")
    assert ("Travel and reversals are" in page) == (audience == "engineer")
    assert page.count('<section class="evidence') == evidence


def test_a_recording_whose_name_is_not_utf8_is_a_row(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"W\xe4rme")
    folder.mkdir()
    for name, cells in ((b"R\xfcck.csv", "40,50\n"), (b"\xe4.csv", "zwei,1\n")):
        (folder / os.fsdecode(name)).write_text("op,pv\n" + 60 * cells)
    out = tmp_path / "list.html"
    run("report", folder, "--out", out)
    page = out.read_text("utf-8")
    assert r"R\xfcck" in page
    assert r"\xe4" in page


def test_op_from_0_to_1_is_a_share_of_its_span(tmp_path: Path) -> None:
    op, pv = limit_cycle()
    rows = [f"{(50 + u) / 100:.8f},{y:.6f}" for u, y in zip(op, pv, strict=True)]
    (tmp_path / "FC7.csv").write_text("\n".join(["op,pv", *rows]) + "\n")
    (loop,) = json.loads(run("report", tmp_path, "--json").stdout)["loops"]
    assert loop["stick_band"] == pytest.approx(4.0, rel=0.02)
    assert loop["travel_per_day"] > 100.0
    (given,) = json.loads(run("report", tmp_path, "--json", "--op-span", "100").stdout)["loops"]
    assert given["stick_band"] == pytest.approx(0.04, rel=0.02)


def test_how_far_noise_moves_a_valve_is_told_by_the_span_that_was_given(tmp_path: Path) -> None:
    # OP in mA: noise moves it by 0.8 % of 4 to 20, and by 0.13 % of 0 to 100
    loop = run_loop(noise=1.0)
    columns = zip(4.0 + 0.16 * loop.op, loop.pv, loop.sp, strict=True)
    rows = [f"{op:.6f},{pv:.6f},{sp:.6f}" for op, pv, sp in columns]
    (tmp_path / "FC8.csv").write_text("\n".join(["op,pv,sp", *rows]) + "\n")
    causes = {}
    for more in ((), ("--op-span", "16")):
        (row,) = json.loads(run("report", tmp_path, "--json", *more).stdout)["loops"]
        causes[more] = row["wrong"]
    assert causes[("--op-span", "16")] == "sensor"
    assert causes[()] != "sensor"


def test_recordings_are_judged_and_listed_and_a_report_that_was_ended_goes_on(
    tmp_path: Path,
) -> None:
    op, pv = limit_cycle()
    rows = [f"{u:.6f},{y:.6f}" for u, y in zip(op, pv, strict=True)]
    (tmp_path / "FC7.csv").write_text("\n".join(["FC7.OUT,FC7.PV", *rows]) + "\n")
    still = "op,pv\n" + "".join(f"40,{50 + k % 7}\n" for k in range(200))
    (tmp_path / "FC8.csv").write_text(still)
    (tmp_path / "FC9.csv").write_text("op,pv\n1,zwei\n" + "1,2\n" * 60)
    result = run("report", tmp_path, "--json")
    first, second, third = json.loads(result.stdout)["loops"]
    assert (first["tag"], first["wrong"]) == ("FC7", "sticky_valve")
    assert first["stick_band"] == pytest.approx(4.0, rel=0.02)
    assert first["reversals_per_day"] > 0.0
    # OP stands still: the diagnosis takes the loop for one in manual
    assert (second["tag"], second["wrong"]) == ("FC8", "manual")
    assert (third["tag"], third["wrong"], third["confidence"]) == ("FC9", "unreadable", None)
    assert third["action"] == "correct_recording"
    assert "'zwei' is not a number" in third["would_determine"][0]

    out = tmp_path / "list.html"

    def end_early(_name: str, done: int, _all: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    partial = PartialReport(out)
    with pytest.raises(KeyboardInterrupt):
        judge_recordings(sorted(tmp_path.glob("*.csv")), progress=end_early, partial=partial)
    partial.close()
    assert not out.exists()
    with (tmp_path / "list.html.partial").open("a") as file:
        file.write('{"recording": "cut o')
    again = run("report", tmp_path, "--json", "--out", out)
    assert "going on with an earlier run: 2 loops are judged" in again.stderr
    assert json.loads(again.stdout)["loops"] == [first, second, third]
    assert [path.name for path in tmp_path.glob("list*")] == ["list.html"]
    partial.keep(tmp_path / "FC7.csv", None, {"problem": "old"})
    partial.close()
    (tmp_path / "FC7.csv").touch()
    assert PartialReport(out).find(tmp_path / "FC7.csv", None) is None


def test_loops_of_one_file_are_rows_and_a_report_that_was_ended_goes_on(tmp_path: Path) -> None:
    op, pv = limit_cycle()
    still = [f"40,{50 + k % 7},1" for k in range(op.size)]
    rows = [f"{u:.6f},{y:.6f},{rest}" for u, y, rest in zip(op, pv, still, strict=True)]
    wide = tmp_path / "mill.csv"
    header = "FC7.OP,FC7.PV,FC8.OP,FC8.PV,FC9.OP,FC9.PV"
    wide.write_text("\n".join([header, *(f"{row},x" for row in rows)]) + "\n")
    loops = json.loads(run("report", wide, "--json").stdout)["loops"]
    found = [(loop["tag"], loop["wrong"]) for loop in loops]
    assert found == [("FC7", "sticky_valve"), ("FC8", "manual"), ("FC9", "unreadable")]
    assert "'x' is not a number" in loops[2]["would_determine"][0]

    def end_early(_name: str, _done: int, _all: int) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "list.html"
    partial = PartialReport(out)
    with pytest.raises(KeyboardInterrupt):
        judge_recordings([wide], progress=end_early, partial=partial)
    partial.close()
    again = run("report", wide, "--json", "--out", out)
    assert "going on with an earlier run: 1 loop is judged" in again.stderr
    assert json.loads(again.stdout)["loops"] == loops

    (tmp_path / "FC8.csv").write_text(f"op,pv\n{chr(10).join(row[:-2] for row in still)}\n")
    both = judge_recordings([wide, tmp_path / "FC8.csv"])
    assert {loop.row.tag for loop in both} == {"FC7", "FC8", "mill/FC8", "FC9"}
    (renamed,) = (loop.row for loop in both if loop.row.tag == "mill/FC8")
    assert "FC8 is in more than one file: this one is called mill/FC8" in renamed.remarks


def test_a_recorded_mode_counts_as_in_a_diagnosis_and_a_packed_file_has_a_row(
    tmp_path: Path,
) -> None:
    op, pv = limit_cycle()
    rows = [f"{u:.6f},{y:.6f},{int(k < 50)}" for k, (u, y) in enumerate(zip(op, pv, strict=True))]
    (tmp_path / "FC7.csv").write_text("\n".join(["op,pv,auto", *rows]) + "\n")
    (tmp_path / "FC8.csv.gz").write_bytes(gzip.compress(b"op,pv\n"))
    (tmp_path / "._FC7.csv").write_text("attributes")
    loops = json.loads(run("report", tmp_path, "--json").stdout)["loops"]
    assert {loop["tag"]: loop["wrong"] for loop in loops} == {
        "FC7": "manual",
        "FC8.csv": "unreadable",
    }


def test_of_a_long_recording_the_newest_part_is_judged_and_the_page_says_so(tmp_path: Path) -> None:
    rows = "".join(f"40,{50 + k % 7}\n" for k in range(20_100))
    (tmp_path / "FC7.csv").write_text("op,pv\n" + rows)
    (row,) = json.loads(run("report", tmp_path / "FC7.csv", "--json").stdout)["loops"]
    assert "the newest 20000 of 20100 samples are judged" in " ".join(row["remarks"])


def test_a_line_for_a_file_name_is_the_screen(
    fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    there = run("report", fleet.file, "--format", "csv", "--out", "-").stdout
    assert there == run("report", fleet.file, "--format", "csv").stdout
    assert there.startswith("rank,tag,")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("nowhere.toml",), "check the path"),
        (("nowhere.sqlite",), "run the daemon first"),
        (("nowhere.csv",), "check the path"),
        (("{fleet}", "--out", "list.docx"), "end it in .html"),
        (("{fleet}", "--out", "nowhere/list.html"), "folder that exists"),
        (("{fleet}", "--format", "csv", "--out", "list.xlsx"), "or end the name in .csv"),
        (("{fleet}", "--out", "-"), "add --format csv or --json"),
        (("{fleet}", "other.csv"), "name it alone"),
    ],
)
def test_bad_input_is_one_sentence(
    fleet: Fleet,
    arguments: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [argument.format(fleet=fleet.file) for argument in arguments]
    result = run("report", *given)
    text = result.output
    if result.exit_code != 2:
        assert isinstance(result.exception, FieldlinkError)
        text = str(result.exception)
    assert said in " ".join(text.replace("│", " ").split())
    assert not list(tmp_path.glob("**/*.part"))


def test_a_historian_without_estimates_says_what_to_do_next(tmp_path: Path) -> None:
    file = tmp_path / "empty.sqlite"
    open_for_writing(f"sqlite:///{file}", EventRecord(0, "daemon.start", "daemon", "")).dispose()
    out = tmp_path / "list.html"
    assert run("report", file, "--out", out).exit_code == 0
    assert "fieldlink status" in out.read_text("utf-8")


def test_work_is_set_shown_and_reported(site: Path) -> None:
    plan = ("--state", "planned", "--owner", "Meyer", "--note", "next stop")
    assert run("work", site, "FC102", *plan).exit_code == 0
    assert run("work", site, "FC102", "--note", "parts are here").exit_code == 0
    said = json.loads(run("work", site, "FC102", "--json").stdout)
    assert [(row["state"], row["owner"], row["note"]) for row in said] == [
        ("planned", "Meyer", "next stop"),
        ("planned", "Meyer", "parts are here"),
    ]
    assert run("work", site, "FC101").stdout.startswith("nothing is recorded yet")
    rows = json.loads(run("report", site, "--json").stdout)["loops"]
    row = next(row for row in rows if row["tag"] == "FC102")
    assert (row["state"], row["owner"], row["note"]) == ("planned", "Meyer", "parts are here")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("FC1O2", "--state", "done"), "did you mean 'FC102'?"),
        (("--state", "done"), "name the loop"),
        (("FC102", "--state", "done", "--at", "2999-01-01"), "in the future"),
        (("FC102", "--at", "yesterday", "--note", "x"), "2026-11-21"),
    ],
)
def test_work_that_cannot_be_is_refused(site: Path, arguments: tuple[str, ...], said: str) -> None:
    result = run("work", site, *arguments)
    assert result.exit_code == 2
    assert said in " ".join(result.output.replace("│", " ").split())


@pytest.mark.parametrize("hours", [150 / 3600, 2.5, 60.0, 24.0 * 75])
def test_the_course_of_the_first_hours_has_its_times(tmp_path: Path, hours: float) -> None:
    """No step of whole seconds, minutes or hours suits two to three of the next unit."""
    store = f"sqlite:///{tmp_path / 'history.sqlite'}"
    historian = Historian(store)
    historian.start(EventRecord(1, "start", "daemon", "started"))
    for at in (1_795_000_000_000 + round(part * hours * 3.6e6) for part in (0.0, 0.4, 1.0)):
        historian.put(
            EstimateRecord(
                "FC101", at, at, 0, 9, "estimated", "", "stiction", stick_band=4.0,
                stick_band_low=3.0, stick_band_high=5.0, confidence=0.9,
                document={"confidence": 0.9, "verdict": "not_assessable", "period_s": 1.0},
            )
        )  # fmt: skip
    historian.stop()
    (loop,) = list_loops(store)
    # A warning is an error here; on a terminal it stood above the report.
    assert "stick band S" in EvidencePictures().svg(loop, 1)


def test_files_that_cannot_be_used_are_counted_apart(tmp_path: Path) -> None:
    op, pv = limit_cycle()
    rows = [f"{u:.6f},{y:.6f}" for u, y in zip(op, pv, strict=True)]
    (tmp_path / "FC7.csv").write_text("\n".join(["op,pv", *rows]) + "\n")
    (tmp_path / "empty.csv").touch()
    (tmp_path / "other.csv").write_text("a,b\n" + "1,2\n" * 60)
    result = run("report", tmp_path, "--out", tmp_path / "list.html")
    assert result.stdout.splitlines()[:4] == [
        "3 loops: 3 are on the work list, 0 with nothing to do.",
        "1 valve sticks, 0 of them over the limit; 1 action needs an outage.",
        "2 recordings cannot be used; the reasons are in their rows.",
        "Work: 3 open.",
    ]
    page = (tmp_path / "list.html").read_text()
    assert "is empty; give a header and rows of data" in page
    assert "record what would determine" not in page
