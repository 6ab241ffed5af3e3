"""Help that answers "what do I type next", for every command."""

from __future__ import annotations

import shlex

import click
import pytest
import typer
from typer.testing import CliRunner

from fieldlink.cli.app import app
from fieldlink.cli.examples import EXAMPLES

ROOT = typer.main.get_command(app)


def commands() -> dict[str, click.Command]:
    found = {}
    for name, command in ROOT.commands.items():  # type: ignore[attr-defined]
        inner = getattr(command, "commands", None)
        if inner is None:
            found[name] = command
        else:
            found |= {f"{name} {below}": one for below, one in inner.items()}
    return found


COMMANDS = commands()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_help_has_an_example_of_its_command(name: str) -> None:
    shown = CliRunner().invoke(app, [*name.split(), "--help"], env={"COLUMNS": "200"})
    assert shown.exit_code == 0
    assert "Examples" in shown.stdout
    for line in EXAMPLES[name]:
        assert line.startswith(name)
        assert f"fieldlink {line}" in " ".join(shown.stdout.split())


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_can_be_typed(name: str) -> None:
    for line in EXAMPLES[name]:
        typed = shlex.split(line.split(" > ")[0])[len(name.split()) :]
        COMMANDS[name].make_context(name, typed)


def test_brackets_of_a_help_text_are_shown() -> None:
    shown = CliRunner().invoke(app, ["run", "--help"]).stdout
    assert "[web]" in shown


def test_the_first_help_says_what_to_type_next() -> None:
    shown = CliRunner().invoke(app, ["--help"]).stdout
    for step in ("fieldlink demo", "fieldlink scan", "--install-completion", "Judge loops"):
        assert step in shown


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("fieldlink serv", ["service"]),
        ("fieldlink report --for t", ["technician"]),
        ("fieldlink identify --criterion o", ["oe"]),
        ("fieldlink rehearse wrong-", ["wrong-model", "wrong-sign"]),
    ],
)
def test_the_shell_completes_commands_options_and_scenarios(
    typed: str, completed: list[str]
) -> None:
    asked = {"_FIELDLINK_COMPLETE": "complete_bash", "COMP_WORDS": typed}
    asked["COMP_CWORD"] = str(len(typed.split()) - 1)
    shown = CliRunner().invoke(app, [], env=asked, prog_name="fieldlink").stdout
    assert shown.split() == completed
