"""Refuse expressions that a reader has to read twice.

    python -m tools.words

Every Python file, document, template and structured text of the repository is searched; each find
is a line with what to write instead. Add a pair when a review finds one more.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

__all__ = ["INSTEAD", "finds_in", "main"]

INSTEAD: Mapping[str, str] = {
    r"do(es)? not bear": "say what is not supported",
    r"is said": "say what the program does: logs, prints, reports, refuses",
    r"is told to about": "is found to, is known to",
    r"is no (number|part of|state)": "is not a number, is not part of, is not a state",
    r"nobody (has|is there)": "say what is missing: no terminal, an unused unit id",
    r"whoever": "name the reader, the caller, the process",
    r"what became of": "the outcome of, the counts of",
    r"hardly less|far sooner": "give the figures",
    r"cannot be had": "is not available, is in use",
    r"beg[iau]ns? anew": "starts again",
    r"do(es)? not care": "is not affected",
    r"at the begin": "at the start",
    r"likes? no better": "costs at least as much",
    r"its way is not known": "its direction is not known",
    r'help="(of|that|than)': "name the thing: samples of a window, not: of a window",
}
"""By pattern (case ignored, whole words), what to write."""

SUFFIXES = (".py", ".md", ".html", ".st", ".toml", ".txt", ".yml")
_PATTERNS = {re.compile(rf"\b(?:{p})\b", re.IGNORECASE): text for p, text in INSTEAD.items()}


def finds_in(text: str) -> Iterator[tuple[int, str, str]]:
    """Give the line, the words and the advice of every expression in a text."""
    # An expression may be broken over two lines of a docstring or comment.
    joined = re.sub(r"\n(\s*#)?\s*", lambda gap: " " * len(gap[0]), text)
    for pattern, advice in _PATTERNS.items():
        loose = re.compile(pattern.pattern.replace(" ", r"\s+"), re.IGNORECASE)
        for found in loose.finditer(joined):
            yield text.count("\n", 0, found.start()) + 1, " ".join(found[0].split()), advice


def main() -> int:
    """Print every find; exit status 1 when there is any."""
    listed = subprocess.run(["git", "ls-files"], check=True, capture_output=True, text=True)
    own = {"tools/words.py", "tests/docs/test_words.py"}
    count = 0
    for name in listed.stdout.splitlines():
        path = Path(name)
        if name in own or path.suffix not in SUFFIXES or not path.is_file():
            continue
        for line, words, advice in finds_in(path.read_text(encoding="utf-8")):
            print(f"{name}:{line}: {words!r}: {advice}", file=sys.stderr)
            count += 1
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
