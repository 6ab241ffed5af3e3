"""Files that a command is to write."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import typer

__all__ = ["refuse_folder", "refuse_source", "refuse_to_replace"]


def refuse_folder(out: Path | None, option: str = "--out") -> None:
    """Refuse a folder where a file is to be written.

    Raises:
        typer.BadParameter: ``out`` is a folder.
    """
    if out is not None and os.path.isdir(out):
        raise typer.BadParameter(f"{out} is a folder; name a file", param_hint=option)


def refuse_source(out: Path | None, sources: Iterable[Path], option: str = "--out") -> None:
    """Refuse to write over a file that the command reads.

    Args:
        out: the file to write; None where there is none.
        sources: what is read; names of files that do not exist are passed over.
        option: that names ``out``.

    Raises:
        typer.BadParameter: ``out`` is one of the sources, by another name perhaps, or a folder.
    """
    refuse_folder(out, option)
    if out is None or not os.path.isfile(out):
        return
    if any(os.path.exists(source) and os.path.samefile(source, out) for source in sources):
        raise typer.BadParameter(
            f"{out} is read by this command and would be lost; name another file",
            param_hint=option,
        )


def refuse_to_replace(out: Path | None, *, force: bool, option: str = "--out") -> None:
    """Refuse to replace a file, whose content may be somebody's work, without ``force``.

    Raises:
        typer.BadParameter: ``out`` is a file that exists, or a folder.
    """
    refuse_folder(out, option)
    if out is not None and not force and os.path.isfile(out):
        raise typer.BadParameter(
            f"{out} exists; choose another name, or replace it with --force", param_hint=option
        )
