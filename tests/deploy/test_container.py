"""The container file: what can be checked of it where no container can be built."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import typer

from fieldlink.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
TEXT = re.sub(r"\\\n", " ", (ROOT / "Containerfile").read_text())
LINES = [line.split(maxsplit=1) for line in TEXT.splitlines() if line and line[0].isupper()]
STAGE = LINES[[i for i, (word, _) in enumerate(LINES) if word == "FROM"][-1] :]
"""The instructions of the last stage, which is the image."""


def given(instruction: str) -> list[str]:
    return [rest for word, rest in STAGE if word == instruction]


def test_every_base_is_pinned_to_a_python_that_the_package_supports() -> None:
    bases = [rest for word, rest in LINES if word == "FROM"]
    assert len({base.split()[0] for base in bases}) == 1
    (major, minor) = re.fullmatch(r".*/python:(\d+)\.(\d+)-slim.*", bases[0]).groups()  # type: ignore[union-attr]
    assert (int(major), int(minor)) >= (3, 11)


def test_it_runs_without_root_on_a_volume_of_its_own_with_no_compiler() -> None:
    (user,) = given("USER")
    assert user not in ("root", "0")
    (volume,) = given("VOLUME")
    install = " ".join(given("RUN"))
    assert f"useradd --uid 10001 --gid fieldlink --home-dir {volume}" in install
    assert re.search(rf"install -d -o {user} .* {volume}\b", install)
    assert "gcc" not in install
    assert not given("COPY")[0].startswith(". "), "the image holds the wheel, not the sources"


def test_its_commands_are_commands_of_ours() -> None:
    root = typer.main.get_command(app)
    (entry,) = given("ENTRYPOINT")
    program = json.loads(entry)
    health = json.loads(given("HEALTHCHECK")[0].split("CMD", 1)[1])
    for line in (program + json.loads(given("CMD")[0]), health):
        assert line[0] == "fieldlink"
        assert line[2] == "/site/site.toml"
        command = root.commands[line[1]]  # type: ignore[attr-defined]
        command.make_context(line[1], line[2:])
    (settings,) = given("ENV")
    caches = dict(word.split("=") for word in shlex.split(settings))
    assert caches["NUMBA_CACHE_DIR"].startswith(given("VOLUME")[0])


def test_what_is_not_needed_is_not_sent_to_the_builder() -> None:
    left_out = (ROOT / ".containerignore").read_text().split()
    assert {".git", ".venv", "tests"} <= set(left_out)
    packages = {"fieldlink", "estimator", "compensator", "fmu_models"}
    assert not packages & set(left_out)


def test_the_command_leaves_the_store_its_time_and_starts_again() -> None:
    """Engines kill ten seconds after the signal; the service's unit says how long an end takes."""
    unit = (ROOT / "deploy/systemd/fieldlink@.service").read_text()
    needed = int(re.search(r"^TimeoutStopSec=(\d+)$", unit, re.MULTILINE)[1])  # type: ignore[index]
    page = (ROOT / "docs/operations.md").read_text()
    for text in (re.sub(r"\\\n#", " ", (ROOT / "Containerfile").read_text()), page):
        (command,) = re.findall(r"podman run .*fieldlink$", text, re.MULTILINE)
        words = command.split()
        assert int(words[words.index("--stop-timeout") + 1]) >= needed
        assert words[words.index("--restart") + 1] == "always"
