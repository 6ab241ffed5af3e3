"""``fieldlink diagnose`` as a user meets it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from estimator.diagnosis.sources import Candidate
from fieldlink.cli.app import app
from fieldlink.cli.diagnose import print_plant
from fieldlink.diagnosed_plant import Plant
from fieldlink.diagnosis import Cause, CauseName, Diagnosis, Group, diagnose
from tests.cli.conftest import Run
from tests.closed_loop import run
from tests.docs.pages import keys_of


def test_one_file_answers_in_the_contract_s_form(
    fieldlink: Run, recording: Path, tmp_path: Path
) -> None:
    result = fieldlink("diagnose", recording, "--json", "--plot", "loop.png")
    assert result.returncode == 0, result.stderr
    document = json.loads(result.stdout)
    assert set(document) == keys_of("docs/diagnosis.md", "key of one loop")
    assert document["causes"][0]["name"] == "sticky_valve"
    assert (tmp_path / "loop.png").stat().st_size > 10_000


def test_op_alone_and_a_folder(recording: Path, tmp_path: Path) -> None:
    folder = tmp_path / "hours"
    folder.mkdir()
    wave = np.sin(np.arange(900) / 7.0)
    (folder / "ALONE.csv").write_text("op\n" + "\n".join(f"{v:.6f}" for v in wave))
    (folder / "LOOP.csv").write_text(recording.read_text())
    (folder / "BROKEN.csv").write_text("a,b\n1,2\n")
    result = CliRunner().invoke(app, ["diagnose", str(folder), "--json"])
    assert result.exit_code == 1, result.output  # of a recording that cannot be used
    document = json.loads(result.stdout)
    assert set(document) == keys_of("docs/diagnosis.md", "key of several")
    assert set(document["loops"]) == {"ALONE", "LOOP"}
    assert document["loops"]["ALONE"]["oscillation"]["present"] is True
    assert isinstance(document["groups"], list)
    assert "BROKEN" in document["refused"]


def test_a_person_reads_the_cause_and_what_to_do(recording: Path) -> None:
    result = CliRunner().invoke(app, ["diagnose", str(recording)])
    assert "sticky valve" in result.stdout
    assert "packing" in result.stdout
    text = " ".join(result.stdout.split())
    assert "turns within two of its usual moves are left out" in text
    assert "op_travel_per_day" not in text


def test_a_folder_says_what_to_do_and_that_hours_differ(tmp_path: Path) -> None:
    wave = np.sin(np.arange(600) / 7.0)
    for day in (1, 2):
        rows = "\n".join(
            f"2026-03-0{day}T{k // 60:02d}:{k % 60:02d}:00,{value:.6f}"
            for k, value in enumerate(wave)
        )
        rows += "\n2026-03-02T10:00:00,bad" if day == 2 else ""
        (tmp_path / f"FC{day}.csv").write_text(f"time,op\n{rows}\n")
    result = CliRunner().invoke(app, ["diagnose", str(tmp_path)])
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    assert "no two loops share any hours" in text
    assert "no loops were found to swing together" in text
    assert "→ Give PV" in text
    assert "FC2: op: 'bad' in 1 row" in text


def test_how_far_noise_moves_a_valve_is_told_by_the_span_that_was_given(tmp_path: Path) -> None:
    # OP in mA: noise moves it by 0.8 % of 4 to 20, and by 0.13 % of 0 to 100
    loop = run(noise=1.0)
    columns = list(zip(4.0 + 0.16 * loop.op, loop.pv, loop.sp, strict=True))
    one = "\n".join(f"{op:.6f},{pv:.6f},{sp:.6f}" for op, pv, sp in columns)
    (tmp_path / "FC8.csv").write_text(f"op,pv,sp\n{one}\n")
    two = "\n".join(f"{op:.6f},{pv:.6f},{pv:.6f},{op:.6f}" for op, pv, _ in columns)
    (tmp_path / "mill.csv").write_text(f"FC8.OP,FC8.PV,FC9.PV,FC9.OP\n{two}\n")
    folder = tmp_path / "hours"
    folder.mkdir()
    (folder / "FC8.csv").write_text(f"op,pv,sp\n{one}\n")

    def named(path: Path, *more: str) -> str:
        result = CliRunner().invoke(app, ["diagnose", str(path), "--json", *more])
        assert result.exit_code == 0, result.output
        answer = json.loads(result.stdout)
        causes = answer.get("causes") or answer["loops"]["FC8"]["causes"]
        return str(causes[0]["name"])

    assert named(tmp_path / "FC8.csv") != "sensor"
    for path in (tmp_path / "FC8.csv", tmp_path / "mill.csv", folder):
        assert named(path, "--op-span", "16") == "sensor"


def test_an_empty_folder_is_one_sentence(fieldlink: Run, tmp_path: Path) -> None:
    (tmp_path / "none").mkdir()
    result = fieldlink("diagnose", tmp_path / "none")
    assert result.returncode == 2
    assert "holds no recording" in result.stderr


def test_a_recording_that_is_there_twice_is_no_group(
    fieldlink: Run, recording: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "hours"
    folder.mkdir()
    for name in ("FC101", "FC102"):
        (folder / f"{name}.csv").write_bytes(recording.read_bytes())
    answer = CliRunner().invoke(app, ["diagnose", str(folder), "--json"])
    found = json.loads(answer.stdout)
    assert set(found["loops"]) == {"FC101", "FC102"}
    assert found["groups"] == []
    assert any("FC102 has the OP and PV of FC101" in note for note in found["notes"])
    again = fieldlink("diagnose", str(folder), str(folder / "FC101.csv"))
    assert again.returncode != 0
    assert "is given twice; name it once" in again.stderr


def grouped(source: str | None, weight: float) -> Plant:
    """Two loops that swing alike: A, whose valve sticks, and B, which looks tight by itself."""
    loop = run(load=4.0 * np.sin(2.0 * np.pi * np.arange(600) / 50.0), n=600)
    found = diagnose(loop.op, loop.pv, loop.sp, advice=False, figures=False)

    def called(name: CauseName) -> Diagnosis:
        return replace(found, causes=(Cause(name, 0.7, ("its sentence",)),))

    loops = {"A": called(CauseName.STICKY_VALVE), "B": called(CauseName.TIGHT_TUNING)}
    group = Group(("A", "B"), 50.0, (Candidate(source, weight, ("strokes",)),))
    return Plant(loops, (group,), {}, {})


def test_a_loop_that_another_moves_is_not_told_to_be_retuned(
    capsys: pytest.CaptureFixture[str],
) -> None:
    plant = grouped("A", 0.98)
    assert plant.source_of("B") == "A"
    assert plant.source_of("A") is None
    print_plant(plant)
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "it swings with A, the likeliest source (below); by itself: its sentence" in text
    assert "Put A right first, then diagnose this loop again." in text
    assert "Lower the controller's gain" not in text


@pytest.mark.parametrize(("source", "weight"), [(None, 0.9), ("B", 0.9), ("A", 0.4)])
def test_a_loop_keeps_its_own_advice_where_no_other_is_likely_the_source(
    source: str | None, weight: float
) -> None:
    assert grouped(source, weight).source_of("B") is None


def test_a_candidate_without_a_word_for_it_has_those_against_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    plant = grouped("A", 0.98)
    more = Candidate("B", 0.01, (), ("its past tells less",))
    group = replace(plant.groups[0], candidates=(*plant.groups[0].candidates, more))
    print_plant(replace(plant, groups=(group,)))
    assert "or: B (1%): against it: its past tells less" in capsys.readouterr().out
