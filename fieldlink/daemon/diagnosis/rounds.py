"""A round: every full window is diagnosed, groups are looked for, and the findings follow.

Windows are copied when the round begins, so that loops are compared over the same hours, and
diagnosed one after another, so that one worker at most is kept from the windows of the write-back.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fieldlink.daemon.diagnosis.counts import FindingsReport
from fieldlink.daemon.diagnosis.window_diagnosis import (
    DiagnosisRequest,
    diagnose_window,
    group_windows,
)
from fieldlink.daemon.estimation.answers import Worker
from fieldlink.daemon.estimation.estimating import Estimate, EstimateOutcome
from fieldlink.daemon.reporting.journal import Journal
from fieldlink.daemon.sampling.device import DeviceRunner
from fieldlink.daemon.windows.window import WindowData
from fieldlink.findings import Ledger, ObservedGroup, ObservedLoop, Repair, Round
from fieldlink.links import Clock
from fieldlink.site import Site
from fieldlink.site.findings import FindingsTable
from fieldlink.store import (
    REPAIR_KINDS,
    DiagnosisRecord,
    FindingRecord,
    Record,
    StoreError,
    last_events,
    open_findings,
)

__all__ = ["DiagnosisRounds"]

NEW_SHARE = 0.5
"""Share of a window that must be new since the loop's last diagnosis: two windows that share more
are one piece of evidence, and a finding is confirmed by a second one."""

_Groups = tuple[ObservedGroup, ...] | None


@dataclass(frozen=True, slots=True)
class _Seen:
    """What a round has by now, by loop."""

    loops: dict[str, ObservedLoop]
    packed: dict[str, bytes]


class DiagnosisRounds:
    """Diagnoses the loops of a site again and again.

    Args:
        runners: gives the devices that run now.
        put: takes records for the store; must not block.
        journal: takes events.
        clock: gives the time of day.
        url: the historian with what was found before; None where nothing is stored.
    """

    def __init__(
        self,
        runners: Callable[[], Mapping[str, DeviceRunner]],
        put: Callable[[Record], object],
        journal: Journal,
        clock: Clock,
        url: str | None,
    ) -> None:
        self._runners, self._put, self._journal, self._clock = runners, put, journal, clock
        self._url = url
        self._ledger = Ledger()
        self._diagnosed_to: dict[str, int] = {}
        self._causes: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._rounds = 0
        self._ending = asyncio.Event()

    def report(self) -> FindingsReport:
        """Return the counts and the open findings."""
        return FindingsReport(
            self._rounds, dict(self._counts), self._ledger.open, dict(self._causes)
        )

    def stop(self) -> None:
        """Let a round that is under way end after the window that is being diagnosed."""
        self._ending.set()

    async def resume(self) -> None:
        """Go on with the findings that an earlier process left open."""
        if self._url is None:
            return
        try:
            self._ledger = Ledger(await asyncio.to_thread(open_findings, self._url))
        except StoreError as error:
            self._journal.event(
                "finding.past_unknown",
                "daemon",
                f"{error}; what was open before is seen as new",
                bad=True,
            )

    async def run(self, current: Callable[[], Site], worker: Worker) -> None:
        """Make one round; returns without one while there is nothing new to look at.

        Args:
            current: gives the site, which may change while the round is under way.
            worker: diagnoses.
        """
        self._follow_names()
        requests = self._requests()
        if self._ending.is_set():
            return
        if not requests:
            self._forget_loops_that_left(current())
            return
        repairs = await self._repairs()
        seen = _Seen({}, {})
        for request in requests:
            if self._ending.is_set():
                return
            await self._diagnose(request, worker, seen)
        groups = await self._groups(seen.packed, worker)
        if groups is None or self._ending.is_set():
            return
        site = current()
        table = site.file.findings
        if not table.enabled:
            return
        self._ledger.set_rules(confirm_after=table.confirm_after, close_after=table.close_after)
        now = Round(
            utc_ms=round(1000.0 * self._clock.utc()),
            loops={name: loop for name, loop in seen.loops.items() if name in site.loops},
            known=frozenset(site.loops),
            groups=groups,
            repairs=repairs,
        )
        for row in self._ledger.advance(now):
            self._tell(row)
        self._rounds += 1

    def _forget_loops_that_left(self, site: Site) -> None:
        """Close what is about loops that the site no longer has, while nothing is diagnosed."""
        if all(name in site.loops for found in self._ledger.open for name in found.loops):
            return
        now_ms = round(1000.0 * self._clock.utc())
        for row in self._ledger.advance(Round(now_ms, {}, frozenset(site.loops), (), {})):
            self._tell(row)

    def switch_off(self) -> None:
        """Close what is open: nobody looks any more whether it is still so."""
        now_ms = round(1000.0 * self._clock.utc())
        for row in self._ledger.close_all(now_ms, "the site file switches the diagnosis off"):
            self._tell(row)

    def interval(self, table: FindingsTable) -> float:
        """Return the seconds of the clock between two rounds."""
        fastest = max((runner.speed for runner in self._runners().values()), default=1.0)
        return table.every / fastest

    def _follow_names(self) -> None:
        """Let what is known of loops that the site file has renamed go on under the new names."""
        loops = [loop for runner in self._runners().values() for loop in runner.loops.values()]
        renamed = {former: loop.name for loop in loops if (former := loop.take_former_name())}
        for former, name in renamed.items():
            if (slot := self._diagnosed_to.pop(former, None)) is not None:
                self._diagnosed_to[name] = slot
            if (cause := self._causes.pop(former, None)) is not None:
                self._causes[name] = cause
        for row in self._ledger.rename(round(1000.0 * self._clock.utc()), renamed):
            self._tell(row)

    def _requests(self) -> list[DiagnosisRequest]:
        now = self._clock.utc()
        found = []
        for runner in self._runners().values():
            for name, loop in runner.loops.items():
                window = loop.pipeline.full_window()
                if window is None or not self._is_new(name, window.last_slot, window.op.size):
                    continue
                period = loop.spec.loop.period
                length = period * (window.op.size - 1) / runner.speed
                found.append(
                    DiagnosisRequest(
                        loop=name,
                        window=window,
                        period=period,
                        ended_s=(window.end_utc - now) * runner.speed,
                        begin_ms=round(1000.0 * (window.end_utc - length)),
                        compensated=loop.writer is not None and loop.writer.may_compensate,
                        valve_is_healthy=_is_judged_healthy(loop.newest_estimate, window),
                        op_span=loop.spec.op_span,
                    )
                )
        return found

    def _is_new(self, loop: str, last_slot: int, size: int) -> bool:
        """Whether enough of a loop's window came after its last diagnosis."""
        before = self._diagnosed_to.get(loop)
        # slots that are numbered again begin below
        return before is None or last_slot < before or last_slot - before >= NEW_SHARE * size

    async def _diagnose(self, request: DiagnosisRequest, worker: Worker, found: _Seen) -> None:
        answer = await worker.call(diagnose_window, request)
        self._diagnosed_to[request.loop] = request.window.last_slot
        outcome, message, result = answer.outcome, answer.message, answer.value
        if isinstance(result, str):
            outcome, message, result = EstimateOutcome.REFUSED, result, None
        self._counts[outcome.code] += 1
        end_ms = round(1000.0 * request.window.end_utc)
        record = DiagnosisRecord(
            loop=request.loop,
            utc_ms=round(1000.0 * self._clock.utc()),
            window_begin_ms=request.begin_ms,
            window_end_ms=end_ms,
            outcome=outcome.code,
            compensated=request.compensated,
            message=message,
        )
        if result is None:
            self._put(record)
            if outcome is not EstimateOutcome.REFUSED:
                self._journal.event(
                    "diagnosis.failed", request.loop, f"{message}; {outcome.advice}", bad=True
                )
            return
        loop = ObservedLoop.of_document(
            result.document,
            request.begin_ms,
            end_ms,
            compensated=request.compensated,
            manual_since_ms=_manual_since(request, result.document),
        )
        first = loop.causes[0]
        self._put(
            replace(
                record,
                cause=first.name,
                weight=first.weight,
                swing_period_s=loop.swing_period_s,
                document=result.document,
            )
        )
        self._causes[request.loop] = first.name
        found.loops[request.loop] = loop
        found.packed[request.loop] = result.packed

    async def _groups(self, packed: dict[str, bytes], worker: Worker) -> _Groups:
        """Return the groups; None where the worker gave no answer."""
        if len(packed) < 2:
            return ()
        answer = await worker.call(group_windows, packed)
        if answer.value is None:
            self._journal.event(
                "finding.no_groups",
                "daemon",
                f"the groups of this round are not known: {answer.message or answer.outcome.code}; "
                f"{answer.outcome.advice}",
                bad=True,
            )
            return None
        return tuple(
            ObservedGroup(tuple(one["loops"]), float(one["period_s"]), tuple(one["candidates"]))
            for one in answer.value
        )

    async def _repairs(self) -> dict[str, Repair]:
        """Return the newest repair of each loop, from any author."""
        if self._url is None:
            return {}
        try:
            events = await asyncio.to_thread(last_events, self._url, REPAIR_KINDS)
        except StoreError as error:
            self._journal.event(
                "finding.repairs_unknown",
                "daemon",
                f"{error}; repairs are taken into account once it can be read",
                bad=True,
            )
            return {}
        found: dict[str, Repair] = {}
        for event in events:
            before = found.get(event.source)
            if before is None or event.utc_ms > before.utc_ms:
                found[event.source] = Repair(event.utc_ms, event.message)
        return found

    def _tell(self, row: FindingRecord) -> None:
        self._put(row)
        source = row.loop or (row.loops[0] if row.loops else "daemon")
        self._journal.event(f"finding.{row.state}", source, f"{row.finding}: {row.message}")


def _is_judged_healthy(newest: Estimate | None, window: WindowData) -> bool:
    """Whether the estimator found the valve healthy in most of a window: it is judged once."""
    if newest is None or newest.findings is None or newest.last_slot > window.last_slot:
        return False
    new = window.last_slot - newest.last_slot
    found = newest.findings
    return (
        found.verdict == "no_stiction" and not found.uncertain and new < NEW_SHARE * window.op.size
    )


def _manual_since(request: DiagnosisRequest, document: Mapping[str, Any]) -> int | None:
    """When the controller left automatic for good; None where it is in automatic at the end.

    Without a mode it is the end of a window in which OP stood still.
    """
    auto, end_ms = request.window.auto, 1000.0 * request.window.end_utc
    if auto is None:
        is_manual = any(cause["name"] == "manual" for cause in document["causes"])
        return round(end_ms) if is_manual else None
    known = np.flatnonzero(np.isfinite(auto))
    if known.size == 0 or auto[known[-1]] > 0.0:
        return None
    in_automatic = np.flatnonzero(auto > 0.0)
    first = int(in_automatic[-1]) + 1 if in_automatic.size else 0
    share = first / max(1, auto.size - 1)
    return round(request.begin_ms + share * (end_ms - request.begin_ms))
