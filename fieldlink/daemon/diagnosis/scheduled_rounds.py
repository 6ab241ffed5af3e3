"""Rounds of diagnoses at the beat of the site file, while the daemon runs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.daemon.diagnosis.rounds import DiagnosisRounds
from fieldlink.daemon.estimation.judging import WindowJudging
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.schedule import Schedule
from fieldlink.site import Site

__all__ = ["ROUND", "ScheduledRounds"]

ROUND = "diagnoses"


class ScheduledRounds:
    """Lets the loops be diagnosed in the estimator's processes.

    Args:
        rounds: makes one round.
        judging: has the estimator's processes.
        journal: for a round that fails.
        site: gives the site that is in force.
    """

    def __init__(
        self,
        rounds: DiagnosisRounds,
        judging: WindowJudging,
        journal: Journal,
        site: Callable[[], Site],
    ) -> None:
        self._rounds = rounds
        self._judging = judging
        self._journal = journal
        self._site = site
        self._every = 0.0

    def follow(self, schedule: Schedule) -> None:
        """Make rounds as the site file of now says, or none."""
        table = self._site().file.findings
        if not table.enabled:
            self._every = 0.0
            schedule.remove(ROUND)
            self._rounds.switch_off()
        elif (seconds := self._rounds.interval(table)) != self._every:
            self._every = seconds
            schedule.every(seconds, ROUND, self._make)

    async def resume(self) -> None:
        """Go on with the findings that the historian has open."""
        await self._rounds.resume()

    def stop(self) -> None:
        """Begin no more diagnoses."""
        self._rounds.stop()

    def report(self) -> FindingsReport | None:
        """The findings of now; None where the site file switches the diagnosis off."""
        return self._rounds.report() if self._site().file.findings.enabled else None

    async def _make(self) -> None:
        task = asyncio.current_task()
        assert task is not None
        task.set_name(ROUND)
        self._judging.tasks.add(task)
        try:
            await self._rounds.run(self._site, self._judging.pool)
        except Exception as error:  # noqa: BLE001  (told; the rest of the daemon goes on)
            self._journal.defect("daemon", error, "this round of diagnoses is left out")
        finally:
            self._judging.tasks.discard(task)
