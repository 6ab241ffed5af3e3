"""``fieldlink identify`` as a user meets it."""

from __future__ import annotations

import json
import struct
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.docs.pages import keys_of

NUMBERS = {"value", "low", "high"}


def found(run: Run, *arguments: str | Path) -> dict[str, Any]:
    result = run("identify", *arguments, "--json")
    assert result.returncode == 0, result.stderr
    document: dict[str, Any] = json.loads(result.stdout)
    return document


def test_json_is_the_contract(script: Run, recording: Path) -> None:
    document = found(script, recording)
    assert set(document) == {
        "verdict",
        "reasons",
        "score",
        "stick_band",
        "slip_jump",
        "static_friction",
        "dynamic_friction",
        "confidence",
        "process",
        "fit",
        "criterion",
        "samples",
        "period_s",
        "seconds",
        "uncertain",
        "reason_codes",
        "advice",
        "evidence",
        "identifiability",
        "runners_up",
        "fieldlink_version",
        "units",
    }
    assert set(document) == keys_of("docs/tutorials/recorded-file.md", "key")
    assert document["fieldlink_version"] == version("fieldlink")
    assert (document["units"]["stick_band"], document["units"]["gain"]) == ("OP", "PV/OP")
    assert document["uncertain"] is False
    assert document["evidence"]["log_bayes_factor"] == document["score"]
    assert len(document["advice"]) == len(document["reasons"]) == len(document["reason_codes"])
    for name in ("stick_band", "slip_jump", "static_friction", "dynamic_friction"):
        assert set(document[name]) == NUMBERS
    assert set(document["process"]) == {"structure", "parameters", "dead_time_samples", "gain"}
    assert set(document["fit"]) == {"r2", "r2_healthy_valve"}
    assert document["confidence"] == 0.9
    assert (document["samples"], document["period_s"]) == (600, 1.0)
    # The limit cycle was made with S = 4 and J = 2.
    assert document["verdict"] == "stiction"
    assert document["score"] > 0.0
    assert document["stick_band"]["value"] == pytest.approx(4.0, rel=0.02)
    assert document["static_friction"]["value"] == pytest.approx(
        (document["stick_band"]["value"] + document["slip_jump"]["value"]) / 2
    )
    assert document["process"]["gain"] == pytest.approx(1.0, rel=0.05)


def test_summary_names_verdict_and_numbers(fieldlink: Run, recording: Path) -> None:
    result = fieldlink("identify", recording)
    assert result.returncode == 0, result.stderr
    assert "the valve sticks" in result.stdout
    assert "stick band S" in result.stdout
    assert "a row is taken for a second" in result.stdout


def test_columns_window_and_period_can_be_named(
    fieldlink: Run, tmp_path: Path, recording: Path
) -> None:
    renamed = tmp_path / "renamed.csv"
    renamed.write_text(recording.read_text().replace("op,pv", "CO;Flow", 1).replace(",", ";"))
    arguments = ("--op", "CO", "--pv", "Flow", "--period", "5", "--window", "100:500")
    document = found(fieldlink, renamed, *arguments)
    assert (document["samples"], document["period_s"]) == (400, 5.0)


@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_a_picture_that_cannot_be_written_costs_no_result(
    command: str, fieldlink: Run, tmp_path: Path, recording: Path
) -> None:
    result = fieldlink(command, recording, "--json", "--plot", tmp_path / "not there" / "x.png")
    assert result.returncode == 2
    assert "the picture cannot be written" in result.stderr
    assert json.loads(result.stdout)


def test_plot_is_a_picture(fieldlink: Run, tmp_path: Path, recording: Path) -> None:
    result = fieldlink("identify", recording, "--plot", "out.png")
    assert result.returncode == 0, result.stderr
    data = (tmp_path / "out.png").read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert (width, height) > (800, 500)


@pytest.mark.parametrize(
    ("arguments", "text", "said"),
    [
        (("missing.csv",), None, ("missing.csv", "check the path")),
        (("bad.csv",), "flow,pv\n1,2\n", ("bad.csv", "op", "flow")),
        (("bad.csv",), "op,pv\n1,2\n1,zwei\n" + "1,2\n" * 60, ("bad.csv", "bad.csv:3", "zwei")),
        (("bad.csv",), "op,pv\n" + "1,2\n" * 49, ("bad.csv", "49", "50")),
        (("bad.csv",), "\x00\x01\x02", ("bad.csv",)),
        (("bad.csv", "--plot", "nowhere/x.png"), None, ("nowhere/x.png", "written")),
        (("bad.csv", "--plot", "x.docx"), None, ("x.docx", ".png")),
        (("bad.csv", "--window", "10-90"), None, ("10-90", "START:STOP")),
        (("bad.csv", "--window", "10:9000"), None, ("10:9000", "0:600")),
        (
            ("bad.csv",),
            "op,pv\n" + "1,2\n" * 86_400,
            ("bad.csv: 86400", "20000", "--window 66400:86400", "fieldlink assess bad.csv --out"),
        ),
        (("bad.csv", "--window", ":20001"), "op,pv\n" + "1,2\n" * 30_000, ("--window 1:20001",)),
        (("bad.csv", "--criterion", "best"), None, ("best", "oe")),
        (("bad.csv", "--confidence", "1.5"), None, ("1.5", "confidence")),
    ],
)
def test_bad_input_is_explained(
    fieldlink: Run,
    tmp_path: Path,
    recording: Path,
    arguments: tuple[str, ...],
    text: str | None,
    said: tuple[str, ...],
) -> None:
    (tmp_path / "bad.csv").write_text(recording.read_text() if text is None else text)
    result = fieldlink("identify", *arguments)
    assert result.returncode == 2
    # a picture that cannot be written does not cost the result
    assert (result.stdout == "") is ("--plot" not in arguments)
    assert "Traceback" not in result.stderr
    message = " ".join(result.stderr.replace("│", " ").split())
    for part in said:
        assert part in message


def test_constant_op_is_not_assessable_and_says_why(fieldlink: Run, tmp_path: Path) -> None:
    path = tmp_path / "still.csv"
    path.write_text("op,pv\n" + "".join(f"40,{50 + k % 7}\n" for k in range(200)))
    document = found(fieldlink, path)
    assert document["verdict"] == "not_assessable"
    assert any("OP" in reason for reason in document["reasons"])
    assert document["stick_band"] == {"value": None, "low": None, "high": None}


def test_a_run_of_bad_samples_is_not_assessable(
    fieldlink: Run, tmp_path: Path, recording: Path
) -> None:
    rows = recording.read_text().splitlines()
    gap = [",".join((row.split(",")[0], "")) for row in rows[100:500]]
    path = tmp_path / "gap.csv"
    path.write_text("\n".join([*rows[:100], *gap, *rows[500:]]) + "\n")
    document = found(fieldlink, path)
    assert document["verdict"] == "not_assessable"
    assert any("bad" in reason for reason in document["reasons"])
