"""The pages of README and docs, and the command blocks in them.

What stands behind the language of a block says how it is tested:

    ```sh                       every line is run, in a folder that has what the page speaks of
    ```sh background            the line runs until the page is done
    ```sh status 1              the lines end with this exit status
    ```sh tested: PATH          the test named runs it
    ```sh parsed: REASON        it cannot run here; commands and options must exist
    ```toml file: NAME          the block is the content of this file
    ```text printed             the block is what the command before it prints, to the last figure
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md"))
    if path.parent.name != "benchmarks"
)
_FENCE = re.compile(r"^( *)```(\w+) ?([^\n]*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)


@dataclass(frozen=True, slots=True)
class Block:
    """A fenced block: where it stands, its language, the note behind it, its text."""

    page: Path
    line: int
    language: str
    note: str
    text: str

    @property
    def place(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def commands(self) -> list[list[str]]:
        """The words of every line, continued lines joined, comments left out."""
        joined = self.text.replace("\\\n", " ")
        lines = (shlex.split(line, comments=True) for line in joined.splitlines())
        return [words for words in lines if words]


def blocks_of(page: Path) -> Iterator[Block]:
    text = page.read_text(encoding="utf-8")
    for found in _FENCE.finditer(text):
        line = text.count("\n", 0, found.start()) + 1
        yield Block(page, line, found[2], found[3].strip(), found[4])


def command_blocks(page: Path) -> list[Block]:
    return [block for block in blocks_of(page) if block.language in ("sh", "console")]


def keys_of(page: str, heading: str) -> set[str]:
    """The names in the first cells of the table whose header begins with ``heading``."""
    text = (ROOT / page).read_text(encoding="utf-8")
    rows = text.split(f"| {heading} | meaning |")[1].split("\n\n")[0].splitlines()[2:]
    return {name for row in rows for name in re.findall(r"`(\w+)`", row.split(" | ")[0])}
