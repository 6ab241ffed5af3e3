"""The page of the estimator's settings, written from their docstrings.

    python -m benchmarks.settings_page [--out docs]

Each class of `estimator.settings` is a section; each entry of its docstring's ``Attributes`` is a
row with the value that is shipped. A field without an entry is an error.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from benchmarks.report import table
from estimator.settings import SETTINGS

__all__ = ["entries_of", "main", "page"]

_HEAD = """# Settings of the estimator

Every number of the estimator that somebody chose, with its unit, its reason and its source.
No constant was chosen by recorded loops: where the source is "tuning family", the number was
chosen on the simulated loops of `benchmarks.families.tuning`, and the estimator is judged on
others (`benchmarks.families.report`). There are {count} of them. A nat is
one unit of the natural logarithm of a likelihood.

`identify(op, pv, settings=...)` takes other values; this page is written by
`python -m benchmarks.settings_page --out docs` from `estimator/settings.py`."""


def entries_of(settings: object) -> Iterator[tuple[tuple[str, ...], str]]:
    """Names and text of every entry of a settings class's docstring, in order.

    An entry explains one field or several (``lanes, rounds: ...``); a second one may follow on the
    same line after a semicolon.

    Raises:
        ValueError: a field has no entry.
    """
    known = {field.name for field in fields(settings)}  # type: ignore[arg-type]
    _, _, listed = inspect.cleandoc(type(settings).__doc__ or "").partition("Attributes:")
    text = " ".join(listed.split())
    start = re.compile(r"(?:^|(?<=[.;]) )((?:\w+)(?:, \w+)*): ")
    heads = [m for m in start.finditer(text) if set(m.group(1).split(", ")) <= known]
    ends = [m.start() for m in heads[1:]] + [len(text)]
    found = [
        (tuple(m.group(1).split(", ")), text[m.end() : end].rstrip(" ;."))
        for m, end in zip(heads, ends, strict=True)
    ]
    missing = known - {name for names, _ in found for name in names}
    if missing:
        raise ValueError(
            f"{type(settings).__name__} has no sentence for {', '.join(sorted(missing))}: "
            f"add one to its docstring"
        )
    yield from found


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(_shown(part) for part in value)
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)


def page() -> str:
    """The page in Markdown."""
    parts, count = [], 0
    for group in fields(SETTINGS):
        settings = getattr(SETTINGS, group.name)
        count += len(fields(settings))
        summary = inspect.cleandoc(type(settings).__doc__ or "").partition("\n\nAttributes:")[0]
        rows = [
            (
                ", ".join(f"`{name}`" for name in names),
                "; ".join(_shown(getattr(settings, name)) for name in names),
                meaning,
            )
            for names, meaning in entries_of(settings)
        ]
        parts += [f"## `{group.name}`", summary, table(("setting", "value", "meaning"), rows)]
    return "\n\n".join([_HEAD.format(count=count), *parts]).replace("``", "`") + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the page, or write it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="folder for settings.md")
    options = parser.parse_args(arguments)
    if options.out is None:
        print(page(), end="")
    else:
        (options.out / "settings.md").write_text(page())
    return 0


if __name__ == "__main__":
    sys.exit(main())
