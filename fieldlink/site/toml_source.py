"""A TOML file with the line of every key, so that an error can say where it is.

`tomllib` reports no lines, so a light scan of the text finds table headers and the keys at the
beginning of lines. Keys inside an inline table have the line of the key that holds the table.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fieldlink.site.bounded_file import UnreadableFileError, read_bytes
from fieldlink.site.errors import Problem, SiteError

__all__ = ["Key", "TomlSource"]

_PART = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
_PATH = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"^\s*(\[\[?)\s*({_PATH})\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(rf"^\s*({_PATH})\s*=")
_LINE_IN_ERROR = re.compile(r"\s*\(at line (\d+), column \d+\)$|\s*\(at end of document\)$")

_TWICE = re.compile(r"Cannot declare \((.*)\) twice")
_REMEDIES = {
    "Cannot declare": "join the two tables, or remove the line NAME = { ... } that was the first",
    "Cannot overwrite a value": "a key or table is there twice, keep one",
    "Invalid value": 'texts stand in straight "quotes", yes is true and no is false',
    "Expected newline": 'one key a line; texts stand in "quotes", numbers have a point and no unit',
    "Expected ']'": (
        "a name with blanks or with letters other than a to z stands in quotes, such as "
        '[loops."FC 101"]; else close the bracket'
    ),
    "Invalid statement": (
        "a line is [TABLE] or KEY = VALUE, a comment begins with #, and a name with letters other "
        "than a to z stands in quotes"
    ),
    "Unescaped": "write / or \\\\ in its place",
}
"""What people mean by the parser's words, by how these begin."""

Key = tuple[str, ...]

LARGEST = 10
"""Megabytes of a site file: a thousand loops take half of one."""

DEEPEST = 30
"""Levels of tables and arrays: far more than a site file has, far less than a parser's stack."""


class TomlSource:
    """A parsed TOML file.

    Attributes:
        path: the file as given.
        data: its content.
    """

    def __init__(self, path: Path) -> None:
        """Read and parse ``path``.

        Raises:
            SiteError: it cannot be read or is not TOML.
        """
        self.path = path
        text = _read_text(path)
        try:
            self.data: dict[str, Any] = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise SiteError([_syntax_problem(path, text, str(error))]) from error
        except ValueError as error:
            raise SiteError([_too_many_digits(path, text)]) from error
        except RecursionError as error:
            raise SiteError([_too_deep(path)]) from error
        if _depth(self.data) > DEEPEST:
            raise SiteError([_too_deep(path)])
        self._lines = _find_lines(text)

    def line_of(self, key: Sequence[str | int]) -> int | None:
        """Return the line of a key, or of the nearest thing around it that has one."""
        parts = tuple(str(part) for part in key)
        while parts:
            if parts in self._lines:
                return self._lines[parts]
            parts = parts[:-1]
        return None

    def problem(self, key: Sequence[str | int], message: str, remedy: str) -> Problem:
        """Return a problem at ``key`` of this file."""
        dotted = ".".join(str(part) for part in key)
        return Problem(str(self.path), dotted, message, remedy, self.line_of(key))


def _read_text(path: Path) -> str:
    try:
        raw = read_bytes(path, most_megabytes=LARGEST)
    except UnreadableFileError as error:
        raise SiteError([Problem(str(path), "", error.message, error.remedy)]) from error
    if raw.startswith(b"SQLite format 3\0"):
        message = "is a historian, no site file"
        remedy = "give the site file (TOML); report, web and assess read a historian, too"
        raise SiteError([Problem(str(path), "", message, remedy)])
    try:
        if b"\0" in raw:
            raise UnicodeDecodeError("utf-8", raw, raw.index(b"\0"), 0, "a zero byte")
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"is not UTF-8 text (byte {error.start})"
        raise SiteError(
            [Problem(str(path), "", message, "save it as a UTF-8 text file")]
        ) from error


def _depth(data: object) -> int:
    """Return how deep tables and arrays lie in each other, without recursion."""
    depth, level = 0, [data]
    while level:
        inner: list[object] = []
        for item in level:
            if isinstance(item, dict):
                inner.extend(item.values())
            elif isinstance(item, list):
                inner.extend(item)
        level = [item for item in inner if isinstance(item, dict | list)]
        depth += 1
    return depth


def _too_deep(path: Path) -> Problem:
    message = f"its tables or arrays lie more than {DEEPEST} deep in each other"
    return Problem(str(path), "", message, "no key of a site file needs more than six")


def _too_many_digits(path: Path, text: str) -> Problem:
    """Name the line of a whole number that is longer than Python takes."""
    most = sys.get_int_max_str_digits()
    digits = re.compile(rf"\d(?:_?\d){{{most},}}")
    line = next((i for i, row in enumerate(text.splitlines(), 1) if digits.search(row)), None)
    message = f"a number has more than {most} digits"
    return Problem(str(path), "", message, "no key of a site file needs more than ten", line)


def _syntax_problem(path: Path, text: str, message: str) -> Problem:
    found = _LINE_IN_ERROR.search(message)
    line = int(found[1]) if found and found[1] else None
    if found and line is None:
        line = text.count("\n") + 1
    what = _LINE_IN_ERROR.sub("", message)
    remedy = next((said for begin, said in _REMEDIES.items() if what.startswith(begin)), "")
    if twice := _TWICE.fullmatch(what):
        table = ".".join(re.findall(r"'([^']*)'", twice[1]))
        what = f"[{table}] is there already"
    return Problem(str(path), "", f"is not TOML: {what}", remedy or "correct this line", line)


def _find_lines(text: str) -> dict[Key, int]:
    lines: dict[Key, int] = {}
    entries: dict[Key, int] = {}
    table: Key = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _split(header[2])
            if header[1] == "[[":
                entries[table] = entries.get(table, -1) + 1
                table = (*table, str(entries[table]))
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            lines.setdefault((*table, *_split(key[1])), number)
    return lines


def _split(path: str) -> Key:
    """Return the parts of a dotted key as the parser reads them, quotes and escapes resolved."""
    try:
        found: Any = tomllib.loads(f"{path} = 0")
    except tomllib.TOMLDecodeError:
        # The line of a text over several lines only looks like a key.
        return (path,)
    parts = []
    while isinstance(found, dict):
        ((part, found),) = found.items()
        parts.append(part)
    return tuple(parts)
