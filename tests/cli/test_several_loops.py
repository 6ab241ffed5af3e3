"""Files of several loops at the command line: the same as a file for each of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldlink import diagnosing
from fieldlink.cli.app import app
from fieldlink.diagnosing import Columns, loops_in, read
from tests.closed_loop import Loop, run
from tests.docs.pages import keys_of

ROWS = 1000
SHORT = 300
NAMES = ("FC101", "LC7", "TC9")


@pytest.fixture(scope="module")
def hours() -> dict[str, Loop]:
    """A sticky valve, a loop that it moves, and one apart."""
    source = run(band=6.0, jump=4.0, seed=1)
    moved = run(load=1.5 * (source.op - source.op.mean()), lag=20.0, seed=2)
    return dict(zip(NAMES, (source, moved, run(seed=3)), strict=True))


def rows_of(
    hours: dict[str, Loop], names: Sequence[str] = NAMES, rows: int = ROWS
) -> Iterator[tuple[str, str]]:
    """A row of each moment, of which a few are missing: its time, and OP, PV, SP of each loop."""
    for k in range(rows):
        if k not in (200, 201):
            cells = [
                f"{signal[k]:.4f}"
                for name in names
                for signal in (hours[name].op, hours[name].pv, hours[name].sp)
            ]
            yield f"2026-03-04 10:{k // 60:02d}:{k % 60:02d}", ",".join(cells)


def side_by_side(hours: dict[str, Loop], names: Sequence[str] = NAMES, rows: int = ROWS) -> str:
    tags = [f"{name}.{role}" for name in names for role in ("OP", "PV", "SP")]
    quality = [f"{name}.PV.Quality" for name in names]
    lines = [",".join(["Timestamp", *tags, *quality])]
    for k, (time, cells) in enumerate(rows_of(hours, names, rows)):
        good = ["Bad" if k == 50 and name == "LC7" else "Good" for name in names]
        lines.append(",".join([time, cells, *good]))
    return "\n".join(lines) + "\n"


def by_column(hours: dict[str, Loop]) -> str:
    lines = ["loop,time,op,pv,sp,pv_quality"]
    for name in NAMES:
        for k, (time, cells) in enumerate(rows_of(hours, [name])):
            good = "Bad" if k == 50 and name == "LC7" else "Good"
            lines.append(f"{name},{time},{cells},{good}")
    return "\n".join(lines) + "\n"


def row_a_value(hours: dict[str, Loop]) -> str:
    lines = ["Time,Tag,Value,Quality"]
    for k, (time, cells) in enumerate(rows_of(hours)):
        tags = [f"{name}.{role}" for name in NAMES for role in ("OP", "PV", "SP")]
        for tag, cell in zip(tags, cells.split(","), strict=True):
            lines.append(f"{time},{tag},{cell},{'Bad' if (k, tag) == (50, 'LC7.PV') else 'Good'}")
    return "\n".join(lines) + "\n"


def answer(*arguments: str | Path, status: int = 0) -> dict[str, Any]:
    result = CliRunner().invoke(app, ["diagnose", *map(str, arguments), "--json"])
    assert result.exit_code == status, result.output
    document: dict[str, Any] = json.loads(result.stdout)
    return document


def refused(*arguments: str | Path) -> str:
    result = CliRunner().invoke(app, list(map(str, arguments)))
    assert result.exit_code != 0, result.output
    return " ".join(f"{result.output} {result.exception}".split())


@pytest.mark.parametrize("form", [side_by_side, by_column, row_a_value])
def test_every_form_holds_the_loops_of_single_files(
    form: Callable[[dict[str, Loop]], str], hours: dict[str, Loop], tmp_path: Path
) -> None:
    path = tmp_path / "plant.csv"
    path.write_text(form(hours))
    loops = loops_in(path, Columns())
    assert tuple(loops) == NAMES
    for name in NAMES:
        alone = tmp_path / f"{name}.csv"
        alone.write_text(side_by_side(hours, [name]))
        expected, found = read(alone, Columns()), loops[name]()
        assert (found.period, found.start) == (expected.period, expected.start)
        for role in ("op", "pv", "sp"):
            np.testing.assert_array_equal(getattr(found, role), getattr(expected, role))
    bad = np.flatnonzero(np.isnan(loops["LC7"]().pv)).tolist()
    # a bad quality, and two missing rows
    assert bad == [50, 200, 201]


def test_loops_side_by_side_are_grouped(hours: dict[str, Loop], tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(side_by_side(hours, NAMES[:2]))
    found = answer(path)
    assert set(found) == keys_of("docs/diagnosis.md", "key of several")
    assert list(found["loops"]) == ["FC101", "LC7"]
    assert [group["loops"] for group in found["groups"]] == [["FC101", "LC7"]]
    assert found["groups"][0]["candidates"][0]["loop"] == "FC101"
    assert found["refused"] == {}


def test_one_loop_of_several_is_named(hours: dict[str, Loop], tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(side_by_side(hours, rows=SHORT))
    found = answer(path, "--loop", "tc9")
    assert set(found) == keys_of("docs/diagnosis.md", "key of one loop")
    assert "no loop of that name; did you mean 'TC9'?" in refused("diagnose", path, "--loop", "TC8")
    assert "names a loop of one recording" in refused("diagnose", tmp_path, "--loop", "TC9")


def test_identify_says_which_loops_there_are_and_takes_one(
    hours: dict[str, Loop], tmp_path: Path
) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(side_by_side(hours, rows=SHORT))
    said = refused("identify", path)
    assert "holds 3 loops side by side: 'FC101', 'LC7', 'TC9'; name one with --loop 'FC101'" in said
    result = CliRunner().invoke(app, ["identify", str(path), "--loop", "FC101", "--json"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["stick_band"]["value"] == pytest.approx(6.0, rel=0.1)


def test_a_folder_of_both_kinds_and_names_that_stand_twice(
    hours: dict[str, Loop], tmp_path: Path
) -> None:
    (tmp_path / "TC9.csv").write_text(side_by_side(hours, ["TC9"], SHORT))
    (tmp_path / "mill.csv").write_text(side_by_side(hours, ["FC101", "TC9"], SHORT))
    (tmp_path / "broken.csv").write_text("A.OP,A.PV,B.OP,B.PV\n" + "1,2,3,x\n2,1,3,4\n" * 40)
    found = answer(tmp_path, status=1)
    assert set(found["loops"]) == {"TC9", "FC101", "mill/TC9", "A"}
    assert "'x' is not a number" in found["refused"]["B"]
    assert "TC9 is in more than one file: called mill/TC9." in found["notes"]
    assert any(
        "mill/TC9 has the OP and PV of TC9" in note or "TC9 has the OP and PV of mill/TC9" in note
        for note in found["notes"]
    )


def test_many_loops_of_one_file_go_to_workers_and_stay_in_its_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # threads begin at once, processes after seconds
    monkeypatch.setattr(diagnosing, "_workers", lambda: ThreadPoolExecutor(2))
    names = ["FC5", "FC4", "FC3", "FC2", "FC1"]
    path = tmp_path / "wide.csv"
    lines = [",".join(f"{name}.{role}" for name in names for role in ("OP", "PV"))]
    for k in range(60):
        cells = [f"{40 + k % (3 + n)},{50 + k % (4 + n)}" for n in range(len(names))]
        cells[2] = f"x,{k}"
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n")
    found = answer(path, status=1)
    assert list(found["loops"]) == ["FC5", "FC4", "FC2", "FC1"]
    assert list(found["refused"]) == ["FC3"]
