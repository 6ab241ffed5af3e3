"""Every command of README and docs exists, and those that can run here are run."""

from __future__ import annotations

import contextlib
import csv
import inspect
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldlink.cli.app import app
from tests.docs.pages import PAGES, ROOT, Block, blocks_of, command_blocks
from tests.web.stack import free_port
from tools.command_page import commands_by_name

COMMANDS = commands_by_name()
PROGRAM = Path(sys.executable).with_name("fieldlink")
MARKS = ("background", "status ", "tested: ", "parsed: ")
RUN = [
    page
    for page in PAGES
    if any(b.note[:6] not in ("parsed", "tested") for b in command_blocks(page))
]


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def named_commands(page: Path) -> Iterator[tuple[str, list[str]]]:
    """Give every command of ``fieldlink`` on a page, in a block or in a line of text."""
    for block in command_blocks(page):
        for words in block.commands:
            if words[0].endswith("fieldlink"):
                yield block.place, words[1:]
    for found in re.finditer(r"`fieldlink ([^`]+)`", page.read_text(encoding="utf-8")):
        yield name_of(page), found[1].split()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_and_option_exists(page: Path) -> None:
    for place, words in named_commands(page):
        if words[0].startswith("-") or "|" in words[-1] or "|" in words[0]:
            continue
        known = [n for n in (words[0], " ".join(words[:2])) if n in COMMANDS]
        group = any(name.startswith(f"{words[0]} ") for name in COMMANDS)
        assert known or (group and len(words) < 3), f"{place}: fieldlink {' '.join(words)}"
        command = COMMANDS[known[-1]] if known else None
        for word in words if command else ():
            option = word.split("=")[0].rstrip(".,:;")
            if option.startswith("--") or (option.startswith("-") and option[1:].isalpha()):
                offered = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}
                assert option in {*offered, "--help"}, f"{place}: {option} of {known[-1]}"


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_names_an_exit_status_of_1(name: str) -> None:
    """docs/reference/cli.md promises it for every command that ends with one."""
    command = COMMANDS[name]
    if re.search(r"Exit\(1\b", inspect.getsource(command.callback)):
        told = " ".join(
            [command.help, *(p.help or "" for p in command.params if hasattr(p, "help"))]
        )
        assert re.search(r"status( is)? 1\b", told), name


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_names_its_language(page: Path) -> None:
    """A block without one is neither coloured nor run."""
    fences = [line for line in page.read_text().splitlines() if line.lstrip().startswith("```")]
    assert not [line for line in fences[::2] if line.strip() == "```"]
    assert not [line for line in fences[1::2] if line.strip() != "```"]


def test_every_mark_is_one_of_ours_and_every_test_named_is_there() -> None:
    for block in (block for page in PAGES for block in command_blocks(page)):
        assert not block.note or block.note.startswith(MARKS), block.place
        if block.note.startswith("tested: "):
            assert (ROOT / block.note.removeprefix("tested: ")).is_file(), block.place


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make what pages speak of: recordings, a site with a store, the shipped sites."""
    folder = tmp_path_factory.mktemp("docs")
    for name in ("site_configs", "examples"):
        shutil.copytree(ROOT / name, folder / name)
    recording = folder / "site_configs" / "FC202.csv"
    for name in ("FC101.csv", "hours/FC101.csv", "recordings/FC101.csv", "history/FC101.csv"):
        (folder / name).parent.mkdir(exist_ok=True)
        with recording.open() as source, (folder / name).open("w", newline="") as target:
            csv.writer(target).writerows(list(csv.reader(source))[:401])
    text = (folder / "site_configs" / "lockstep.toml").read_text()
    text = text.replace('"demo.csv"', '"site_configs/demo.csv"').replace('"data-lockstep"', '"."')
    (folder / "site.toml").write_text(text.replace("window = 800", "window = 300"))
    (folder / "backup").mkdir()
    with contextlib.chdir(folder):
        done = CliRunner().invoke(app, ["run", "site.toml", "--duration", "310"])
    assert done.exit_code == 0, done.output
    return folder


@contextlib.contextmanager
def served(words: list[str], folder: Path) -> Iterator[None]:
    """Run a line until the page is done.

    A PLC is ready when it has printed where it listens, a daemon when its PLC has answered.
    """
    ready = "device.good" if words[1] == "run" else "serving "
    command = [str(PROGRAM), *words[1:]]
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert process.stdout is not None
    try:
        assert any(ready in line for line in process.stdout), f"{' '.join(words)} is not ready"
        yield
    finally:
        process.terminate()
        process.communicate(timeout=300)


def run_line(words: list[str], folder: Path) -> tuple[int, str]:
    if words[0] == "python" and words[1].endswith(".py"):
        with contextlib.chdir(folder), pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", words[1:])
            runpy.run_path(words[1], run_name="__main__")
        return 0, ""
    if words[0] == "python":
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, *words[1:]],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout
    with contextlib.chdir(folder):
        result = CliRunner().invoke(app, words[1:])
    return result.exit_code, f"{result.output}{result.stderr}"


def words_of(text: str) -> list[str]:
    """Return the words and figures of a print; lines and blanks are those of the screen."""
    return text.replace("─", "").split()


def rewritten(block: Block, port: int) -> str:
    return block.text.replace("5020", str(port))


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_the_commands_of_a_page_run(page: Path, prepared: Path, tmp_path: Path) -> None:
    folder = tmp_path / "page"
    shutil.copytree(prepared, folder)
    port = free_port()
    for site in (*folder.glob("site_configs/*.toml"),):
        site.write_text(site.read_text().replace("port = 5020", f"port = {port}"))
    output = ""
    with contextlib.ExitStack() as background:
        for block in blocks_of(page):
            if block.note == "printed":
                assert words_of(block.text) == words_of(output), block.place
            if block.note.startswith("file: "):
                (folder / block.note.removeprefix("file: ")).write_text(block.text)
            if block.language != "sh" or block.note.startswith(("parsed", "tested")):
                continue
            wanted = int(block.note.removeprefix("status ")) if "status" in block.note else 0
            here = Block(block.page, block.line, "sh", block.note, rewritten(block, port))
            for words in here.commands:
                if block.note == "background":
                    background.enter_context(served(words, folder))
                    continue
                status, output = run_line(words, folder)
                assert status == wanted, f"{block.place}: {' '.join(words)}\n{output}"
