"""Files that commands write: whole or not at all, and never over what is read."""

from __future__ import annotations

import errno
import os
import shutil
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from fieldlink.assess.errors import AssessError
from fieldlink.assess.table_files import write_tables
from fieldlink.cli.app import app
from fieldlink.unfinished_file import created, write_whole
from tests.cli.conftest import Run

ROOT = Path(__file__).parents[2]
RECORDING = ROOT / "site_configs" / "FC202.csv"


def run(*arguments: str, blocks: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command, with files of at most ``blocks`` KiB."""
    program = [sys.executable, "-m", "fieldlink", *arguments]
    if blocks is not None:
        # SIGXFSZ is ignored, so that writing fails as on a full disk.
        limit = f"trap '' XFSZ; ulimit -f {blocks}; exec \"$@\""
        program = ["bash", "-c", limit, "bash", *program]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "200", "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(program, capture_output=True, text=True, env=env, timeout=200)


def test_a_picture_that_does_not_fit_leaves_the_one_before(tmp_path: Path) -> None:
    picture = tmp_path / "loop.png"
    picture.write_bytes(b"the one before")
    done = run("identify", str(RECORDING), "--window", "0:100", "--plot", str(picture), blocks=4)
    assert done.returncode == 2
    assert "the picture cannot be written (File too large); check the folder" in done.stderr
    assert picture.read_bytes() == b"the one before"
    assert os.listdir(tmp_path) == ["loop.png"]


def test_a_new_file_that_does_not_fit_is_not_in_the_way(tmp_path: Path) -> None:
    rows = "".join(f"FC{n}.PV,{2 * n},float32,{'long ' * 20}\n" for n in range(100))
    vendor = tmp_path / "vendor.csv"
    vendor.write_text(f"tag,address,type,comment\n{rows}")
    done = run("map", "import", str(vendor), "--out", str(tmp_path / "map.csv"), blocks=4)
    assert done.returncode == 2
    assert "map.csv: cannot be written (File too large)" in done.stderr
    done = run("fmu", "new", "my_tank", "--output", str(tmp_path), blocks=1)
    assert done.returncode == 2
    assert "my_tank.c: it cannot be written (File too large)" in done.stderr
    assert os.listdir(tmp_path) == ["vendor.csv"]


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_does_not_fit_is_one_sentence(unbuffered: str) -> None:
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": unbuffered}
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "fieldlink.cli", "schema"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=env,
        )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "the output cannot be written completely (No space left on device)" in line


@pytest.mark.parametrize("linked", [False, True])
def test_what_is_read_is_not_written_over(
    fieldlink: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, linked: bool
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    recording = tmp_path / "FC202.csv"
    shutil.copy(RECORDING, recording)
    out = tmp_path / "out.csv" if linked else recording
    if linked:
        out.symlink_to(recording)
    before = recording.read_bytes()
    for command in (
        ("report", str(tmp_path if linked else recording)),
        ("map", "import", str(recording)),
        ("fmu", "run", "flow", "--inputs", str(recording)),
    ):
        done = fieldlink(*command, "--out", out)
        assert done.returncode == 2, command
        assert "is read by this command and would be lost" in " ".join(done.stderr.split())
    assert recording.read_bytes() == before


def test_a_file_is_replaced_with_its_permissions_and_through_its_link(tmp_path: Path) -> None:
    file, link = tmp_path / "map.csv", tmp_path / "link.csv"
    file.write_text("before")
    file.chmod(0o640)
    link.symlink_to(file)
    write_whole(link, b"after")
    assert link.is_symlink()
    assert file.read_text() == "after"
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert sorted(os.listdir(tmp_path)) == ["link.csv", "map.csv"]


def test_a_pipe_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
        write_whole(pipe, b"the report")
        assert reader.communicate(timeout=20)[0] == b"the report"
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_a_name_of_the_greatest_length_can_be_written(tmp_path: Path) -> None:
    file = tmp_path / ("x" * 251 + ".csv")
    write_whole(file, b"after")
    assert os.listdir(tmp_path) == [file.name]


def test_nothing_is_left_of_a_new_file_after_an_error(tmp_path: Path) -> None:
    file = tmp_path / "site.toml"

    def fail() -> None:
        with created(file) as stream:
            stream.write("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not file.exists()
    file.write_text("a person's")
    with pytest.raises(FileExistsError), created(file):
        pass
    assert file.read_text() == "a person's"


def test_the_tables_of_an_assessment_are_whole_or_leave_nothing(tmp_path: Path) -> None:
    class Full:
        def ranked_rows(self) -> Iterator[list[Any]]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            yield

    (tmp_path / "loops.csv").write_text("the one before")
    with pytest.raises(AssessError, match=r"cannot be written \(No space left on device\); check"):
        write_tables(Full(), tmp_path)  # type: ignore[arg-type]
    assert os.listdir(tmp_path) == ["loops.csv"]
    assert (tmp_path / "loops.csv").read_text() == "the one before"


@pytest.mark.parametrize("folder", [".", "old"])
@pytest.mark.parametrize(
    "command",
    [
        ("report", "FC202.csv", "--out"),
        ("map", "import", "vendor.csv", "--out"),
        ("map", "export", "site.toml", "--out"),
        ("backup", "site.toml"),
        ("export", "site.toml", "--out"),
        ("support-bundle", "--out"),
        ("fmu", "run", "example1", "--stop", "1", "--out"),
        ("fmu", "run", "example1", "--stop", "1", "--save-state"),
        ("fmu", "sweep", "example1", "--set", "stick_band=4", "--out"),
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_a_folder_is_no_file_to_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...], folder: str
) -> None:
    (tmp_path / "old").mkdir()
    for name in ("FC202.csv", "demo.toml", "demo.csv"):
        shutil.copy(ROOT / "site_configs" / name, tmp_path)
    (tmp_path / "demo.toml").rename(tmp_path / "site.toml")
    (tmp_path / "vendor.csv").write_text("name,address,type\nA,0,float\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    before = sorted(os.listdir(tmp_path))
    done = CliRunner().invoke(app, [*command, folder])
    assert done.exit_code == 2
    assert isinstance(done.exception, SystemExit)
    assert f"{folder} is a folder; name a file" in done.stderr
    assert sorted(os.listdir(tmp_path)) == before
    assert os.listdir(tmp_path / "old") == []
