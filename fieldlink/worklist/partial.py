"""Recordings that were judged before a report was finished: a file beside the report to come.

A report of many recordings takes minutes to hours. Each result is on disk as soon as it is there,
so the same command goes on where an earlier one was ended. A line is one result with the path, the
size and the time of change of its recording; a line that was cut off is left out.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import IO, Any

from fieldlink.worklist.errors import ReportError

__all__ = ["PartialReport"]

_ENDING = ".partial"


class PartialReport:
    """Results of one report that is not finished.

    Args:
        report: the file that is to be written.
    """

    def __init__(self, report: Path) -> None:
        self._file = report.with_name(report.name + _ENDING)
        # Another release may judge otherwise.
        self._head = {"fieldlink": metadata.version("fieldlink")}
        self._known = self._read()
        self._open: IO[str] | None = None

    def find(self, recording: Path, period: float | None, *, loop: str = "") -> Any | None:
        """Return what was kept of a loop, None where there is nothing or its file has changed.

        Args:
            recording: the file.
            period: seconds between its rows where they were given.
            loop: name in a file of several, else empty.
        """
        return self._known.get(_key(recording, period, loop))

    def count(self, recording: Path, period: float | None) -> int:
        """Return of how many loops of a file results were kept."""
        begin = _key(recording, period, "")
        return sum(key == begin or key.startswith(f"{begin}\0") for key in self._known)

    def keep(
        self,
        recording: Path,
        period: float | None,
        result: Mapping[str, Any],
        *,
        loop: str = "",
    ) -> None:
        """Put a result on disk, see `find`.

        Raises:
            ReportError: it cannot be written.
        """
        try:
            if self._open is None:
                begin = not self._known
                self._open = self._file.open("w" if begin else "a", encoding="utf-8")
                # After a line that was cut off, the next one starts again.
                self._open.write(json.dumps(self._head) + "\n" if begin else "\n")
            line = {"recording": _key(recording, period, loop), "result": result}
            self._open.write(json.dumps(line) + "\n")
            self._open.flush()
            os.fsync(self._open.fileno())
        except OSError as error:
            raise ReportError(
                f"{self._file} cannot be written: {error.strerror or error}; name another --out"
            ) from error

    def close(self) -> None:
        """Let go of the file; it stays for the next run."""
        if self._open is not None:
            self._open.close()
            self._open = None

    def remove(self) -> None:
        """Remove the file: the report is written."""
        self.close()
        self._file.unlink(missing_ok=True)

    def _read(self) -> dict[str, Any]:
        try:
            lines = self._file.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError):
            return {}
        if not lines or _parse(lines[0]) != self._head:
            return {}
        found = (_parse(line) for line in lines[1:])
        return {line["recording"]: line["result"] for line in found if "recording" in line}


def _parse(line: str) -> dict[str, Any]:
    """Return what a line holds; nothing where it was cut off."""
    try:
        parsed = json.loads(line)
    except ValueError:
        return {}
    return parsed if isinstance(parsed, dict) else {}


def _key(recording: Path, period: float | None, loop: str) -> str:
    own = f"\0{loop}" if loop else ""
    try:
        state = recording.stat()
    except OSError:
        return f"{recording.absolute()}\0absent{own}"
    return f"{recording.absolute()}\0{state.st_size}\0{state.st_mtime_ns}\0{period}{own}"
