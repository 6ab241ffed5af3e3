"""The page of the command line, from the program's own help."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

import typer

from fieldlink.cli.app import app
from fieldlink.cli.examples import EXAMPLES, PANELS
from tools.tables import markdown_table

__all__ = ["command_page", "commands_by_name"]

_HEAD = """# Command line

Every command prints this with `--help`. Exit statuses: 0 for success, 1 where a command found
something wrong or unfinished (its help names it), 2 for an error with one message on stderr.
"""


def commands_by_name() -> dict[str, Any]:
    """Return every command by its words after ``fieldlink``, such as ``fmu run``."""
    return dict(_walk(typer.main.get_command(app), ""))


def _walk(command: Any, name: str) -> Iterator[tuple[str, Any]]:
    inner = getattr(command, "commands", None)
    if inner is None:
        yield name, command
        return
    for word, member in inner.items():
        yield from _walk(member, f"{name} {word}".strip())


def command_page() -> str:
    """Return the page in Markdown."""
    commands = commands_by_name()
    parts = [_HEAD]
    for title, members in PANELS.items():
        parts.append(f"## {title}\n")
        for name, command in commands.items():
            if name.split()[0] in members:
                parts.append(_section(name, command))
    return "\n".join(parts)


def _section(name: str, command: Any) -> str:
    arguments = " ".join(_argument(p) for p in command.params if not p.opts[0].startswith("-"))
    text = "\n\n".join(" ".join(part.split()) for part in command.help.split("\n\n"))
    rows = [(_names(p), _default(p), _help(p)) for p in command.params if p.name != "help"]
    parts = [f"### fieldlink {name}\n", f"`fieldlink {name} {arguments}`".replace(" `", "`") + "\n"]
    parts += [text + "\n"]
    if rows:
        parts.append(markdown_table(("argument or option", "default", "meaning"), rows))
    examples = EXAMPLES.get(name, ())
    if examples:
        lines = "".join(f"fieldlink {line}\n" for line in examples)
        parts.append(f"```sh parsed: examples\n{lines}```\n")
    return "\n".join(parts)


def _argument(param: Any) -> str:
    name = (param.metavar or param.name).upper().removesuffix("...")
    shown = name if param.required else f"[{name}]"
    return f"{shown}..." if param.nargs == -1 else shown


def _names(param: Any) -> str:
    if not param.opts[0].startswith("-"):
        return f"`{(param.metavar or param.name).upper()}`"
    value = f" {param.metavar}" if param.metavar else ""
    return ", ".join(f"`{option}{value}`" for option in (*param.opts, *param.secondary_opts))


def _default(param: Any) -> str:
    value = param.default
    if param.required:
        return "needed"
    if value is None or value is False or value in ("", (), []) or callable(value):
        return ""
    if not getattr(param, "show_default", True):
        return ""
    if isinstance(value, enum.Enum):
        value = value.value
    if isinstance(value, (list, tuple)):
        value = " ".join(str(getattr(item, "value", item)) for item in value)
    return f"`{value}`"


def _help(param: Any) -> str:
    text = " ".join((getattr(param, "help", None) or "").split())
    choices = list(_choices(param))
    if choices:
        text = f"{text} One of {', '.join(f'`{one}`' for one in choices)}.".strip()
    if getattr(param, "multiple", False):
        text += " May be given several times."
    return text


def _choices(param: Any) -> Iterator[str]:
    """The words that an option takes: of click's type, or of the annotation behind it."""
    offered = getattr(getattr(param, "type", None), "choices", None)
    if offered is None:
        annotation = getattr(getattr(param, "type_descriptor", None), "annotation", None)
        offered = list(_words_of(annotation))
    yield from (str(getattr(one, "value", one)) for one in offered)


def _words_of(annotation: Any) -> Iterator[Any]:
    if isinstance(annotation, type) and issubclass(annotation, enum.Enum):
        yield from annotation
    elif get_origin(annotation) is Literal:
        yield from get_args(annotation)
    else:
        for inner in get_args(annotation):
            yield from _words_of(inner)
