"""How benchmarks print and keep their results: a Markdown table and JSON."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["heading", "keep", "machine", "table"]


def table(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A Markdown table; floats are given to three significant digits."""

    def cell(value: Any) -> str:
        if isinstance(value, float):
            return "" if np.isnan(value) else f"{value:.3g}"
        return str(value)

    cells = [[cell(value) for value in row] for row in (header, *rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    lines = [
        "| " + " | ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)) + " |"
        for row in cells
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


_FOLDERS = ("--out", "--images", "--data", "--beside", "--so-far")


def heading(module: str, about: str | None, arguments: Sequence[str] | None) -> str:
    """The head of a report in Markdown: title and text of the module's docstring, command, machine.

    ``arguments`` are those of the command line, None for the process's own; folders are left out.
    """
    title, _, body = (about or module).strip().partition("\n")
    given = list(sys.argv[1:] if arguments is None else arguments)
    shown = [
        word
        for i, word in enumerate(given)
        if word not in _FOLDERS and (i == 0 or given[i - 1] not in _FOLDERS)
    ]
    command = " ".join(["python -m benchmarks." + module, *shown])
    m = machine()
    on = f"{m['machine']}, {m['cores']} cores, Python {m['python']}, NumPy {m['numpy']}"
    # The first paragraph may be indented code: only empty lines are taken away.
    text = body.strip("\n")
    return f"# {title.rstrip('.')}\n\n{text}\n\nThis run: `{command}` ({on})."


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
        "cores": os.cpu_count(),
    }


def _plain(value: Any) -> Any:
    """The same for JSON, which has no NaN and no infinity: null; NumPy's scalars as Python's."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def keep(folder: Path | None, name: str, text: str, figures: Mapping[str, Any]) -> None:
    """Write ``name.md`` and ``name.json`` into ``folder``; nothing when it is None.

    A figure that is NaN or infinite becomes null.
    """
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.md").write_text(text + "\n")
    (folder / f"{name}.json").write_text(
        json.dumps(_plain(figures), indent=2, allow_nan=False) + "\n"
    )
