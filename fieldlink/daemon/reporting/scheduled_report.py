"""The report that the site file schedules: written by a process of its own, so that no scan waits.

The files that are there tell whether one is due: a daemon that was down at the
hour writes it when it is back, and one that is restarted writes it once. The first report is that
of the first due hour after the daemon's start; before it there is nothing to report.
"""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from fieldlink.daemon.reporting.journal import Journal
from fieldlink.site import Site

__all__ = ["REPORT_LOOK", "ScheduledReport", "due_moment"]

REPORT_LOOK = 600.0
"""Seconds between two looks whether a report is due: an hour is met within its sixth part."""

LONGEST = 600.0
"""Seconds that a report may take: twenty times that of 200 loops; then its process is ended."""

_PROGRAM = (
    "from fieldlink.daemon.estimation.priority import stand_back; stand_back(); "
    "from fieldlink.cli import main; main()"
)
"""``fieldlink``, behind the daemon in the queue for the processor."""

_WEEKDAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")


def due_moment(now: datetime, weekday: str, hour: int) -> datetime:
    """Return the last moment, up to ``now`` (UTC), at which a report was due.

    Args:
        now: with a time zone.
        weekday: its English name in small letters, or daily.
        hour: 0 to 23, UTC.
    """
    due = now.astimezone(UTC).replace(hour=hour, minute=0, second=0, microsecond=0)
    if due > now:
        due -= timedelta(days=1)
    if weekday != "daily":
        due -= timedelta(days=(due.weekday() - _WEEKDAYS.index(weekday)) % 7)
    return due


class ScheduledReport:
    """Writes a site's reports when they are due.

    Args:
        journal: takes what comes of it.
        now: gives the time of day.
        command: the arguments that make a report of a site in a file; ``fieldlink report`` unless
            given.
    """

    def __init__(
        self,
        journal: Journal,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        command: Callable[[Site, Path], list[str]] | None = None,
    ) -> None:
        self._journal = journal
        self._now = now
        self._command = command or _command
        self._since = now()
        self._failed: Path | None = None

    async def write_due(self, site: Site) -> list[Path]:
        """Write what is due and not there; return the new files.

        A report that fails is an event, and is tried again at the next look; the event is not
        repeated for the same file.
        """
        settings = site.report
        if settings.folder is None:
            return []
        now = self._now()
        # a clock that was ahead at the start must not put the first report off until then
        self._since = min(self._since, now)
        due = due_moment(now, settings.weekday, settings.hour)
        folder = site.data_dir / settings.folder
        written = []
        for kind in settings.formats:
            file = folder / f"report-{due:%Y-%m-%d}.{kind}"
            first = not any(folder.glob(f"report-*.{kind}"))
            if file.exists() or (first and due < self._since):
                continue
            problem = await self._write(site, file)
            if problem:
                self._say_failure(file, problem)
                break
            self._failed = None
            self._journal.event("report.written", "daemon", f"{file} is written")
            written.append(file)
        return written

    def _say_failure(self, file: Path, problem: str) -> None:
        if file != self._failed:
            self._failed = file
            self._journal.event("report.failed", "daemon", f"{file}: {problem}", bad=True)

    async def _write(self, site: Site, file: Path) -> str:
        """Run the command; return what is wrong, nothing when all is well."""
        try:
            file.parent.mkdir(mode=0o750, parents=True, exist_ok=True)
            process = await asyncio.create_subprocess_exec(
                *self._command(site, file),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.PIPE,
            )
        except OSError as error:
            return f"cannot be made: {error.strerror or error}; check the folder's permissions"
        try:
            async with asyncio.timeout(LONGEST):
                _, said = await process.communicate()
        except TimeoutError:
            return f"took more than {LONGEST:g} s and was given up; write fewer formats"
        finally:
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()
        if process.returncode == 0:
            return ""
        lines = said.decode("utf-8", "replace").strip().splitlines()
        last = lines[-1].removeprefix("fieldlink: ") if lines else ""
        return last or f"the process ended with status {process.returncode}"


def _command(site: Site, file: Path) -> list[str]:
    return [
        sys.executable, "-c", _PROGRAM, "report", str(site.path),
        "--for", site.report.audience, "--out", str(file),
    ]  # fmt: skip
