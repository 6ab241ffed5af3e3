"""The journal of a sweep: a line a run, so that an interrupted sweep goes on where it was."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from .errors import PlantInputError

__all__ = ["SweepJournal"]


class SweepJournal:
    """The runs that are done, in memory and, where there is a file, on disk.

    Args:
        file: of the journal; None keeps it in memory only.
        plan: what decides the runs; a journal of another plan is refused.

    Raises:
        PlantInputError: the file is not a journal, or of another plan.
    """

    def __init__(self, file: Path | None, plan_of_runs: Any) -> None:
        plan = json.dumps(plan_of_runs, sort_keys=True)
        self._head = {"sweep": hashlib.sha256(plan.encode()).hexdigest(), "plan": json.loads(plan)}
        self._file = file
        self.rows: dict[int, dict[str, Any]] = {}
        if file is None:
            return
        if file.exists():
            self._read(file)
        else:
            file.write_text(json.dumps(self._head) + "\n", encoding="ascii")

    def _read(self, file: Path) -> None:
        lines = file.read_bytes().split(b"\n")
        try:
            head = json.loads(lines[0])
            known = head["sweep"]
        except (ValueError, KeyError, TypeError) as error:
            raise PlantInputError(
                f"{file}: this file is not the journal of a sweep; name another"
            ) from error
        if known != self._head["sweep"]:
            raise PlantInputError(
                f"{file}: it is the journal of another sweep, or of another build of the FMU; name "
                "another file, or remove it to start again"
            )
        whole = len(lines[0]) + 1
        for line in lines[1:-1]:  # the last has no end of line: empty, or cut short
            row = json.loads(line)
            self.rows[row["number"]] = row
            whole += len(line) + 1
        if lines[-1]:
            os.truncate(file, whole)

    def add(self, row: dict[str, Any]) -> None:
        """Keep a run that is done."""
        self.rows[row["number"]] = row
        if self._file is not None:
            with self._file.open("a", encoding="ascii") as stream:
                stream.write(json.dumps(row) + "\n")

    def take(self, number: int) -> dict[str, Any]:
        """Return the row of a run; its signals are let go of here."""
        row = self.rows[number]
        self.rows[number] = {"number": number}
        return row
