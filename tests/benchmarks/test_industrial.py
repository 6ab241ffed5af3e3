"""Recorded loops: labels joined to windows, Table 1, and published files from end to end."""

from __future__ import annotations

import json

import pytest
from scipy.io import savemat

from benchmarks.families.tuning import draw
from benchmarks.industrial import main
from benchmarks.recorded import labelled_loops
from benchmarks.table1 import CASES, table_of


def test_shared_windows_carry_label_period_and_index(shared_data):
    plant = labelled_loops(shared_data, "plant")
    assert len(plant) == 36
    assert {w.label for w in plant} == {"stiction", "no_stiction"}
    assert all(w.op.shape == w.pv.shape == w.sp.shape == w.auto.shape for w in plant)
    periods = {w.file: w.period_s for w in plant}
    # 126 samples over 125 minutes, whatever its row of the label table says.
    assert periods.pop("plant_18.csv") == 60.0
    assert set(periods.values()) == {10.0}
    isdb = labelled_loops(shared_data, "isdb")
    assert [w.loop for w in isdb][:3] == ["CHEM1", "CHEM2", "CHEM10"]
    assert all(w.index is None and w.begun is None for w in isdb)


def test_table_1_is_the_papers():
    names = {case.name: case for case in CASES}
    assert set(names) == {"CHEM 10", "CHEM 25", "POW 4"}
    assert names["POW 4"].samples == 1000
    # What the literature says of S for CHEM 10: 1.70 (grid), 1.79 (Lee et al.), 1.85 (K & K).
    bands = {row.method: row.stick_band for row in names["CHEM 10"].published}
    assert bands["paper, grid 0.1"] == pytest.approx(1.70)
    assert bands["Lee et al."] == pytest.approx(1.79)
    assert bands["K & K"] == pytest.approx(1.85)
    assert "1.79" in table_of(names["CHEM 10"], [])


def test_published_files_give_table_1_and_verdicts(tmp_path, capsys):
    sticky = draw("he", True, 0)
    op, pv = sticky.op, sticky.pv
    loop = {"OP": op[:, None], "PV": pv[:, None], "Ts": 1.0, "comments": "made up"}
    isdb = tmp_path / "isdb.mat"
    savemat(
        isdb, {"cdata": {"chemicals": {"loop10": loop}, "power": {"loop9": {"OP": [], "PV": []}}}}
    )
    folder = tmp_path / "sacac"
    folder.mkdir()
    rows = "\r".join(f"x;{p};{u}" for u, p in zip(op, pv, strict=True))
    (folder / "one.csv").write_bytes(f"TIME;pv;Op\r{rows}\r".encode())
    options = ["--data", str(tmp_path / "none"), "--isdb", str(isdb), "--sacac", str(folder)]
    assert main([*options, "--starts", "0", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "industrial.md").read_text() == printed
    assert "CHEM 25: give the published file" in printed
    assert printed.count("| one ") == 1
    assert "not read" in printed
    assert "power.loop9 needs OP and PV" in printed
    table = json.loads((tmp_path / "industrial.json").read_text())["table1"]
    assert set(table) == {"CHEM 10"}
    ours = table["CHEM 10"][0]
    found = ours["static_friction"] + ours["dynamic_friction"]
    assert found == pytest.approx(sticky.stick_band, rel=0.05)


def test_without_any_data_it_says_what_to_give(tmp_path, capsys):
    assert main(["--data", str(tmp_path / "none")]) == 2
    assert "--isdb" in capsys.readouterr().err
